"""Current filter: Kalman filter of a glider's position and of the current that carries it.

The state holds position north and east [m]; relative error of the speed and offset of the compass;
the error of the current dive, independent of other dives; and the modes of the current (`modes`):
mean, eddies, inertial oscillation, tide. The position follows

    dp/dt = (1 + scale) R(offset) v + dive + sum of modes,

with the velocity through the water v and a small rotation R. The equations are linear and stepped
exactly (Kalman 1960, J. Basic Eng. 82; depth-averaged currents from fixes: Eriksen et al. 2001,
IEEE J. Oceanic Eng. 26(4); tide and other parts of a glider's current from its own dives: Chang,
Zhang and Edwards 2015, J. Atmos. Oceanic Technol. 32(3)).

An innovation beyond `OUTLIER` raises the eddy's variance instead of being spread over all modes.
The size of this deployment's currents relative to the parameters is estimated from the fixes. All
variances have a common unknown factor with a conjugate prior. Forecasts then have a Student's t
distribution, whose degrees of freedom grow with the fixes (West and Harrison 1997, Bayesian
Forecasting and Dynamic Models, section 4.5, with the forgetting of section 10.8).
"""

from __future__ import annotations

import copy
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
"""[m] Standard deviation of a GPS fix, north and east each"""
OUTLIER = 9.0
"""[1] Squared distance of an innovation (mean 2) above which it is an outlier: 1.1 % are above"""
KEPT = 0.9
"""[1] Fraction of the degrees of freedom above the prior's that a fix keeps; they stay below 25"""
LEAST_LEG = 600.0
"""[s] Shortest time between fixes that updates `inflation`: below, the fixes' noise dominates"""


