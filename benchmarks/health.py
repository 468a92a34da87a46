"""Health: fault detection on simulated deployments, by the twin and by simple rivals.

    python -m benchmarks.health --vehicle slocum-200 --each 8 --sound 16 --seed 201 --keep FILE
    python -m benchmarks.health --judge FILE [FILE ...] [--taught FILE ...]

The first command flies deployments in the batched engine with the errors of preset `faulty`, and
keeps the channels of their dives, a line for each deployment. The second prints how faults were
detected. A fault is detectable from the first dive whose expected signature is three standard
deviations of the channels before it. It is detected in time if the first alarm comes within three
dives of that dive, and not before the onset; an ideal detector says whether it could be. Rivals use
the same channels: charts with limits of three standard deviations, or of one false alarm in 30 days
of the deployments after `--taught`, and a detector trained on these deployments. Tables are printed
in the form of docs/results/health.md.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import json
import math
import sys
import tempfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks import command
from benchmarks.command import markdown
from factory.generation.executors import local_pool
from glider_twin_ops.health.assessment import DeploymentHealth, flown_signatures, judged
from glider_twin_ops.health.channels import NAMES
from glider_twin_ops.health.deployment_dives import told_by
from glider_twin_ops.health.fault_detector import FaultDetector
from glider_twin_ops.health.judgement import RARE, sure, threshold_of
from glider_twin_ops.health.signatures import TypicalDive
from glider_twin_ops.presets.deployment import DeploymentDraw, DeploymentPlan, faulty_of
from glider_twin_ops.presets.deployments import (
    CHUNK,
    FAULT_KIND,
    FAULT_ONSET,
    HEALTHY,
    LABELS,
    NAME,
    dataset_of_logs,
    first_draw,
    flown_logs,
)
from twin.faults.base import FAULTS, fault_from_dict
from twin.records.logged import LogStore
from twin.records.presence import is_store
from twin.records.store import read_zarr, write_store
from twin.vehicle.vehicle import Vehicle, load_vehicle

Array = NDArray[np.float64]
Case = dict[str, Any]

SEEN = 3.0
"""[1] Size of a signature, in standard deviations of a dive, from which a fault is detectable"""
WITHIN = 3
"""Dives within which a detection is in time"""
NEAR = 2
"""Largest error, in dives, of an onset that counts as right"""
RATE = 30.0
"""[d] Time of sound vehicles per false alarm"""
OURS, LEARNED = "twin health", "learned detector"
CHARTS: Mapping[str, tuple[str, ...]] = {
    "chart of roll and depth rate": ("roll_dive", "roll_climb", "rate_dive", "rate_climb"),
    "chart of the battery's place at the pitch": ("trim_dive", "trim_climb"),
}
COUNTED = ("flown", "to be noticed", "could be", "in time", "noticed", "named", "onset")
"""Columns of `counts`"""
LIMIT = 3.0
"""[1] Charts' limits in standard deviations"""
BEFORE = 6
"""Number of first dives that set a chart's limits"""


# --- deployments ----------------------------------------------------------------------------------


def _flown(job: tuple[DeploymentPlan, Sequence[DeploymentDraw], Path | None]) -> list[Case]:
    """Fly some deployments, store them and compute their channels; a kept store is read again."""
    plan, draws, kept = job
    with tempfile.TemporaryDirectory() as folder:
        path = kept or Path(folder) / "cases.zarr"
        if not is_store(path):
            write_store(dataset_of_logs(flown_logs(plan, draws), plan), path)
        dataset = read_zarr(path)
        with LogStore(path) as logs:
            found = [told_by(logs, str(one), plan.vehicle) for one in dataset[NAME].values]
        labels = [dataset[word].values.tolist() for word in (FAULT_KIND, FAULT_ONSET, LABELS)]
    return [
        {
            **one, "values": one["values"].tolist(), "time": one["time"].tolist(),
            "ways": one["ways"].tolist(), "dive": dataclasses.asdict(one["dive"]),
            "changes": one["changes"].tolist(), "wander": one["wander"].tolist(),
            "tests": list(map(bool, one["tests"])), "powered": list(map(bool, one["powered"])),
            "vehicle": plan.vehicle.name, "preset": plan.preset, "truth": truth, "onset": onset,
            "fault": json.loads(fault),
        }
        for one, truth, onset, fault in zip(found, *labels, strict=True)
    ]  # fmt: skip


