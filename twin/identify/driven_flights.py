"""Driven flights: simulated runs of a propelled vehicle with the measured attitude.

The log gives the attitude, the body's rates and the positions of the parts. The three equations of
translation are integrated as in a glider's flight model (`twin.identify.translation`), with the
whole Fossen model: thrust, fins, moving masses, hull law. At every sample the same equations give
the angular acceleration. From it and the measured rates follow pitch and yaw rate one second ahead.
REMUS 100 with fins at rest is unstable in yaw (Prestero 2001): an error grows threefold a second.
Rates can therefore not be predicted for longer from the positions of the parts.

Residuals are those of a Doppler log's surge and sway, of the depth rate, and of pitch and yaw rate.
With bottom lock a Doppler log measures the current too. The current of each run is an unknown of
the fit, which differs from a speed error if the run has several headings. The scale of the Doppler
log and the three angles of its mount are unknowns of each run too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit
from twin.errors import InputError
from twin.fossen.equations import acceleration
from twin.fossen.forces import ForceParameters, density_at, displaced_mass, parameters_of, pumped
from twin.frames import euler_to_matrix
from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import ComparedQuantity, Comparison
from twin.identify.driven_runs import DrivenRun
from twin.identify.translation import Translation
from twin.identify.unknowns import UnknownParameter
from twin.mission.glide_balance import mass_matrix, surplus_at
from twin.vehicle.vehicle import Vehicle

PIECE = 20.0
"""[s] Duration of a run's independent windows: three times the settling time of surge"""
SETTLE = 15.0
"""[s] Time after the start of a run or a gap that is not compared"""
START = 1.0
"""[s] Time over which the median of the measured velocity is the initial velocity"""
LEAD = 1.0
"""[s] Time ahead for which rates are predicted"""
STEP = 0.1
"""[s] Longest step of the integration"""
CURRENT = 0.2
"""[m/s] Spread of each component of a run's current"""
PITCH = math.radians(0.25)
"""[rad] Spread of the pitch sensor's zero from run to run: data sheets of attitude sensors, and the
gyroscope's bias, which is another each time that it is switched on"""
SENSORS = ("pitch_offset", "dvl_scale", *(f"dvl_turn_{axis}" for axis in "xyz"))
"""Sensor errors that are unknown in each run"""
DOPPLER_SCALE, DOPPLER_TURN = 0.005, math.radians(0.5)
"""Spreads in each run, the shipped instrument's (`twin.sensors.dvl`). DOPPLER_SCALE: [1] of a
Doppler log's scale. DOPPLER_TURN: [rad] of its angle about each axis of its mount"""
LONGEST_CORRELATION = 60.0
"""[s] Longest lag over which autocorrelation is summed"""
CHANNELS = {
    "surge": ("m s-1", 0.005),
    "sway": ("m s-1", 0.005),
    "depth_rate": ("m s-1", 0.005),
    "pitch_rate": ("rad s-1", math.radians(0.2)),
    "yaw_rate": ("rad s-1", math.radians(0.2)),
}
"""Unit of each channel and lower bound of its standard deviation: noise of a Doppler log and of a
pressure sensor. Bounds of the rates one second ahead are the effect of a fin that moves between
two samples. A gyroscope's own noise is a tenth of that: with it as the bound, every manoeuvre would
be an outlier, and the other samples hardly determine the moments."""
FASTEST = 20.0
"""[m/s] Speed that no such vehicle reaches"""


class DrivenMotion(NamedTuple):
    """Motion of a vehicle in a run; arrays are (time,)."""

    velocity: Translation
    """Velocity through the water"""
    depth_rate: Array
    """[m/s] Depth rate through the run's filter"""
    turning: Array
    """[rad/s2] Roll, pitch, yaw acceleration, body FRD, (3, time); mean until the next sample"""


