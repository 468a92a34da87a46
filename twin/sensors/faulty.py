"""Faulty sensors: the readings that faults change under way, a sample after the other.

A fault acts on a sample as soon as the sensors that it changes have measured it, and before a
sensor that reads them, so that what is navigated by is what the log shows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.faults.base import Fault, FaultRun
from twin.numbers import Array


@dataclasses.dataclass(frozen=True, eq=False)
class _Acting:
    """A fault at work on some channels."""

    run: FaultRun
    channels: tuple[str, ...]
    delay: int
    """[samples] of the latest of the channels"""
    seed: int


class FaultySensors:
    """The faults of one mission's sensors."""

    def __init__(
        self,
        faults: Sequence[Fault],
        sensors: Sequence[tuple[Sequence[str], Sequence[str], int]],
        *,
        dt: float,
        rng_seed: np.random.SeedSequence,
    ):
        """Begin before the first sample.

        Args:
          faults: of the vehicle; those that change no reading are left out.
          sensors: what each one reads and writes, and its delay [samples], in their order.
          dt: [s] between samples.
          rng_seed: of the mission; each fault has a branch of its own.
        """
        self._dt = dt
        self._all: list[_Acting] = []
        self._after: dict[int, list[_Acting]] = {}
        tree = np.random.SeedSequence(rng_seed.entropy, spawn_key=(*rng_seed.spawn_key, _STREAM))
        seeds = tree.generate_state(max(len(faults), 1), np.uint64)
        channels = [name for _, writes, _ in sensors for name in writes]
        for fault, seed in zip(faults, seeds, strict=False):
            changed = changed_by(fault, channels)
            if not changed:
                continue
            writers = [k for k, (_, writes, _) in enumerate(sensors) if changed & set(writes)]
            readers = [
                k for k, (reads, _, _) in enumerate(sensors)
                if k > writers[-1] and changed & set(reads)
            ]  # fmt: skip
            last = min(readers, default=len(sensors)) - 1
            delay = max(sensors[k][2] for k in writers)
            acting = _Acting(fault.begin(), tuple(sorted(changed)), delay, int(seed))
            self._all.append(acting)
            self._after.setdefault(last, []).append(acting)

    def act(self, sensor: int, arrays: Mapping[str, Array], sample: int) -> None:
        """Change the readings whose turn has come when a sensor has measured a sample.

        Args:
          sensor: place of the sensor in the order.
          arrays: signals of the whole mission, shape (n,); changed in place.
          sample: the newest one.
        """
        for acting in self._after.get(sensor, ()):
            if sample >= acting.delay:
                self._change(acting, arrays, sample - acting.delay)

    def finish(self, arrays: Mapping[str, Array], count: int) -> None:
        """Change the readings of the last samples, which came late, of a mission that ended."""
        for acting in self._all:
            for sample in range(max(count - acting.delay, 0), count):
                self._change(acting, arrays, sample)

    def _change(self, acting: _Acting, arrays: Mapping[str, Array], sample: int) -> None:
        run = acting.run
        size = run.fault.at(np.array([sample * self._dt]))
        if not (size.any() or run.carried.size):
            return
        # a stream of each sample: what is drawn does not depend on how often it was asked for
        rng = np.random.default_rng((acting.seed, sample))
        signals = {name: values[sample : sample + 1] for name, values in arrays.items()}
        found = run.readings(signals, size, self._dt, rng)
        for name in acting.channels if size.any() else ():
            arrays[name][sample] = found[name][0]

    def state(self) -> dict[str, NDArray[Any]]:
        """What later readings depend on, as arrays by name."""
        return {f"fault:{k}": one.run.carried.copy() for k, one in enumerate(self._all)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from where `state` was called."""
        for index, one in enumerate(self._all):
            one.run.carried = np.array(state[f"fault:{index}"], np.float64)


_STREAM = 0xFA17
"""Of the branch of a mission's seed that faults draw from"""


def changed_by(fault: Fault, channels: Sequence[str]) -> set[str]:
    """Those of some channels whose readings a fault changes."""
    nothing = {name: np.full(1, np.nan) for name in channels}
    with np.errstate(all="ignore"):
        found = fault.readings(nothing, np.array([fault.size]), 1.0, np.random.default_rng(0))
    return set(found) & set(channels)
