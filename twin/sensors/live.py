"""Live sensors: a suite at work in one mission, sample by sample, as a vehicle under way has it.

The readings are those of `SensorSuite.measure` for the same seed and as many samples: the same
random numbers, drawn in the same order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.faults.base import Fault
from twin.numbers import Array
from twin.sensors.base import NOWHERE, Outset, SensorRun, Surroundings
from twin.sensors.faulty import FaultySensors
from twin.sensors.noise import sensor_generator
from twin.sensors.suite import SensorSuite, is_exact


class LiveSuite:
    """The sensors of a suite in one mission.

    A reading that needs samples after its own, such as a Doppler log's mean over an interval around
    it, comes as much later: `step` gives the last one that is known, `measured` puts each where it
    belongs.
    """

    def __init__(
        self,
        suite: SensorSuite,
        signals: Iterable[str],
        samples: int,
        *,
        dt: float,
        rng_seed: np.random.SeedSequence,
        drawn: Mapping[str, float] | None = None,
        surroundings: Surroundings = NOWHERE,
        wanted: Iterable[str] | None = None,
        faults: Sequence[Fault] = (),
    ):
        """Begin before the first sample.

        Args:
          suite: the sensors.
          signals: names of the true and commanded signals that a sample has.
          samples: of the mission at most; random numbers are drawn for so many.
          dt, rng_seed, drawn: as in `SensorSuite.measure`.
          surroundings: water, place and sea floor.
          wanted: measured signals; sensors that neither measure one nor are read for one stay out.
            None: all.
          faults: of the vehicle, which change what its sensors read.

        Raises:
          InputError: a signal is missing, or a sensor measures whole missions only.
        """
        self.suite, self.samples = suite, samples
        self.signals = tuple(signals)
        missing = [name for name in suite.reads(self.signals) if name not in self.signals]
        if missing:
            raise InputError(
                f"a sample lacks {', '.join(missing)}: the sensors need every signal of "
                "SensorSuite.reads"
            )
        self.drawn = suite.draw(rng_seed) if drawn is None else dict(drawn)
        self.count = 0
        """Samples so far."""
        self._runs: list[tuple[SensorRun | None, int, dict[str, str]]] = []
        delays: dict[str, int] = {}
        channels: list[str] = []
        order: list[tuple[Sequence[str], Sequence[str], int]] = []
        needed = _needed(suite, self.signals, wanted)
        for name, sensor in suite.items():
            if name not in needed:
                continue
            own = [entry.name for entry in sensor.channels(self.signals)]
            if not own:
                continue
            behind = {c: f"true_{c.removeprefix('measured_')}" for c in own}
            known = is_exact(sensor, self.drawn)
            truths = {c: t for c, t in behind.items() if known and t in self.signals}
            run = None
            if len(truths) < len(own):
                run = sensor.begin(
                    Outset(
                        samples=samples, signals=self.signals, dt=dt, drawn=self.drawn,
                        rng=sensor_generator(rng_seed, name), surroundings=surroundings,
                    )
                )  # fmt: skip
            delay = max([delays.get(c, 0) for c in sensor.inputs(self.signals)], default=0)
            if run is not None:
                delay += run.delay
            delays |= dict.fromkeys((c for c in own if c not in truths), delay)
            channels += own
            self._runs.append((run, delay, truths))
            order.append((sensor.inputs(self.signals), own, delay))
        self._faulty = FaultySensors(faults, order, dt=dt, rng_seed=rng_seed)
        self.channels = tuple(channels)
        """What it measures."""
        self._delays = delays
        self._arrays: dict[str, Array] = {
            name: np.full(samples, np.nan) for name in (*self.signals, *self.channels)
        }

    def step(self, sample: Mapping[str, float]) -> dict[str, float]:
        """Readings after a sample, by channel; NaN where there is none yet.

        Args:
          sample: true and commanded signals, in the units of the schema.

        Raises:
          InputError: the mission has had all of its samples.
        """
        k = self.count
        if k >= self.samples:
            raise InputError(
                f"the sensors were made for {self.samples} samples, which have been measured: "
                "make them for a longer mission"
            )
        for name in self.signals:
            self._arrays[name][k] = sample[name]
        self.count += 1
        for place, (run, delay, truths) in enumerate(self._runs):
            for channel, true in truths.items():
                self._arrays[channel][k] = self._arrays[true][k]
            if run is not None and k >= delay:
                self._put(run, truths, k - delay, k - delay + 1)
            self._faulty.act(place, self._arrays, k)
        return {name: self._last(name) for name in self.channels}

    def _put(self, run: SensorRun, truths: Mapping[str, str], first: int, last: int) -> None:
        for channel, values in run.measure(self._arrays, first, last).items():
            if channel not in truths:
                self._arrays[channel][first:last] = values

    def _last(self, channel: str) -> float:
        at = self.count - 1 - self._delays.get(channel, 0)
        return float(self._arrays[channel][at]) if at >= 0 else float("nan")

    def measured(self) -> dict[str, Array]:
        """The readings so far, each of shape (count,).

        The last ones of sensors that come later are measured as if the mission ended here; a step
        afterwards gives them again, as they are then.
        """
        out = {name: self._arrays[name][: self.count].copy() for name in self.channels}
        late = [(run, delay, truths) for run, delay, truths in self._runs if run and delay]
        if not late or not self.count:
            return out
        kept = self.state()
        ended = {name: values[: self.count] for name, values in self._arrays.items()}
        for run, delay, truths in late:
            first = max(self.count - delay, 0)
            for channel, values in run.finish(ended, first, self.count).items():
                if channel not in truths:
                    ended[channel][first:] = values
        self._faulty.finish(ended, self.count)
        out |= {name: ended[name].copy() for name in self.channels}
        self.restore(kept)
        return out

    def state(self) -> dict[str, NDArray[Any]]:
        """All that later readings depend on, as arrays by name; go on with `restore`."""
        state: dict[str, NDArray[Any]] = {
            f"signal:{name}": values[: self.count].copy() for name, values in self._arrays.items()
        }
        for index, (run, _, _) in enumerate(self._runs):
            if run is not None:
                state |= {f"run:{index}:{k}": v for k, v in run.state().items()}
        return state | self._faulty.state()

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from where `state` was called, with sensors that were made in the same way.

        Raises:
          InputError: it is of another suite, or of a longer mission.
        """
        names = {f"signal:{name}" for name in self._arrays}
        if names - set(state) or len(state[f"signal:{self.signals[0]}"]) > self.samples:
            raise InputError(
                "this state is of other sensors or of a longer mission: make the suite as it was "
                "when it was saved"
            )
        for name, values in self._arrays.items():
            saved = state[f"signal:{name}"]
            values[:] = np.nan
            values[: len(saved)] = saved
            self.count = len(saved)
        for index, (run, _, _) in enumerate(self._runs):
            if run is not None:
                own = f"run:{index}:"
                run.restore({k[len(own) :]: v for k, v in state.items() if k.startswith(own)})
        self._faulty.restore(state)


def _needed(suite: SensorSuite, signals: tuple[str, ...], wanted: Iterable[str] | None) -> set[str]:
    """Names of the sensors that measure something wanted, or that those read."""
    if wanted is None:
        return set(suite)
    signals_wanted, needed = set(wanted), set()
    for name, sensor in reversed(list(suite.items())):  # each comes after those that it reads
        if signals_wanted & {entry.name for entry in sensor.channels(signals)}:
            needed.add(name)
            signals_wanted |= set(sensor.inputs(signals))
    return needed
