"""Navigator consistency: errors against stated uncertainty, on simulated missions that surface.

    python -m benchmarks.navigator_consistency STORE [STORE ...] [--learn STORE ...] [--run RUN]
        [--json]

Missions are of preset `field`, made by `factory generate --preset field --seed NEW`. The navigator
dead-reckons by steady flight, or by a run's networks; its current filter uses the fixes after
dives, but no Doppler log. The current's parameters and the ellipses' sizes are fitted to the stores
after `--learn`, or without them to one half of the missions for the other
(`twin.navigation.current.tuning`).

With halves, if one has few fixes inside its ellipses, the other has many. The fractions of both
together are then closer to 50 and 90 % than on unseen data: judge with `--learn`.

`nis` is the mean normalised squared innovation (2 is right). `in_50` and `in_90` are the fractions
of fixes within the 50 and 90 % ellipses. `first_dive_m` is the mean error at the fix after a
mission's first dive, `later_m` after later ones. Two rivals on the same dives are printed beside
these figures: no current, and the mean current of the dive before.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import command
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
"""[s] Period of the navigator's samples; the velocities use all samples"""
METHOD = "steady_flight"
CHANNELS = (DEPTH, *ATTITUDE, *FIX, *RATES)


class Given(VelocityEstimator):
    """Estimator that returns given velocities, (time,) each."""

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
    """Dives of one mission, as the navigator records them."""
    signals = mission.signals
    fixes = np.flatnonzero(np.isfinite(signals[FIX[0]]))
    if not fixes.size:
        return []
    every = max(1, round(SAMPLE_S / mission.period))
    rows = np.arange(fixes[0] % every, mission.samples, every)
    navigator = Navigator(
        Given(surge[rows], sway[rows], every * mission.period), latitude=45.0
    )  # the filter's current does not change the track through the water
    names = [name for name in CHANNELS if name in signals]
    latest = np.maximum.accumulate(
        np.where(np.isfinite(signals[FIX[0]]), np.arange(mission.samples), -1)
    )
    # a fix between two of these samples moves to the second
    of_fix = np.where(rows - latest[rows] < every, latest[rows], rows)
    given = [signals[name][of_fix if name in FIX else rows] for name in names]
    for values in np.stack(given, axis=1).tolist():
        navigator.step(dict(zip(names, values, strict=True)))
    return navigator.legs


def records(
    store: str, run: str | None
) -> tuple[list[list[Leg]], VelocityDeviation, float, list[float]]:
    """Dives of each mission, stated errors of estimator and compass [degree], and latitudes."""
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
    """Missions with their surge and sway [m/s], (time,) each."""
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


def main(
    stores: command.Positional[tuple[str, ...]],
    *,
    learn: tuple[str, ...] = (),
    run: str | None = None,
    json: bool = False,
) -> None:
    """Print the consistency figures.

    Args:
      stores: missions of preset field.
      learn: stores to which the current's parameters are fitted.
      run: folder of networks in place of steady flight.
    """
    every, latitudes = [], []
    for which in (stores, learn):
        kept: list[list[Leg]] = []
        for store in which:
            found, stated, compass, where = records(store, run)
            kept += found
            latitudes += where
        every.append(kept)
    judged = consistency_of(
        every[0], others=every[1], latitude=float(np.median(latitudes)),
        speed_scale=stated.scale, compass=compass, noise=stated.noise, memory=stated.memory,
    )  # fmt: skip
    figures = {"missions": len(every[0]), **dataclasses.asdict(judged)}
    command.say(figures, [{"figure": k, "value": v} for k, v in figures.items()], json=json)


if __name__ == "__main__":
    sys.exit(command.run(main))
