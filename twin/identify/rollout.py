"""Rollout: simulation of the full twin with logged actuator positions, fitted by least squares.

The flight model takes the attitude from the log; the twin computes the attitude too. Windows of the
log are simulated from the flight model's state at their start, with the logged battery and pump as
commands. Depth rate and pitch of the twin are compared with the logged ones. The pitch adds the
parameters of the moments (`twin.identify.pitch`): positions of battery, centre of gravity and pump.
All windows and all steps of the finite differences are one batch.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from twin.errors import InputError, SimulationUnstable
from twin.identify.answer import Identification, IdentifiedParameter
from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import consider, correlation_samples, rms, robust_scale
from twin.identify.logged_missions import Log, gliding, layers
from twin.identify.pitch import PITCHING, balanced
from twin.identify.speed import density_of, motion_of
from twin.identify.turning_windows import channel_of
from twin.identify.unknowns import PARAMETERS, choose
from twin.mission.controller import Schedule
from twin.physics.fleet import Fleet
from twin.physics.scenario import Scenario
from twin.physics.start import Start
from twin.water.density import DensityProfile

WINDOWS_S = (400.0, 200.0, 100.0)
"""[s] Durations of a window that are tried. In longer windows the twin's depth would leave the
log's; shorter windows are for dives that are too short for ENOUGH_WINDOWS."""
ENOUGH_WINDOWS = 4
SETTLE_S = 30.0
"""[s] Time at the start of a window that is not compared: its initial state is an estimate."""
MOST_WINDOWS = 12
LEAST_DEPTH = 10.0
"""[m] Smallest depth at the start of a window"""
REFINED = ("neutral_density", "drag", "lift_ratio", "compressibility")
"""Parameters of `twin.identify.unknowns` that the twin's fit includes"""
ITERATIONS = 6
"""Number of Gauss-Newton steps from the flight model's answer"""
PARTS = (1.0, 0.5, 0.2, 0.05, 0.0)
"""Fractions of a Gauss-Newton step that are tried in one batch; the best is used."""
STEP = 0.02
"""Step of the finite differences in spreads, well above errors of the time step"""
PROMPT_LAG, PROMPT_RATE = 0.2, 1e4
"""Actuators that follow logged positions. PROMPT_LAG: [s] lag. PROMPT_RATE: [units/s] limit"""
REACH = 10.0
"""[travels] Largest distance of logged positions beyond an actuator's ends"""
PITCH_BIAS = np.deg2rad(0.3)
"""[rad] Standard deviation of the attitude sensor's bias between windows"""
MOST_PITCH = np.deg2rad(3.0)
"""[rad] Largest RMS residual of the pitch: with more, the drag would compensate a wrong angle."""
DENSITY_STEP = 2.0
"""[m] Thickness of the layers of the log's density profile"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Refinement:
    """Identification with the twin's estimates in place of the flight model's."""

    identification: Identification
    flight: Identification
    depth_rate_rmse: float
    """[m/s] RMS residual of the twin's depth rate in the windows"""
    pitch_rmse: float
    """[rad] RMS residual of the twin's pitch in the windows"""
    windows: int

    def describe(self) -> dict[str, Any]:
        """JSON-able figures."""
        return {
            "twin_windows": self.windows,
            "twin_depth_rate_rmse_m_s": self.depth_rate_rmse,
            "twin_pitch_rmse_deg": float(np.rad2deg(self.pitch_rmse)),
        }


class _Window(NamedTuple):
    """Window of a log."""

    log: Log
    part: slice


