"""Rollout: the full MuJoCo twin on logged actuator positions, refined by batched least squares.

The flight model takes the attitude from the log; the twin makes its own. Parts of the log are
flown again from the state that the flight model finds at their beginning, with the logged battery
and pump as commands, and the depth rate and the pitch that come out are compared with the logged
ones. That adds what only the moments tell (`twin.identify.pitch`): where the battery's neutral
position, the centre of gravity and the pump lie. All windows and all steps of the finite
differences fly side by side in one batch.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, SimulationUnstable
from twin.identify.answer import Identification, IdentifiedParameter
from twin.identify.calibration import Calibration
from twin.identify.comparison import correlation_samples, robust_scale
from twin.identify.logged_missions import Log, gliding
from twin.identify.pitch import PITCHING, balanced
from twin.identify.speed import density_of, motion_of
from twin.identify.turning_fit import channel_of
from twin.identify.unknowns import UnknownParameter, choose
from twin.mission.controller import Schedule
from twin.physics.fleet import Fleet
from twin.physics.scenario import Scenario
from twin.physics.start import Start
from twin.water.density import DensityProfile

Array = NDArray[np.float64]

WINDOWS_S = (400.0, 200.0, 100.0)
"""[s] of one rollout: longer, and the twin's depth leaves the water that the log was in; shorter
where dives are too short for enough of them."""
ENOUGH_WINDOWS = 4
SETTLE_S = 30.0
"""[s] at its start that are not compared: the start is an estimate."""
MOST_WINDOWS = 12
LEAST_DEPTH = 10.0
"""[m] where a window may start."""
REFINED = ("neutral_density", "drag", "lift_ratio", "compressibility")
"""Parameters of `twin.identify.unknowns` that the twin flies with."""
ITERATIONS = 6
"""Gauss-Newton steps: it starts at the flight model's answer."""
PARTS = (1.0, 0.5, 0.2, 0.05, 0.0)
"""Of a Gauss-Newton step that are tried side by side; the best is taken."""
STEP = 0.02
"""Spreads of the finite differences: well above what the time step leaves."""
PROMPT_LAG, PROMPT_RATE = 0.2, 1e4
"""[s] and units per second of actuators that follow the logged positions."""
REACH = 10.0
"""Travels of an actuator by which its logged positions may lie beyond its ends."""
PITCH_BIAS = np.deg2rad(0.3)
"""[rad] of bias that the attitude sensor may have from one window to the next."""
MOST_PITCH = np.deg2rad(3.0)
"""[rad] of pitch that a refined twin may be off: more, and its drag answers for the wrong angle."""
DENSITY_STEP = 2.0
"""[m] of the density profile taken from the log."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Refinement:
    """The identification with the twin's answers in place of the flight model's."""

    identification: Identification
    flight: Identification
    depth_rate_rmse: float
    """[m/s] of the twin in the windows."""
    pitch_rmse: float
    """[rad] of the twin in the windows."""
    windows: int

    def describe(self) -> dict[str, Any]:
        """JSON-able figures."""
        return {
            "twin_windows": self.windows,
            "twin_depth_rate_rmse_m_s": self.depth_rate_rmse,
            "twin_pitch_rmse_deg": float(np.rad2deg(self.pitch_rmse)),
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Window:
    log: Log
    first: int
    last: int
    density: DensityProfile

    @property
    def compared(self) -> slice:
        skip = round(SETTLE_S / self.log.period)
        return slice(self.first + skip, self.last)


def refine(
    logs: Sequence[Log],
    flight: Identification,
    *,
    progress: Callable[[float], None] = lambda part: None,
) -> Refinement:
    """Fit the twin to windows of the logs, from what `identify` found.

    Args:
      progress: called with the part done, 0 to 1.

    Raises:
      InputError: no window with battery positions, or the twin does not fly them.
    """
    logs, _ = gliding(logs)
    windows = _windows(logs, flight.calibration)
    names = [name for name in flight.determined if name in REFINED]
    parameters = (*choose(names), *PITCHING)
    nominal = flight.nominal
    centres = np.array([p.get(nominal) for p in parameters])
    balance = balanced(logs, flight.calibration)
    start = flight.calibration if balance is None else balance.calibration
    x = np.array([_offset(p, c, start) for p, c in zip(parameters, centres, strict=True)])

    def calibrated(offsets: Array) -> Calibration:
        out = flight.calibration
        for parameter, centre, offset in zip(parameters, centres, offsets, strict=True):
            out = parameter.at(out, float(centre), float(offset))
        return out

    for iteration in range(ITERATIONS):
        progress(iteration / ITERATIONS)
        points = [x] + [x + STEP * unit for unit in np.eye(len(x))]
        flown = _fly(windows, [calibrated(point) for point in points])
        scales = _scales(windows, flown[0], calibrated(x))

        def stacked(
            results: list[_Flown], offsets: Array, scales: tuple[float, float] = scales
        ) -> Array:
            return _residual(windows, results, calibrated(offsets), scales)

        base = stacked(flown[0], x)
        columns = [
            (stacked(f, p) - base) / STEP for f, p in zip(flown[1:], points[1:], strict=True)
        ]
        jacobian = np.stack(columns, axis=1)
        hessian = jacobian.T @ jacobian + np.eye(len(x))
        step = np.linalg.solve(hessian, jacobian.T @ base + x)
        tried = [x - part * step for part in PARTS]
        costs = [
            np.sum(stacked(f, p) ** 2) + np.sum(p**2)
            for f, p in zip(_fly(windows, [calibrated(p) for p in tried]), tried, strict=True)
        ]
        x = tried[int(np.argmin(costs))]
    progress(1.0)
    covariance = np.asarray(np.linalg.inv(hessian), np.float64)
    final = calibrated(x)
    results = _fly(windows, [final])[0]
    rate = np.concatenate([_rate_residual(w, f) for w, f in zip(windows, results, strict=True)])
    pitch = np.concatenate(
        [_pitch_residual(w, f, final) for w, f in zip(windows, results, strict=True)]
    )
    deviation: Array = np.sqrt(np.diag(covariance))
    pitch_rmse = float(np.sqrt(np.mean(pitch**2)))
    if pitch_rmse > MOST_PITCH:
        raise InputError(
            f"the twin does not pitch as this log does (RMSE {np.rad2deg(pitch_rmse):.1f} deg), "
            "with any place of battery, pump and centre of gravity near those of vehicle "
            f"{final.vehicle.name!r}; use --model flight, which takes the pitch from the log"
        )
    return Refinement(
        identification=_merged(flight, final, parameters, centres, deviation, covariance),
        flight=flight,
        depth_rate_rmse=float(np.sqrt(np.mean(rate**2))),
        pitch_rmse=pitch_rmse,
        windows=len(windows),
    )


def _offset(parameter: UnknownParameter, centre: float, calibration: Calibration) -> float:
    value = parameter.get(calibration)
    if parameter.logarithmic:
        return float(np.log(value / centre) / parameter.spread)
    return (value - centre) / parameter.spread


def _windows(logs: Sequence[Log], calibration: Calibration) -> list[_Window]:
    """Parts of the logs under water with battery positions, spread over all of them."""
    found: list[_Window] = []
    for seconds in WINDOWS_S:
        found = [w for log in logs for w in _windows_of(log, calibration, seconds)]
        if len(found) >= ENOUGH_WINDOWS:
            break
    if not found:
        raise InputError(
            f"no {WINDOWS_S[-1]:g} s under water with battery positions in these logs; "
            "use --model flight"
        )
    chosen = np.unique(np.linspace(0, len(found) - 1, MOST_WINDOWS).round().astype(int))
    return [found[k] for k in chosen]


def _windows_of(log: Log, calibration: Calibration, seconds: float) -> list[_Window]:
    if log.shift is None:
        return []
    length, found = round(seconds / log.period), []
    for first in range(0, len(log.depth) - length, length):
        part = slice(first, first + length + 1)
        deep = log.depth[first] > LEAST_DEPTH and log.depth[part].min() > 0.5 * LEAST_DEPTH
        if deep and log.use[part].all():
            profile = _density(log, calibration, part)
            found.append(_Window(log=log, first=first, last=first + length, density=profile))
    return found


def _density(log: Log, calibration: Calibration, part: slice) -> DensityProfile:
    """The water of a window, as dense as it feels to a hull that swells with its temperature,
    which the twin's physics does not know."""
    swelling = 1.0 + calibration.thermal_expansion * log.hull_warming(calibration.thermal_lag)
    density = (density_of(log, calibration) * swelling)[part]
    bins = np.maximum(np.round(log.depth[part] / DENSITY_STEP), 0).astype(int)
    used = np.unique(bins)
    values = np.array([np.median(density[bins == k]) for k in used])
    return DensityProfile(depth=used * DENSITY_STEP, values=values)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Flown:
    depth: Array
    pitch: Array