def _store_name(plan: DeploymentPlan, draws: Sequence[DeploymentDraw]) -> str:
    """Name of the store of some deployments of a plan."""
    which = repr((plan.kinds, plan.size, [draw.number for draw in draws]))
    words = (plan.vehicle.name, plan.preset, plan.seed, f"{zlib.crc32(which.encode()):08x}")
    return "-".join(map(str, words)) + ".zarr"


def fly(
    plan: DeploymentPlan, *, each: int, sound: int, workers: int = 1, stores: Path | None = None
) -> Iterator[Case]:
    """Fly `each` deployments of every fault type of a plan, and `sound` ones; give their channels.

    Args:
      stores: folder that keeps the logs; a log that is there is read instead of flown.
    """
    lacking = dict.fromkeys(plan.kinds, each) | {HEALTHY: sound}
    draws: list[DeploymentDraw] = []
    for index in itertools.count():
        if not any(lacking.values()):
            break
        faulty = sum(lacking.values()) - lacking[HEALTHY]
        if not (faulty if faulty_of(plan.seed, index) else lacking[HEALTHY]):
            continue
        draw = first_draw(plan, index)
        if lacking[draw.kind]:
            lacking[draw.kind] -= 1
            draws.append(draw)
    # a block flies as long as its longest deployment
    draws.sort(key=lambda draw: draw.scenario.run_time())
    blocks = [draws[first : first + CHUNK] for first in range(0, len(draws), CHUNK)]
    jobs = [(plan, block, stores and stores / _store_name(plan, block)) for block in blocks]
    with local_pool(workers) as pool:
        for cases in pool.map(_flown, jobs):
            yield from cases


# --- judged ---------------------------------------------------------------------------------------


class Alarms(NamedTuple):
    """Result of one detector on a deployment."""

    statistic: Array
    """Statistic after each dive, (dives,); above its level there is an alarm"""
    kind: str
    """Fault type that the detector names at the end; empty for none"""
    also: Sequence[str] = ()
    since: int | None = None
    """Index of the dive at which the fault began, by the detector"""
    probability: float = math.nan
    """Probability of the alarm that stands after the last dive; NaN without one"""


class Judged(NamedTuple):
    """Deployment with its true fault and the result of each detector."""

    case: Case
    days: Array
    """[d] Times of the dives since the first, (dives,)"""
    onset: int | None
    seen: int | None
    """Index of the first dive in which the fault is detectable"""
    ideal: int | None
    """Index of the dive of the first alarm of the ideal detector, see `_bound`"""
    alarms: dict[str, Alarms]

    def first(self, name: str, level: float) -> int | None:
        """Index of the dive of a detector's first alarm."""
        over = np.flatnonzero(self.alarms[name].statistic > level)
        return int(over[0]) if over.size else None

    def in_time(self, name: str, level: float) -> bool:
        """True if a detectable fault was detected in time, and not before its onset."""
        at = self.first(name, level)
        if at is None or self.seen is None or self.onset is None:
            return False
        return self.onset <= at <= self.seen + WITHIN

    @property
    def could(self) -> bool:
        """True if the ideal detector detects the fault in time."""
        if self.ideal is None or self.seen is None:
            return False
        return self.ideal <= self.seen + WITHIN


_vehicle = functools.cache(load_vehicle)


