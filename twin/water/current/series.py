"""Series: currents of time alone, a smooth curve through given or randomly sampled velocities."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from twin.compiled import borrowing
from twin.errors import CurrentError, unknown_name
from twin.numbers import numbers
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import Current
from twin.water.current.checks import not_negative, positive, setting
from twin.water.current.sampler import INVALID, Floats


@borrowing
def smooth_series(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Cubic through nodes (payload: interval [s], velocity (n, 3)), held after the last. Slopes
    come from neighbour nodes (Catmull and Rom 1974), so that no acceleration jumps."""
    if size < 4 or (size - 1) % 3 != 0 or not program[start] > 0.0:
        return INVALID
    last = (size - 1) // 3 - 1
    x = t / program[start]
    if not x >= 0.0:
        x = 0.0
    k = int(x) if x < last else last
    f, held = x - k, k == last
    if held:
        f = 0.0
    here = start + 1 + 3 * k
    after = here if held else here + 3
    before = here if k == 0 else here - 3
    beyond = after if k >= last - 1 else after + 3
    # weights of the values and of the slopes at both ends, and their derivatives
    g = 1.0 - f
    h0, h1 = g * g * (1.0 + 2.0 * f), f * f * (3.0 - 2.0 * f)
    s0, s1 = 0.5 * f * g * g, -0.5 * f * f * g
    rate = 0.0 if held else r_t / program[start]
    dh = 6.0 * f * g
    ds0, ds1 = 0.5 * g * (1.0 - 3.0 * f), 0.5 * f * (3.0 * f - 2.0)
    n0, e0, d0 = program[here], program[here + 1], program[here + 2]
    n1, e1, d1 = program[after], program[after + 1], program[after + 2]
    pn, pe, pd = n1 - program[before], e1 - program[before + 1], d1 - program[before + 2]
    qn, qe, qd = program[beyond] - n0, program[beyond + 1] - e0, program[beyond + 2] - d0
    return (
        h0 * n0 + h1 * n1 + s0 * pn + s1 * qn,
        h0 * e0 + h1 * e1 + s0 * pe + s1 * qe,
        h0 * d0 + h1 * d1 + s0 * pd + s1 * qd,
        rate * (dh * (n1 - n0) + ds0 * pn + ds1 * qn),
        rate * (dh * (e1 - e0) + ds0 * pe + ds1 * qe),
        rate * (dh * (d1 - d0) + ds0 * pd + ds1 * qd),
    )


