"""Observations: a task's named arrays as Gymnasium spaces, flat or by name, and their noise.

A flat observation is one vector of 32-bit numbers in the task's order. Each is divided by its usual
size (`GliderTask.scale`) and clipped at `LIMIT`, so a network gets numbers of order 1 without a
running mean. An observation by name has 64-bit numbers in SI units, clipped at the task's generous
limits (`GliderTask.limits`), which noise widens.

White noise depends on seed, episode, step and index alone, so a vehicle's noise is the same alone
and among any number of others. The numbers are hashed with SplitMix64 (Steele, Lea and Flood 2014,
Fast splittable pseudorandom number generators, OOPSLA), and shaped by Box and Muller's transform.
Goals are computed from the same noisy numbers that are observed, so no observation reveals the
true value of another.
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
"""Measurements from which goals are computed but which are no observations, and their widths:
heading [rad]; north and east [m]."""


class Noisy:
    """Measurements with errors, in the shapes of the physics, for one vehicle or many."""

    def __init__(self, seen: Any, errors: Mapping[str, Array]):
        """Add errors to the measurements of `seen`.

        Args:
          seen: a Physics, a ManyPhysics or a Believed.
          errors: by the names of `GliderTask.observe_vehicle` and of UNSHOWN, in their units, shape
            (numbers,) or (vehicles, numbers). Names that are left out have no error.
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
        """Heading [rad] in [0, 2 pi), with its error."""
        errors = self._errors.get("heading")
        return (self._seen.heading() + (0.0 if errors is None else errors[..., 0])) % (2.0 * np.pi)

    def surge(self) -> Any:
        """Surge [m/s] through the water, with the error of the velocity."""
        return self.velocity_through_water()[..., 0]

    def speed(self) -> Any:
        """Speed [m/s] through the water, with the error of the velocity."""
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
"""Observation and index whose error each measurement gets; None: without error."""
DERIVED = ("heading", "surge", "speed")


_GAMMA, _ONE, _TWO = (np.uint64(value) for value in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9,
                                                      0x94D049BB133111EB))  # fmt: skip


def _mix_words(words: Words) -> Words:
    """Next SplitMix64 number of each state."""
    words = words + _GAMMA
    words = (words ^ (words >> np.uint64(30))) * _ONE
    words = (words ^ (words >> np.uint64(27))) * _TWO
    return words ^ (words >> np.uint64(31))


LARGEST = 13.0
"""Largest error in standard deviations: Box-Muller radii end at sqrt(108 ln 2) = 8.7, and a pair
of numbers that is turned into other axes at sqrt(2) times that."""


def normal(seed: Counts, episode: Counts, step: Counts, width: int) -> Array:
    """Standard normal numbers, shape (vehicles, width).

    Args:
      seed, episode, step: integers, one of each for every vehicle, shape (vehicles,).
    """
    with np.errstate(over="ignore"):
        state = np.zeros(len(seed), np.uint64)
        for part in (seed, episode, step):
            state = _mix_words(state ^ np.asarray(part).astype(np.uint64))
        places = state[:, None] + np.arange(2 * width, dtype=np.uint64) * _GAMMA
        bits = _mix_words(places) >> np.uint64(11)
    uniform = (bits.astype(np.float64) + 0.5) * 2.0**-53
    radius = np.sqrt(-2.0 * np.log(uniform[:, :width]))
    return np.asarray(radius * np.cos(2.0 * np.pi * uniform[:, width:]))


