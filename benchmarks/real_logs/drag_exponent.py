"""Drag exponent: whether depth rates of left-out dives show a drag that falls with speed.

    python -m benchmarks.real_logs.drag_exponent FOLDER [--kind seaglider] [--json]

The basestation's flight model has a drag coefficient that falls with the root of the speed
(Eriksen et al. 2001: q^-1/4); the twin's is constant. Both models have a balance of forces with
volume and drag, fitted to the depth rates of a deployment's other dives, and the vehicle file's
lift and induced drag. A row has the RMS error in dives that were left out, one at a time, and the
ratio of the falling drag to the constant one with a bootstrap over dives; below 1 it gains.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from json import dumps
from pathlib import Path

import numpy as np

from benchmarks import command
from benchmarks.real_logs.folds import start_vehicle
from benchmarks.real_logs.public import AREA, DEEP, STEEP, SteadyModel, fit_balance
from benchmarks.real_logs.row import CENTRAL, bootstrap
from benchmarks.real_logs.source import Deployment, gather
from twin.identify import density_of, load_calibration
from twin.navigation.dead_reckoning import Array

FALLS = (0.0, 0.25, 0.5)
"""Powers of speed by which the drag coefficient falls; 0.5 is the basestation's"""
LEAST_DIVES = 4
SEA = 1027.0
"""[kg/m3] turns the file's forces over squared speed into coefficients on `AREA`"""


def errors_by_dive(deployment: Deployment, fall: float) -> list[Array]:
    """Errors of the depth rate [m/s] in each dive, by models that the other dives gave."""
    logs = deployment.logs()
    calibration = load_calibration(start_vehicle(deployment.store))
    law, scale = calibration.vehicle.flow_frame, 2.0 / (SEA * AREA)
    pitches = [calibration.true_pitch(log.pitch) for log in logs]
    densities = [density_of(log, calibration) for log in logs]
    start = SteadyModel(
        mass=calibration.vehicle.mass, volume=0.0, drag=scale * law.drag[0],
        lift=scale * law.lift[1], induced=scale * law.drag[1], fall=fall,
    )  # fmt: skip
    found = []
    for left, (log, pitch, density) in enumerate(zip(logs, pitches, densities, strict=True)):
        others = [k for k in range(len(logs)) if k != left]
        chosen = [[each[k] for k in others] for each in (logs, pitches, densities)]
        model = fit_balance(*chosen, start)
        judged = (log.depth > DEEP) & (np.abs(pitch) > STEEP) & log.use
        found.append((model.fly(log, pitch, density).sink - log.depth_rate)[judged])
    return found


def rows_of(deployment: Deployment) -> list[dict[str, object]]:
    """Rows of one deployment, a row for each power."""
    by_fall = {fall: errors_by_dive(deployment, fall) for fall in FALLS}
    sums = {fall: _squares(errors) for fall, errors in by_fall.items()}
    drawn = bootstrap(len(by_fall[0.0]))
    rows = []
    for fall, (squares, counts) in sums.items():
        ratio = np.sqrt(squares[drawn].sum(1) / sums[0.0][0][drawn].sum(1))
        low, high = np.percentile(ratio, CENTRAL)
        rows.append({
            "deployment": deployment.name, "dives": len(drawn[0]), "falls_by": fall,
            "rms_cm_s": 100.0 * float(np.sqrt(squares.sum() / counts.sum())),
            "ratio": float(np.sqrt(squares.sum() / sums[0.0][0].sum())),
            "low": float(low), "high": float(high),
        })  # fmt: skip
    return rows


def _squares(errors: Sequence[Array]) -> tuple[Array, Array]:
    return (
        np.array([float(np.sum(dive**2)) for dive in errors]),
        np.array([float(dive.size) for dive in errors]),
    )


def main(folder: command.Positional[Path], *, kind: str = "seaglider", json: bool = False) -> None:
    """Print the rows of the deployments in `folder` with at least four dives."""
    with tempfile.TemporaryDirectory() as work:
        found, _ = gather(folder, Path(work), lambda text: print(text, file=sys.stderr))
        judged = [one for one in found if one.kind == kind and len(one.rows) >= LEAST_DIVES]
        rows = [row for one in judged for row in rows_of(one)]
    if json:
        print(dumps(rows, indent=1))
        return
    head = ("deployment", "dives", "drag falls by the power", "RMS, cm/s", "ratio (95 %)")
    text = [
        (row["deployment"], row["dives"], row["falls_by"], f"{row['rms_cm_s']:.2f}",
         f"{row['ratio']:.3f} ({row['low']:.3f} to {row['high']:.3f})")
        for row in rows
    ]  # fmt: skip
    print(command.markdown(head, text))


if __name__ == "__main__":
    sys.exit(command.run(main))
