"""Health: deployments with and without a fault, judged by the twin and by simple rivals.

    python -m benchmarks.health --vehicle slocum-200 --each 10 --seed 101 --json

For each kind of fault as many deployments with it as without fly in lanes with the errors of preset
`faulty`, on seeds that tuned nothing. A fault counts where its signature, over the noise of the
channels, is at least three standard deviations in some dive; it is noticed where the first alarm
comes within three dives of the first such dive and not before the onset. Rivals see the same
channels: a chart with limits of three standard deviations on roll and depth rates, and one on the
battery's place at the pitch.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from factory.generation.deployments import (
    CHUNK,
    FAULT_KIND,
    FAULT_ONSET,
    LABELS,
    DeploymentPlan,
    dataset_of_logs,
    flown_logs,
)
from factory.generation.executors import local_pool
from factory.sampling.deployment import fault_kinds
from twin.faults.base import fault_from_dict
from twin.health.assessment import DeploymentHealth, assess, dives_of, hypotheses_for, typical
from twin.health.channels import CHANNELS, NAMES
from twin.records.logged import LogStore
from twin.records.store import write_store
from twin.vehicle.vehicle import load_vehicle

SEEN = 3.0
"""Standard deviations of a signature in one dive from which a fault is there to be noticed"""
WITHIN = 3
"""Dives in which it must be"""
NEAR = 2
"""Dives by which the onset may be off"""
CHARTS = {
    "3-sigma chart of roll and depth rate": (
        "roll_dive", "roll_climb", "rate_dive", "rate_climb"
    ),
    "3-sigma chart of the battery's place": ("trim_dive", "trim_climb"),
}  # fmt: skip
LEARNING = 6
"""Dives that a chart's limits are learned from"""
NOISE = np.array([channel.noise for channel in CHANNELS])


def _cases(job: tuple[str, str, str, int, int, float | None]) -> list[dict[str, Any]]:
    """Some deployments of one kind: flown, stored, judged."""
    vehicle_name, preset, kind, first, seed, size = job
    vehicle = load_vehicle(vehicle_name)
    plan = DeploymentPlan(
        vehicle=vehicle, preset=preset, seed=seed, kinds=(kind,), size=size
    )  # fmt: skip
    flown = flown_logs(plan, range(first, first + CHUNK))
    dataset = dataset_of_logs(flown, plan)
    with tempfile.TemporaryDirectory() as folder:
        path = write_store(dataset, Path(folder) / "cases.zarr")
        found = assess(path, vehicle)
        with LogStore(path) as logs:
            contexts = [dives_of(logs, one.name)[1:] for one in found]
    cases = []
    for k, one in enumerate(found):
        truth = str(dataset[FAULT_KIND].values[k])
        onset = float(dataset[FAULT_ONSET].values[k])
        cases.append(_case(one, truth, onset, str(dataset[LABELS].values[k]), contexts[k], vehicle))
    return cases


def _case(
    one: DeploymentHealth, truth: str, onset: float, labels: str, context: Any, vehicle: Any
) -> dict[str, Any]:
    dives, ways = context
    numbers = list(one.dives)
    case: dict[str, Any] = {
        "name": one.name, "truth": truth, "days": one.days, "alarm": one.alarm, "kind": one.kind,
        "evidence": float(one.evidence.max()), "dives": len(numbers),
        "also": list(one.kinds[0].also) if one.kinds else [],
        "charts": {name: _chart(one, channels) for name, channels in CHARTS.items()},
    }  # fmt: skip
    case["alarm_at"] = numbers.index(one.noticed_dive) if one.noticed_dive is not None else None
    case["since_at"] = numbers.index(one.since_dive) if one.since_dive is not None else None
    if truth == "none" or not math.isfinite(onset) or int(onset) not in numbers:
        return case
    fault = fault_from_dict(json.loads(labels))
    begun = numbers.index(int(onset))
    case["onset_at"], case["size"] = begun, fault.size
    signature = _signature(
        fault, hypotheses_for(vehicle, typical(dives, vehicle), ways), len(numbers)
    )
    days = (one.time - one.time[begun]) / 86400.0
    size = abs(fault.size) * (np.maximum(days, 0.0) if fault.grows else 1.0)
    told = np.isfinite(one.values).any(axis=0)
    over = np.linalg.norm(np.nan_to_num(signature)[:, told] / NOISE[told], axis=1) * size
    there = [d for d in range(begun, len(numbers)) if over[d] >= SEEN]
    case["seen_at"] = there[0] if there else None
    return case


def _signature(fault: Any, hypotheses: Sequence[Any], dives: int) -> np.ndarray:
    """Of size 1, in each dive; of the way in which the vehicle has the fault."""
    mine = [h for h in hypotheses if h.kind == fault.kind]
    side = [h for h in mine if getattr(h.fault, "side", None) == getattr(fault, "side", None)]
    return np.broadcast_to((side or mine)[0].signature, (dives, len(NAMES)))


def _chart(one: DeploymentHealth, channels: Sequence[str]) -> int | None:
    """The first dive, as a place, at which a chart is beyond its limits twice in a row."""
    beyond = np.zeros(len(one.values), bool)
    for name in channels:
        values = one.values[:, NAMES.index(name)]
        learned = values[:LEARNING][np.isfinite(values[:LEARNING])]
        if len(learned) < 3:
            continue
        spread = max(float(np.std(learned, ddof=1)), 1e-6)
        beyond |= np.nan_to_num(np.abs(values - learned.mean()) / spread) > 3.0
    twice = np.flatnonzero(beyond[LEARNING:] & np.roll(beyond, 1)[LEARNING:])
    return int(twice[0]) + LEARNING if twice.size else None