def refine(
    logs: Sequence[Log],
    flight: Identification,
    *,
    known: Collection[str] = (),
    progress: Callable[[float], None] = lambda part: None,
) -> Refinement:
    """Fit the twin to windows of the logs, from the answer of `identify`.

    Args:
      known: names whose nominal value is known, as for `identify`.
      progress: called with the fraction done, 0 to 1.

    Raises:
      InputError: no window with battery positions, or the twin does not fly them.
    """
    logs, _ = gliding(logs)
    windows = _windows(logs)
    names = [name for name in flight.determined if name in REFINED]
    parameters = (*choose(names), *PITCHING)
    centres = np.array([p.get(flight.nominal) for p in parameters])
    balance = balanced(logs, flight.calibration)
    start = flight.calibration if balance is None else balance.calibration
    began = [(p, p.get(start), c) for p, c in zip(parameters, centres, strict=True)]
    x = np.array([(np.log(v / c) if p.logarithmic else v - c) / p.spread for p, v, c in began])

    def calibrated(offsets: Array) -> Calibration:
        out = flight.calibration
        for parameter, centre, offset in zip(parameters, centres, offsets, strict=True):
            out = parameter.at(out, float(centre), float(offset))
        return out

    def missed(places: Sequence[Array]) -> list[tuple[list[Array], list[Array]]]:
        return _missed(windows, [calibrated(place) for place in places])

    for iteration in range(ITERATIONS):
        progress(iteration / ITERATIONS)
        places = [x] + [x + STEP * unit for unit in np.eye(len(x))]
        found = missed(places)
        period = logs[0].period
        scales = _scale(found[0][0], period, 0.0), _scale(found[0][1], period, PITCH_BIAS)
        base, *moved = (_weighted(one, scales) for one in found)
        jacobian = np.stack([(one - base) / STEP for one in moved], axis=1)
        hessian = jacobian.T @ jacobian + np.eye(len(x))
        step = np.linalg.solve(hessian, jacobian.T @ base + x)
        tried = [x - part * step for part in PARTS]
        costs = [
            np.sum(_weighted(one, scales) ** 2) + np.sum(p**2)
            for one, p in zip(missed(tried), tried, strict=True)
        ]
        x = tried[int(np.argmin(costs))]
    final = calibrated(x)
    held = [p for p in PARAMETERS if p not in parameters and p.name not in known]
    values = [p.get(final) for p in held]
    stepped = [p.at(final, v, STEP) for p, v in zip(held, values, strict=True)]
    # a heavier hull is trimmed to the same moments
    moment = final.vehicle.static_mass * final.vehicle.static_cg
    stepped = [c.with_vehicle(static_cg=moment / c.vehicle.static_mass) for c in stepped]
    ((rates, pitches), *changed) = _missed(windows, [final, *stepped])
    base = _weighted((rates, pitches), scales)
    others = [(_weighted(one, scales) - base) / STEP for one in changed]
    sure = {e.name: e.deviation for e in flight.estimates if e.determined}
    usual = [p.deviation(v, p.held / p.spread) for p, v in zip(held, values, strict=True)]
    off = [sure.get(p.name, u) * p.held / p.spread / u for p, u in zip(held, usual, strict=True)]
    slopes = np.reshape(others, (len(held), -1)).T
    noise, shift = consider(jacobian, slopes, np.array(off))
    covariance = noise + shift @ shift.T
    progress(1.0)
    pitch_rmse = rms(np.concatenate(pitches))
    if pitch_rmse > MOST_PITCH:
        raise InputError(
            f"the twin does not pitch as this log does (RMSE {np.rad2deg(pitch_rmse):.1f} deg), "
            "with any place of battery, pump and centre of gravity near those of vehicle "
            f"{final.vehicle.name!r}; use --model flight, which takes the pitch from the log"
        )
    refined = [
        IdentifiedParameter.of(p, flight.nominal, final, float(off), True)
        for p, off in zip(parameters, np.sqrt(np.diag(covariance)), strict=True)
    ]
    # correlations of the flight model's fit are not those of the twin
    alone = dataclasses.replace(flight, model="twin", correlation=np.eye(len(flight.determined)))
    return Refinement(
        identification=alone.with_estimates(final, refined, covariance),
        flight=flight,
        depth_rate_rmse=rms(np.concatenate(rates)),
        pitch_rmse=pitch_rmse,
        windows=len(windows),
    )


def _windows(logs: Sequence[Log]) -> list[_Window]:
    """Windows of the logs under water with battery positions, spread over all logs."""
    found: list[_Window] = []
    for seconds in WINDOWS_S:
        found = [w for log in logs for w in _windows_of(log, seconds)]
        if len(found) >= ENOUGH_WINDOWS:
            break
    if not found:
        raise InputError(
            f"no {WINDOWS_S[-1]:g} s under water with battery positions in these logs; "
            "use --model flight"
        )
    chosen = np.unique(np.linspace(0, len(found) - 1, MOST_WINDOWS).round().astype(int))
    return [found[k] for k in chosen]


def _windows_of(log: Log, seconds: float) -> list[_Window]:
    if log.shift is None:
        return []
    length, found = round(seconds / log.period), []
    for first in range(0, len(log.depth) - length, length):
        part = slice(first, first + length + 1)
        deep = log.depth[first] > LEAST_DEPTH and log.depth[part].min() > 0.5 * LEAST_DEPTH
        if deep and log.use[part].all():
            found.append(_Window(log, part))
    return found


