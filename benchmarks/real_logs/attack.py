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
from benchmarks.real_logs.row import Row, central
from twin.errors import InputError
from twin.mission.glide_balance import steady_glide
from twin.vehicle.vehicle import Vehicle, load_vehicle

BINS, LEFT_OUT = "angle of attack by pitch", "angle of attack, one yo left out"
TASKS = (BINS, LEFT_OUT)
SHIPPED, PUBLISHED = ("slocum-1000", "slocum-200"), 7.53 / 0.15
"""Vehicles that are judged; lift slope over drag as published (Merckelbach et al. 2010, 2019)"""
Model = Callable[[float], float]
"""Angle of attack [degree], positive in dives, at a pitch [degree]"""
CONSTANT: dict[str, Model] = {"constant 3 deg": lambda pitch: -math.copysign(3.0, pitch)}
"""Constant angle of attack (OceanGliders)"""
THRESHOLDS = {"Doppler log": 1.0, "twice the thresholds": 2.0, "half the thresholds": 0.5}
"""Factor on the thresholds of the screens, by method; the tightest may leave nothing"""
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


def rows_of(folder: Path) -> list[Row]:
    """Rows of a folder's PD0 files, which are of one vehicle; a reason for each bad file."""
    rows, yos = [], {}
    models: dict[str, Model] = {
        name: partial(glide_angle_of_attack, load_vehicle(name)) for name in SHIPPED
    }
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() == ".pd0"):
        found: dict[str, Ensembles] = {}
        for name, scale in THRESHOLDS.items():
            try:
                found[name] = read_ensembles(path, scale)
            except InputError as error:
                data = f"{folder.name}/{path.stem}, {name}"
                rows.append(Row(task=BINS, data=data, method="", kind="skipped", note=str(error)))
                break
        if found:
            yos[path.stem] = next(iter(found.values()))
            rows += _bins(path.stem, found, models | CONSTANT)
    whole = {name: yo for name, yo in yos.items() if min(m.sum() for m in yo.sides) >= FEW}
    for name, yo in whole.items() if len(whole) > 1 else ():
        rows += _left_out(name, yo, [other for other in whole.values() if other is not yo])
    return rows


def _bins(stem: str, found: Mapping[str, Ensembles], models: Mapping[str, Model]) -> list[Row]:
    """Rows of one file: angle of attack of each bin of pitch, by each threshold and model."""
    rows, bins = [], {name: attack_by_pitch(one) for name, one in found.items()}
    for key, one in next(iter(bins.values())).items():
        steep, side = sorted((abs(key), abs(key + 1))), "down" if key < 0 else "up"
        put = partial(
            Row, task=BINS, data=f"{stem}, {steep[0]} to {steep[1]} deg nose {side}",
            unit="degree", samples=one.ensembles, dives=one.minutes,
        )  # fmt: skip
        for name, mean in ((name, means[key]) for name, means in bins.items() if key in means):
            low, high = central(mean.draws)
            note = f"pitch {mean.pitch:.1f} deg, {mean.ensembles} ensembles"
            rows.append(
                put(method=name, kind="truth", value=mean.attack, low=low, high=high, note=note)
            )
        for name, model in models.items():
            angle = model(one.pitch)
            note = f"{(angle / one.attack - 1.0):+.0%} of the Doppler log's"
            rows.append(put(method=name, kind="twin", value=angle, note=note))
    return rows


def _left_out(name: str, yo: Ensembles, others: Sequence[Ensembles]) -> list[Row]:
    """Rows of one yo: mean angle by models less the Doppler log's, dives and climbs averaged."""
    (down, up), vehicle = both_sides(yo), load_vehicle(SHIPPED[0])
    induced = vehicle.flow_frame.drag[1] / vehicle.flow_frame.lift[1]
    laws = {name: load_vehicle(name).flow_frame for name in SHIPPED}
    ratios = {
        "ratio of the other yos": lift_ratio(others, induced),
        **{name: law.lift[1] / law.drag[0] for name, law in laws.items()},
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
