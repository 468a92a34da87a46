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
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.real_logs.ensembles import Ensembles, attack_by_pitch, mean_attack, read_ensembles
from benchmarks.real_logs.folds import thinned
from benchmarks.real_logs.row import Interval, Kind, Row, central
from benchmarks.real_logs.source import Deployment
from twin.errors import InputError
from twin.identify import identify, load_calibration
from twin.identify.logged_missions import start_vehicle
from twin.mission.glide_balance import steady_glide
from twin.vehicle.vehicle import Vehicle, load_vehicle

BINS, LEFT_OUT = "angle of attack by pitch", "angle of attack, one yo left out"
TASKS = (BINS, LEFT_OUT)
UNIT = "degree"
SHIPPED, PUBLISHED = "slocum-1000", 0.15
"""Vehicle that is judged; drag coefficient of a Slocum on 0.1 m2 as published, the default of
gliderflight (Merckelbach et al. 2019), with lift and induced drag as the vehicle file has them"""
AREA = 0.1
"""[m2] Reference area of the coefficient"""
CONSTANT = 3.0
"""[degree] Constant angle of attack (OceanGliders)"""
THRESHOLDS = {"Doppler log": 1.0, "half the thresholds": 0.5, "twice the thresholds": 2.0}
"""Factor on the thresholds of the screens, by method"""
STEEP, FEW = 15.0, 30
"""[degree] Pitch beyond which a hull glides; fewest ensembles of a dive and of a climb"""


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
    sides = [mean_attack(both.where(side * both.pitch > STEEP)) for side in (-1.0, 1.0)]
    attack, pitch = (
        math.radians(0.5 * (down - up))
        for down, up in ((sides[0].attack, sides[1].attack), (-sides[0].pitch, -sides[1].pitch))
    )
    return 1.0 / (attack * math.tan(pitch + attack) - induced * attack**2)


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
    whole = {
        name: found
        for name, found in yos.items()
        if min((side * found.pitch > STEEP).sum() for side in (-1.0, 1.0)) >= FEW
    }
    return [*rows, *(row for name in whole if len(whole) > 1 for row in _left_out(name, whole))]


def _bins(path: Path, vehicles: Mapping[str, Vehicle]) -> list[Row]:
    """Rows of one file: angle of attack of each bin of pitch, by each method."""
    found = {
        name: attack_by_pitch(read_ensembles(path, scale)) for name, scale in THRESHOLDS.items()
    }
    rows = []
    for key, one in found["Doppler log"].items():
        low, high = sorted((abs(key), abs(key + 1)))
        data = f"{path.stem}, {low} to {high} deg nose {'down' if key < 0 else 'up'}"
        for name, bins in found.items():
            if key in bins:
                mean = bins[key]
                note = f"pitch {mean.pitch:.1f} deg, surge {mean.surge:.3f} m/s"
                rows.append(_row(BINS, data, name, "truth", mean.attack, mean.interval,
                                 mean.ensembles, mean.minutes, note))  # fmt: skip
        flown = {name: glide_angle_of_attack(each, one.pitch) for name, each in vehicles.items()}
        flown["constant 3 deg"] = -math.copysign(CONSTANT, one.pitch)
        for name, angle in flown.items():
            kind: Kind = "twin" if name in vehicles else "public method"
            note = f"{(angle / one.attack - 1.0):+.0%} of the Doppler log's"
            rows.append(_row(BINS, data, name, kind, angle, None, one.ensembles, one.minutes, note))
    return rows


def _left_out(name: str, yos: Mapping[str, Ensembles]) -> list[Row]:
    """Rows of one yo: mean angle by models less the Doppler log's, dives and climbs averaged."""
    vehicle, yo = load_vehicle(SHIPPED), yos[name]
    law = vehicle.flow_frame
    others = [found for other, found in yos.items() if other != name]
    ratio = lift_ratio(others, law.drag[1] / law.lift[1])
    drag = 0.5 * vehicle.reference_density * AREA * PUBLISHED
    models: dict[str, tuple[Kind, Vehicle, str]] = {
        "ratio of the other yos": ("twin", with_ratio(vehicle, ratio), f"lift ratio {ratio:.1f}"),
        SHIPPED: ("twin", vehicle, f"lift ratio {law.lift[1] / law.drag[0]:.1f}"),
        f"published drag, {PUBLISHED:g}": (
            "public method", with_ratio(vehicle, law.lift[1] / drag),
            f"lift ratio {law.lift[1] / drag:.1f}",
        ),
    }  # fmt: skip
    sides = {side: mean_attack(yo.where(side * yo.pitch > STEEP)) for side in (-1.0, 1.0)}
    draws = 0.5 * (sides[-1.0].draws - sides[1.0].draws)
    measured = 0.5 * (sides[-1.0].attack - sides[1.0].attack)
    count, minutes = (
        sum(getattr(one, what) for one in sides.values()) for what in ("ensembles", "minutes")
    )
    rows = []
    for method, (kind, model, note) in models.items():
        angles = [abs(glide_angle_of_attack(model, one.pitch)) for one in sides.values()]
        error, interval = float(np.mean(angles)) - measured, central(np.mean(angles) - draws)
        rows.append(_row(LEFT_OUT, name, method, kind, error, interval, count, minutes, note))
    error, interval = CONSTANT - measured, central(CONSTANT - draws)
    note = f"the Doppler log's is {measured:.2f} deg"
    method = "constant 3 deg"
    rows.append(
        _row(LEFT_OUT, name, method, "public method", error, interval, count, minutes, note)
    )
    return rows


def _row(
    task: str, data: str, method: str, kind: Kind, value: float, interval: Interval | None,
    samples: int, minutes: int, note: str,
) -> Row:  # fmt: skip
    low, high = interval or (math.nan, math.nan)
    return Row(
        task=task, data=data, method=method, kind=kind, value=value, low=low, high=high, unit=UNIT,
        samples=samples, dives=minutes, note=note,
    )  # fmt: skip
