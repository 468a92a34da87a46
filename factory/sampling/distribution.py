"""Distribution: probability distribution of a mission's parameter, and its text form.

35                                 always 35
none                               not used (NaN)
uniform(15, 45)                    also: uniform(15, 45) except (28, 32) (38, 40)
loguniform(40, 500)
normal(0, 0.7)                     mean, standard deviation
choice(saw-tooth: 0.7, spiral: 0.3)   options with or without weights

`Parameter` is one row of the table of parameters (`factory.sampling.parameters`).
`number` and `limit` read the sampled values of a mission.
"""

from __future__ import annotations

import abc
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from twin.errors import InputError, unknown_name

if TYPE_CHECKING:
    import numpy as np


Value = float | str
Interval = tuple[float, float]

MAX_REDRAWS = 1000
"""Maximum number of attempts to sample a value outside the exclusions, before an error."""
MOST_TEXT = 10_000
"""[character] Longest text of a distribution, enough for a choice among a thousand words"""


class Distribution(abc.ABC):
    """Distribution of one parameter."""

    @abc.abstractmethod
    def draw(self, rng: np.random.Generator) -> Value:
        """Sample one value."""

    @abc.abstractmethod
    def text(self) -> str:
        """Return the text form, which `parse_distribution` reads back."""

    @abc.abstractmethod
    def allows(self, value: Value) -> bool:
        """Return whether the distribution can give `value`."""

    @property
    @abc.abstractmethod
    def highest(self) -> float:
        """Largest number that it gives; of a normal one, what one draw in 1e9 exceeds."""


@dataclass(frozen=True)
class Fixed(Distribution):
    """Fixed value, or NaN for "not used"."""

    value: Value

    def draw(self, rng: np.random.Generator) -> Value:
        """Return the value."""
        return self.value

    def text(self) -> str:
        """Return a number, a word or none."""
        if isinstance(self.value, str):
            return self.value
        return _number(self.value)

    def allows(self, value: Value) -> bool:
        """Return whether `value` is the fixed value."""
        if isinstance(value, float) and isinstance(self.value, float) and math.isnan(value):
            return math.isnan(self.value)
        return value == self.value

    @property
    def highest(self) -> float:
        """The value; NaN for a word."""
        return math.nan if isinstance(self.value, str) else self.value


@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform in [low, high) without the excluded open intervals."""

    low: float
    high: float
    excluded: tuple[Interval, ...] = ()

    def __post_init__(self) -> None:
        self._check_range()
        left = self.high - self.low
        for low, high in self.excluded:
            if not low < high:
                raise InputError(f"{self.text()}: except ({low:g}, {high:g}) is empty; swap them")
            left -= max(0.0, min(high, self.high) - max(low, self.low))
        if left <= 1e-3 * (self.high - self.low):
            raise InputError(f"{self.text()}: the exclusions leave nothing to draw")

    def _check_range(self) -> None:
        if not (math.isfinite(self.high - self.low) and self.low < self.high):
            raise InputError(f"{self.text()}: give low < high, both finite")

    def draw(self, rng: np.random.Generator) -> float:
        """Sample one value."""
        for _ in range(MAX_REDRAWS):
            if not self._excludes(value := self._draw(rng)):
                return value
        raise InputError(f"{self.text()}: the exclusions leave almost nothing to draw")

    def _draw(self, rng: np.random.Generator) -> float:
        return float(rng.uniform(self.low, self.high))

    def _excludes(self, value: float) -> bool:
        return any(low < value < high for low, high in self.excluded)

    def text(self) -> str:
        """Return the name, (low, high) and the exclusions."""
        pairs = " ".join(f"({_number(low)}, {_number(high)})" for low, high in self.excluded)
        name = type(self).__name__.lower()
        range_ = f"{name}({_number(self.low)}, {_number(self.high)})"
        return f"{range_} except {pairs}" if pairs else range_

    def allows(self, value: Value) -> bool:
        """Return whether `value` is inside the range and outside every exclusion."""
        return isinstance(value, float) and self._includes(value) and not self._excludes(value)

    def _includes(self, value: float) -> bool:
        return self.low <= value <= self.high

    @property
    def highest(self) -> float:
        """Upper end."""
        return self.high


class LogUniform(Uniform):
    """Uniform in the logarithm, in [low, high), without the excluded open intervals."""

    def __post_init__(self) -> None:
        self._check_range()
        if self.low <= 0.0:
            raise InputError(f"{self.text()}: the lower bound must be above 0")

    def _draw(self, rng: np.random.Generator) -> float:
        return math.exp(rng.uniform(math.log(self.low), math.log(self.high)))

    def _includes(self, value: float) -> bool:
        slack = 1e-12 * self.high  # rounding of the exponential
        return self.low - slack <= value <= self.high + slack


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal with a mean and a standard deviation."""

    mean: float
    std: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.std) and self.std > 0.0):
            raise InputError(f"{self.text()}: give a finite mean and a positive deviation")

    def draw(self, rng: np.random.Generator) -> float:
        """Sample one value."""
        return float(rng.normal(self.mean, self.std))

    def text(self) -> str:
        """Return `normal(mean, std)`."""
        return f"normal({_number(self.mean)}, {_number(self.std)})"

    def allows(self, value: Value) -> bool:
        """Return whether `value` is a finite number."""
        return isinstance(value, float) and math.isfinite(value)

    @property
    def highest(self) -> float:
        """Six standard deviations above the mean."""
        return self.mean + 6.0 * self.std


