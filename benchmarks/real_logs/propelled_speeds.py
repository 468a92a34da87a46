"""Propelled speeds: surge of a run without its Doppler log, by the velocities of other runs.

A method is a function of training runs, which gives a function from a run to its surge [m/s].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.real_logs.propelled_runs import Run
from twin.navigation.dead_reckoning import Array, Mask, smooth
from twin.navigation.propelled_surge import SPEEDS, LiftBalance, Propulsion, ThrustBalance
from twin.navigation.standstill import largest_surge, quiet_rate, standing, yaw_noise

Predict = Callable[[Run], Array]

STEEP = np.sin(np.radians(10.0))
"""[1] Sine of the least pitch for the depth rate over it"""
WINDOW, NOISE_WINDOW = 14.0, 30.0
"""[s] Averaging times of depth rate and pitch, and of the rates' noise"""
SUBMERGED = 1.5
"""[m] Depth below which the balance of lift holds"""
PENALTY = 0.03
"""[1] Weight of squared slopes relative to squared errors, in standard deviations"""
CONSTANT, LINE, THRUST = "constant speed", "linear in rpm", "balance of thrust"


def known(runs: Sequence[Run], values: Callable[[Run], Array]) -> Array:
    """Join the values (time, ...) of runs at their moving samples."""
    return np.concatenate([values(run)[run.moving] for run in runs])


def constant(train: Sequence[Run]) -> Predict:
    """Mean surge of the training runs while they move."""
    mean = float(known(train, lambda run: run.surge).mean())
    return lambda run: np.full(run.surge.size, mean)


def line(train: Sequence[Run]) -> Predict:
    """Line in the propeller's speed, fitted to moving samples."""
    speed = known(train, lambda run: run.signals["propeller"])
    matrix = np.stack([speed, np.ones_like(speed)], axis=1)
    slope, start = np.linalg.lstsq(matrix, known(train, lambda run: run.surge), rcond=None)[0]
    return lambda run: slope * run.signals["propeller"] + start


def depth_terms(run: Run, seconds: float) -> tuple[Array, Array]:
    """Depth rate [m/s] and minus the sine of the pitch, averaged; NaN near the surface."""
    rate = np.gradient(run.signals["depth"], run.period)
    under = np.where(run.signals["depth"] > SUBMERGED, 1.0, np.nan)
    down = -np.sin(run.signals["pitch"])
    return under * smooth(rate, seconds, run.period), smooth(down, seconds, run.period)


def porpoise(train: Sequence[Run]) -> Predict:
    """Depth rate over the sine of the pitch; the constant where the pitch is flat."""
    rest = constant(train)

    def predict(run: Run) -> Array:
        rate, down = depth_terms(run, 5.0)
        speed = rate / np.where(down == 0.0, np.nan, down)
        steep = (np.abs(down) > STEEP) & (speed > 0.0)
        return np.where(steep, np.minimum(speed, SPEEDS[-1]), rest(run))

    return predict


def lift(train: Sequence[Run]) -> Predict:
    """Balance of lift; near the surface the mean."""
    terms = known(train, lambda run: np.stack([*depth_terms(run, WINDOW), run.surge], axis=1))
    balance = LiftBalance.fit(*terms[np.isfinite(terms).all(axis=1)].T)
    rest = constant(train)

    def predict(run: Run) -> Array:
        rate, down = depth_terms(run, WINDOW)
        return np.where(np.isfinite(rate), balance.surge(rate, down), rest(run))

    return predict


def thrust(train: Sequence[Run]) -> Predict:
    """Balance of thrust."""
    balance = ThrustBalance.fit([propulsion(run) for run in train])
    return lambda run: balance.surge(propulsion(run))


def propulsion(run: Run) -> Propulsion:
    """Channels of a run's propulsion; without depth the run counts as under water."""
    speed = run.signals["propeller"]
    depth = run.signals.get("depth", np.full(speed.size, 10.0 * SUBMERGED))
    return Propulsion(speed, run.signals.get("power", speed), depth, run.surge, run.period)


def levels(values: Array, seconds: float, period: float) -> tuple[Array, Array]:
    """Means of values, (n, time), over some seconds, and the logarithms of their noise."""
    mean = smooth(values, seconds, period)
    square = smooth(values**2, seconds, period) - mean**2
    return mean, np.log(np.sqrt(np.maximum(square, 0.0)) + 1e-3)


def noise(train: Sequence[Run]) -> Predict:
    """Linear regression on the logarithms of the rates' noise, a hull's answer to its own flow."""

    def noises(run: Run) -> Array:
        rates = np.stack([run.signals[name] for name in "pqr"])
        return levels(rates, NOISE_WINDOW, run.period)[1].T

    matrix, surge = known(train, noises), known(train, lambda run: run.surge)
    middle, scale = matrix.mean(axis=0), matrix.std(axis=0)
    x = (matrix - middle) / scale
    slopes = np.linalg.solve(x.T @ x + PENALTY * len(x) * np.eye(3), x.T @ (surge - surge.mean()))
    return lambda run: surge.mean() + np.clip((noises(run) - middle) / scale, -3.0, 3.0) @ slopes


METHODS: dict[str, tuple[Callable[[Sequence[Run]], Predict], set[str]]] = {
    CONSTANT: (constant, set()),
    LINE: (line, {"propeller"}),
    "depth rate over sine of pitch": (porpoise, {"depth"}),
    "balance of lift": (lift, {"depth"}),
    THRUST: (thrust, {"propeller"}),
    "noise of the rates": (noise, set()),
}
"""Methods by name, with the signals that they need"""


def learned_quiet(train: Sequence[Run]) -> float:
    """Yaw noise [rad/s] that divides standing from moving in the training runs."""
    noises = [yaw_noise(run.signals["r"], run.period) for run in train]
    return quiet_rate(np.concatenate(noises), np.concatenate([run.surge for run in train]))


def standing_samples(run: Run, quiet: float) -> Mask:
    """Samples at which the run stands by its depth, propeller, or without both by yaw noise."""
    depth, propeller = run.signals.get("depth"), run.signals.get("propeller")
    return standing(
        run.signals["pitch"], run.period, depth=depth, propeller=propeller,
        yaw_rate=run.signals["r"], quiet=quiet if depth is None and propeller is None else 0.0,
    )  # fmt: skip


def limit_surge(run: Run, surge: Array, quiet: float, method: str) -> Array:
    """Surge below the largest one that the depth rate leaves, 0 where the vehicle stands."""
    if method == THRUST or (method.startswith("network") and "propeller" in run.signals):
        return surge  # they coast by themselves
    if "depth" in run.signals and "propeller" not in run.signals:
        largest = largest_surge(run.signals["depth"], run.signals["pitch"], run.period)
        surge = np.minimum(surge, largest)
    return np.where(standing_samples(run, quiet), 0.0, np.clip(surge, 0.0, SPEEDS[-1]))
