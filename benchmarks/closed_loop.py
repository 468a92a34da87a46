"""Closed loop: a box flown on the on-board estimate, `python -m benchmarks.closed_loop`.

The vehicle flies round a square under water without a fix and steers by its own dead reckoning; the
square lies in another direction for each seed. Printed is how far from its start it truly is when
it believes to be back, in percent of the way, for sensors without errors and with those of `field`.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math

import numpy as np

import twin
from twin.mission.segments import Waypoint
from twin.navigation.settings import Navigation
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation

GOALS = {"ideal": 0.3, "field": 1.5}
"""[%] of the way"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Closed:
    """One round."""

    sensors: str
    seed: int
    distance: float
    """[m] over ground"""
    error: float
    """[m] from the start when it believes to be there"""
    navigation: float
    """[m] between belief and truth there"""
    arrived: bool

    @property
    def percent(self) -> float:
        """Of the way."""
        return 100.0 * self.error / self.distance


def box(side: float, turn: float = 0.0, depth: float = 150.0) -> twin.Mission:
    """Round a square of this side [m], turned by an angle [rad], in yos down to `depth` [m]."""
    ahead, beside = side * math.cos(turn), side * math.sin(turn)
    corners = ((ahead, beside), (ahead - beside, ahead + beside), (-beside, ahead), (0.0, 0.0))
    return twin.Mission(
        name="box",
        segments=[
            Waypoint(
                targets=tuple({"north_m": n, "east_m": e} for n, e in corners),
                max_depth_m=depth,
                min_depth_m=15.0,
                pitch_deg=26.0,
                arrival_radius_m=10.0,
                surface_at_target=False,
                renewed="continuously",
            )
        ],
    )


def fly(side: float, sensors: str, seed: int, estimator: str = "ekf") -> Closed:
    """One round of the box."""
    navigate = Navigation(estimator=estimator, sensors=sensors, seed=seed)
    mission = box(side, np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi))
    run = Simulation(Scenario(plan=mission, navigate=navigate)).run()
    segment = run["commanded_segment"]
    back = np.flatnonzero(segment >= 4)
    at = int(back[0]) if back.size else len(segment) - 1
    north, east = run["true_north"], run["true_east"]
    believed = run["measured_onboard_north"][at], run["measured_onboard_east"][at]
    return Closed(
        sensors=sensors,
        seed=seed,
        distance=float(np.hypot(np.diff(north[: at + 1]), np.diff(east[: at + 1])).sum()),
        error=float(np.hypot(north[at], east[at])),
        navigation=float(np.hypot(north[at] - believed[0], east[at] - believed[1])),
        arrived=bool(back.size),
    )


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=float, default=2000.0, help="[m] of the box")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--estimator", default="ekf")
    parser.add_argument("--sensors", choices=tuple(GOALS), help="one suite; default: both")
    parser.add_argument("--json", action="store_true", help="print every round")
    options = parser.parse_args()
    for sensors in [options.sensors] if options.sensors else GOALS:
        goal = GOALS[sensors]
        rounds = [fly(options.side, sensors, k, options.estimator) for k in range(options.seeds)]
        if options.json:
            print(json.dumps([dataclasses.asdict(one) for one in rounds]))
            continue
        percent = np.array([one.percent for one in rounds])
        print(
            f"{sensors}: back within {percent.mean():.3f} % of the way (mean of {len(rounds)} "
            f"seeds; worst {percent.max():.3f} %, goal {goal:g} %), "
            f"{sum(one.arrived for one in rounds)} of {len(rounds)} arrived"
        )


if __name__ == "__main__":
    main()
