"""Live sensors: a suite that measures a mission sample by sample, as on a vehicle under way.

The readings equal those of `SensorSuite.measure` for the same seed and number of samples, because
the same random numbers are sampled in the same order. A fault changes a sample once the affected
sensors have measured it, and before other sensors read it. The vehicle then navigates by the
readings in its log.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.faults.base import Fault, FaultRun
from twin.numbers import Array
from twin.sensors.base import NOWHERE, Outset, SensorRun, Surroundings, sensor_generator
from twin.sensors.suite import SensorSuite, truths

_STREAM = 0xFA17
"""Branch of a mission's seed for the faults."""


class LiveSuite:
    """The sensors of a suite in one mission.

    A reading that needs later samples, such as a Doppler log's mean over an interval, is late by
    that many samples. `step` returns the latest known reading; `measured` assigns each reading to
    its own sample.
    """

    def __init__(
        self,
        suite: SensorSuite,
        signals: Iterable[str],
        samples: int,
        *,
        dt: float,
        rng_seed: np.random.SeedSequence,
        surroundings: Surroundings = NOWHERE,
        wanted: Iterable[str] | None = None,
        faults: Sequence[Fault] = (),
    ):
        """Begin before the first sample.

        Args:
          suite: the sensors.
          signals: names of the true and commanded signals of a sample.
          samples: largest number in the mission; random numbers are sampled for all of them.
          dt, rng_seed: as in `SensorSuite.measure`.
          surroundings: water, place and sea floor.
          wanted: measured signals; sensors that these do not need, directly or through others, are
            left out. None: all.
          faults: faults of the vehicle; some change sensor readings.

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
        self.drawn = suite.draw(rng_seed)
        self.count = 0
        """Number of samples so far."""
        self._runs: list[tuple[SensorRun | None, int, dict[str, str]]] = []
        self._delays: dict[str, int] = {}
        order: list[tuple[Sequence[str], Sequence[str], int]] = []
        needed = _needed(suite, self.signals, wanted)
        for name, sensor in suite.items():
            own = [entry.name for entry in sensor.channels(self.signals)]
            if name not in needed or not own:
                continue
            known = truths(sensor, own, self.signals, self.drawn)
            inputs, run = sensor.inputs(self.signals), None
            delay = max([self._delays.get(channel, 0) for channel in inputs], default=0)
            if len(known) < len(own):
                run = sensor.begin(
                    Outset(
                        samples=samples, signals=self.signals, dt=dt, drawn=self.drawn,
                        rng=sensor_generator(rng_seed, name), surroundings=surroundings,
                    )
                )  # fmt: skip
                delay += run.delay
            self._delays |= dict.fromkeys((c for c in own if c not in known), delay)
            self._runs.append((run, delay, known))
            order.append((inputs, own, delay))
        self._faulty = FaultySensors(faults, order, dt=dt, rng_seed=rng_seed)
        self.channels = tuple(channel for _, own, _ in order for channel in own)
        """Measured channels."""
        self._arrays: dict[str, Array] = {
            name: np.full(samples, np.nan) for name in (*self.signals, *self.channels)
        }

    def step(self, sample: Mapping[str, float]) -> dict[str, float]:
        """Take a sample and return the latest readings by channel; NaN where there is none yet.

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
        for place, (run, delay, known) in enumerate(self._runs):
            for channel, true in known.items():
                self._arrays[channel][k] = self._arrays[true][k]
            if run is not None and k >= delay:
                for channel, values in run.measure(self._arrays, k - delay, k - delay + 1).items():
                    if channel not in known:
                        self._arrays[channel][k - delay] = values[0]
            self._faulty.act(place, self._arrays, k)
        latest = {name: k - self._delays.get(name, 0) for name in self.channels}
        return {
            name: float(self._arrays[name][at]) if at >= 0 else math.nan
            for name, at in latest.items()
        }

    def measured(self) -> dict[str, Array]:
        """Return the readings so far, each of shape (count,).

        The last readings of late sensors are measured as if the mission ended here; a later `step`
        measures them again with the samples that follow.
        """
        out = {name: self._arrays[name][: self.count].copy() for name in self.channels}
        delayed = [(run, delay, known) for run, delay, known in self._runs if run and delay]
        if not delayed or not self.count:
            return out
        kept = self.state()
        ended = {name: values[: self.count] for name, values in self._arrays.items()}
        for run, delay, known in delayed:
            first = max(self.count - delay, 0)
            for channel, values in run.finish(ended, first, self.count).items():
                if channel not in known:
                    ended[channel][first:] = values
        self._faulty.finish(ended, self.count)
        out |= {name: ended[name].copy() for name in self.channels}
        self.restore(kept)
        return out

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays by name on which later readings depend, for `restore`."""
        state: dict[str, NDArray[Any]] = {
            f"signal:{name}": values[: self.count].copy() for name, values in self._arrays.items()
        }
        for index, (run, _, _) in enumerate(self._runs):
            if run is not None:
                state |= {f"run:{index}:{k}": v for k, v in run.state().items()}
        return state | self._faulty.state()

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a `state`, with sensors made in the same way.

        Raises:
          InputError: the state is from another suite, or from a longer mission.
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
    """Names of the sensors that measure a wanted signal, and of the sensors that these read."""
    if wanted is None:
        return set(suite)
    signals_wanted, needed = set(wanted), set()
    for name, sensor in reversed(list(suite.items())):  # sensors come after those that they read
        if signals_wanted & {entry.name for entry in sensor.channels(signals)}:
            needed.add(name)
            signals_wanted |= set(sensor.inputs(signals))
    return needed


class _ActiveFault(NamedTuple):
    """A fault that acts on some channels."""

    run: FaultRun
    channels: tuple[str, ...]
    delay: int
    """[samples] Delay of the latest of the channels."""
    seed: int


class FaultySensors:
    """Faults of one mission's sensors."""

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
          faults: faults of the vehicle; those that change no reading are left out.
          sensors: signals read and written and delay [samples] of each sensor, in order.
          dt: [s] between samples.
          rng_seed: seed of the mission; each fault has a branch of its own.
        """
        self._dt = dt
        self._all: list[_ActiveFault] = []
        self._after: dict[int, list[_ActiveFault]] = {}
        tree = np.random.SeedSequence(rng_seed.entropy, spawn_key=(*rng_seed.spawn_key, _STREAM))
        seeds = tree.generate_state(max(len(faults), 1), np.uint64)
        channels = [name for _, writes, _ in sensors for name in writes]
        nothing, probe = {name: np.full(1, np.nan) for name in channels}, np.random.default_rng(0)
        for fault, seed in zip(faults, seeds, strict=False):
            with np.errstate(all="ignore"):
                found = fault.readings(nothing, np.array([fault.size]), 1.0, probe)
            changed = set(found) & set(channels)
            if not changed:
                continue
            writers = [k for k, (_, writes, _) in enumerate(sensors) if changed & set(writes)]
            readers = [
                k for k, (reads, _, _) in enumerate(sensors)
                if k > writers[-1] and changed & set(reads)
            ]  # fmt: skip
            last = min(readers, default=len(sensors)) - 1
            delay = max(sensors[k][2] for k in writers)
            acting = _ActiveFault(fault.begin(), tuple(sorted(changed)), delay, int(seed))
            self._all.append(acting)
            self._after.setdefault(last, []).append(acting)

    def act(self, sensor: int, arrays: Mapping[str, Array], sample: int) -> None:
        """Apply the faults that are due after a sensor has measured a sample.

        Args:
          sensor: place of the sensor in the order.
          arrays: signals of the whole mission, shape (n,); changed in place.
          sample: index of the newest sample.
        """
        for acting in self._after.get(sensor, ()):
            if sample >= acting.delay:
                self._change(acting, arrays, sample - acting.delay)

    def finish(self, arrays: Mapping[str, Array], count: int) -> None:
        """Apply the faults to the late readings of a mission that ended after `count` samples."""
        for acting in self._all:
            for sample in range(max(count - acting.delay, 0), count):
                self._change(acting, arrays, sample)

    def _change(self, acting: _ActiveFault, arrays: Mapping[str, Array], sample: int) -> None:
        run = acting.run
        size = run.fault.at(np.array([sample * self._dt]))
        if not (size.any() or run.carried.size):
            return
        # one stream per sample, so that random numbers do not depend on repeated calls
        rng = np.random.default_rng((acting.seed, sample))
        signals = {name: values[sample : sample + 1] for name, values in arrays.items()}
        found = run.readings(signals, size, self._dt, rng)
        for name in acting.channels if size.any() else ():
            arrays[name][sample] = found[name][0]

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays by name on which later readings depend."""
        return {f"fault:{k}": one.run.carried.copy() for k, one in enumerate(self._all)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a `state` saved earlier."""
        for index, one in enumerate(self._all):
            one.run.carried = np.array(state[f"fault:{index}"], np.float64)
