"""Health of real logs: alarms on the logs as they are, and detection of faults added to them.

    python -m benchmarks.health_real barnacle.zarr unit334.zarr --work identified \
        --keep docs/results/health_real.json

The stores are those of `factory import`. Each deployment is judged with the shipped vehicle of its
type and, if the log has attitude, with the vehicle that `twin identify` fits to its first half.
Then each fault's signature is added to the second half's channels, and the detector runs again.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import command
from glider_twin_ops.health.assessment import LEAST_DIVES, flown_signatures, judged
from glider_twin_ops.health.channels import NAMES
from glider_twin_ops.health.deployment_dives import told_by
from glider_twin_ops.health.judgement import sure, threshold_of
from twin.cli.text_table import format_number
from twin.identify.logged_missions import start_vehicle
from twin.records.logged import LogStore
from twin.vehicle.vehicle import Vehicle, load_vehicle

PUT: tuple[tuple[str, float, dict[str, Any]], ...] = (
    ("attached", 0.1, {}),
    ("attached", 0.3, {}),
    ("wing_lost", 1.0, {"side": "port"}),
    ("compass_iron", 5.0, {"toward": 45.0}),
    ("compass_iron", 15.0, {"toward": 45.0}),
)
"""Faults to add: type, size and variant; sizes are within the types' sampled ranges"""
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


def _look(
    logs: LogStore, store: Path, name: str, which: str, vehicle: Vehicle, kept: dict[str, Any]
) -> None:
    """Judge one deployment as it is, and with each fault added."""
    told = told_by(logs, name, vehicle)
    threshold = threshold_of(DAYS)
    one = judged(**told, vehicle=vehicle, threshold=threshold)
    attitude = bool(np.isfinite(told["values"][:, NAMES.index("rate_dive")]).any())
    highest = float(sure(one.evidence).max())
    kept["logs"].append({
        "log": store.stem, "deployment": name, "vehicle": which, "dives": len(one.dives),
        "days": round(one.days, 2), "attitude": attitude,
        "rang": [list(ring) for ring in one.rang], "kind": one.kind,
        "highest": round(highest, 2) if math.isfinite(highest) else None,
        "remarks": list(one.remarks),
    })  # fmt: skip
    if which != "identified":
        return
    begun = len(one.dives) // 2
    hypotheses = flown_signatures(vehicle, told["dive"]).in_dives(told["ways"])
    for kind, size, way in PUT:
        mine = [h for h in hypotheses if h.kind == kind
                and all(getattr(h.fault, key) == value for key, value in way.items())]  # fmt: skip
        values = told["values"].copy()
        added = np.broadcast_to(np.nan_to_num(mine[0].signature), values.shape)
        values[begun:] += size * added[begun:]
        found = judged(**{**told, "values": values}, vehicle=vehicle, threshold=threshold)
        rung = [one.dives.index(ring[0]) for ring in found.rang]
        late = [place - begun for place in rung if place >= begun]
        kept["faults"].append({
            "log": store.stem, "deployment": name, "fault": kind, "size": size,
            "dives_after": len(one.dives) - begun,
            "noticed_after": late[0] if late else None,
            "in_time": bool(late) and late[0] < WITHIN,
            "named": found.kind if found.alarm else "none",
            "since_off": None if found.since_dive is None
            else one.dives.index(found.since_dive) - begun,
            "found_size": None if not found.alarm else round(found.kinds[0].size, 3),
            "deviation": None if not found.alarm else round(found.kinds[0].size_deviation, 3),
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
