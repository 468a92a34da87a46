"""Attack: the angle of attack that a Doppler log shows, beside that of flight models.

In a steady glide at pitch p, with lift K_alpha a and drag K_D0 + K_D a^2 (Zhang et al. 2013), the
angle of attack a meets

    a tan(p + a) = K_D0 / K_alpha + (K_D / K_alpha) a^2

whatever the buoyancy is. So a Doppler log shows one ratio of a hull, and no drag or lift alone.
Dives and climbs have equal weights, since a tilt of the mount raises one and lowers the other.
`K_D / K_alpha` is the vehicle file's: at one pitch it cannot be told from the first ratio.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.real_logs.ensembles import Ensembles, attack_by_pitch, both_sides, read_ensembles
from benchmarks.real_logs.folds import thinned
from benchmarks.real_logs.row import Row, central
from benchmarks.real_logs.source import Deployment
from twin.errors import InputError
from twin.identify import identify, load_calibration
from twin.identify.logged_missions import start_vehicle
from twin.mission.glide_balance import steady_glide
from twin.vehicle.vehicle import Vehicle, load_vehicle

BINS, LEFT_OUT = "angle of attack by pitch", "angle of attack, one yo left out"
TASKS = (BINS, LEFT_OUT)
SHIPPED, PUBLISHED = "slocum-1000", 7.53 / 0.15
"""Vehicle that is judged; lift slope over drag as published (Merckelbach et al. 2010, 2019)"""
Model = Callable[[float], float]
"""Angle of attack [degree], positive in dives, at a pitch [degree]"""
CONSTANT: dict[str, Model] = {"constant 3 deg": lambda pitch: -math.copysign(3.0, pitch)}
"""Constant angle of attack (OceanGliders)"""
THRESHOLDS = {"Doppler log": 1.0, "half the thresholds": 0.5, "twice the thresholds": 2.0}
"""Factor on the thresholds of the screens, by method"""
FEW = 30
"""Fewest ensembles of a dive and of a climb"""


def glide_angle_of_attack(vehicle: Vehicle, pitch: float) -> float:
    """Angle of attack [degree] of a vehicle's steady glide at a pitch [degree]; positive in dives.

    Raises:
      MissionError: the pitch is too shallow for the vehicle.
    """
    net_mass = -math.copysign(vehicle.usual_glide[1], pitch)
    return math.degrees(steady_glide(vehicle, math.radians(pitch), net_mass).angle_of_attack)


def with_ratio(vehicle: Vehicle, ratio: float) -> Vehicle:
    """Return the vehicle with the drag K_D0 that has this ratio K_alpha / K_D0 [1/rad]."""
    law = vehicle.flow_frame
    return vehicle.replace(drag=(law.lift[1] / ratio, law.drag[1]))


def lift_ratio(yos: Sequence[Ensembles], induced: float) -> float:
    """Lift slope over parasite drag, K_alpha / K_D0 [1/rad], by dives and climbs of equal weight.

    Args:
      induced: K_D / K_alpha [1/rad].
    """
    both = Ensembles(*(np.concatenate(values) for values in zip(*yos, strict=True)))
    down, up = both_sides(both)
    attack, pitch = np.radians(0.5 * np.array([down.attack - up.attack, up.pitch - down.pitch]))
    return float(1.0 / (attack * np.tan(pitch + attack) - induced * attack**2))


def identified(deployment: Deployment) -> dict[str, Vehicle]:
    """Vehicle of a log, by name, if the log determines its lift; errors as `identify`."""
    rows = thinned([log.index for log in deployment.logs()])
    nominal = load_calibration(start_vehicle(deployment.store))
    found = identify(deployment.logs(rows), nominal)
    known = "lift_ratio" in found.determined
    return {f"identified, {deployment.name}": found.calibration.vehicle} if known else {}


def rows_of(folder: Path, vehicles: Mapping[str, Vehicle]) -> list[Row]:
    """Rows of the PD0 files of a folder, which belong to one vehicle; a reason for each bad file.

    Args:
      vehicles: identified vehicles to be set beside, by name.
    """
    rows, yos = [], {}
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() == ".pd0"):
        try:
            yos[path.stem] = read_ensembles(path)
            rows += _bins(path, {SHIPPED: load_vehicle(SHIPPED), **vehicles})
        except InputError as error:
            name = f"{folder.name}/{path.stem}"
            rows.append(Row(task=BINS, data=name, method="", kind="skipped", note=str(error)))
    whole = {name: yo for name, yo in yos.items() if min(m.sum() for m in yo.sides) >= FEW}
    for name, yo in whole.items() if len(whole) > 1 else ():
        rows += _left_out(name, yo, [other for other in whole.values() if other is not yo])
    return rows


def _bins(path: Path, vehicles: Mapping[str, Vehicle]) -> list[Row]:
    """Rows of one file: angle of attack of each bin of pitch, by each method."""
    found = {
        name: attack_by_pitch(read_ensembles(path, scale)) for name, scale in THRESHOLDS.items()
    }
    models = {name: partial(glide_angle_of_attack, one) for name, one in vehicles.items()}
    rows = []
    for key, one in found["Doppler log"].items():
        steep, side = sorted((abs(key), abs(key + 1))), "down" if key < 0 else "up"
        put = partial(
            Row, task=BINS, data=f"{path.stem}, {steep[0]} to {steep[1]} deg nose {side}",
            unit="degree", samples=one.ensembles, dives=one.minutes,
        )  # fmt: skip
        for name, mean in ((name, bins[key]) for name, bins in found.items() if key in bins):
            note = f"pitch {mean.pitch:.1f} deg, surge {mean.surge:.3f} m/s, {mean.ensembles} of it"
            low, high = central(mean.draws)
            rows.append(
                put(method=name, kind="truth", value=mean.attack, low=low, high=high, note=note)
            )
        for name, model in {**models, **CONSTANT}.items():
            angle = model(one.pitch)
            note = f"{(angle / one.attack - 1.0):+.0%} of the Doppler log's"
            rows.append(put(method=name, kind="twin", value=angle, note=note))
    return rows


def _left_out(name: str, yo: Ensembles, others: Sequence[Ensembles]) -> list[Row]:
    """Rows of one yo: mean angle by models less the Doppler log's, dives and climbs averaged."""
    vehicle, (down, up) = load_vehicle(SHIPPED), both_sides(yo)
    law = vehicle.flow_frame
    ratios = {
        "ratio of the other yos": lift_ratio(others, law.drag[1] / law.lift[1]),
        SHIPPED: law.lift[1] / law.drag[0],
        "published ratio": PUBLISHED,
    }
    flown = {k: partial(glide_angle_of_attack, with_ratio(vehicle, r)) for k, r in ratios.items()}
    rows = []
    for method, model in {**flown, **CONSTANT}.items():
        angle = 0.5 * (model(down.pitch) - model(up.pitch))
        low, high = central(angle - 0.5 * (down.draws - up.draws))
        error = angle - 0.5 * (down.attack - up.attack)
        note = f"lift ratio {ratios[method]:.1f}" if method in ratios else ""
        rows.append(Row(
            task=LEFT_OUT, data=name, method=method, kind="twin", value=error, low=low, high=high,
            unit="degree", samples=down.ensembles + up.ensembles, dives=down.minutes + up.minutes,
            note=note,
        ))  # fmt: skip
    return rows