@dataclass(frozen=True, kw_only=True)
class GaussMarkov(Current):
    """Speed and direction as independent stationary first-order Gauss-Markov processes.

    The process x' + (x - mean)/T = w (Fossen 2021, ch. 10) is discretised exactly:
    x[k+1] = mean + exp(-dt/T) (x[k] - mean) + std sqrt(1 - exp(-2 dt/T)) w[k], started from the
    stationary distribution. The speed is clipped after the recursion. Compilation samples nodes at
    a fixed interval, with a smooth curve between; a longer mission extends the same series.
    """

    kind = "gauss-markov"
    code = 8
    directional = smooth_series
    depends_on = ("time",)
    usage: ClassVar[Mapping[str, str]] = {
        "gauss-markov:speed=0.1,std=0.05,direction=90,direction_std=20,time=10800,seed=1": (
            "a current that wanders"
        )
    }

    speed: float = setting("speed", unit="m/s", check=not_negative)
    """[m/s] Mean speed."""
    direction_deg: float = setting("direction", unit="degree")
    """[degree] Mean compass direction TOWARD which the water flows."""
    speed_std: float = setting("std", unit="m/s", check=not_negative)
    """[m/s] Stationary standard deviation of the speed before clipping."""
    direction_std_deg: float = setting(
        "direction_std", unit="degree", check=not_negative, default=0.0
    )
    """[degree] Stationary standard deviation of the direction."""
    correlation_time: float = setting("time", unit="s", check=positive, default=10800.0)
    """[s] Correlation time T of both; 1-6 h for submesoscale, 10-15 d for mesoscale motion."""
    min_speed: float = setting("min", unit="m/s", check=not_negative, default=0.0)
    """[m/s] Lower clip of the speed."""
    max_speed: float = setting("max", unit="m/s", check=not_negative, default=2.0)
    """[m/s] Upper clip of the speed."""
    interval: float = setting("interval", unit="s", check=positive, default=60.0)
    """[s] Spacing of the sampled values."""
    seed: int = setting("seed", check=None, default=0)
    """Seed of the random numbers (numpy PCG64)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("speed", "min_speed", "max_speed"):
            checks.speed(self.kind, name, getattr(self, name))
        if self.min_speed > self.max_speed:
            raise CurrentError(
                f"gauss-markov: min_speed {self.min_speed:g} m/s exceeds max_speed"
                f" {self.max_speed:g} m/s"
            )
        if not isinstance(self.seed, (int, np.integer)) or self.seed < 0:
            raise CurrentError(f"gauss-markov: seed must be an integer >= 0, not {self.seed!r}")

    def draw(self, duration_s: float) -> tuple[Floats, Floats, Floats]:
        """Sample time [s], speed [m/s] after clipping and direction [rad], each of shape (n,)."""
        n = math.ceil(duration_s / self.interval) + 2  # one node more for the last slope
        # one row per node, so that a longer series starts with the shorter one
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
        """Make one record."""
        _, speed, direction = self.draw(duration_s)
        velocity = np.column_stack(
            [speed * np.cos(direction), speed * np.sin(direction), np.zeros_like(speed)]
        )
        return [self.record(self.interval, velocity)]


@dataclass(frozen=True, kw_only=True)
class Series(Current):
    """A smooth curve through velocities at equal steps from the start; held after the last.

    The slope at a value follows from its neighbours (Catmull and Rom 1974).
    """

    kind = "series"
    code = 10
    directional = smooth_series
    depends_on = ("time",)
    usage: ClassVar[Mapping[str, str]] = {
        "series:interval=3600,north=0.1/0.2/0.1,east=0/0/0.05": "m/s, so many seconds apart"
    }

    interval: float = setting("interval", unit="s", check=positive)
    """[s] Time between two values."""
    north: tuple[float, ...]
    """[m/s] Velocities toward north."""
    east: tuple[float, ...]
    """[m/s] Velocities toward east."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("north", "east"):
            values = numbers(getattr(self, name), f"series: {name}", CurrentError)
            if values.ndim != 1 or not values.size:
                raise CurrentError(f"series: {name} must be a list of at least one number")
            checked = tuple(checks.speed(self.kind, name, value) for value in values.tolist())
            object.__setattr__(self, name, checked)
        if len(self.north) != len(self.east):
            raise CurrentError(
                f"series: north has {len(self.north)} values and east {len(self.east)}: give as "
                "many of both"
            )

    @classmethod
    def parse(cls, rest: str) -> Series:
        """Parse interval=, and north= and east= with / between the values."""
        positional, given = checks.split_settings(cls.kind, rest)
        if positional:
            raise CurrentError(f"series: write NAME=VALUE, not {positional[0]!r}")
        allowed = ("interval", "north", "east")
        settings: dict[str, Any] = {}
        for name, value in given.items():
            if name not in allowed:
                raise CurrentError(unknown_name("series setting", name, allowed))
            words = value.split("/") if name != "interval" else [value]
            found = [checks.number(cls.kind, name, word) for word in words]
            settings[name] = found[0] if name == "interval" else tuple(found)
        for name in allowed:
            if name not in settings:
                raise CurrentError(f"series: {name}= is missing; {checks.allowed(allowed)}")
        return cls(**settings)

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make one record of the values within the mission."""
        count = min(len(self.north), math.ceil(duration_s / self.interval) + 3)
        velocity = np.zeros((count, 3))
        velocity[:, 0], velocity[:, 1] = self.north[:count], self.east[:count]
        return [self.record(self.interval, velocity)]