def judged_case(case: Case, detector: FaultDetector | None = None) -> Judged:
    """Run every detector on one kept deployment."""
    vehicle, values = _vehicle(case["vehicle"]), np.array(case["values"], float)
    one = judged(
        case["name"], case["numbers"], values, np.array(case["time"]), np.array(case["ways"]),
        TypicalDive(**case["dive"]), vehicle, threshold_of(RATE),
        changes=np.array(case["changes"]), wander=np.array(case["wander"]),
        tests=case["tests"], powered=case["powered"],
    )  # fmt: skip
    alarms = {name: Alarms(_chart(values, channels), "") for name, channels in CHARTS.items()}
    alarms[OURS] = Alarms(sure(one.evidence), "")
    if one.kinds:
        best = one.kinds[0]
        since = None if best.since_dive is None else one.dives.index(best.since_dive)
        standing = one.probability if one.alarm else math.nan
        alarms[OURS] = Alarms(sure(one.evidence), best.kind, best.also, since, standing)
    if detector is not None:
        odds, named = detector.judge(values)
        alarms[LEARNED] = Alarms(odds, named[-1])
    days = (one.time - one.time[0]) / 86400.0
    onset = case["onset"]
    begun = one.dives.index(int(onset)) if math.isfinite(onset) and onset in one.dives else None
    seen, ideal = (None, None) if begun is None else _bound(one, case, begun, vehicle)
    return Judged(case, days, begun, seen, ideal, alarms)


def _bound(
    one: DeploymentHealth, case: Case, begun: int, vehicle: Vehicle
) -> tuple[int | None, int | None]:
    """Indices of the first dive in which a fault can be seen, and of an ideal detector's alarm.

    A fault can be seen in a dive whose channels it changes by more than `SEEN` standard deviations.
    The ideal detector knows kind, size, first dive and signature, and how levels walk and step. Its
    evidence is half the square of the matched filter's output; its alarm has the odds of an alarm
    of `twin health` in two dives in a row.
    """
    fault = fault_from_dict(case["fault"])
    every = flown_signatures(vehicle, TypicalDive(**case["dive"])).in_dives(np.array(case["ways"]))
    mine = [h for h in every if h.kind == fault.kind]
    same = [
        h for h in mine
        if all(getattr(h.fault, name) == getattr(fault, name) for name in fault.choices(vehicle)[0])
    ]  # fmt: skip
    signature = (same or mine)[0].signature
    if (told := fault.expected(np.nan_to_num(np.array(case["ways"])))) is not None:
        signature = np.zeros((len(one.time), len(NAMES)))
        for name, values in told.items():
            signature[:, NAMES.index(name)] = values
    since = (one.time - one.time[begun]) / 86400.0
    size = abs(fault.size) * (np.maximum(since, 0.0) if fault.grows else 1.0)
    sizes = np.broadcast_to(size, since.shape)[:, None]
    shown = sizes * np.broadcast_to(np.nan_to_num(np.atleast_2d(signature)), one.values.shape)
    # a channel shows a fault in dives that have it, beside dives before
    known = np.isfinite(one.values) & np.isfinite(one.values[:begun]).any(axis=0)
    over = np.where(known, shown / np.sqrt(one.levels.expected[begun - 1]), 0.0)
    evidence, answer = np.zeros(len(since)), np.zeros(len(NAMES))
    for d in range(begun, len(since)):
        response = np.where(known[d], shown[d] - answer, 0.0)
        answer = answer + np.nan_to_num(one.levels.gain[d]) * response
        evidence[d] = evidence[d - 1] + 0.5 * (response**2 / one.levels.expected[d]).sum()
    rung = sure(evidence - math.log(RARE * len(every))) > threshold_of(RATE)
    seen, ideal = (
        np.flatnonzero(there[begun:]) + begun
        for there in (np.linalg.norm(over, axis=1) >= SEEN, rung)
    )
    return (int(seen[0]) if seen.size else None), (int(ideal[0]) if ideal.size else None)


def _chart(values: Array, channels: Sequence[str]) -> Array:
    """Smaller distance from a chart's mean in two successive dives, in standard deviations."""
    beyond = np.zeros(len(values))
    for name in channels:
        column = values[:, NAMES.index(name)]
        learned = column[:BEFORE][np.isfinite(column[:BEFORE])]
        if len(learned) >= 3:
            spread = max(float(np.std(learned, ddof=1)), 1e-6)
            off = np.nan_to_num(np.abs(column - learned.mean()) / spread)
            beyond = np.maximum(beyond, np.minimum(off, np.roll(off, 1)))
    beyond[: BEFORE + 1] = 0.0
    return beyond


