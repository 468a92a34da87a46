"""Features by name: one definition for whole missions and for single samples.

A feature is a function of a few terms. A term is the last value, mean or slope of one signal over
its last samples. Terms are linear in their samples, so that both computations, and code for
other machines, agree. A vehicle's own parts have features too."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np

from twin import seams
from twin.errors import InputError, unknown_name
from twin.navigation.dead_reckoning import values_of
from twin.numbers import Array
from twin.records.schema import SIMULATED, VARIABLES, WITH_FLOOR
from twin.registry import Registry

Channels = Mapping[str, Array]
"""Signals (time,) of one mission by schema name; angles in degrees as stored"""

SLOW_S = 10.0
"""[s] Window of the slow features: long against sensor noise at 2 Hz, short against the 30-60 s
that a glider takes to settle."""

Shape = Literal["plain", "sine", "cosine", "angle"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
Look = Literal["last", "mean", "slope"]
LOOKS: tuple[Look, ...] = get_args(Look)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Term:
    """Linear function of one signal's last samples."""

    channel: str
    """Schema variable."""
    shape: Shape = "plain"
    """Function of each sample: itself; sine or cosine of an angle in degrees; or the angle in
    radians without jumps at 360 degrees."""
    look: Look = "last"
    """Last sample, or mean or least-squares slope [unit/s] of the window."""
    seconds: float = 0.0
    """[s] Length of the window; a window has at least two samples."""

    def __post_init__(self) -> None:
        for value, known in ((self.shape, SHAPES), (self.look, LOOKS)):
            if value not in known:
                raise InputError(f"a term cannot be {value!r}: choose {' or '.join(known)}")

    def samples(self, period: float) -> int:
        """Number of samples in the window, with one every `period` [s]."""
        return 1 if self.look == "last" else max(2, round(self.seconds / period))

    def compute(self, signals: Channels, period: float) -> Array:
        """Compute the values (time,) over one mission."""
        values = _SHAPED[self.shape](signals[self.channel])
        if self.look == "mean":
            return trailing_mean(values, self.samples(period))
        if self.look == "slope":
            return trailing_slope(values, self.samples(period), period)
        return values


@dataclasses.dataclass(frozen=True, kw_only=True)
class Feature:
    """Feature: one input of the networks."""

    name: str
    group: str
    """Group whose mask switches off this feature together with similar ones."""
    unit: str
    terms: tuple[Term, ...]
    combine: Callable[..., Any] | None = dataclasses.field(default=None, repr=False)
    """Function that gives the feature from the terms' values, in order, for arrays and numbers.
    None: the feature is the value of its one term."""
    c: str = dataclasses.field(default="", repr=False)
    """`combine` in C99, for vehicles without Python: the body of a function that returns a float
    from the terms' values `const float *t`."""
    odd: bool | None = False
    """True if the sign changes when the vehicle is mirrored, port for starboard; None: the store's
    vehicle decides."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Variables that the feature reads, of the schema or of `twin.navigation.settings`."""
        return tuple(dict.fromkeys(term.channel for term in self.terms))

    def compute(self, signals: Channels, period: float) -> Array:
        """Compute the values (time,) of a mission with one sample every `period` [s].

        `FeatureSteps` gives the same values sample by sample.
        """
        values = [term.compute(signals, period) for term in self.terms]
        return values[0] if self.combine is None else np.asarray(self.combine(*values))

    def flaw(self, name: str) -> str:
        """First fault of the feature, such as reading true signals; empty if it has none."""
        if not name.isidentifier():
            return "its name must be of letters, digits and underscores"
        if not self.terms or (self.combine is None and len(self.terms) > 1):
            return "it needs one term, or `combine` for its terms"
        for channel in self.channels:
            if not channel.startswith(("measured_", "commanded_", "estimated_")):
                return (
                    f"it reads {channel}: a network sees only what is measured_*, commanded_* or "
                    "estimated_*"
                )
        return ""


def trailing_slope(values: Array, samples: int, period: float) -> Array:
    """Least-squares slope [unit/s] over the last `samples` values; no later value is used.

    Before the first sample the signal counts as constant, as at a launch from rest. Two samples
    give the backward difference.
    """
    padded = np.concatenate([np.full(samples - 1, values[0]), values])
    return np.convolve(padded, slope_weights(samples, period)[::-1], mode="valid")


def slope_weights(samples: int, period: float) -> Array:
    """Weights (samples,) of samples, oldest first, for their least-squares slope [unit/s]."""
    places = np.arange(samples) - (samples - 1) / 2
    return np.asarray(places / (places @ places) / period)


def trailing_mean(values: Array, samples: int) -> Array:
    """Mean of the last `samples` values, fewer at the start."""
    total = np.concatenate([[0.0], np.cumsum(values - values[0])])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - samples, 0)
    return (total[last] - total[first]) / (last - first) + values[0]


_SHAPED: dict[str, Callable[[Array], Array]] = {
    "plain": lambda values: values,
    "sine": lambda values: np.sin(np.deg2rad(values)),
    "cosine": lambda values: np.cos(np.deg2rad(values)),
    "angle": lambda values: np.unwrap(np.deg2rad(values)),
}


FEATURES: Registry[Feature] = seams.FEATURES
"""All features by name."""

register = FEATURES.add
"""Add a feature to `FEATURES`."""

GLIDER_PARTS = ("shift", "rotation", "pump")
"""Parts whose features are in `FEATURES`. Features of other parts have the channels' names:
`measured_rudder` in the group `controls`, `commanded_rudder` in `commands`."""
PART_GROUPS = {"measured": "controls", "commanded": "commands"}
"""Group of a part's channel, by the channel's prefix."""


