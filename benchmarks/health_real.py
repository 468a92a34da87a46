"""Health of real logs: alarms on the logs as they are, and detection of faults put into them.

    python -m benchmarks.health_real barnacle.zarr unit334.zarr --work identified \
        --keep docs/results/health_real.json

The stores are those of `factory import`. Each deployment is judged with the shipped vehicle of its
kind and, where the log has attitude, with the one that `twin identify` makes of its first half.
From the middle on, its signals are changed as by a fault: a glide slowed by more drag, a pressure
that drifts, a pump that is slow, a compass turned as a whole. Health reads the changed signals.
"""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import command
from glider_twin_ops.health.assessment import (
    LEAST_DIVES,
    DeploymentHealth,
    flown_signatures,
    judged,
)
from glider_twin_ops.health.channels import NAMES
from glider_twin_ops.health.deployment_dives import ballasted, dives_of, told_by, values_of
from glider_twin_ops.health.dive_channels import (
    PUMPING,
    DiveSignals,
    flight_model,
    strokes_of,
)
from glider_twin_ops.health.judgement import sure, threshold_of
from twin.cli.text_table import format_number
from twin.identify.logged_missions import start_vehicle
from twin.records.logged import LogStore
from twin.vehicle.vehicle import Vehicle, load_vehicle

Array = NDArray[np.float64]
DRAG, DRIFT, PUMP, TURN = 0.3, 4.0, 0.4, 8.0
"""Added drag over the vehicle's own; [dbar/d] drift of the pressure; lost part of the pump's rate;
[degree] turn of the compass"""
PUT = (("attached", DRAG), ("pressure_drift", DRIFT), ("pump_weak", PUMP), ("compass_turned", TURN))
"""Faults that are put in, by the kind that is right"""
RIGHT = {"attached": {"attached", "fouling"}}
"""Kinds that name a fault as well: drag is drag"""
LEAST_DAYS, LEAST = 2.0, 20
"""[d] and dives of a deployment that gets faults"""
SEEN = 3.0
"""Standard deviations of a fault in one dive, by its signature, from which on it can be seen"""
WITHIN = 3
"""Dives from the first faulty one within which an alarm is in time"""
DAYS = 30.0
"""[d] Time of sound vehicles per false alarm"""