def fly_run(
    run: DrivenRun, calibration: Calibration, current: Array, offset: float = 0.0
) -> DrivenMotion:
    """Simulate a run with its measured attitude.

    Args:
      current: north, east [m/s], (2,), subtracted from a velocity over ground at the start.
      offset: true minus measured pitch [rad], in addition to the calibration's.

    Raises:
      InputError: the vehicle cannot fly the run.
    """
    depths, densities = run.density or (np.zeros(1), np.array([calibration.water_density]))
    pitch = calibration.true_pitch(run.pitch) + offset
    turned = euler_to_matrix(run.roll, pitch, run.heading)
    steps = max(1, math.ceil(run.period / STEP - 1e-9))
    starts = run.use.copy()
    starts[1:] &= ~run.use[:-1]
    begun = np.full((len(pitch), 3), np.nan)
    for first in np.flatnonzero(starts):
        begun[first] = _start(run, int(first), calibration.vehicle, turned[first], current)
    velocity, turning = _fly(
        parameters_of(calibration.vehicle, depths, densities, np.zeros(0), np.zeros(0)),
        run.depth,
        np.ascontiguousarray(turned[:, 2, :]),
        np.ascontiguousarray(run.rates.T),
        np.ascontiguousarray(run.positions),
        run.use,
        begun,
        run.period,
        steps,
        np.array([part.lag for part in calibration.vehicle.parts]),
        _rolled(calibration.vehicle, run.positions[0]),
    )
    if not (np.abs(velocity) < FASTEST).all():
        raise InputError(
            f"vehicle {calibration.vehicle.name!r} does not fly run {run.index}: it leaves "
            f"{FASTEST:g} m/s; look at the units and signs of its parts"
        )
    motion = Translation(surge=velocity[:, 0], sway=velocity[:, 1], heave=velocity[:, 2])
    return DrivenMotion(
        velocity=motion,
        depth_rate=run.filtered(motion.sink_rate(run.roll, pitch)),
        turning=turning.T,
    )


@jit
def _change(  # type: ignore[no-untyped-def]
    p: ForceParameters, depth, down, rates, positions, velocity, still, flat, rolling, rolled
):
    """Acceleration (6,) [m/s2, rad/s2] at this attitude with the roll acceleration `rolling`."""
    nu = np.empty(6)
    nu[:3], nu[3:] = velocity, rates
    displaced = displaced_mass(p, depth, pumped(p, positions)[0])
    change = acceleration(
        p, down, depth, nu, positions, displaced, density_at(p, depth), still, still, flat
    )
    return change + rolled * (rolling - change[3])


@jit
def _fly(  # type: ignore[no-untyped-def]
    p: ForceParameters, depth, down, rates, positions, use, begun, period, steps, lags, rolled
) -> Any:
    """Velocity and angular acceleration (time, 3), by Heun's method; 0 while the run is not used.

    Between samples a part moves with its lag [s] towards a constant command, and attitude and rates
    are linear. The angular acceleration is the mean until the next sample.
    """
    count = depth.size
    velocity, turning = np.zeros((count, 3)), np.zeros((count, 3))
    still, flat = np.zeros(3), np.zeros((3, 3))
    now = np.zeros(3)
    h = period / steps
    for k in range(count):
        if not use[k]:
            continue
        if not np.isnan(begun[k, 0]):
            now = begun[k].copy()
        velocity[k] = now
        if k == count - 1 or not use[k + 1]:
            continue
        rolling = (rates[k + 1, 0] - rates[k, 0]) / period
        change = _change(
            p, depth[k], down[k], rates[k], positions[k], now, still, flat, rolling, rolled
        )
        for step in range(steps):
            a = (step + 1.0) / steps
            gone = (1.0 - np.exp(-a * period / lags)) / (1.0 - np.exp(-period / lags))
            first = change
            sunk = depth[k] + a * (depth[k + 1] - depth[k])
            below = down[k] + a * (down[k + 1] - down[k])
            turning_at = rates[k] + a * (rates[k + 1] - rates[k])
            moved = positions[k] + gone * (positions[k + 1] - positions[k])
            ahead_of = now + h * first[:3]
            change = _change(
                p, sunk, below, turning_at, moved, ahead_of, still, flat, rolling, rolled
            )
            now = now + 0.5 * h * (first[:3] + change[:3])
            now = np.minimum(np.maximum(now, -50.0), 50.0)
            turning[k] += (first[3:] + change[3:]) / (2.0 * steps)
    return velocity, turning