def _water(window: _Window, calibration: Calibration) -> DensityProfile:
    """Density of a window's water, with the hull's thermal expansion, which the twin here lacks."""
    log, part = window
    warming = log.hull_warming(calibration.thermal_lag)
    density = density_of(log, calibration) * (1.0 + calibration.thermal_expansion * warming)
    depths, values = layers(log.depth[part], density[part], DENSITY_STEP)
    return DensityProfile(depth=depths, values=values)


def _missed(
    windows: Sequence[_Window], calibrations: Sequence[Calibration]
) -> list[tuple[list[Array], list[Array]]]:
    """Residuals of depth rate [m/s] and pitch [rad] of each window, for each calibration.

    All windows and calibrations are simulated in one batch.
    """
    flights = Fleet([_scenario(w, c) for c in calibrations for w in windows], threads=1).run()
    found = []
    for k, calibration in enumerate(calibrations):
        rates, pitches = [], []
        for window, flown in zip(windows, flights[k * len(windows) :], strict=False):
            if isinstance(flown, SimulationUnstable):
                raise InputError(f"the twin does not fly this log: {flown}; use --model flight")
            log, skip = window.log, round(SETTLE_S / window.log.period)
            seen = slice(window.part.start + skip, window.part.stop - 1)
            rate = log.filtered(np.gradient(flown["true_depth"], log.period))
            rates.append((rate[skip:-1] - log.depth_rate[seen])[: -log.window])
            pitch = np.deg2rad(flown["true_pitch"])[skip:-1]
            pitches.append(pitch - calibration.true_pitch(log.pitch)[seen])
        found.append((rates, pitches))
    return found


def _weighted(missed: tuple[list[Array], list[Array]], scales: tuple[float, float]) -> Array:
    """Residuals of depth rate and pitch of all windows, divided by their scales, in one array."""
    (rates, pitches), (of_rates, of_pitches) = missed, scales
    return np.concatenate([*(r / of_rates for r in rates), *(p / of_pitches for p in pitches)])


def _scenario(window: _Window, calibration: Calibration) -> Scenario:
    log, part, first = window.log, window.part, window.part.start
    vehicle = calibration.vehicle
    commands = np.tile(vehicle.rest, (part.stop - first, 1))
    turning = channel_of(calibration)
    for control, values in (
        ("pitch", log.shift),
        ("heading", None if turning is None else getattr(log, turning)),
        ("buoyancy", log.pump),
    ):
        place = vehicle.steered_index(control)
        if place is not None and values is not None:
            commands[:, place] = values[part]
    # half a sample early: a held position then has no lag on average
    times = np.maximum(log.period * (np.arange(len(commands)) - 0.5), 0.0)
    times[0] = -log.period
    motion = motion_of(log, calibration)
    prompt = {
        own.name: {
            "lag": PROMPT_LAG,
            "rate": PROMPT_RATE,
            "low": own.low - REACH * (own.high - own.low),
            "high": own.high + REACH * (own.high - own.low),
        }
        for own in vehicle.parts
    }
    return Scenario(
        vehicle=vehicle.replace(**prompt),
        mission=Schedule(times=times, commands=commands),
        duration=log.period * (len(commands) - 1),
        sample_period=log.period,
        density=_water(window, calibration),
        start=Start(
            depth=float(log.depth[first]),
            roll=float(log.roll[first]),
            pitch=float(calibration.true_pitch(log.pitch)[first]),
            heading=float(log.heading[first] % (2 * np.pi)),
            v_rel=(
                float(motion.surge[first]),
                float(motion.sway[first]),
                float(motion.heave[first]),
            ),
            rates=(float(log.rates[0, first]), float(log.rates[1, first]), 0.0),
            actuators=tuple(map(float, commands[0])),
        ),
    )


def _scale(series: list[Array], period: float, least: float) -> float:
    """Standard deviation that gives correlated residuals the weight of independent ones.

    `least` is the standard deviation of an error of a whole window, such as a sensor's bias.
    """
    scale = robust_scale(np.concatenate(series))
    samples = correlation_samples(series, round(WINDOWS_S[0] / period))
    length = float(np.mean([len(s) for s in series]))
    return float(max(scale * np.sqrt(samples), least * np.sqrt(length)))
