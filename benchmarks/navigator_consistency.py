"""Whether the navigator errs as it says, on simulated missions that surface.

    python -m benchmarks.navigator_consistency STORE [STORE ...] [--learn STORE ...] [--run RUN]
        [--json]

Missions of preset `field`, which `factory generate --preset field --seed NEW` makes. The navigator
dead-reckons each by steady flight, or by the networks of a run, and its current filter takes the
fixes after dives; a Doppler log is not used. What the sea is like, and how far the ellipses reach,
is learned from the fixes of the stores after `--learn`; without them from one half of the missions
for the other (`twin.navigation.current.tuning`).

With halves the chance by which one holds too few is the one by which the other holds too many, so
that the parts of both together are nearer to 50 and 90 % than of as many unseen fixes: judge with
`--learn`.

`nis` is the mean squared normalised innovation (2 is right), `in_50` and `in_90` the parts of the
fixes within the ellipses of 50 and 90 %, `first_dive_m` the mean miss at the fix after the first
dive of a mission, `later_m` after the later ones. Beside them the simple rivals on the same dives:
no current, and the mean current of the dive before.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.generated_store import GeneratedStore
from learn.data.dataset import MissionSequence, Selection
from learn.run import open_run
from twin.navigation.current import Leg, consistency_of
from twin.navigation.estimators.base import BodyVelocity, VelocityDeviation, VelocityEstimator
from twin.navigation.navigator import ATTITUDE, DEPTH, FIX, RATES, Navigator
from twin.seams import VELOCITY_ESTIMATORS
from twin.vehicle.vehicle import Vehicle

Array = NDArray[np.float64]

SAMPLE_S = 4.0
"""[s] between the samples that the navigator is given; the velocities are made of all"""
METHOD = "steady_flight"
CHANNELS = (DEPTH, *ATTITUDE, *FIX, *RATES)


class Given(VelocityEstimator):
    """Velocities that were made before, (time,) each."""

    channels = (DEPTH,)

    def __init__(self, surge: Array, sway: Array, period: float):
        self._rows, self.period = np.stack([surge, sway], axis=1).tolist(), period
        self.reset()

    def reset(self) -> None:
        """See `VelocityEstimator`."""
        self._next = 0

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`."""
        surge, sway = self._rows[self._next]
        self._next += 1
        return BodyVelocity(surge=surge, sway=sway)

    def state(self) -> dict[str, NDArray[Any]]:
        """See `VelocityEstimator`."""
        return {"next": np.array(self._next)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """See `VelocityEstimator`."""
        self._next = int(state["next"])


def legs_of(mission: MissionSequence, surge: Array, sway: Array) -> list[Leg]:
    """The dives of one mission as the navigator has them."""
    signals = mission.signals
    fixes = np.flatnonzero(np.isfinite(signals[FIX[0]]))
    if not fixes.size:
        return []
    every = max(1, round(SAMPLE_S / mission.period))
    rows = np.arange(fixes[0] % every, mission.samples, every)
    navigator = Navigator(
        Given(surge[rows], sway[rows], every * mission.period), latitude=45.0
    )  # the current that it learns does not touch its way through the water
    names = [name for name in CHANNELS if name in signals]
    latest = np.maximum.accumulate(
        np.where(np.isfinite(signals[FIX[0]]), np.arange(mission.samples), -1)
    )
    # a fix between two of these samples counts at the second
    of_fix = np.where(rows - latest[rows] < every, latest[rows], rows)
    given = [signals[name][of_fix if name in FIX else rows] for name in names]
    for values in np.stack(given, axis=1).tolist():
        navigator.step(dict(zip(names, values, strict=True)))
    return navigator.legs


def records(
    store: str, run: str | None
) -> tuple[list[list[Leg]], VelocityDeviation, float, list[float]]:
    """The dives of each mission, what estimator and compass [degree] state, and the latitudes."""
    with GeneratedStore(store) as generated:
        vehicle, compass = generated.vehicle, generated.suite.compass.deviation_deg
        latitudes = generated.array("water_latitude").astype(float).tolist()
    found = [legs_of(*one) for one in _velocities(store, vehicle, run)]
    if run is None:
        return found, VELOCITY_ESTIMATORS[METHOD](vehicle, SAMPLE_S).deviation, compass, latitudes
    return found, open_run(run).velocity_deviation(vehicle), compass, latitudes


def _velocities(
    store: str, vehicle: Vehicle, run: str | None
) -> Iterator[tuple[MissionSequence, Array, Array]]:
    """Missions with surge and sway [m/s], (time,) each."""
    if run is not None:
        known = {one.mission: one for one in open_run(run).predict(store)}
        with Selection(store, CHANNELS) as selection:
            for mission in selection.each():
                one = known[mission.index]
                time = mission.period * np.arange(mission.samples)
                yield mission, *(np.interp(time, one.time, v) for v in (one.surge, one.sway))
        return
    kind = VELOCITY_ESTIMATORS[METHOD]
    with Selection(store, list(dict.fromkeys([*CHANNELS, *kind.needs(vehicle)]))) as selection:
        method = kind(vehicle, selection.period)
        for mission in selection.each():
            found = method.batch(mission.signals)
            yield mission, found.surge, found.sway


def main(words: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("stores", nargs="+", metavar="STORE", help="missions of preset field")
    parser.add_argument(
        "--learn", nargs="+", default=[], metavar="STORE", help="missions that tell of the sea"
    )
    parser.add_argument("--run", help="networks in place of steady flight: a folder")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    options = parser.parse_args(words)
    every: dict[str, list[list[Leg]]] = {"stores": [], "learn": []}
    latitudes: list[float] = []
    for which, kept in every.items():
        for store in getattr(options, which):
            found, stated, compass, where = records(store, options.run)
            kept += found
            latitudes += where
    judged = consistency_of(
        every["stores"],
        others=every["learn"],
        latitude=float(np.median(latitudes)),
        speed_scale=stated.scale,
        compass=compass,
        noise=stated.noise,
        memory=stated.memory,
    )
    figures = {"missions": len(every["stores"]), **dataclasses.asdict(judged)}
    if options.json:
        print(json.dumps(figures))
    else:
        for name, value in figures.items():
            print(f"{name:26s} {'none' if value is None else f'{value:.4g}'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