class CurrentFilter:
    """Filter of one vehicle's position and current, updated by measurements in order of time.

    found = CurrentFilter(parameters, latitude=31.5)
    found.fix((0.0, 0.0))
    found.step(3600.0, (0.2, 0.1), 0.02**2 * np.eye(2))
    found.fix((900.0, 300.0))
    ahead = found.forecast(found.time + np.array([3600.0, 7200.0]))

    All methods raise InputError for numbers that are not finite or of another shape.

    Args:
      parameters: parameters of the current, such as those of `tune`.
      latitude: [degree] of the deployment.
      time: [s] start, on any clock.
      memory: [s] correlation time of the velocity's errors. If it exceeds a step, the errors
        of successive steps add up linearly instead of as squares.
      record: keep the steps for `smooth`, some 20 kB each.
      outlier: [1] squared distance above which a fix shows a new eddy since the last fix. Use
        infinity for smoothing: the eddy would appear only at the dive's end.
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
        """[1] Degrees of freedom of the Student's t distribution of forecasts and fixes"""
        self.inflation = DEGREES / (DEGREES - 2.0)
        """[1] Factor from the variances by the parameters alone to those of forecasts"""
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
        """Propagate the state over a time step.

        Args:
          dt: [s]
          velocity: north, east through the water [m/s], mean over dt; None if the motion is
            unknown, as at the surface, so that only the next fix gives the position.
          covariance: [m2/s2], (2, 2), of the velocity's error; None: scale and compass errors.
          field: north, east [m/s] current of a forecast field, mean over dt; the filter's
            current is then the difference between the true current and the field.
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
        """Shift the position by a later correction of the track so far, north, east [m], (2,)."""
        self._mean = self._mean.copy()
        self._mean[POSITION] += pair(metres, "displacement")
        self._note(np.eye(self.size))

    def fix(self, position: ArrayLike, sigma: float = FIX_DEVIATION) -> Innovation | None:
        """Update with a GPS position.

        Args:
          position: north, east [m], (2,).
          sigma: [m] standard deviation, north and east each.

        Returns:
          The innovation; None if the motion since the last fix is unknown: the fix then only sets
          the position.
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
        """Start a dive at a position, with arguments as in `fix`; the current is not updated."""
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
            # the inverse of the variances' common factor has a gamma distribution of shape
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
        """Raise the eddy's variance by an excess [m2] at the fix: an eddy appeared in the dive."""
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
        """Update with a current that was measured or forecast elsewhere, at the filter's time.

        A profiler, the vehicle itself or a forecast field may give it. Errors are correlated in
        time: report about once a dive, not once a step.

        Args:
          current: north, east [m/s], (2,).
          covariance: [m2/s2], (2, 2), of its error.
          dive: True if the current includes the error of the current dive, as a profiler's does and
            a forecast field's does not.
        """
        observed = self._of_current(dive=dive)
        value = pair(current, "current")
        self._update(observed, value - observed @ self._mean, square(covariance, "covariance"))

    def ground_velocity(self, velocity: ArrayLike, covariance: ArrayLike) -> None:
        """Update with a Doppler log's velocity over ground, at the end of the last step.

        Args:
          velocity: north, east [m/s], (2,).
          covariance: [m2/s2], (2, 2), of its error plus that of the velocity through the water.

        Raises:
          InputError: no earlier step had a velocity.
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
        """Update the state in Kalman's Joseph form, which keeps the covariance positive."""
        cross = self._covariance @ observed.T
        gain = np.linalg.solve(observed @ cross + spread, cross.T).T
        left = np.eye(self.size) - gain @ observed
        self._mean = self._mean + gain @ residual
        self._covariance = even(left @ self._covariance @ left.T + gain @ spread @ gain.T)
        self._amend(estimate=self._mean, covariance=self._covariance)

    def _begin_dive(self) -> None:
        """Start the next dive, with a new error of its own."""
        self._lost, self._since = False, 0.0
        self._forget(DIVE, np.zeros(2), self.parameters.dive)

    def _forget(self, part: slice, values: Array, deviation: float) -> None:
        """Replace a pair of the state, with its covariance, by new values."""
        carry = np.eye(self.size)
        carry[part, part] = 0.0
        self._mean = carry @ self._mean
        self._mean[part] = values
        self._covariance = carry @ self._covariance @ carry.T
        self._covariance[part, part] = deviation**2 * np.eye(2)
        self._note(carry)

    @property
    def position(self) -> tuple[Array, Array]:
        """Position north, east [m], (2,), and its covariance [m2], (2, 2)."""
        return self._mean[POSITION].copy(), self._covariance[POSITION, POSITION].copy()

    @property
    def current(self) -> tuple[Array, Array]:
        """Current north, east [m/s], (2,), and its covariance [m2/s2], (2, 2), at this time."""
        observed = self._of_current(dive=False)
        return observed @ self._mean, observed @ self._covariance @ observed.T

    @property
    def calibration(self) -> tuple[float, float]:
        """Relative error of the speed [1] and offset of the compass [rad]."""
        scale, offset = self._mean[CALIBRATION]
        return float(scale), float(offset)

    def part(self, name: str) -> Array:
        """North, east [m/s] of one mode, such as `mean`, `eddy`, `M2`; 0 without the mode."""
        found = np.zeros(2)
        for mode, values in zip(self.modes.names, self._mean[MODES:].reshape(-1, 2), strict=True):
            if mode.split()[0] == name:
                found += values
        return found

    def forecast(
        self, times: ArrayLike, velocity: ArrayLike | None = None, *, field: ArrayLike | None = None
    ) -> CurrentForecast:
        """Forecast the current at later times, and the displacement by it until then.

        The filter's covariances are multiplied by `inflation`, which the fixes determine.

        Args:
          times: [s] on the filter's clock, not before the filter's time, (time,).
          velocity: north, east through the water [m/s] until then, (2,); the displacement then
            includes the effect of speed and compass errors.
          field: north, east [m/s] current of a forecast field, as in `step`; it adds to the
            displacement, but not to the current.
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
        # forecast with a copy whose position is exactly the origin
        probe, passed = copy.copy(self), 0.0
        probe._nodes = None
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
        """Arrays that `restore` continues from, without the record of steps."""
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
        """Continue from the `state` of a filter with the same parameters."""
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
        """Number of nodes recorded for `smooth`; 0 without `record`."""
        return len(self._nodes or ())

    def smooth(self) -> SmoothedTrack:
        """Smooth position and current at every step with all measurements; needs `record`."""
        if self._nodes is None:
            raise InputError("smoothing needs the steps: make the CurrentFilter with record=True")
        current = self._of_current(dive=False)
        return smoothed(self._nodes, position=POSITION, current=current, dive=DIVE)

    def _note(self, carry: Array) -> None:
        """Record a step that ends at the present state."""
        if self._nodes is not None:
            now = self._mean, self._covariance
            self._nodes.append(Node(self.time, carry, *now, *now))

    def _amend(self, **changes: Any) -> None:
        """Change the last recorded step after a measurement at its time."""
        if self._nodes is not None:
            self._nodes[-1] = self._nodes[-1]._replace(**changes)