def feature(name: str) -> Feature:
    """Return the feature of that name, from `FEATURES` or of a vehicle's part.

    Raises:
      InputError: no feature has that name; the message has the nearest.
    """
    if name in FEATURES:
        return FEATURES[name]
    if not is_part_channel(name):
        raise InputError(unknown_name("feature", name, FEATURES))
    return Feature(
        name=name,
        group=PART_GROUPS[name.partition("_")[0]],
        unit=VARIABLES[name].units if name in VARIABLES else "",
        terms=(Term(channel=name),),
        odd=None,
    )


def is_known(name: str) -> bool:
    """True if `feature` accepts the name."""
    return name in FEATURES or is_part_channel(name)


def is_part_channel(name: str) -> bool:
    """True if the name is the measured or commanded channel of a part without shipped features."""
    kind, _, part = name.partition("_")
    return kind in PART_GROUPS and bool(part) and name not in (*SIMULATED, *WITH_FLOOR)


def channels_of(features: Iterable[str]) -> tuple[str, ...]:
    """Channels that these features read, each once: of the schema, or estimated."""
    return tuple(dict.fromkeys(c for name in features for c in feature(name).channels))


class FeatureSteps:
    """Values of several features, sample by sample, equal to those of `Feature.compute`.

    Terms that features share are computed once. All terms are weighted sums over one window of the
    last samples, (terms, samples).
    """

    def __init__(self, features: Sequence[str | Feature], period: float):
        """Create the steps.

        Args:
          features: names or features, in the order of the values.
          period: [s] between samples.
        """
        self.period = period
        self.features = tuple(feature(f) if isinstance(f, str) else f for f in features)
        terms = tuple(dict.fromkeys(term for f in self.features for term in f.terms))
        self.channels = tuple(dict.fromkeys(term.channel for term in terms))
        """Schema variables that a sample must hold."""
        column = {name: k for k, name in enumerate(self.channels)}
        place = {term: k for k, term in enumerate(terms)}
        self._columns = np.array([column[term.channel] for term in terms], int)
        shapes = np.array([term.shape for term in terms])
        self._sine, self._cosine, self._angle = (
            np.flatnonzero(shapes == shape) for shape in ("sine", "cosine", "angle")
        )
        lengths = [term.samples(period) for term in terms]
        self._weights = np.zeros((len(terms), max(lengths, default=1)))
        for k, (term, length) in enumerate(zip(terms, lengths, strict=True)):
            slope = term.look == "slope"
            self._weights[k, -length:] = slope_weights(length, period) if slope else 1.0 / length
        self._means = np.flatnonzero([term.look == "mean" for term in terms])
        self._lengths = np.array(lengths, int)[self._means]
        plain = [(k, place[f.terms[0]]) for k, f in enumerate(self.features) if f.combine is None]
        self._combined = [
            (k, f.combine, [place[term] for term in f.terms])
            for k, f in enumerate(self.features)
            if f.combine is not None
        ]
        self._to, self._from = np.array(plain, int).reshape(-1, 2).T
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._window = np.zeros_like(self._weights)
        self._angles = np.zeros(self._angle.size)
        self._count = 0

    def step(self, sample: Mapping[str, float]) -> Array:
        """Compute the values (features,) after a sample, in their own units.

        Args:
          sample: a finite value for each of `channels`, in the schema's units.

        Raises:
          InputError: a channel is missing or not finite.
        """
        readers = f"; its features read {', '.join(self.channels)}"
        wrong = (
            f" is not finite at sample {self._count}: hold the last good value, or leave the "
            "sample out"
        )
        given = values_of(sample, self.channels, readers, wrong)
        looked = self._look(np.array(given)[self._columns])
        values = np.empty(len(self.features))
        values[self._to] = looked[self._from]
        for k, combine, places in self._combined:
            values[k] = combine(*looked[places])
        return values

    def _look(self, given: Array) -> Array:
        """Values of the terms, (terms,), after a sample of each, (terms,)."""
        given[self._sine] = np.sin(np.deg2rad(given[self._sine]))
        given[self._cosine] = np.cos(np.deg2rad(given[self._cosine]))
        if self._angle.size:
            turned = np.deg2rad(given[self._angle])
            if self._count:
                turn = turned - self._angles
                turned = self._angles + turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
            given[self._angle] = self._angles = turned
        if self._count:
            self._window[:, :-1] = self._window[:, 1:]
            self._window[:, -1] = given
        else:  # before the first sample a signal counts as constant
            self._window[:] = given[:, None]
        self._count += 1
        looked = np.einsum("ts,ts->t", self._weights, self._window)
        if self._count < self._weights.shape[1]:
            for k, length in zip(self._means, self._lengths, strict=True):
                if self._count < length:
                    looked[k] = self._window[k, -self._count :].mean()
        return looked

    def state(self) -> dict[str, Array]:
        """State as arrays by name, for `restore`."""
        return {
            "window": self._window.copy(),
            "angles": self._angles.copy(),
            "count": np.array(float(self._count)),
        }

    def restore(self, state: Mapping[str, Array]) -> None:
        """Continue from the state that `state` returned, here or in another process.

        Raises:
          InputError: the state has other features or another period.
        """
        if set(self.state()) - set(state) or np.shape(state["window"]) != self._window.shape:
            raise InputError(
                "this state is of other features or of another period: make the steps as they "
                "were when it was saved"
            )
        self._window = np.array(state["window"], np.float64)
        self._angles = np.array(state["angles"], np.float64)
        self._count = int(state["count"])