def learned(cases: Sequence[Case]) -> FaultDetector:
    """Train a detector on kept deployments."""
    onsets = [
        case["numbers"].index(int(case["onset"])) if case["onset"] in case["numbers"] else None
        for case in cases
    ]
    return FaultDetector.fit(
        [np.array(case["values"], float) for case in cases],
        [HEALTHY if onset is None else case["truth"]
         for case, onset in zip(cases, onsets, strict=True)],
        onsets,
    )  # fmt: skip


# --- counted --------------------------------------------------------------------------------------


def sound_days(ones: Sequence[Judged], name: str, level: float) -> tuple[int, float]:
    """Count false alarms, and days of sound vehicles until the first alarm of each deployment.

    The time before a fault is sound; a deployment's count ends at its first alarm.
    """
    alarms, days = 0, 0.0
    for one in ones:
        end = len(one.days) if one.onset is None else one.onset
        at = one.first(name, level)
        rung = at is not None and at < end
        alarms += rung
        days += float(one.days[at if rung else end - 1])
    return alarms, days


def level_of(ones: Sequence[Judged], name: str, days: float) -> float:
    """Lowest level with at most one false alarm in `days`."""
    highest = sorted(
        {float(s) for one in ones
         for s in np.maximum.accumulate(
             one.alarms[name].statistic[: len(one.days) if one.onset is None else one.onset])
         if math.isfinite(s)}
    )  # fmt: skip
    low, high = 0, len(highest) - 1
    while low < high:
        middle = (low + high) // 2
        alarms, at_risk = sound_days(ones, name, highest[middle])
        if alarms * days <= at_risk:
            high = middle
        else:
            low = middle + 1
    return highest[low]


def interval(alarms: int, days: float) -> tuple[float, float]:
    """95 % interval of alarms in `RATE` days, from a count in `days` (Garwood 1936)."""
    low = 0.0 if alarms == 0 else 0.5 * float(chi2.ppf(0.025, 2 * alarms))
    high = 0.5 * float(chi2.ppf(0.975, 2 * alarms + 2))
    return low * RATE / days, high * RATE / days


def outcome(one: Judged, name: str, level: float) -> tuple[bool, ...]:
    """Judge a detector on a deployment with a fault: values of `COUNTED`.

    The name of a fault with the same signature counts as right.
    """
    at, says, onset = one.first(name, level), one.alarms[name], one.onset
    rung = at is not None and onset is not None and at >= onset
    named = rung and one.case["truth"] in (says.kind, *says.also)
    near = rung and says.since is not None and abs(says.since - (onset or 0)) <= NEAR
    in_time = one.in_time(name, level)
    could = one.could or in_time
    return onset is not None, one.seen is not None, could, in_time, rung, named, near


def counts(ones: Sequence[Judged], name: str, level: float) -> dict[str, int]:
    """Count the outcomes of a detector on deployments that have a fault, by name."""
    found = [outcome(one, name, level) for one in ones if one.onset is not None]
    sums = np.array(found, int).reshape(-1, len(COUNTED)).sum(0)
    return dict(zip(COUNTED, sums.tolist(), strict=True))


# --- tables, as pages have them -------------------------------------------------------------------


def split(ones: Sequence[Judged], by: str) -> dict[str, list[Judged]]:
    """Group deployments by `truth`, in the order of FAULTS, or by `vehicle`."""
    order = FAULTS if by == "truth" else dict.fromkeys(one.case["vehicle"] for one in ones)
    found = {word: [one for one in ones if one.case[by] == word] for word in order}
    return {word: mine for word, mine in found.items() if mine}


def of_kinds(ones: Sequence[Judged], level: float) -> str:
    """Table of detections for each fault type."""
    kinds = split(ones, "truth") | {"all": list(ones)}
    rows = [[kind, *counts(mine, OURS, level).values()] for kind, mine in kinds.items()]
    return markdown(["fault", *COUNTED], rows)


