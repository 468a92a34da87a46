"""Observations: a task's named arrays as Gymnasium's spaces, flat or by name, and their noise.

Flat ones are one vector of 32-bit numbers: each observation over the size that it usually has
(`GliderTask.scale`), cut off at `LIMIT` of them, in the task's order. So a network gets numbers of
order 1 without a running mean. By name they are 64-bit numbers in the suite's units, cut off at the
task's generous limits (`GliderTask.limits`), which noise widens.

A number of white noise depends on seed, episode, step and place alone, so one vehicle's noise is
the same alone and among any number of others. The numbers are made by hashing, with SplitMix64
(Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators, OOPSLA), and shaped by
Box and Muller's transform. Goals are worked out from the same noisy numbers that are shown, so that
no observation tells what another one hides.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, unknown_name
from twin.numbers import Array

if TYPE_CHECKING:
    import gymnasium

Words = NDArray[np.uint64]
Counts = NDArray[np.int64]

UNSHOWN = {"heading": 1, "position": 2}
"""Measurements behind goals that are no observations themselves, and how many numbers each has:
heading [rad]; north and east [m]."""


class Noisy:
    """Measurements plus errors; each is shaped as that of the physics, of one vehicle or many."""

    def __init__(self, seen: Any, errors: Mapping[str, Array]):
        """Put errors on what is `seen`.

        Args:
          seen: a Physics, a ManyPhysics or a Believed.
          errors: by the names of `GliderTask.observe_vehicle` and of UNSHOWN, in their units, shape
            (numbers,) or (vehicles, numbers). What is not named has none.
        """
        self._seen, self._errors = seen, errors

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in MEASURED:
            raise InputError(
                f"noise: a goal of this task is made of physics.{name}, which has no noisy form: "
                f"work the goal out from {', '.join(sorted({*MEASURED, *DERIVED}))}"
            )
        measured = getattr(self._seen, name)
        if MEASURED[name] is None:
            return measured
        source, part = MEASURED[name]
        errors = self._errors.get(source)
        error: Any = 0.0 if errors is None else errors[..., part]
        return lambda: np.add(measured(), error)

    def heading(self) -> Any:
        """[rad] in [0, 2 pi)"""
        errors = self._errors.get("heading")
        return (self._seen.heading() + (0.0 if errors is None else errors[..., 0])) % (2.0 * np.pi)

    def surge(self) -> Any:
        """[m/s] through the water."""
        return self.velocity_through_water()[..., 0]

    def speed(self) -> Any:
        """[m/s] through the water."""
        return np.linalg.norm(self.velocity_through_water(), axis=-1)


ALL = slice(None)
MEASURED: Mapping[str, Any] = {
    "time": None,
    "current": None,
    "roll": ("attitude", 0),
    "pitch": ("attitude", 1),
    "rates": ("rates", ALL),
    "velocity_through_water": ("velocity", ALL),
    "depth": ("depth", 0),
    "depth_rate": ("depth_rate", 0),
    "actuators": ("actuators", ALL),
    "net_buoyancy": ("net_buoyancy", 0),
    "north": ("position", 0),
    "east": ("position", 1),
}
"""Observation whose error a measurement gets, and the number of it; None: it has no error"""
DERIVED = ("heading", "surge", "speed")


_GAMMA, _ONE, _TWO = (np.uint64(value) for value in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9,
                                                      0x94D049BB133111EB))  # fmt: skip


def _mixed(words: Words) -> Words:
    """SplitMix64's next number of each state."""
    words = words + _GAMMA
    words = (words ^ (words >> np.uint64(30))) * _ONE
    words = (words ^ (words >> np.uint64(27))) * _TWO
    return words ^ (words >> np.uint64(31))


LARGEST = 13.0
"""Deviations that an error never reaches: radii end at sqrt(108 ln 2) = 8.7 of them, and a pair of
numbers, turned into other axes, at sqrt(2) times that."""


def normal(seed: Counts, episode: Counts, step: Counts, width: int) -> Array:
    """Standard normal numbers of vehicles, shape (vehicles, width).

    Args:
      seed, episode, step: whole numbers, one of each for every vehicle, shape (vehicles,).
    """
    with np.errstate(over="ignore"):
        state = np.zeros(len(seed), np.uint64)
        for part in (seed, episode, step):
            state = _mixed(state ^ np.asarray(part).astype(np.uint64))
        places = state[:, None] + np.arange(2 * width, dtype=np.uint64) * _GAMMA
        bits = _mixed(places) >> np.uint64(11)
    uniform = (bits.astype(np.float64) + 0.5) * 2.0**-53
    radius = np.sqrt(-2.0 * np.log(uniform[:, :width]))
    return np.asarray(radius * np.cos(2.0 * np.pi * uniform[:, width:]))