def summary(cases: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What the cases show."""
    sound = [c for c in cases if c["truth"] == "none"]
    faulty = [c for c in cases if c["truth"] != "none"]
    days = sum(c["days"] for c in sound) + sum(
        c["days"] * c.get("onset_at", 0) / max(c["dives"], 1) for c in faulty
    )
    early = [c for c in faulty if c["alarm"] and c["alarm_at"] < c.get("onset_at", 0)]
    false = sum(c["alarm"] for c in sound) + len(early)
    kinds = {}
    for kind in dict.fromkeys(c["truth"] for c in faulty):
        mine = [c for c in faulty if c["truth"] == kind]
        seen = [c for c in mine if c.get("seen_at") is not None]
        intime = [c for c in seen if _noticed(c)]
        noticed = [c for c in mine if c["alarm"]]
        kinds[kind] = {
            "deployments": len(mine),
            "to_be_noticed": len(seen),
            "noticed_in_time": len(intime),
            "noticed": len(noticed),
            "named": sum(kind == c["kind"] or kind in c["also"] for c in noticed),
            "onset_within_2": sum(
                c["since_at"] is not None and abs(c["since_at"] - c["onset_at"]) <= NEAR
                for c in noticed if "onset_at" in c
            ),
            "called": _counted(c["kind"] for c in noticed),
        }  # fmt: skip
    rivals = {}
    for name in CHARTS:
        first = [(c, c["charts"][name]) for c in faulty if c.get("seen_at") is not None]
        rivals[name] = {
            "noticed_in_time": sum(
                at is not None and c["onset_at"] <= at <= c["seen_at"] + WITHIN for c, at in first
            ),
            "of": len(first),
            "false_alarms": sum(c["charts"][name] is not None for c in sound),
        }
    total = list(kinds.values())
    return {
        "kinds": kinds,
        "to_be_noticed": sum(k["to_be_noticed"] for k in total),
        "noticed_in_time": sum(k["noticed_in_time"] for k in total),
        "noticed": sum(k["noticed"] for k in total),
        "named": sum(k["named"] for k in total),
        "onset_within_2": sum(k["onset_within_2"] for k in total),
        "sound_days": days,
        "false_alarms": false,
        "false_alarms_in_30_days": 30.0 * false / days if days else math.nan,
        "rivals": rivals,
    }


def _noticed(case: dict[str, Any]) -> bool:
    at = case["alarm_at"]
    return at is not None and case["onset_at"] <= at <= case["seen_at"] + WITHIN


def _counted(words: Iterator[str]) -> dict[str, int]:
    found: dict[str, int] = {}
    for word in words:
        found[word] = found.get(word, 0) + 1
    return found


def run(
    vehicle: str, *, each: int, seed: int, preset: str, kinds: Sequence[str],
    size: float | None, workers: int,
) -> list[dict[str, Any]]:  # fmt: skip
    """Cases of a vehicle, `each` of every kind and as many sound ones."""
    chosen = fault_kinds(load_vehicle(vehicle), tuple(kinds))
    jobs = [
        (vehicle, preset, kind, first, seed + place, size)
        for place, kind in enumerate(chosen)
        for first in range(0, 2 * each, CHUNK)
    ]
    with local_pool(workers) as pool:
        return [case for cases in pool.map(_cases, jobs) for case in cases]


def thresholds(cases: Sequence[dict[str, Any]]) -> list[tuple[float, float]]:
    """[d] of sound vehicles for one false alarm by the level of the evidence."""
    sound = [c for c in cases if c["truth"] == "none"]
    days = sum(c["days"] for c in sound)
    highest = np.sort([c["evidence"] for c in sound])[::-1]
    return [(days / (k + 1), float(level)) for k, level in enumerate(highest)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicle", nargs="+", default=["slocum-200"])
    parser.add_argument("--each", type=int, default=4)
    parser.add_argument("--seed", type=int, default=101)
    parser.add_argument("--preset", default="faulty")
    parser.add_argument("--kinds", nargs="*", default=[])
    parser.add_argument("--size", type=float, default=None, help="of every fault, in its unit")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--thresholds", action="store_true", help="levels by false alarms")
    parser.add_argument("--keep", type=Path, default=None, help="file for the cases as JSON")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    cases = []
    for vehicle in given.vehicle:
        cases += run(
            vehicle, each=given.each, seed=given.seed, preset=given.preset, kinds=given.kinds,
            size=given.size, workers=given.workers,
        )  # fmt: skip
        if given.keep is not None:
            given.keep.write_text(json.dumps(cases))
    if given.thresholds:
        for days, level in thresholds(cases)[:12]:
            print(f"{days:8.1f} d  {level:6.2f}")
    found = summary(cases)
    if given.json:
        print(json.dumps(found, indent=1))
        return
    print(f"{'kind':16} there in time noticed named onset  called")
    for kind, row in found["kinds"].items():
        print(
            f"{kind:16} {row['to_be_noticed']:5} {row['noticed_in_time']:7} {row['noticed']:7} "
            f"{row['named']:5} {row['onset_within_2']:5}  {row['called']}"
        )
    print(
        f"false alarms {found['false_alarms']} in {found['sound_days']:.0f} d: "
        f"{found['false_alarms_in_30_days']:.2f} in 30 d"
    )
    for name, row in found["rivals"].items():
        print(
            f"{name}: in time {row['noticed_in_time']} of {row['of']}, "
            f"false alarms {row['false_alarms']}"
        )


if __name__ == "__main__":
    main()
