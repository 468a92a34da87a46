"""Current that wanders in time: first-order Gauss-Markov speed and direction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from twin.compiled import jit
from twin.errors import CurrentError
from twin.water.current import arguments as checks
from twin.water.current.base import Current
from twin.water.current.interpolation import table
from twin.water.current.origin import Origin
from twin.water.current.program import Floats
from twin.water.current.register import register


@jit
def series(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Table over time: n, times [s since mission start] (n), velocity (n, 3)."""
    return table(program, start, size, t, r_t)


@register
@dataclass(frozen=True, kw_only=True)
class GaussMarkov(Current):
    """Speed and direction as independent stationary first-order Gauss-Markov processes.

    x' + (x - mean)/T = w (Fossen 2021, ch. 10), in its exact discretisation
    x[k+1] = mean + exp(-dt/T) (x[k] - mean) + std sqrt(1 - exp(-2 dt/T)) w[k], started from the
    stationary distribution. The speed is clipped after the recursion. Drawn at compile on a fixed
    interval and linear between: a longer mission extends the same series.
    """

    kind: ClassVar[str] = "gauss-markov"
    code: ClassVar[int] = 8
    directional: ClassVar[Any] = series
    usage: ClassVar[Mapping[str, str]] = {
        "gauss-markov:speed=0.1,std=0.05,direction=90,direction_std=20,time=10800,seed=1": (
            "a current that wanders"
        )
    }
    settings: ClassVar[Mapping[str, str]] = {
        "speed": "speed",
        "direction": "direction_deg",
        "std": "speed_std",
        "direction_std": "direction_std_deg",
        "time": "correlation_time",
        "min": "min_speed",
        "max": "max_speed",
        "interval": "interval",
        "seed": "seed",
    }

    speed: float
    """[m/s] Mean speed."""

    direction_deg: float
    """[degree] Mean compass direction TOWARD which it flows."""

    speed_std: float
    """[m/s] Stationary standard deviation of the speed before clipping."""

    direction_std_deg: float = 0.0
    """[degree] Stationary standard deviation of the direction."""

    correlation_time: float = 10800.0
    """[s] T of both processes; 1-6 h for submesoscale, 10-15 d for mesoscale motion."""

    min_speed: float = 0.0
    """[m/s] Lower clip of the speed."""

    max_speed: float = 2.0
    """[m/s] Upper clip of the speed."""

    interval: float = 60.0
    """[s] Spacing of the drawn values."""

    seed: int = 0
    """Seed of the draws (numpy PCG64)."""

    def __post_init__(self) -> None:
        for name in ("speed", "min_speed", "max_speed"):
            checks.speed(self.kind, name, getattr(self, name))
            checks.not_negative(self.kind, name, getattr(self, name), "m/s")
        checks.finite(self.kind, "direction_deg", self.direction_deg, "degree")
        checks.not_negative(self.kind, "speed_std", self.speed_std, "m/s")
        checks.not_negative(self.kind, "direction_std_deg", self.direction_std_deg, "degree")
        checks.positive(self.kind, "correlation_time", self.correlation_time, "s")
        checks.positive(self.kind, "interval", self.interval, "s")
        if self.min_speed > self.max_speed:
            raise CurrentError(
                f"gauss-markov: min_speed {self.min_speed:g} m/s exceeds max_speed"
                f" {self.max_speed:g} m/s"
            )
        if not isinstance(self.seed, (int, np.integer)) or self.seed < 0:
            raise CurrentError(f"gauss-markov: seed must be an integer >= 0, not {self.seed!r}")

    def draw(self, duration_s: float) -> tuple[Floats, Floats, Floats]:
        """time [s], speed [m/s] after clipping, direction [rad], each of shape (n,)."""
        n = math.ceil(duration_s / self.interval) + 1
        # One row per node, so that a longer draw starts with the shorter one.
        noise = np.random.default_rng(self.seed).standard_normal((n, 2))
        keep = math.exp(-self.interval / self.correlation_time)
        kick = math.sqrt(1.0 - keep * keep)
        state = np.empty((n, 2))
        state[0] = noise[0]
        for k in range(1, n):
            state[k] = keep * state[k - 1] + kick * noise[k]
        speed = np.clip(self.speed + self.speed_std * state[:, 0], self.min_speed, self.max_speed)
        direction = np.radians(self.direction_deg + self.direction_std_deg * state[:, 1])
        time = np.arange(n, dtype=np.float64) * self.interval
        return time, speed, direction.astype(np.float64)

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        time, speed, direction = self.draw(duration_s)
        velocity = np.column_stack(
            [speed * np.cos(direction), speed * np.sin(direction), np.zeros_like(speed)]
        )
        return [self.record(time.size, time, velocity)]
