"""Current filter: a Kalman filter of a glider's position and of the current that carries it.

State: position north and east [m]; relative error of the speed and offset of the compass; what the
dive under way adds and does not pass on; and the modes of the current (`modes`): mean, eddies,
inertial oscillation, tide. Position follows

    dp/dt = (1 + scale) R(offset) v + dive + sum of modes,

v the velocity through the water, R a small turn. The equations are linear and stepped exactly
(Kalman 1960, J. Basic Eng. 82; depth-averaged currents from fixes: Eriksen et al. 2001, IEEE J.
Oceanic Eng. 26(4); tide and other parts of a glider's current from its own dives: Chang, Zhang and
Edwards 2015, J. Atmos. Oceanic Technol. 32(3)).

A surprise beyond `OUTLIER` is taken for an eddy of its size instead of being spread over all modes.
How strong the currents of this deployment are beside the parameters' is learned from the fixes: all
variances have a common factor of unknown size with a conjugate prior, so that what is forecast has
Student's t distribution, whose degrees grow with the fixes (West and Harrison 1997, Bayesian
Forecasting and Dynamic Models, section 4.5, with the forgetting of section 10.8).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import InputError
from twin.navigation.current.current_parameters import (
    CALIBRATION,
    DEGREES,
    DIVE,
    MODES,
    POSITION,
    CurrentParameters,
    even,
    pair,
    square,
)
from twin.navigation.current.modes import (
    LONGEST,
    CurrentForecast,
    Innovation,
    Modes,
    Node,
    SmoothedTrack,
    modes_of,
    passage,
    smoothed,
    transition,
    turns,
)
from twin.numbers import Array

FIX_DEVIATION = 5.0
"""[m] north and east each, of a GPS fix"""
OUTLIER = 9.0
"""[1] squared distance, of two degrees of freedom (mean 2; 1.1 % are beyond), of a surprise"""
KEPT = 0.9
"""[1] part of the degrees beyond the prior's that stays until the next fix: 25 at most"""
LEAST_LEG = 600.0
"""[s] between two fixes that count for both: shorter, the fixes' noise decides"""


