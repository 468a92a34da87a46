"""Observations: a task's named arrays as Gymnasium's spaces, flat or by name.

Flat ones are one vector of 32-bit numbers: each observation over the size that it usually has
(`GliderTask.scale`), cut off at `LIMIT` of them, in the task's order. So a network gets numbers of
order 1 without a running mean. By name they are 64-bit numbers in the suite's units, cut off at the
task's generous limits (`GliderTask.limits`), which noise widens.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from twin.control.task import GliderTask
from twin.control.white_noise import LARGEST
from twin.errors import InputError, unknown_name
from twin.numbers import Array

FLAT, DICT = "flat", "dict"
KINDS = (FLAT, DICT)
LIMIT = 10.0
"""Usual sizes at which flat observations are cut off"""


class Observations:
    """How the observations of a task are shown."""

    def __init__(
        self,
        task: GliderTask,
        widths: Mapping[str, int],
        kind: str,
        *,
        deviations: Mapping[str, float],
    ):
        """For a task.

        Args:
          widths: numbers of each observation of one vehicle, by name.
          kind: one of KINDS.
          deviations: of noise, by name; see `twin.control.white_noise.Noise`.

        Raises:
          InputError: an unknown kind.
        """
        if kind not in KINDS:
            raise InputError(unknown_name("observation", str(kind), KINDS))
        self.kind = kind
        self.widths = dict(widths)
        ends = np.cumsum([0, *self.widths.values()]).tolist()
        self.columns = {
            name: slice(first, last)
            for name, first, last in zip(self.widths, ends, ends[1:], strict=False)
        }
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
        """Of one vehicle."""
        if self.kind == FLAT:
            return spaces.Box(-LIMIT, LIMIT, (len(self.scale),), np.float32)
        return spaces.Dict(
            {
                name: spaces.Box(*self.limits[name], (width,), np.float64)
                for name, width in self.widths.items()
            }
        )

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

    @property
    def columns(self) -> dict[str, slice]:
        """Where each observation stands in a flat one, by name."""
        return dict(self._observations.columns)

    @property
    def scale(self) -> Array:
        """What a flat observation is multiplied by to be in SI units, shape (width,)."""
        return self._observations.scale.copy()