def _fly(windows: Sequence[_Window], calibrations: Sequence[Calibration]) -> list[list[_Flown]]:
    """Every window with every calibration, in one batch."""
    scenarios = [_scenario(w, c) for c in calibrations for w in windows]
    results = Fleet(scenarios, threads=1).run()
    flown: list[_Flown] = []
    for result in results:
        if isinstance(result, SimulationUnstable):
            raise InputError(f"the twin does not fly this log: {result}; use --model flight")
        flown.append(_Flown(depth=result["true_depth"], pitch=np.deg2rad(result["true_pitch"])))
    n = len(windows)
    return [flown[k * n : (k + 1) * n] for k in range(len(calibrations))]


def _scenario(window: _Window, calibration: Calibration) -> Scenario:
    log, first, last = window.log, window.first, window.last
    part = slice(first, last + 1)
    vehicle = calibration.vehicle
    commands = np.tile(vehicle.rest, (last + 1 - first, 1))
    turning = channel_of(calibration)
    for control, values in (
        ("pitch", log.shift),
        ("heading", None if turning is None else getattr(log, turning)),
        ("buoyancy", log.pump),
    ):
        place = vehicle.steered_index(control)
        if place is not None and values is not None:
            commands[:, place] = values[part]
    # Half a sample early: a held position then lags the logged one by nothing on average.
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
        duration=log.period * (last - first),
        sample_period=log.period,
        density=window.density,
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