class CurrentFilter:
    """Position and current of one vehicle, from measurements in order of time.

    found = CurrentFilter(parameters, latitude=31.5)
    found.fix((0.0, 0.0))
    found.step(3600.0, (0.2, 0.1), 0.02**2 * np.eye(2))
    found.fix((900.0, 300.0))
    ahead = found.forecast(found.time + np.array([3600.0, 7200.0]))

    All methods raise InputError for numbers that are not finite or of another shape.

    Args:
      parameters: of the current; `tune` finds them.
      latitude: [degree] of the deployment.
      time: [s] on any clock, at which it begins.
      memory: [s] over which errors of the velocity through the water are alike: longer than a
        step, they add up along and not in squares.
      record: whether to keep what `smooth` needs, some 20 kB a step.
      outlier: [1] squared distance of a fix beyond which an eddy has come up since the fix before;
        infinity where dives are smoothed: the eddy would come up at their end.
    """

    def __init__(
        self,
        parameters: CurrentParameters | None = None,
        *,
        latitude: float,
        time: float = 0.0,
        memory: float = 60.0,
        record: bool = False,
        outlier: float = OUTLIER,
    ):
        if not (math.isfinite(latitude) and abs(latitude) <= 90.0):
            raise InputError(f"a latitude of {latitude:g} degree; it must be from -90 to 90")
        self.parameters = CurrentParameters() if parameters is None else parameters
        self.latitude, self.memory = float(latitude), float(memory)
        self.modes: Modes = modes_of(self.parameters, latitude)
        self.outlier, self.time = float(outlier), float(time)
        self.degrees = DEGREES
        """[1] of freedom of Student's t, as which forecasts and fixes are distributed"""
        self.inflation = DEGREES / (DEGREES - 2.0)
        """[1] variances of forecasts by those that the parameters alone say"""
        self.size = MODES + 2 * len(self.modes)
        self._mean = np.zeros(self.size)
        own = self.parameters
        variance = [0.0, 0.0, own.speed_scale**2, math.radians(own.compass) ** 2]
        variance += [own.dive**2] * 2
        self._covariance = np.diag([*variance, *np.repeat(self.modes.variance, 2)])
        self._lost, self._since = True, 0.0
        self._velocity: Array | None = None
        self._nodes: list[Node] | None = [] if record else None
        self._note(np.eye(self.size))

    def step(
        self,
        dt: float,
        velocity: ArrayLike | None,
        covariance: ArrayLike | None = None,
        *,
        field: ArrayLike | None = None,
    ) -> None:
        """Pass a time.

        Args:
          dt: [s]
          velocity: north, east through the water [m/s], mean over dt; None: the motion is not
            known, as at the surface, so that only the next fix tells where the vehicle is.
          covariance: [m2/s2], (2, 2), of its error; None: none but the scale and the compass.
          field: north, east [m/s] of a current that a forecast field foretells, mean over dt: the
            filter's current is then what the field lacks.
        """
        if not (math.isfinite(dt) and dt >= 0.0):
            raise InputError(f"a step of {dt:g} s; it must be zero or positive")
        through = None if velocity is None else pair(velocity, "velocity")
        carried = np.zeros(2) if field is None else pair(field, "current")
        spread = np.zeros((2, 2)) if covariance is None else square(covariance, "covariance")
        pieces = max(1, math.ceil(dt / LONGEST))
        for _ in range(pieces if dt > 0.0 else 0):
            part = dt / pieces
            gone = passage(self.modes, round(part, 9))
            carry, noise = transition(gone, part, through, spread, self.memory)
            self._mean = carry @ self._mean
            if through is None:
                self._lost = True
            else:
                self._mean[POSITION] += part * (through + carried)
            self._covariance = even(carry @ self._covariance @ carry.T + noise)
            self.time += part
            self._since += part
            self._velocity = through
            self._note(carry)

    def displace(self, metres: ArrayLike) -> None:
        """Move the position by what is now known of the way before, north and east [m], (2,)."""
        self._mean = self._mean.copy()
        self._mean[POSITION] += pair(metres, "displacement")
        self._note(np.eye(self.size))

    def fix(self, position: ArrayLike, sigma: float = FIX_DEVIATION) -> Innovation | None:
        """A position from GPS.

        Args:
          position: north, east [m], (2,).
          sigma: [m] standard deviation, north and east each.

        Returns:
          The innovation; None where the filter had not known the vehicle's way since the last fix:
          then the fix only says where it is.
        """
        place = pair(position, "position")
        if not (math.isfinite(sigma) and sigma > 0.0):
            raise InputError(f"a fix with a deviation of {sigma:g} m; it must be positive")
        if self._lost:
            self.locate(place, sigma)
            return None
        found = self._update_by_fix(place, sigma)
        self._begin_dive()
        return found

    def locate(self, position: ArrayLike, sigma: float = FIX_DEVIATION) -> None:
        """Begin a dive at a position, as `fix` takes it, which says nothing of the current."""
        self._forget(POSITION, pair(position, "position"), sigma)
        self._begin_dive()

    def _update_by_fix(self, place: Array, sigma: float) -> Innovation:
        residual = place - self._mean[POSITION]
        spread = self._covariance[POSITION, POSITION] + sigma**2 * np.eye(2)
        distance = float(residual @ np.linalg.solve(spread, residual))
        found = Innovation(
            residual=residual, covariance=spread, distance=distance, duration=self._since,
            inflation=self.inflation,
        )  # fmt: skip
        if self._since >= LEAST_LEG:
            # the inverse of the common factor of all variances has a gamma distribution of shape
            # degrees / 2 and mean 1 / centre
            centre = self.inflation * (self.degrees - 2.0) / self.degrees
            kept = DEGREES + KEPT * (self.degrees - DEGREES)
            self.degrees = kept + 2.0
            self.inflation = (kept * centre + distance) / (self.degrees - 2.0)
            if distance > self.outlier:
                self._blame_eddy((distance / self.outlier - 1.0) * spread)
        observed = np.zeros((2, self.size))
        observed[:, POSITION] = np.eye(2)
        self._update(observed, residual, sigma**2 * np.eye(2))
        return found

    def _blame_eddy(self, surprise: Array) -> None:
        """Make room for a surprise [m2] at the fix: an eddy has come up during the dive."""
        name = "eddy" if "eddy" in self.modes.names else "mean"
        first = MODES + 2 * self.modes.names.index(name)
        into = np.zeros((self.size, 2))
        into[POSITION] = np.eye(2)
        into[first : first + 2] = np.eye(2) / self._since
        self._covariance = even(self._covariance + into @ surprise @ into.T)
        self._amend(predicted_covariance=self._covariance, covariance=self._covariance)

    def current_report(
        self, current: ArrayLike, covariance: ArrayLike, *, dive: bool = False
    ) -> None:
        """A current measured or forecast by others, at this time.

        A profiler's, the vehicle's own, or that of a forecast field, whose error lasts: report it
        about once a dive, not once a step.

        Args:
          current: north, east [m/s], (2,).
          covariance: [m2/s2], (2, 2), of its error.
          dive: whether it contains what the dive under way adds (a profiler's does, a forecast
            field's does not).
        """
        observed = self._of_current(dive=dive)
        value = pair(current, "current")
        self._update(observed, value - observed @ self._mean, square(covariance, "covariance"))

    def ground_velocity(self, velocity: ArrayLike, covariance: ArrayLike) -> None:
        """Velocity over ground, by a Doppler log that has lock, at the end of the last step.

        Args:
          velocity: north, east [m/s], (2,).
          covariance: [m2/s2], (2, 2), of its error and of that of the velocity through the water.

        Raises:
          InputError: no step with a velocity came before.
        """
        if self._velocity is None:
            raise InputError(
                "a velocity over ground gives a current only beside one through the water: give "
                "`step` a velocity first"
            )
        observed = self._of_current(dive=True)
        observed[:, CALIBRATION] = turns(np.array(complex(*self._velocity)))
        value = pair(velocity, "velocity") - self._velocity
        self._update(observed, value - observed @ self._mean, square(covariance, "covariance"))

    def _of_current(self, *, dive: bool) -> Array:
        observed = np.zeros((2, self.size))
        observed[:, MODES:] = np.tile(np.eye(2), len(self.modes))
        if dive:
            observed[:, DIVE] = np.eye(2)
        return observed

    def _update(self, observed: Array, residual: Array, spread: Array) -> None:
        """Kalman's update in Joseph's form, which keeps the covariance positive."""
        cross = self._covariance @ observed.T
        gain = np.linalg.solve(observed @ cross + spread, cross.T).T
        left = np.eye(self.size) - gain @ observed
        self._mean = self._mean + gain @ residual
        self._covariance = even(left @ self._covariance @ left.T + gain @ spread @ gain.T)
        self._amend(estimate=self._mean, covariance=self._covariance)

    def _begin_dive(self) -> None:
        """The next dive adds something else."""
        self._lost, self._since = False, 0.0
        self._forget(DIVE, np.zeros(2), self.parameters.dive)

    def _forget(self, part: slice, values: Array, deviation: float) -> None:
        """Put a pair of the state in place of what was known of it."""
        carry = np.eye(self.size)
        carry[part, part] = 0.0
        self._mean = carry @ self._mean
        self._mean[part] = values
        self._covariance = carry @ self._covariance @ carry.T
        self._covariance[part, part] = deviation**2 * np.eye(2)
        self._note(carry)

    @property
    def position(self) -> tuple[Array, Array]:
        """North, east [m], (2,), and its covariance [m2], (2, 2)."""
        return self._mean[POSITION].copy(), self._covariance[POSITION, POSITION].copy()

    @property
    def current(self) -> tuple[Array, Array]:
        """North, east [m/s], (2,), and its covariance [m2/s2], (2, 2), at this time."""
        observed = self._of_current(dive=False)
        return observed @ self._mean, observed @ self._covariance @ observed.T

    @property
    def calibration(self) -> tuple[float, float]:
        """Relative error of the speed [1], and offset of the compass [rad]."""
        scale, offset = self._mean[CALIBRATION]
        return float(scale), float(offset)

    def part(self, name: str) -> Array:
        """North, east [m/s] of one part at this time, such as `mean`, `eddy`, `M2`; 0 without."""
        found = np.zeros(2)
        for mode, values in zip(self.modes.names, self._mean[MODES:].reshape(-1, 2), strict=True):
            if mode.split()[0] == name:
                found += values
        return found

    def forecast(
        self, times: ArrayLike, velocity: ArrayLike | None = None, *, field: ArrayLike | None = None
    ) -> CurrentForecast:
        """The current at later times and the displacement that it makes until then.

        Covariances are those of the filter times `inflation`, which the fixes have taught.

        Args:
          times: [s] on the filter's clock, none before its time, (time,).
          velocity: north, east through the water [m/s] meanwhile, (2,): the displacement then holds
            what the errors of the speed and the compass make of it, too.
          field: north, east [m/s] that a forecast field foretells, as `step` takes it; it is part
            of the displacement, and not of the current.
        """
        moments = np.atleast_1d(np.asarray(times, float))
        ahead, count = moments - self.time, len(moments)
        if not (np.isfinite(ahead).all() and (ahead >= -1e-6).all()):
            raise InputError(
                f"a forecast for {ahead.min():g} s from the filter's time; it must be later"
            )
        through = np.zeros(2) if velocity is None else pair(velocity, "velocity")
        found = CurrentForecast(
            times=moments,
            current=np.empty((count, 2)),
            current_covariance=np.empty((count, 2, 2)),
            displacement=np.empty((count, 2)),
            displacement_covariance=np.empty((count, 2, 2)),
        )
        # a copy that starts at the origin, known exactly
        probe = CurrentFilter(
            self.parameters, latitude=self.latitude, time=self.time, memory=self.memory
        )
        probe.modes, passed = self.modes, 0.0
        probe._mean, probe._covariance = self._mean.copy(), self._covariance.copy()
        probe._mean[POSITION] = 0.0
        probe._covariance[POSITION] = probe._covariance[:, POSITION] = 0.0
        for index in np.argsort(ahead, kind="stable"):
            wait = max(float(ahead[index]) - passed, 0.0)
            probe.step(wait, through, field=field)
            passed += wait
            (current, spread), (place, scattered) = probe.current, probe.position
            found.current[index] = current
            found.current_covariance[index] = self.inflation * spread
            found.displacement[index] = place - passed * through
            found.displacement_covariance[index] = self.inflation * scattered
        return found

    def state(self) -> dict[str, Array]:
        """The filter's knowledge as arrays, for `restore`; the record is not in it."""
        velocity = np.full(2, np.nan) if self._velocity is None else self._velocity
        return {
            "time": np.array(self.time),
            "mean": self._mean.copy(),
            "covariance": self._covariance.copy(),
            "inflation": np.array(self.inflation),
            "degrees": np.array(self.degrees),
            "lost": np.array(float(self._lost)),
            "since_fix": np.array(self._since),
            "velocity": velocity.copy(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state` of a filter with the same parameters."""
        missing = sorted({*self.state()} - {*state})
        if missing:
            raise InputError(f"the state of a current filter lacks {', '.join(missing)}")
        mean = np.asarray(state["mean"], float)
        if mean.shape != (self.size,):
            raise InputError(
                f"the state is of a current filter with {mean.size} numbers, this one has "
                f"{self.size}: make it with the same parameters"
            )
        self._mean, self._covariance = mean.copy(), np.array(state["covariance"], float)
        self.time = float(state["time"])
        self.inflation, self.degrees = float(state["inflation"]), float(state["degrees"])
        self._lost, self._since = bool(state["lost"]), float(state["since_fix"])
        velocity = np.array(state["velocity"], float)
        self._velocity = velocity if np.isfinite(velocity).all() else None
        if self._nodes is not None:
            self._nodes = []
            self._note(np.eye(self.size))

    @property
    def recorded(self) -> int:
        """Nodes that `smooth` will answer for so far; 0 without `record`."""
        return len(self._nodes or ())

    def smooth(self) -> SmoothedTrack:
        """Position and current at every step, by all measurements, of a filter with `record`."""
        if self._nodes is None:
            raise InputError("smoothing needs the steps: make the CurrentFilter with record=True")
        current = self._of_current(dive=False)
        return smoothed(self._nodes, position=POSITION, current=current, dive=DIVE)

    def _note(self, carry: Array) -> None:
        """Record a step to the present state."""
        if self._nodes is not None:
            now = self._mean, self._covariance
            self._nodes.append(Node(self.time, carry, *now, *now))

    def _amend(self, **changes: Any) -> None:
        """Change the last recorded step by a measurement at its time."""
        if self._nodes is not None:
            self._nodes[-1] = self._nodes[-1]._replace(**changes)