@dataclass(frozen=True)
class Choice(Distribution):
    """Choice of one of several options, with weights."""

    options: tuple[Value, ...]
    weights: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.options or len(set(self.options)) < len(self.options):
            raise InputError(f"{self.text()}: give options that differ, at least one")
        if not all(isinstance(option, str) or math.isfinite(option) for option in self.options):
            raise InputError(f"{self.text()}: numbers among the options must be finite")
        total = sum(self.weights)
        if not math.isfinite(total) or min(self.weights) < 0.0 or total <= 0.0:
            raise InputError(
                f"{self.text()}: weights must be finite and must not be negative, nor all 0"
            )

    def draw(self, rng: np.random.Generator) -> Value:
        """Sample one option."""
        total = sum(self.weights)
        return self.options[int(rng.choice(len(self.options), p=[w / total for w in self.weights]))]

    def text(self) -> str:
        """Return `choice(option: weight, ...)`."""
        items = zip(self.options, self.weights, strict=True)
        inner = ", ".join(
            (o if isinstance(o, str) else _number(o)) + ("" if w == 1.0 else f": {_number(w)}")
            for o, w in items
        )
        return f"choice({inner})"

    def allows(self, value: Value) -> bool:
        """Return whether `value` is an option with a weight above 0."""
        items = zip(self.options, self.weights, strict=True)
        return any(value == option and weight > 0.0 for option, weight in items)

    @property
    def highest(self) -> float:
        """Largest option that it gives; NaN if all are words."""
        numbers = (o for o in self.options if not isinstance(o, str) and self.allows(o))
        return max(numbers, default=math.nan)


_FORMS = ("uniform", "loguniform", "normal", "choice")
_CALL = re.compile(r"^\s*([a-z]+)\s*\(([^()]*)\)\s*(?:except\s*((?:\([^()]*\)\s*(?:,\s*)?)+))?$")
_PAIR = re.compile(r"\(([^()]*)\)")