def of_detectors(ones: Sequence[Judged], teachers: Sequence[Judged], level: float) -> str:
    """Table of all detectors, each at its own level and at the training deployments' level."""
    levels = [(OURS, OURS, level)]
    levels += [(f"{name}, 3 deviations", name, LIMIT) for name in CHARTS]
    if teachers:
        others = [name for name in ones[0].alarms if name != OURS]
        levels += [(f"{name}, same rate", name, level_of(teachers, name, RATE)) for name in others]
    rows = []
    for says, name, limit in levels:
        found, (alarms, days) = counts(ones, name, limit), sound_days(ones, name, limit)
        right = "-" if name in CHARTS else found["named"]
        rows.append([says, found["could be"], found["in time"], right, alarms, f"{days:.0f}",
                     f"{RATE * alarms / days:.2f}"])  # fmt: skip
    head = ["detector", "could be", "in time", "named", "false alarms", "days", "in 30 d"]
    return markdown(head, rows)


def of_vehicles(ones: Sequence[Judged], level: float) -> str:
    """Table of detections and false alarms for each vehicle."""
    rows = []
    for vehicle, mine in {**split(ones, "vehicle"), "all": ones}.items():
        alarms, days = sound_days(mine, OURS, level)
        low, high = interval(alarms, days)
        rows.append([vehicle, *counts(mine, OURS, level).values(), f"{days:.0f}", alarms,
                     f"{RATE * alarms / days:.2f}", f"{low:.2f} to {high:.2f}"])  # fmt: skip
    head = ["vehicle", *COUNTED, "sound days", "false alarms", "in 30 d", "95 %"]
    return markdown(head, rows)


def of_both(ones: Sequence[Judged], level: float) -> str:
    """Table of the fraction of detectable faults detected in time, by fault type and vehicle."""
    vehicles, rows = split(ones, "vehicle"), []
    for kind in split(ones, "truth"):
        found = [
            counts([one for one in mine if one.case["truth"] == kind], OURS, level)
            for mine in vehicles.values()
        ]
        rows.append([kind, *(f"{one['in time']} of {one['could be']}" for one in found)])
    return markdown(["fault", *vehicles], rows)


def of_sizes(ones: Sequence[Judged], level: float) -> str:
    """Table of the fraction detected in each third of a fault type's sizes."""
    rows = []
    for kind, mine in split(ones, "truth").items():
        low, high = FAULTS[kind].sizes
        faulty = [one for one in mine if one.onset is not None]
        if not faulty or low == high:
            continue
        edges = np.geomspace(low, high, 4)
        sizes = [abs(fault_from_dict(one.case["fault"]).size) for one in faulty]
        thirds = np.clip(np.searchsorted(edges, sizes) - 1, 0, 2)
        cells = []
        for k in range(3):
            third = [one for one, place in zip(faulty, thirds, strict=True) if place == k]
            cells.append(f"{counts(third, OURS, level)['noticed']} of {len(third)}")
        rows.append([kind, f"{low:.3g} to {high:.3g}", *cells])
    return markdown(["fault", "sizes", "smallest third", "middle", "largest"], rows)


def of_confusion(ones: Sequence[Judged], name: str, level: float) -> str:
    """Table of the names that detected faults were given."""
    rows = []
    noticed = COUNTED.index("noticed")
    for kind, mine in split(ones, "truth").items():
        rung = [one for one in mine if outcome(one, name, level)[noticed]]
        called = [one.alarms[name].kind for one in rung]
        if called:
            words = sorted(set(called), key=lambda word: -called.count(word))
            rows.append([kind, ", ".join(f"{word} {called.count(word)}" for word in words)])
    return markdown(["fault", "called"], rows)


def of_rates(ones: Sequence[Judged]) -> str:
    """Table of both detectors at equal false-alarm rates on these deployments."""
    rows = []
    for name in (OURS, LEARNED):
        for rate in (0.25, 0.5, 1.0, 1.5):
            level = level_of(ones, name, RATE / rate)
            found, (alarms, days) = counts(ones, name, level), sound_days(ones, name, level)
            onset = found["onset"] if name == OURS else "-"
            rows.append([name, f"{RATE * alarms / days:.2f}", found["in time"], found["noticed"],
                         found["named"], onset])  # fmt: skip
    return markdown(["detector", "in 30 d", *COUNTED[3:]], rows)


BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Edges of the probabilities of standing alarms"""


def weights(ones: Sequence[Judged]) -> Array:
    """Weight of each deployment, with which a fault begins once in `RARE` dives of all."""
    faulty = np.array([one.onset is not None for one in ones])
    due = sum(len(one.days) for one in ones) / RARE
    return np.where(faulty, due / max(int(faulty.sum()), 1), 1.0)


def named(one: Judged) -> bool:
    """True where a fault has begun and is named, alone or with others."""
    says = one.alarms[OURS]
    return one.onset is not None and one.case["truth"] in (says.kind, *says.also)


def of_probabilities(ones: Sequence[Judged]) -> str:
    """Standing alarms by their probability, and the part of them that is true."""
    said = np.array([one.alarms[OURS].probability for one in ones])
    true, weight = np.array([named(one) for one in ones]), weights(ones)
    rows = []
    for low, high in itertools.pairwise(BINS):
        inside = (said > low) & (said <= high)
        if inside.any():
            mine = weight[inside]
            rows.append([
                f"{low:.1f} to {high:.1f}", int(inside.sum()), int(true[inside].sum()),
                f"{np.average(said[inside], weights=mine):.2f}",
                f"{np.average(true[inside], weights=mine):.2f}",
            ])  # fmt: skip
    head = ["probability", "alarms", "true", "mean probability", "part that is true"]
    return markdown(head, rows)


def load(paths: Sequence[Path]) -> list[Case]:
    """Read kept deployments."""
    return [json.loads(line) for path in paths for line in path.read_text().splitlines()]


def main(
    *,
    vehicle: tuple[str, ...] = ("slocum-200",),
    each: int = 4,
    sound: int = 8,
    seed: int = 201,
    preset: str = "faulty",
    kinds: tuple[str, ...] = (),
    size: float | None = None,
    workers: int = 1,
    keep: Path | None = None,
    stores: Path | None = None,
    judge: tuple[Path, ...] = (),
    taught: tuple[Path, ...] = (),
) -> None:
    """Fly and keep deployments, or print the tables.

    Args:
      each: deployments of each fault type.
      sound: deployments without a fault.
      size: size of every fault, in its unit.
      keep: file to which channels are added, for `--judge`.
      stores: folder that keeps the logs, so that none flies twice.
      judge: kept files to judge, without flying.
      taught: kept files of training deployments.
    """
    cases = load(judge)
    for name in vehicle if not judge else ():
        plan = DeploymentPlan(
            vehicle=_vehicle(name), preset=preset, seed=seed, kinds=kinds, size=size
        )
        for case in fly(plan, each=each, sound=sound, workers=workers, stores=stores):
            cases.append(case)
            if keep is not None:
                with keep.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(case) + "\n")
    if keep is not None:
        return
    teaching = load(taught)
    detector = learned(teaching) if teaching else None
    ones = [judged_case(case, detector) for case in cases]
    # deployments that did not train a detector set its level
    halves = [teaching[0::2], teaching[1::2]]
    others = [learned(half) if teaching else None for half in halves[::-1]]
    teachers = [
        judged_case(case, other)
        for half, other in zip(halves, others, strict=True)
        for case in half
    ]
    level = threshold_of(RATE)
    tables = {
        "kinds": of_kinds(ones, level), "vehicles": of_vehicles(ones, level),
        "kinds_by_vehicle": of_both(ones, level),
        "detectors": of_detectors(ones, teachers, level), "sizes": of_sizes(ones, level),
        "confusion": of_confusion(ones, OURS, level), "probabilities": of_probabilities(ones),
    }  # fmt: skip
    if detector is not None:
        named_at = level_of(teachers, LEARNED, RATE)
        tables |= {
            "levels": of_rates(ones), "confusion_learned": of_confusion(ones, LEARNED, named_at)
        }  # fmt: skip
    for name, rows in tables.items():
        print(f"<!-- figures: health.{name} -->\n\n{rows}\n")


if __name__ == "__main__":
    sys.exit(command.run(main))