class Noise:
    """White noise of what a task's observations are made of.

    The vehicle's own observations get it where they are measured, so goals made of them follow:
    with noise of the depth, the depth shown and the metres to go add up to the target. Heading and
    position, which goals are made of and no observation shows, have noise by these names. Noise of
    a goal's own name is added to the goal. Rewards and ends of episodes keep to the truth.
    """

    def __init__(
        self,
        noise: Mapping[str, float] | None,
        goals_from: Mapping[str, tuple[str, ...]],
        widths: Mapping[str, int],
    ):
        """Standard deviations by name, in its unit.

        Args:
          goals_from: of the task, what its goals are made of; see `GliderTask.goals_from`.
          widths: numbers of each observation, by name.

        Raises:
          InputError: no such observation, or a deviation that is negative or not finite.
        """
        behind = {name for made_of in goals_from.values() for name in made_of}
        unshown = {name: width for name, width in UNSHOWN.items() if name in behind}
        self.deviations = dict(noise or {})
        self._first: dict[str, slice] = {}
        self._width = 0
        for name, width in {**widths, **unshown}.items():
            self._first[name] = slice(self._width, self._width + width)
            self._width += width
        for name, deviation in self.deviations.items():
            if name not in self._first:
                raise InputError(unknown_name("observation of this task", name, self._first))
            if not (np.isfinite(deviation) and deviation >= 0.0):
                raise InputError(f"noise of {name} is {deviation!r}: give 0 or more")

    def draw(self, seed: Counts, episode: Counts, step: Counts) -> dict[str, Array]:
        """Errors by name, each of shape (vehicles, numbers)."""
        drawn = normal(seed, episode, step, self._width)
        return {
            name: sigma * drawn[:, self._first[name]] for name, sigma in self.deviations.items()
        }


FLAT, DICT = "flat", "dict"
KINDS = (FLAT, DICT)
LIMIT = 10.0
"""Usual sizes at which flat observations are cut off"""


class Observations:
    """How the observations of a task are shown."""

    def __init__(
        self,
        task: Any,
        widths: Mapping[str, int],
        kind: str,
        *,
        deviations: Mapping[str, float],
    ):
        """For a task, a `GliderTask`.

        Args:
          widths: numbers of each observation of one vehicle, by name.
          kind: one of KINDS.
          deviations: of noise, by name; see `Noise`.

        Raises:
          InputError: an unknown kind.
        """
        if kind not in KINDS:
            raise InputError(unknown_name("observation", str(kind), KINDS))
        self.kind = kind
        self.widths = dict(widths)
        ends = itertools.pairwise(np.cumsum([0, *self.widths.values()]).tolist())
        self.columns = {name: slice(*two) for name, two in zip(self.widths, ends, strict=True)}
        """Where each observation stands in a flat one."""
        self.scale = np.concatenate([np.full(n, task.scale(k)) for k, n in self.widths.items()])
        """Unit of each number of a flat observation, shape (width,)."""
        limits, everywhere = task.limits(), (-np.inf, np.inf)
        self.limits: dict[str, tuple[float, float]] = {}
        """Of each observation by name, in its unit."""
        for name in widths:
            made_of = {name, *task.goals_from.get(name, ())}
            room = LARGEST * sum(deviations.get(source, 0.0) for source in made_of)
            low, high = limits.get(name, everywhere)
            self.limits[name] = low - room, high + room

    @property
    def space(self) -> gymnasium.Space[Any]:
        """Space of one vehicle."""
        from gymnasium import spaces

        if self.kind == FLAT:
            return spaces.Box(-LIMIT, LIMIT, (len(self.scale),), np.float32)
        boxes: dict[str, Any] = {}
        for name, width in self.widths.items():
            boxes[name] = spaces.Box(*self.limits[name], (width,), np.float64)
        return spaces.Dict(boxes)

    def show(self, found: Mapping[str, Array]) -> Any:
        """A task's observation, of one vehicle or of many, in this space."""
        if self.kind == DICT:
            return {name: np.clip(value, *self.limits[name]) for name, value in found.items()}
        values = np.concatenate(list(found.values()), axis=-1)
        values /= self.scale
        np.clip(values, -LIMIT, LIMIT, out=values)
        return values.astype(np.float32)


class Observed:
    """What an environment, of one vehicle or of many, says of its flat observations."""

    _observations: Observations
    _noise: Noise

    def _observe(
        self,
        task: Any,
        first: Mapping[str, Array],
        observation: str,
        noise: Mapping[str, float] | None,
    ) -> None:
        """Show a task's observations, whose `first` one of a single vehicle tells their widths."""
        widths = {name: int(np.size(value)) for name, value in first.items()}
        self._noise = Noise(noise, task.goals_from, widths)
        deviations = self._noise.deviations
        self._observations = Observations(task, widths, observation, deviations=deviations)
        task.noise = self._errors if deviations else None

    def _errors(self) -> dict[str, Array]:
        """Errors of the observations that are being made, by name."""
        raise NotImplementedError

    @property
    def columns(self) -> dict[str, slice]:
        """Where each observation stands in a flat one, by name."""
        return dict(self._observations.columns)

    @property
    def scale(self) -> Array:
        """What a flat observation is multiplied by to be in SI units, shape (width,)."""
        return self._observations.scale.copy()