def _vehicles(logs: LogStore, store: Path, name: str, work: Path) -> dict[str, Vehicle]:
    """Shipped vehicle, and the one fitted to the first half; none for too few dives."""
    rows = logs.missions_of(name)
    if len(rows) < LEAST_DIVES:
        return {}
    if "measured_pitch" in logs:
        found = {"shipped": start_vehicle(store)}
    else:  # a log deeper than a 200 m vehicle dives is of a 1000 m vehicle
        deep = float(np.nanmax(logs.rows("measured_depth", range(len(logs))))) > 230.0
        found = {"shipped": load_vehicle("slocum-1000" if deep else "slocum-200")}
    path = work / f"{store.stem}-{name}.xml"
    if "measured_pitch" in logs and not path.exists():
        first = ",".join(map(str, rows[: max(len(rows) // 2, 4)]))
        command = [sys.executable, "-m", "twin", "identify", str(store), "--missions", first]
        subprocess.run([*command, "--out", str(path)], check=False, capture_output=True)
    if path.exists():
        found["identified"] = load_vehicle(str(path))
    return found


def _slowed(dive: DiveSignals, slow: Array) -> DiveSignals:
    """Dive in which each sample lasts `slow` times as long, (n,), sampled as before."""
    at = np.concatenate([[0.0], np.cumsum(slow[:-1])])
    index = np.searchsorted(at, np.arange(int(at[-1]) + 1), side="right") - 1
    inside = (np.arange(len(index)) - at[index]) / slow[index]
    after = np.minimum(index + 1, len(slow) - 1)
    signals = {}
    for name, values in dive.signals.items():
        step = values[after] - values[index]
        step = (step + 180.0) % 360.0 - 180.0 if name.endswith("heading") else step
        signals[name] = np.where(np.isfinite(step), values[index] + inside * step, values[index])
    if (nearest := dive.signals.get("measured_depth_time")) is not None:
        away = nearest - dive.period * np.arange(len(nearest))
        signals["measured_depth_time"] = away[index] + dive.period * np.arange(len(index))
    return dataclasses.replace(dive, signals=signals)


def put_in(kind: str, dive: DiveSignals, days: float) -> DiveSignals:
    """Change a dive's signals as a fault does that began `days` [d] before."""
    signals = dict(dive.signals)
    if kind in ("attached", "pump_weak"):
        pump = dive.get("pump")
        if pump is None:
            return dive
        out = strokes_of(pump, dive.period).out
        moving = np.abs(np.gradient(np.nan_to_num(pump), dive.period)) > PUMPING
        slow = np.where(out, 1.0 / (1.0 - PUMP), 1.0)
        if kind == "attached":
            slow = np.where(moving, 1.0, math.sqrt(1.0 + DRAG))
        return _slowed(dive, slow)
    added = {"measured_depth": 0.99 * DRIFT * days, "measured_pressure": DRIFT * days}
    if kind == "compass_turned":
        added = dict.fromkeys(("measured_heading", "commanded_heading"), TURN)
    signals |= {name: signals[name] + more for name, more in added.items() if name in signals}
    way, current = complex(*dive.way), complex(*dive.current)
    if kind == "compass_turned":
        current += way
        way *= complex(math.cos(math.radians(TURN)), math.sin(math.radians(TURN)))
        current -= way
    return dataclasses.replace(
        dive, signals=signals, way=(way.real, way.imag), current=(current.real, current.imag)
    )


def _bound(found: DeploymentHealth, told: dict[str, Any], kind: str, size: float) -> float:
    """Standard deviations of a fault in a dive a day after the middle, by its signature."""
    begun = len(found.dives) // 2
    hypotheses = flown_signatures(told["vehicle"], told["dive"]).in_dives(told["ways"])
    known = np.isfinite(told["values"][:begun]).any(axis=0)
    shown = [
        np.nan_to_num(np.atleast_2d(h.signature))[-1] / np.sqrt(found.levels.expected[begun - 1])
        for h in hypotheses if h.kind == kind
    ]  # fmt: skip
    return max(float(np.linalg.norm(one[known])) * size for one in shown)


def _look(
    logs: LogStore, store: Path, name: str, which: str, vehicle: Vehicle, kept: dict[str, Any]
) -> None:
    """Judge one deployment as it is, and with each fault put in."""
    threshold = threshold_of(DAYS)
    calibration = flight_model(vehicle)
    _, dives, _ = dives_of(logs, name, calibration)
    calibration = None if calibration is None else ballasted(dives, calibration)
    told = told_by(logs, name, vehicle) | {"vehicle": vehicle, "threshold": threshold}
    one = judged(**told)
    highest = float(sure(one.evidence).max())
    masked = sum(dive.masked for dive in dives)
    kept["logs"].append({
        "log": store.stem, "deployment": name, "vehicle": which, "dives": len(one.dives),
        "masked": masked, "judged": one.judged_dives, "days": round(one.days, 2),
        "channels": len(NAMES) - len(one.lacking), "rang": [list(ring) for ring in one.rang],
        "kind": one.kind, "highest": round(highest, 2) if math.isfinite(highest) else None,
        "remarks": list(one.remarks),
    })  # fmt: skip
    if one.days < LEAST_DAYS or len(dives) < LEAST or not one.judged:
        return
    begun, days = len(dives) // 2, (told["time"] - told["time"][0]) / 86400.0
    for kind, size in PUT:
        bound = _bound(one, told, kind, size)
        faulty = list(dives)
        for k in range(begun, len(dives)):
            faulty[k] = put_in(kind, dives[k], float(days[k] - days[begun]))
        values = values_of(faulty, calibration)
        found = judged(**{**told, "values": values, "ways": np.array([one.way for one in faulty])})
        rung = [one.dives.index(ring[0]) for ring in found.rang]
        late = [place - begun for place in rung if place >= begun]
        named = found.alarm and {found.kind, *found.kinds[0].also} & RIGHT.get(kind, {kind})
        kept["faults"].append({
            "log": store.stem, "deployment": name, "vehicle": which, "fault": kind, "size": size,
            "deviations": round(bound, 1), "can_be_seen": bound >= SEEN,
            "dives_after": len(dives) - begun, "noticed_after": late[0] if late else None,
            "called": " or ".join((found.kind, *found.kinds[0].also)) if found.alarm else "none",
            "rightly": bool(named), "probability": round(found.probability, 2),
            "found_size": round(found.kinds[0].size, 3) if found.alarm else None,
            "deviation": round(found.kinds[0].size_deviation, 3) if found.alarm else None,
        })  # fmt: skip


def _table(rows: list[dict[str, Any]]) -> str:
    heads = [head for head in rows[0] if head != "remarks"] if rows else []
    return command.markdown(heads, [[_cell(row[head]) for head in heads] for row in rows])


def _cell(value: object) -> str:
    return str(value or "-") if isinstance(value, list) else format_number(value)


def main(
    stores: command.Positional[tuple[Path, ...]], *, work: Path, keep: Path | None = None
) -> None:
    """Judge deployments, print the results, and keep them if asked.

    Args:
      stores: of logs.
      work: folder for vehicles.
      keep: write the figures here (.json).
    """
    work.mkdir(parents=True, exist_ok=True)
    kept: dict[str, list[dict[str, Any]]] = {"logs": [], "faults": []}
    for store in stores:
        with LogStore(store) as logs:
            for name in dict.fromkeys(logs.deployments):
                for which, vehicle in _vehicles(logs, store, name, work).items():
                    _look(logs, store, name, which, vehicle, kept)
    print(_table(kept["logs"]), "\n", _table(kept["faults"]), sep="\n")
    days = {which: sum(one["days"] for one in kept["logs"] if one["vehicle"] == which)
            for which in ("shipped", "identified")}  # fmt: skip
    print({which: f"{value:.1f} d" for which, value in days.items()})
    if keep is not None:
        keep.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(command.run(main))