def parse_distribution(text: str | float | int, name: str = "value") -> Distribution:
    """Parse the text of a distribution; a plain number is a fixed value.

    Raises:
      InputError: the text is wrong; the error contains `name` and the reason.
    """
    if isinstance(text, bool) or not isinstance(text, str | int | float):
        raise InputError(f"{name} = {text!r}: give a number or a text such as 'uniform(15, 45)'")
    if isinstance(text, str):
        if len(text) > MOST_TEXT:
            raise InputError(f"{name} has {len(text)} characters, at most {MOST_TEXT} are possible")
        text = text.strip()
        if text == "none":
            return Fixed(math.nan)
    try:
        value, said = float(text), str(text)
    except OverflowError:  # a whole number with hundreds of digits
        value, said = math.inf, "a number beyond 1e308"
    except ValueError:
        return _parse_words(str(text), name)
    if not math.isfinite(value):
        raise InputError(f"{name} = {said}: give a finite number, or none for 'not used'")
    return Fixed(value)


def _parse_words(text: str, name: str) -> Distribution:
    """Parse a distribution that is no plain number."""
    if re.fullmatch(r"[A-Za-z][\w-]*", text):
        return Fixed(text)
    match = _CALL.match(text)
    if match is None:
        raise InputError(
            f"{name} = {text!r} is not a distribution: write a number, none, or one of "
            "uniform(low, high), loguniform(low, high), normal(mean, std), choice(a, b: weight)"
        )
    form, inner, exclusions = match.groups()
    if form not in _FORMS:
        raise InputError(f"{name}: {unknown_name('distribution', form, _FORMS)}")
    try:
        if form == "choice":
            return _parse_choice(inner)
        low, high = _two_numbers(inner)
        excluded = tuple(_two_numbers(pair) for pair in _PAIR.findall(exclusions or ""))
        if form == "normal":
            if excluded:
                raise InputError("normal(...) takes no except")
            return Normal(low, high)
        return (Uniform if form == "uniform" else LogUniform)(low, high, excluded)
    except InputError as error:
        raise InputError(f"{name} = {text!r}: {error}") from None


def _two_numbers(text: str) -> Interval:
    parts = [part.strip() for part in text.split(",")]
    try:
        first, second = (float(part) for part in parts)
    except ValueError:
        raise InputError(f"({text.strip()}) must hold two numbers") from None
    return first, second


def _parse_choice(inner: str) -> Choice:
    options: list[Value] = []
    weights: list[float] = []
    for item in inner.split(","):
        option, colon, weight = (part.strip() for part in item.partition(":"))
        if not option:
            raise InputError("choice(...) needs options, separated by commas")
        try:
            options.append(float(option))
        except ValueError:
            options.append(option)
        try:
            weights.append(float(weight) if colon else 1.0)
        except ValueError:
            raise InputError(f"the weight of {option!r} is {weight!r}, not a number") from None
    return Choice(tuple(options), tuple(weights))


def _number(value: float) -> str:
    """Format a number with every digit, because replays read the text in a store."""
    return "none" if math.isnan(value) else repr(float(value)).removesuffix(".0")


@dataclass(frozen=True)
class Parameter:
    """Row of the table of parameters."""

    name: str
    """Name as group.name; the store's variable has an underscore instead of the dot"""
    unit: str
    """Unit in CF's spelling; "1" is dimensionless"""
    paper: str
    """Distribution in presets paper and paper-test"""
    field: str
    """Distribution in preset field"""
    long_name: str
    """Meaning, a short noun phrase"""
    why: str = ""
    """Reason for these values, and conventions, in one line"""
    per_segment: bool = False
    """True if the parameter is sampled for every segment"""

    @property
    def variable(self) -> str:
        """Name of the variable in a store."""
        return self.name.replace(".", "_")


Drawn = Mapping[str, Value]
"""Sampled values by name in the table; unused values are NaN."""


def number(drawn: Drawn, name: str) -> float:
    """Return a value that must be a number; raises InputError for a word."""
    value = drawn[name]
    if isinstance(value, str):
        raise InputError(
            f"{name} = {value} is no number: give numbers, such as 0.1 or uniform(0, 0.1)"
        )
    return value


def limit(drawn: Drawn, name: str) -> float | None:
    """Return an optional value; None if it is missing or not used."""
    value = number(drawn, name) if name in drawn else math.nan
    return None if math.isnan(value) else value
