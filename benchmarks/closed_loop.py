"""Closed loop: a box flown on the on-board estimate, `python -m benchmarks.closed_loop`.

The vehicle flies round a square under water without a fix and steers by its own dead reckoning. The
square has another direction for each seed. Printed is the true distance from the start when the
vehicle believes to be back, in percent of the path, for ideal sensors and for those of `field`.

`floor` is that distance for a dead reckoning with the true body velocity and the measured attitude:
the error by the attitude alone, above all the compass. `--without NAME` makes one device of the
suite ideal, `--only NAME` all others, for an error budget. `--swing N` first flies spirals, in
which the gyros give the compass deviation.
"""

from __future__ import annotations

import math
import sys
from json import dumps
from typing import Any, Literal

import numpy as np

import twin
from benchmarks import command
from twin.errors import unknown_name
from twin.mission.segments import Spiral, Waypoint
from twin.navigation.dead_reckoning import AttitudeSeries, integrate, rotate_to_ned
from twin.navigation.settings import Navigation
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.records.trajectory import Trajectory
from twin.sensors import SensorSuite

GOALS = {"ideal": 0.3, "field": 1.5}
"""[%] Goals for the error, relative to the path"""
SWING_DEG = 45.0
"""[degree] Rotation of the battery in a spiral: a circle in about 25 minutes"""


def box(side: float, turn: float = 0.0, depth: float = 150.0, swing: int = 0) -> twin.Mission:
    """Mission round a square of this side [m], turned by `turn` [rad], in yos down to `depth` [m].

    It starts with `swing` yos in spirals to starboard and as many to port.
    """
    ahead, beside = side * math.cos(turn), side * math.sin(turn)
    corners = ((ahead, beside), (ahead - beside, ahead + beside), (-beside, ahead), (0.0, 0.0))
    dives: Any = {"max_depth_m": depth, "min_depth_m": 15.0, "pitch_deg": 26.0}
    return twin.Mission(
        name="box",
        segments=[
            *(
                Spiral(rotation_deg=rotation, yos=swing, **dives)
                for rotation in (SWING_DEG, -SWING_DEG)
                if swing
            ),
            Waypoint(
                targets=tuple({"north_m": n, "east_m": e} for n, e in corners),
                arrival_radius_m=10.0, surface_at_target=False, renewed="continuously", **dives,
            ),
        ],
    )  # fmt: skip


def suite_of(sensors: str, without: str | None = None, only: str | None = None) -> SensorSuite:
    """Sensor suite with one device made ideal, or all others.

    Raises:
      SystemExit: the suite has no such device.
    """
    suite = SensorSuite.preset(sensors)
    for name in (without, only):
        if name is not None and name not in suite:
            raise SystemExit(unknown_name("sensor of this suite", name, suite))
    if only is not None:
        return SensorSuite.preset("ideal").replace(**{only: suite[only]})
    return suite if without is None else suite.replace(**{without: type(suite[without]).ideal()})


def attitude_floor(run: Trajectory, at: int) -> float:
    """[m] Position error at sample `at` if the measured attitude turns the true velocity."""
    velocity = np.stack([run[f"true_{n}"] for n in ("surge", "sway", "heave")], axis=1)[: at + 1]
    period = float(run.time[1] - run.time[0])
    ends = []
    for source in ("measured", "true"):
        angles = {n: run[f"{source}_{n}"][: at + 1] for n in ("roll", "pitch", "heading")}
        attitude = AttitudeSeries(**{name: np.deg2rad(values) for name, values in angles.items()})
        ends.append(integrate(rotate_to_ned(velocity, attitude)[:, :2], period)[-1])
    return float(np.hypot(*(ends[0] - ends[1])))


def fly(
    side: float, sensors: SensorSuite, seed: int, estimator: str = "ekf", swing: int = 0
) -> dict[str, float]:
    """Fly one round: distance over ground [m], true error [m] at the estimated return to the start,
    error of the estimate [m], floor of the attitude [m], and whether the vehicle arrived."""
    navigate = Navigation(estimator=estimator, sensors=sensors, seed=seed)
    mission = box(side, np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi), swing=swing)
    run = Simulation(Scenario(mission=mission, navigate=navigate)).run()
    segment = run["commanded_segment"]
    back = np.flatnonzero(segment >= 4 + (2 if swing else 0))
    at = int(back[0]) if back.size else len(segment) - 1
    north, east = run["true_north"], run["true_east"]
    believed = run["measured_onboard_north"][at], run["measured_onboard_east"][at]
    return {
        "seed": seed,
        "distance": float(np.hypot(np.diff(north[: at + 1]), np.diff(east[: at + 1])).sum()),
        "error": float(np.hypot(north[at], east[at])),
        "navigation": float(np.hypot(north[at] - believed[0], east[at] - believed[1])),
        "floor": attitude_floor(run, at),
        "arrived": bool(back.size),
    }


def main(
    *,
    side: float = 2000.0,
    seeds: int = 20,
    first: int = 0,
    estimator: str = "ekf",
    swing: int = 0,
    sensors: Literal["ideal", "field"] | None = None,
    without: str | None = None,
    only: str | None = None,
    json: bool = False,
) -> None:
    """Fly the missions and print the errors.

    Args:
      side: [m] length of the box's side.
      first: seed of the first round.
      swing: yos in spirals before the box, to each side.
      sensors: one suite; both if not given.
      without: a device that is made ideal.
      only: the one device that is not made ideal.
      json: print every round.
    """
    for name in [sensors] if sensors else GOALS:
        suite = suite_of(name, without, only)
        rounds = [fly(side, suite, seed, estimator, swing) for seed in range(first, first + seeds)]
        if json:
            print(dumps({name: rounds}), flush=True)
            continue
        percent, floor = (
            np.array([100.0 * one[name] / one["distance"] for one in rounds])
            for name in ("error", "floor")
        )
        print(
            f"{name}: back within {percent.mean():.3f} % of the way (mean of {len(rounds)} "
            f"seeds; worst {percent.max():.3f} %, goal {GOALS[name]:g} %), floor of the "
            f"attitude {floor.mean():.3f} % (worst {floor.max():.3f} %), "
            f"{sum(one['arrived'] for one in rounds)} of {len(rounds)} arrived",
            flush=True,
        )


if __name__ == "__main__":
    sys.exit(command.run(main))