def _rolled(vehicle: Vehicle, positions: Array) -> Array:
    """Accelerations (6,) by the roll moment that makes a roll acceleration of 1 rad/s2.

    With them the measured roll acceleration replaces the model's: on a slim hull, half a degree of
    error of the roll sensor would make 0.3 rad/s2.
    """
    column = np.linalg.inv(mass_matrix(vehicle, positions))[:, 3]
    return np.asarray(column / column[3])


def _start(run: DrivenRun, first: int, vehicle: Vehicle, turned: Array, current: Array) -> Array:
    """Initial velocity through the water [m/s]: the Doppler log's; without a log, the velocity at
    which thrust and drag balance."""
    near = slice(first, first + max(round(START / run.period), 1))
    velocity, measured = np.zeros(3), run.velocity[:, near]
    if np.isfinite(measured[0]).any():
        known = np.isfinite(measured).any(axis=1)
        velocity[known] = np.nanmedian(measured[known], axis=1)
        if run.ground[near].mean() > 0.5:
            velocity -= turned.T @ np.array([*current, 0.0])
        return velocity
    place = vehicle.steered_index("speed")
    assert place is not None
    rate, slow, fast = float(run.positions[first, place]), 0.0, FASTEST
    for _ in range(40):
        middle = 0.5 * (slow + fast)
        slow, fast = (middle, fast) if surplus_at(vehicle, middle)(rate) > 0.0 else (slow, middle)
    return np.array([slow, 0.0, 0.0])


def settled(run: DrivenRun) -> NDArray[np.bool_]:
    """Samples of a run from SETTLE seconds after a start, which no longer affects them."""
    skip = round(SETTLE / run.period)
    out, since = np.zeros(len(run.use), bool), 0
    for k, used in enumerate(run.use):
        since = since + 1 if used else 0
        out[k] = since > skip
    return out