def _scales(
    windows: Sequence[_Window], flown: list[_Flown], calibration: Calibration
) -> tuple[float, float]:
    """What depth rates [m/s] and pitches [rad] are divided by."""
    rates = [_rate_residual(w, f) for w, f in zip(windows, flown, strict=True)]
    pitches = [_pitch_residual(w, f, calibration) for w, f in zip(windows, flown, strict=True)]
    period = windows[0].log.period
    return _scale(rates, period, 0.0), _scale(pitches, period, PITCH_BIAS)


def _residual(
    windows: Sequence[_Window],
    flown: list[_Flown],
    calibration: Calibration,
    scales: tuple[float, float],
) -> Array:
    """Depth rates and pitches of all windows, in independent deviations, flat."""
    pairs = list(zip(windows, flown, strict=True))
    parts = [_rate_residual(w, f) / scales[0] for w, f in pairs]
    return np.concatenate(
        parts + [_pitch_residual(w, f, calibration) / scales[1] for w, f in pairs]
    )


def _rate_residual(window: _Window, flown: _Flown) -> Array:
    log = window.log
    skip = round(SETTLE_S / log.period)
    rate = log.filtered(np.gradient(flown.depth, log.period))
    return (rate[skip:-1] - log.depth_rate[window.compared])[: -log.window]


def _pitch_residual(window: _Window, flown: _Flown, calibration: Calibration) -> Array:
    skip = round(SETTLE_S / window.log.period)
    measured = calibration.true_pitch(window.log.pitch)[window.compared]
    return flown.pitch[skip:-1] - measured


def _scale(series: list[Array], period: float, least: float) -> float:
    """Deviation to divide residuals by so that they count as independent ones.

    `least` is an error that a whole window shares, such as a sensor's bias.
    """
    scale = robust_scale(np.concatenate(series))
    samples = correlation_samples(series, round(WINDOWS_S[0] / period))
    length = float(np.mean([len(s) for s in series]))
    return float(max(scale * np.sqrt(samples), least * np.sqrt(length)))


def _merged(
    flight: Identification,
    calibration: Calibration,
    parameters: tuple[UnknownParameter, ...],
    centres: Array,
    deviation: Array,
    covariance: Array,
) -> Identification:
    """The flight model's identification with the refined estimates in their places."""
    refined = {
        p.name: IdentifiedParameter(
            name=p.name,
            unit=p.unit,
            meaning=p.meaning,
            nominal=float(c),
            value=p.get(calibration),
            deviation=p.deviation(p.get(calibration), float(d)),
            spread=p.deviation(float(c), 1.0),
            determined=True,
        )
        for p, c, d in zip(parameters, centres, deviation, strict=True)
    }
    names = [p.name for p in parameters]
    kept = tuple(refined.get(e.name, e) for e in flight.estimates)
    own = {e.name for e in flight.estimates}
    estimates = (*kept, *(e for name, e in refined.items() if name not in own))
    mine = covariance / np.outer(deviation, deviation)
    known = [e.name for e in estimates if e.determined]
    correlation = np.eye(len(known))
    for i, one in enumerate(known):
        for j, other in enumerate(known):
            if one in names and other in names:
                correlation[i, j] = mine[names.index(one), names.index(other)]
    return dataclasses.replace(
        flight,
        calibration=calibration,
        model="twin",
        estimates=estimates,
        correlation=correlation,
    )