class Noise:
    """White noise of the measurements from which a task's observations are made.

    The vehicle's own observations get noise where they are measured, so goals computed from them
    agree: a noisy depth plus the noisy distance to go is the true target. Heading and position have
    noise by these names: goals are computed from them, but no observation shows them. Noise under a
    goal's own name is added to the goal. Rewards and ends of episodes use the truth.
    """

    def __init__(
        self,
        noise: Mapping[str, float] | None,
        goals_from: Mapping[str, tuple[str, ...]],
        widths: Mapping[str, int],
    ):
        """Take standard deviations by name, in the unit of the observation.

        Args:
          goals_from: measurements of each goal of the task; see `GliderTask.goals_from`.
          widths: count of numbers in each observation, by name.

        Raises:
          InputError: an unknown observation, or a standard deviation below 0 or not finite.
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
        """Sample errors by name, each of shape (vehicles, numbers)."""
        drawn = normal(seed, episode, step, self._width)
        return {
            name: sigma * drawn[:, self._first[name]] for name, sigma in self.deviations.items()
        }


FLAT, DICT = "flat", "dict"
KINDS = (FLAT, DICT)
LIMIT = 10.0
"""Limit of flat observations, in their usual sizes."""


class Observations:
    """Spaces of a task's observations, and their conversion to these spaces."""

    def __init__(
        self,
        task: Any,
        widths: Mapping[str, int],
        kind: str,
        *,
        deviations: Mapping[str, float],
    ):
        """Prepare the spaces of a `GliderTask`.

        Args:
          widths: count of numbers in each observation of one vehicle, by name.
          kind: one of KINDS.
          deviations: standard deviations of noise, by name; see `Noise`.

        Raises:
          InputError: an unknown type.
        """
        if kind not in KINDS:
            raise InputError(unknown_name("observation", str(kind), KINDS))
        self.kind = kind
        self.widths = dict(widths)
        ends = itertools.pairwise(np.cumsum([0, *self.widths.values()]).tolist())
        self.columns = {name: slice(*two) for name, two in zip(self.widths, ends, strict=True)}
        """Columns of each observation in a flat one."""
        self.scale = np.concatenate([np.full(n, task.scale(k)) for k, n in self.widths.items()])
        """Usual size of each number of a flat observation, shape (width,)."""
        limits, everywhere = task.limits(), (-np.inf, np.inf)
        self.limits: dict[str, tuple[float, float]] = {}
        """Limits of each observation by name, in its unit."""
        for name in widths:
            made_of = {name, *task.goals_from.get(name, ())}
            room = LARGEST * sum(deviations.get(source, 0.0) for source in made_of)
            low, high = limits.get(name, everywhere)
            self.limits[name] = low - room, high + room

    @property
    def space(self) -> gymnasium.Space[Any]:
        """Gymnasium space of one vehicle's observation."""
        from gymnasium import spaces

        if self.kind == FLAT:
            return spaces.Box(-LIMIT, LIMIT, (len(self.scale),), np.float32)
        boxes: dict[str, Any] = {}
        for name, width in self.widths.items():
            boxes[name] = spaces.Box(*self.limits[name], (width,), np.float64)
        return spaces.Dict(boxes)

    def show(self, found: Mapping[str, Array]) -> Any:
        """Convert a task's observation, of one vehicle or of many, to this space."""
        if self.kind == DICT:
            return {name: np.clip(value, *self.limits[name]) for name, value in found.items()}
        values = np.concatenate(list(found.values()), axis=-1)
        values /= self.scale
        np.clip(values, -LIMIT, LIMIT, out=values)
        return values.astype(np.float32)


class Observed:
    """Base of environments, for one vehicle or many, that describe their flat observations."""

    _observations: Observations
    _noise: Noise

    def _observe(
        self,
        task: Any,
        first: Mapping[str, Array],
        observation: str,
        noise: Mapping[str, float] | None,
    ) -> None:
        """Set up observations; `first`, an observation of a single vehicle, gives their widths."""
        widths = {name: int(np.size(value)) for name, value in first.items()}
        self._noise = Noise(noise, task.goals_from, widths)
        deviations = self._noise.deviations
        self._observations = Observations(task, widths, observation, deviations=deviations)
        task.noise = self._errors if deviations else None

    def _errors(self) -> dict[str, Array]:
        """Errors of the observations in progress, by name."""
        raise NotImplementedError

    @property
    def columns(self) -> dict[str, slice]:
        """Columns of each observation in a flat one, by name."""
        return dict(self._observations.columns)

    @property
    def scale(self) -> Array:
        """Factors that convert a flat observation to SI units, shape (width,)."""
        return self._observations.scale.copy()
