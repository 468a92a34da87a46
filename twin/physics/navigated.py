"""Navigated runs: guidance sees measurements and the navigator's estimate, never the truth.

The vehicle's sensors measure every sample; the navigator estimates position, velocity and current.
The compiled guidance, called from Python, reads measured depth, attitude, rates, part positions and
altitude, with the estimated position and current. A sample is complete one physics step after its
time, so a command acts one step later too.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from twin.errors import InputError
from twin.mission.controller import MissionController, Observation
from twin.mission.plan import Mission
from twin.mission.reckoning import ALTITUDE_S, OUT_OF_REACH
from twin.navigation.navigator import (
    ATTITUDE,
    DEPTH,
    FIX,
    LOCK,
    LOG,
    RATES,
    NavigationState,
    Navigator,
)
from twin.navigation.settings import CTD, Navigation
from twin.numbers import Array
from twin.physics.outcome import HYDROGRAPHY
from twin.physics.true_signals import declare_parts
from twin.sensors.base import Surroundings
from twin.sensors.live import LiveSuite

if TYPE_CHECKING:
    from twin.physics.scenario import Scenario
    from twin.water.density import DensityProfile


ALTITUDE = "measured_altitude"


class OnBoard:
    """Sensors, navigator and estimated track of one vehicle during a run."""

    def __init__(
        self,
        scenario: Scenario,
        names: tuple[str, ...],
        samples: int,
        *,
        floor: Array,
        current: Array,
    ):
        """Prepare for the first sample.

        Args:
          scenario: a scenario with `navigate`.
          names: names of the true and commanded signals, `LiveTruth.names`.
          samples: largest number of samples of the run.
          floor, current: compiled tables; empty if absent.

        Raises:
          InputError: no sensor measures a channel of the estimator, or two sea floors are given.
        """
        settings = scenario.navigate
        assert isinstance(settings, Navigation)
        self._suite = suite = settings.suite
        self.vehicle, self.period = scenario.vehicle, scenario.sample_period
        declare_parts(self.vehicle)
        estimator = settings.open(scenario.believed_vehicle, self.period)
        begin = scenario.begin
        self.navigator = Navigator(
            estimator,
            latitude=scenario.place.latitude_deg,
            period=self.period,
            start=(begin.north, begin.east),
            current=settings.current,
            compass=settings.compass_deviation if settings.current is None else None,
        )
        self._scales = {part.name: part.quantity.scale for part in self.vehicle.parts}
        wanted = [
            *self.navigator.channels,
            *FIX,
            *RATES,
            *(f"measured_{name}" for name in self._scales),
            *([ALTITUDE] if floor.size else []),
            *((*LOG, LOCK) if floor.size or settings.bottom_depth is not None else []),
        ]
        self._water: DensityProfile | None = None
        missing = self._missing(names)
        profile = scenario.density
        if missing and profile is not None and profile.temperature_salinity(0.0) is not None:
            self._water = profile
            names = (*names, *HYDROGRAPHY)
            missing = self._missing(names)
        if missing:
            water = "" if self._water is not None or CTD not in missing else (
                ", or, for a CTD, a density profile with temperature and salinity"
            )  # fmt: skip
            raise InputError(
                f"the estimator reads {', '.join(missing)}, which the sensors of this vehicle do "
                f"not measure: choose another estimator or sensors that have it{water}"
            )
        if settings.bottom_depth is not None and floor.size:
            raise InputError(
                "give a floor or a bottom_depth, not both: the sensors see the scenario's floor"
            )
        self._commanded = [n for n in self.navigator.channels if n.startswith("commanded_")]
        self.sensors = LiveSuite(
            suite,
            names,
            samples,
            dt=self.period,
            rng_seed=np.random.SeedSequence(settings.seed),
            surroundings=Surroundings(
                latitude=scenario.place.latitude_deg,
                longitude=scenario.place.longitude_deg,
                density=scenario.density,
                bottom_depth=settings.bottom_depth,
                floor=floor if floor.size else None,
                current=current if current.size else None,
            ),
            wanted=[name for name in wanted if name.startswith("measured_")],
            faults=scenario.faults,
        )
        self._track = np.full((2, samples), np.nan)
        self._sample: dict[str, float] = {}
        self._altitude, self._echo_age = math.inf, math.inf
        self.belief: NavigationState | None = None

    def _missing(self, names: tuple[str, ...]) -> list[str]:
        """Channels of the estimator that the sensors cannot measure from these signals."""
        known = {*(entry.name for entry in self._suite.writes(names)), *names}
        return [n for n in self.navigator.channels if n not in known or n.startswith("true_")]

    def take(self, truth: dict[str, float]) -> NavigationState:
        """Measure one sample of the true signals and update the navigator with it."""
        if self._water is not None:
            water = self._water.temperature_salinity(np.array([truth["true_depth"]]))
            assert water is not None
            truth = truth | {n: float(v[0]) for n, v in zip(HYDROGRAPHY, water, strict=True)}
        sample = self.sensors.step(truth)
        for name in self._commanded:
            sample[name] = truth[name]
        self._sample = sample
        self.belief = self.navigator.step(sample)
        at = self.sensors.count - 1
        self._track[:, at] = self.belief.north, self.belief.east
        if ALTITUDE in sample:
            self._echo_age += self.period
            if math.isfinite(sample[ALTITUDE]):
                self._altitude, self._echo_age = sample[ALTITUDE], 0.0
            elif self._echo_age > ALTITUDE_S:
                self._altitude = OUT_OF_REACH
        return self.belief

    def seen(self, name: str) -> float:
        """Last reading of a channel, in the schema's unit."""
        return self._sample[name]

    def observe(self, time: float) -> Observation:
        """Make guidance's observation at `time` [s] from the last sample."""
        assert self.belief is not None
        seen, belief = self._sample, self.belief
        roll, pitch, heading = (math.radians(seen[name]) for name in ATTITUDE)
        roll_rate, pitch_rate, yaw_rate = (seen[name] for name in RATES)
        parts = {name: seen[f"measured_{name}"] / scale for name, scale in self._scales.items()}
        navigated = ("north", "east", "current_north", "current_east")
        return Observation(
            time=time, depth=seen[DEPTH], altitude=self._altitude,
            roll=roll, pitch=pitch, heading=heading,
            roll_rate=roll_rate, pitch_rate=pitch_rate, yaw_rate=yaw_rate,
            parts=parts, fixed=math.isfinite(seen[FIX[0]] + seen[FIX[1]]),
            **{name: getattr(belief, name) for name in navigated},
        )  # fmt: skip

    def signals(self) -> dict[str, Array]:
        """Measured signals and estimated on-board track so far, each (samples,)."""
        count = self.sensors.count
        north, east = self._track[:, :count].copy()
        return {
            **self.sensors.measured(),
            "measured_onboard_north": north,
            "measured_onboard_east": east,
        }

    def innovations(self) -> list[float]:
        """Squared innovation [1] of each fix that ended a dive, normalised by its covariance."""
        return [float(one.normalised) for one in self.navigator.innovations]


def guidance_of(scenario: Scenario) -> MissionController | None:
    """Controller in Python for a scenario's mission; None without a mission.

    Raises:
      InputError: the mission is a schedule, or a compass offset is set next to a compass.
    """
    if scenario.compass_offset:
        raise InputError(
            "a navigated run has a compass with errors of its own: leave compass_offset out, or "
            "give it to the sensors (Compass(offset_deg=...))"
        )
    if isinstance(scenario.mission, Mission):
        return MissionController(scenario.mission_in_metres(), scenario.believed_vehicle)
    if scenario.mission is not None:
        raise InputError("a schedule sees no position: leave navigate out, or fly a mission")
    return None
