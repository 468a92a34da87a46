"""Plan: how long each mission lasts and which split it belongs to, before any is flown.

Given current: one current for all missions, as `--current` describes it.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from factory.sampling.distribution import Distribution
from factory.sampling.draw import PLAN_STREAM
from twin.errors import InputError
from twin.physics.scenario import SAMPLE_PERIOD
from twin.records.attributes import SPLITS
from twin.water.current.axes import Origin
from twin.water.current.base import Current, current_from_dict, parse_current
from twin.water.current.sampler import Floats

TRAIN, VALIDATION, TEST = 0, 1, 2
VALIDATION_SHARE, TEST_SHARE = 0.15, 0.15
"""Of the missions; the rest trains (the paper's 70/15/15, by mission instead of by sample)."""
MIN_MISSIONS = len(SPLITS)
"""One for each split."""
MIN_DURATION_S = 60.0
"""A mission shorter than this has not even launched."""
HOUR = 3600.0
BYTES_PER_HOUR = 0.4e6
"""Of a store, roughly: preset paper takes 0.36 MB, field 0.49, short stores more"""
GIGABYTE = 1e9
MOST_HOURS = 1e7
"""[h] Of one store; drawing the lengths of more missions takes minutes before the first flies."""
_DURATION_STREAM, _SPLIT_STREAM = 0, 1


@dataclass(frozen=True, kw_only=True)
class Plan:
    """All missions of one store."""

    durations_s: tuple[float, ...]
    """[s] of each mission, multiples of the sample period"""
    splits: tuple[int, ...]
    """TRAIN, VALIDATION or TEST of each mission"""

    def __len__(self) -> int:
        return len(self.durations_s)

    @property
    def hours(self) -> float:
        """Total [h]."""
        return sum(self.durations_s) / HOUR

    @property
    def samples(self) -> int:
        """Samples of the longest mission."""
        return samples_in(max(self.durations_s))


def samples_in(duration_s: float) -> int:
    """Samples of a mission, both ends included."""
    return round(duration_s / SAMPLE_PERIOD) + 1


def check_hours(hours: float) -> None:
    """Raise InputError unless `hours` [h] is a positive number that can be planned."""
    if np.isnan(hours):
        raise InputError("--hours nan is not a number; give hours, such as 10")
    if not hours > 0.0:
        raise InputError(f"--hours {hours:g} must be above 0")
    if hours > MOST_HOURS:
        raise InputError(
            f"--hours {hours:g} would need about {_size(hours)}; give at most {MOST_HOURS:g}, and "
            "more as several stores of different --seed"
        )


def check_room(hours: float, store: Path) -> None:
    """Raise InputError when the disk of `store` has no room for `hours` [h]."""
    check_hours(hours)
    folder = next(p for p in (store.absolute(), *store.absolute().parents) if p.is_dir())
    free = shutil.disk_usage(folder).free
    if hours * BYTES_PER_HOUR > free:
        raise InputError(
            f"--hours {hours:g} needs about {_size(hours)}, and {folder} has {free / GIGABYTE:.3g} "
            "GB free: give fewer hours or an --out on another disk"
        )


def _size(hours: float) -> str:
    return f"{hours * BYTES_PER_HOUR / GIGABYTE:.3g} GB"


def plan_missions(duration_h: Distribution, *, hours: float, seed: int) -> Plan:
    """Draw missions until their durations make `hours` [h]; the last ones are cut to fit.

    Raises:
      InputError: hours that are not positive, or too few for three missions.
    """
    check_hours(hours)
    total = round(hours * HOUR / SAMPLE_PERIOD)
    if total * SAMPLE_PERIOD < MIN_MISSIONS * MIN_DURATION_S:
        raise InputError(
            f"--hours {hours:g} is too little: each of the splits {', '.join(SPLITS)} needs a "
            f"mission of {MIN_DURATION_S:g} s, so give at least "
            f"{MIN_MISSIONS * MIN_DURATION_S / HOUR:g}"
        )
    rng = _generator(seed, _DURATION_STREAM)
    durations: list[int] = []
    remaining = total
    while remaining > 0:
        drawn = duration_h.draw(rng)
        if isinstance(drawn, str) or not drawn * HOUR >= MIN_DURATION_S:
            raise InputError(
                f"mission.duration_h = {duration_h.text()} gives {drawn}: draw hours, at least "
                f"{MIN_DURATION_S / HOUR:g}"
            )
        durations.append(round(drawn * HOUR / SAMPLE_PERIOD))
        remaining -= durations[-1]
    durations[-1] += remaining
    _settle_last(durations, duration_h)
    if len(durations) < MIN_MISSIONS:
        durations = _equal_parts(total, MIN_MISSIONS)
    return Plan(
        durations_s=tuple(n * SAMPLE_PERIOD for n in durations),
        splits=split_missions(len(durations), seed),
    )


def _settle_last(durations: list[int], duration_h: Distribution) -> None:
    """Join a last mission that came out too short with the one before, or share with it."""

    def allowed(samples: int) -> bool:
        return duration_h.allows(samples * SAMPLE_PERIOD / HOUR)

    if len(durations) < 2 or allowed(durations[-1]):
        return
    both = durations[-2] + durations[-1]
    durations[-2:] = [both] if allowed(both) else _equal_parts(both, 2)


def _equal_parts(total: int, parts: int) -> list[int]:
    return [total // parts + (i < total % parts) for i in range(parts)]


def split_missions(count: int, seed: int) -> tuple[int, ...]:
    """A split for each of `count` missions, at least one of each."""
    validation = max(1, round(VALIDATION_SHARE * count))
    test = max(1, round(TEST_SHARE * count))
    splits = np.full(count, TRAIN)
    splits[:validation] = VALIDATION
    splits[validation : validation + test] = TEST
    return tuple(_generator(seed, _SPLIT_STREAM).permutation(splits).tolist())


def _generator(seed: int, stream: int) -> np.random.Generator:
    key = (PLAN_STREAM, stream)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenCurrent(Current):
    """A current compiled once, however many missions meet it; gridded files are read once."""

    program: Floats
    """Compiled for the longest mission"""
    description: Mapping[str, Any]
    """What `current_from_dict` rebuilds it from, everything pinned"""

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Not needed: `compile` has the program."""
        raise NotImplementedError("a given current is compiled already")

    def compile(self, duration_s: float, origin: Origin | None = None) -> Floats:
        """The program, the same for every mission."""
        return self.program

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """As the current itself."""
        return current_from_dict(self.description).begins(duration_s, origin)

    def describe(self) -> dict[str, Any]:
        """The description."""
        return dict(self.description)


def given_current(text: str, longest_s: float) -> GivenCurrent:
    """From a `--current` text, for missions of at most `longest_s` [s]; raises CurrentError."""
    return _compiled(parse_current(text).pinned(longest_s), longest_s)


def stored_current(description: Mapping[str, Any], longest_s: float) -> GivenCurrent:
    """From a store's description; raises CurrentError when a file has changed."""
    return _compiled(current_from_dict(description), longest_s)


def _compiled(current: Current, longest_s: float) -> GivenCurrent:
    return GivenCurrent(program=current.compile(longest_s), description=current.describe())
