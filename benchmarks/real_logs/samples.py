"""Samples of a dive for ridge regression and networks, averaged like a current profiler's.

A current profiler's velocity is a mean over about a minute. So inputs are centred means over a
minute, one for each of the profiler's samples. Simulated missions are averaged in the same way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from twin.identify import Calibration, Log, Translation, density_of, estimate
from twin.navigation.dead_reckoning import Array
from twin.navigation.features import feature_matrix, select_features

AVERAGE = 60.0
"""[s] Averaging time of inputs"""
LEAST_DEPTH = 5.0
"""[m] Least depth of samples; above, a constraint binds the profiler's solution to the surface"""
GLIDER = select_features(
    ("attitude", "depth_rate", "depth_rate_slow", "glide_speed", "glide_speed_slow", "pump")
)
"""Inputs that every log has; the battery is left out, because its zero differs from vehicle to
vehicle."""
TWIN = ("twin_level", "twin_sink", "twin_rise", "twin_net_mass")
"""Inputs of the identified flight model: horizontal speed, downward speed, depth rate minus
downward speed [m/s]; net buoyancy [kg]"""
PENALTY = 10.0
"""Weight of squared coefficients relative to squared errors, in standard deviations; results hardly
change from 1 to 30."""
MOST = 4.0
"""[standard deviations] Limit of inputs: the square of an outlier would dominate the prediction"""


@dataclasses.dataclass(frozen=True)
class Samples:
    """Samples of one dive."""

    row: int
    inputs: dict[str, Array]
    """Inputs by name, each (samples,)"""
    level: Array
    """[m/s] True horizontal velocity through the water along the heading, (samples,)"""

    def matrix(self, names: Sequence[str]) -> Array:
        """Matrix of the named inputs, (samples, names)."""
        return np.stack([self.inputs[name] for name in names], axis=1)


def level_speed(surge: Array, sway: Array, heave: Array, roll: Array, pitch: Array) -> Array:
    """Horizontal velocity along the heading [m/s] of a velocity in body axes FRD; angles in rad."""
    return Translation(surge=surge, sway=sway, heave=heave).level(roll, pitch)[0]


def sample(log: Log, calibration: Calibration, times: Array, level: Array) -> Samples:
    """Average the inputs of one dive at times [s] since its first sample.

    Args:
      level: [m/s] truth at these times.
    """
    signals = {
        "measured_depth": log.depth, "measured_pitch": np.rad2deg(log.pitch),
        "measured_roll": np.rad2deg(log.roll), "measured_heading": np.rad2deg(log.heading),
        "measured_pump": log.pump,
    }  # fmt: skip
    features = feature_matrix(signals, GLIDER, log.period, log.index)
    raw = {name: features[:, k].astype(float) for k, name in enumerate(GLIDER)}
    found = estimate(log, calibration)
    density = density_of(log, calibration)
    warming = log.hull_warming(calibration.thermal_lag)
    raw |= {
        "twin_level": found.motion.level(log.roll, calibration.true_pitch(log.pitch))[0],
        "twin_sink": found.sink_rate,
        "twin_rise": found.water_rise,
        "twin_net_mass": calibration.net_mass(density, log.depth, log.pump, warming),
        "depth": log.depth, "roll": log.roll, "pitch": log.pitch, "rate": log.depth_rate,
    }  # fmt: skip
    inputs = {name: averaged(values, log.period, times) for name, values in raw.items()}
    return Samples(log.index, inputs, level)


def averaged(values: Array, period: float, times: Array) -> Array:
    """Means over `AVERAGE` about each time [s]; shorter at the ends."""
    total = np.concatenate([[0.0], np.cumsum(values)]) * period
    edges = period * (np.arange(len(values) + 1) - 0.5)
    low = np.clip(times - 0.5 * AVERAGE, edges[0], edges[-1] - period)
    high = np.clip(times + 0.5 * AVERAGE, edges[0] + period, edges[-1])
    return (np.interp(high, edges, total) - np.interp(low, edges, total)) / (high - low)


def ridge(train: Array, wanted: Array, test: Array, *, penalty: float = PENALTY) -> Array:
    """Ridge regression on standardised inputs, their squares and products.

    Returns the prediction (n,) for test inputs (n, inputs) from a fit to train (m, inputs), wanted
    (m,).
    """
    mean, scale = train.mean(0), train.std(0)
    scale = np.where(scale > 0.0, scale, 1.0)
    x, y = (_products(np.clip((v - mean) / scale, -MOST, MOST)) for v in (train, test))
    weights = penalty * np.eye(x.shape[1])
    weights[-1, -1] = 0.0  # no penalty on the constant
    solved = np.linalg.solve(x.T @ x + weights, x.T @ wanted)
    return np.asarray(y @ solved, float)


def _products(x: Array) -> Array:
    """Append to columns the products of any two, and a constant."""
    count = x.shape[1]
    pairs = [x[:, i] * x[:, j] for i in range(count) for j in range(i, count)]
    return np.column_stack([x, *pairs, np.ones(len(x))])
