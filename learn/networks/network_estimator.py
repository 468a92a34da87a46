"""Network estimator: a trained run as an estimator of velocity, sample by sample on board.

`NetworkFlight` is the estimator of `twin flight --estimator network:RUN`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from learn.networks.familiarity import HELD_TO, widened
from learn.networks.predictor import Ensemble, Prediction
from learn.networks.shipped_velocities import predict_shipped
from learn.run import TARGETS, Run, open_run
from learn.shipped import MISSING, shipped_run
from twin.errors import InputError, StoreError
from twin.identify.calibration import Calibration
from twin.identify.logged_missions import Log
from twin.identify.translation import Translation, Velocity
from twin.logs.flight_estimator import FlightEstimator
from twin.navigation.channel_guard import ChannelGuard
from twin.navigation.estimators.base import (
    BodyVelocity,
    State,
    VelocityDeviation,
    VelocityEstimator,
)
from twin.navigation.features import FeatureSteps, channels_of
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.flight_filter_kernels import OUTPUTS
from twin.navigation.settings import ADAPTED, ESTIMATED, MIXED, sources
from twin.records.reader import MissionStore
from twin.records.schema.limits import simulated_limits
from twin.records.storage.store_path import StorePath
from twin.vehicle.vehicle import Vehicle
from twin.water.density import standard_density

FASTEST = simulated_limits("true_surge")[1]
"""[m/s] Limit of a network's absolute output; larger velocities are clipped"""


class NetworkVelocity(VelocityEstimator):
    """Surge and sway by the networks of a run, equal to `Run.predict` to rounding of float32.

    `ChannelGuard` replaces an impossible sensor value by the last good value; `held` names these
    channels. The stated error is the error on validation missions. The difference between members
    of an ensemble would omit errors of vehicle and sensors, which all members share. The caller
    solves heave from the vertical velocity.
    """

    kind = "network"
    summary = "networks of a run of `learn fit`, network:RUN; network alone: the shipped ones"
    takes = "RUN"

    def __init__(
        self,
        networks: Mapping[str, Ensemble],
        period: float,
        vehicle: Vehicle | None = None,
        deviation: VelocityDeviation | None = None,
        optional: Collection[str] = (),
    ):
        """Start before the first sample.

        Args:
          networks: ensembles `surge` and `sway`.
          period: [s] sample period of the training.
          vehicle: vehicle with its file's parameters; needed if networks read estimated channels.
          deviation: stated standard deviation, such as `Run.velocity_deviation`; None: not stated.
          optional: channels that a sample may lack; the standard ocean's density replaces them.

        Raises:
          InputError: the vehicle is needed, and is missing or does not suit the flight filter.
        """
        self.period = period
        self._adapted = networks["surge"].adapted
        self._familiar = networks["surge"].familiar
        self._deviation = VelocityDeviation() if deviation is None else deviation
        self._tether = networks["surge"].tether
        self._known = {name: networks[name].interval or math.inf for name in TARGETS}
        self._members = {name: networks[name].members for name in TARGETS}
        names = dict.fromkeys(
            feature
            for members in self._members.values()
            for one in members
            for feature in one.features
        )
        self._features = FeatureSteps(list(names), period)
        read = sources(self._features.channels)
        self._optional = tuple(optional)
        self.channels = tuple(name for name in read if name not in optional)
        self._guard = ChannelGuard(read, period)
        self._flight: FlightFilter | None = None
        self._second: FlightFilter | None = None
        if set(self._features.channels) & set(ESTIMATED):
            if vehicle is None:
                raise InputError(
                    "these networks read the flight filter, which needs a vehicle: "
                    "NetworkVelocity(networks, period, vehicle)"
                )
            spread = networks["surge"].spread
            self._flight = FlightFilter(vehicle, period, spread)
            if self._adapted is not None:
                self._second = FlightFilter(vehicle, period, spread, self._adapted.start)
        place = {name: k for k, name in enumerate(names)}
        self._columns = {
            name: [np.array([place[f] for f in one.features], int) for one in members]
            for name, members in self._members.items()
        }
        self.reset()

    @classmethod
    def open(cls, argument: str, vehicle: Vehicle, period: float) -> Self:
        """Open the run in the folder `argument`, with its training's sample period; without one,
        the shipped networks.

        Raises:
          InputError: no shipped networks suit the vehicle. StoreError: the folder holds no run.
        """
        optional: tuple[str, ...] = ()
        if argument:
            run = open_run(argument)
        else:  # a vehicle without a CTD is usual
            whole = sources(channels_of(shipped_run(vehicle, period)[0].features))
            run, optional = shipped_run(vehicle, period, set(whole) - set(MISSING["ctd"]))
        stated = run.velocity_deviation(vehicle)
        return cls(run.networks(vehicle), run.period, vehicle, stated, optional)

    @property
    def deviation(self) -> VelocityDeviation:
        """See `VelocityEstimator`."""
        return self._deviation

    @property
    def outside(self) -> float | None:
        """Out-of-distribution score, above 1 if the hull so far is unlike the training's, or if a
        channel was without a good value for long (`ChannelGuard.lost`); None: no hulls are known.
        """
        if self._flight is None or self._familiar is None:
            return None
        constants = np.array([value for value, _ in self._flight.constants.values()])
        return max(self._guard.lost, self._familiar.outside(constants)[0])

    @property
    def intervals(self) -> dict[str, float]:
        """[m/s] Half-width of the interval with 68 % of the errors of `surge` and `sway` at the
        last sample (`learn.evaluation.deviation`); infinite without validation."""
        outside = max(self._guard.lost, self.outside or 0.0)
        found = {name: widened(known, outside) for name, known in self._known.items()}
        if self._adapted is not None:
            found["surge"] = float(self._adapted.interval(self._known["surge"], *self._mixed))
        return found

    @property
    def held(self) -> tuple[str, ...]:
        """Channels in which the last good value replaces the value of the last sample."""
        return self._guard.held

    def reset(self) -> None:
        """See `VelocityEstimator`."""
        self._guard.reset()
        self._features.reset()
        for flight in (self._flight, self._second):
            if flight is not None:
                flight.reset()
        self._lasting = 0.0  # see `Tether.step`
        self._mixed = (0.0, 0.0)  # second filter: 1 in a steady glide, surge's std deviation
        self._states = {
            name: [one.network.begin() for one in members]
            for name, members in self._members.items()
        }

    def step(self, sample: Mapping[str, float]) -> BodyVelocity:
        """See `VelocityEstimator`; zero until every channel has had a good value."""
        for name in self._optional:
            if not math.isfinite(sample.get(name, math.nan)):
                sample = {**sample, name: float(standard_density(sample["measured_depth"]))}
        kept = self._guard.step(sample)
        if kept is None:
            return BodyVelocity(surge=0.0, sway=0.0)
        sample = kept
        if self._flight is not None:
            said = dict(zip(ESTIMATED, self._flight.step(sample), strict=True))
            if self._second is not None:
                second = self._second.step(sample)
                said |= {c: second[OUTPUTS.index(n)] for c, n in zip(ADAPTED, MIXED, strict=True)}
            sample = {**sample, **said}
        seen = self._features.step(sample).astype(np.float32)
        mean = {}
        for name, members in self._members.items():
            each = []
            for k, one in enumerate(members):
                value, self._states[name][k] = one.step(
                    seen[self._columns[name][k]], self._states[name][k]
                )
                each.append(value)
            value = bounded(float(np.mean(each)))
            if name == "surge" and self._tether is not None:
                nearest = sample[HELD_TO[self._adapted is not None]]
                self._lasting, off = self._tether.step(self._lasting, value - nearest, self.period)
                value -= off
            if name == "surge" and self._adapted is not None:
                filtered, steady, sd = (sample[c] for c in ADAPTED)
                self._mixed = steady, sd
                value += self._adapted.weight(*self._mixed) * (filtered - value)
            mean[name] = bounded(value)
        return BodyVelocity(surge=mean["surge"], sway=mean["sway"])

    def state(self) -> dict[str, NDArray[Any]]:
        """See `VelocityEstimator`."""
        found: dict[str, NDArray[Any]] = {
            f"features:{name}": value for name, value in self._features.state().items()
        } | {f"guard:{name}": value for name, value in self._guard.state().items()}
        for prefix, flight in (("flight:", self._flight), ("second:", self._second)):
            if flight is not None:
                found |= {prefix + name: value for name, value in flight.state().items()}
        for name, states in self._states.items():
            found |= {f"{name}-{k}": np.array(one) for k, one in enumerate(states)}
        return found | {"lasting": np.array(self._lasting)}

    def restore(self, state: State) -> None:
        """See `VelocityEstimator`.

        Raises:
          InputError: the state is of other networks.
        """
        for name, states in self._states.items():
            for k, one in enumerate(states):
                saved = state.get(f"{name}-{k}")
                if saved is None or saved.shape != tuple(one.shape):
                    raise InputError(
                        "this state is of other networks: open the run that it was saved of"
                    )
                states[k] = np.array(saved, np.float32)
        self._lasting = float(state.get("lasting", 0.0))
        self._guard.restore(_below("guard:", state))
        self._features.restore(_below("features:", state))
        for prefix, flight in (("flight:", self._flight), ("second:", self._second)):
            if flight is not None:
                flight.restore(_below(prefix, state))