class DrivenFlights(Comparison):
    """Residuals of CHANNELS, a series for each window of a run."""

    step = 1e-3

    def __init__(
        self,
        runs: Sequence[DrivenRun],
        nominal: Calibration,
        parameters: tuple[UnknownParameter, ...],
    ):
        self.runs = runs
        self.afloat = [
            k for k, run in enumerate(runs) if (run.ground & np.isfinite(run.velocity[0])).any()
        ]
        """Indices of runs whose Doppler log measures the current"""
        currents = [(f"current_{a}", runs[k]) for k in self.afloat for a in ("north", "east")]
        sensors = [(name, run) for name in SENSORS for run in runs]
        self.biases = tuple(f"{name} of run {run.index}" for name, run in (*sensors, *currents))
        self.started = np.zeros((len(runs), 2))
        """[m/s] Current that is subtracted from each run's initial velocity"""
        self.pieces = [(k, piece) for k, run in enumerate(runs) for piece in _pieces(run)]
        """For each window, the index of its run, and the compared samples by channel"""
        # ground velocity of a current of 1 m/s north and east, body FRD, (time, 3, 2)
        self.turned = [
            euler_to_matrix(run.roll, run.pitch, run.heading).transpose(0, 2, 1)[:, :, :2]
            for run in runs
        ]
        period = runs[0].period
        lengths = dict.fromkeys(CHANNELS, period) | {"pitch_rate": LEAD, "yaw_rate": LEAD}
        channels = {
            name: ComparedQuantity(
                unit=unit, least=least, longest=round(LONGEST_CORRELATION / lengths[name])
            )
            for name, (unit, least) in CHANNELS.items()
        }
        pieces = {name: range(len(self.pieces)) for name in CHANNELS}
        super().__init__(nominal, parameters, channels, pieces)
        self._kept: list[tuple[bytes, DrivenMotion] | None] = [None] * len(runs)

    def currents(self, x: Array) -> Array:
        """Current north and east [m/s] of each run at these offsets, (runs, 2)."""
        found = np.zeros((len(self.runs), 2))
        first = len(self.parameters) + len(SENSORS) * len(self.runs)
        found[self.afloat] = CURRENT * x[first:].reshape(-1, 2)
        return found

    def flown(self, x: Array) -> list[DrivenMotion]:
        """Motion in all runs at these offsets; a run with unchanged inputs is simulated once."""
        count, calibration = len(self.parameters), self.calibration(x)
        found = []
        for k, run in enumerate(self.runs):
            offset = x[count + k]
            key = x[:count].tobytes() + offset.tobytes() + self.started[k].tobytes()
            kept = self._kept[k]
            if kept is None or kept[0] != key:
                motion = fly_run(run, calibration, self.started[k], PITCH * float(offset))
                kept = self._kept[k] = (key, motion)
            found.append(kept[1])
        return found

    def missed(self, x: Array) -> dict[str, list[Array]]:
        """Residuals, model minus run (see `Comparison`)."""
        currents = self.currents(x)
        count, runs = len(self.parameters), len(self.runs)
        _, scales, *turns = x[count : count + len(SENSORS) * runs].reshape(-1, runs)
        whole = []
        for run, motion, turned, current, scale, turn in zip(
            self.runs,
            self.flown(x),
            self.turned,
            currents,
            DOPPLER_SCALE * scales,
            DOPPLER_TURN * np.transpose(turns),
            strict=True,
        ):
            over = turned @ current * run.ground[:, None]
            velocity = motion.velocity
            surge, sway, heave = np.stack([velocity.surge, velocity.sway, velocity.heave]) + over.T
            seen = (1.0 + scale) * surge + turn[2] * sway - turn[1] * heave
            whole.append(
                {
                    "surge": seen - run.velocity[0],
                    "sway": sway - turn[2] * surge + turn[0] * heave - run.velocity[1],
                    "depth_rate": motion.depth_rate - run.depth_rate,
                    "pitch_rate": ahead(run, motion, 1),
                    "yaw_rate": ahead(run, motion, 2),
                }
            )
        return {
            name: [whole[k][name][chosen[name]] for k, chosen in self.pieces] for name in CHANNELS
        }


def ahead(run: DrivenRun, motion: DrivenMotion, axis: int) -> Array:
    """Errors of the rate [rad/s] about an axis, predicted one second ahead from each sample:
    predicted minus measured, (time - one second,)."""
    count = round(LEAD / run.period)
    grown = np.concatenate([[0.0], np.cumsum(run.period * motion.turning[axis, :-1])])
    rate = run.rates[axis]
    return (grown[count:] - grown[:-count]) - (rate[count:] - rate[:-count])


def _pieces(run: DrivenRun) -> list[dict[str, NDArray[np.int_]]]:
    """Compared samples of each window of a run, by channel."""
    good, count = settled(run), round(LEAD / run.period)
    length = round(PIECE / run.period)
    found = []
    for first in range(0, len(good) - length, length):
        rows = np.arange(first, first + length)
        rows = rows[good[rows]]
        if len(rows) < length // 2:
            continue
        inside = rows[(rows < len(good) - run.window) & (rows >= run.window)]
        leads = rows[(rows % count == 0) & (rows < len(good) - count)]
        leads = leads[good[leads + count]]
        surge, sway = (rows[np.isfinite(run.velocity[axis, rows])] for axis in (0, 1))
        found.append(dict(zip(CHANNELS, (surge, sway, inside, leads, leads), strict=True)))
    return found