def bounded(value: float) -> float:
    """Clip a velocity [m/s] to FASTEST; 0 for NaN."""
    return min(max(value, -FASTEST), FASTEST) if value == value else 0.0


def _below(prefix: str, state: State) -> dict[str, NDArray[Any]]:
    """Entries whose names begin with `prefix`, by their names without it."""
    return {k[len(prefix) :]: v for k, v in state.items() if k.startswith(prefix)}


class NetworkFlight(FlightEstimator):
    """Surge and sway by the networks of a run; heave is solved from the vertical velocity."""

    kind = "network"
    summary = (
        "surge and sway by the networks of a run of `learn fit`, network:RUN; network alone: the "
        "shipped ones"
    )

    def __init__(self, run: Run | None):
        """Create the estimator; None: the shipped networks that suit the store."""
        self.run = run
        self._predictions: dict[StorePath, dict[int, Prediction]] = {}

    @classmethod
    def open(cls, argument: str) -> Self:
        """Open the run in the folder `argument`; without one, the shipped networks.

        Raises:
          StoreError: the folder holds no run.
        """
        return cls(open_run(argument) if argument else None)

    def motion(
        self, store: MissionStore, log: Log, calibration: Calibration, start: Velocity
    ) -> Translation:
        """See `FlightEstimator.motion`; a run of longer period is interpolated linearly."""
        if store.path not in self._predictions:
            found = (
                predict_shipped(store.path) if self.run is None else self.run.predict(store.path)
            )
            self._predictions[store.path] = {one.mission: one for one in found}
        known = self._predictions[store.path]
        if log.index not in known:
            raise StoreError(
                f"the networks' velocities lack mission {log.index} of {store.path}; leave it out "
                "with --missions"
            )
        one = known[log.index]
        time = log.period * np.arange(len(log.depth))
        surge, sway = (np.interp(time, one.time, values) for values in (one.surge, one.sway))
        return Translation(surge=surge, sway=sway, heave=np.full(len(time), np.nan))
