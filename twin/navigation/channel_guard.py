"""Channel guard: reject samples outside a channel's limits or rate before they reach a state.

A sample must lie within its channel's limits, and within reach of the last good value. If it is
missing, not finite, outside the limits or out of reach, the last good value replaces it. The reach
grows with the time since the last good value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError
from twin.navigation.c_math import number
from twin.records.schema import variable
from twin.records.schema.limits import recorded_limits

FAR = 1e30
"""Infinite reach, as a number that float32 can hold"""


class ChannelReach(NamedTuple):
    """Reach of a channel from its last good value."""

    rate: float = FAR
    """Fastest change per second, in the channel's unit"""
    jump: float = FAR
    """Additional change by noise, quantisation and a late reading"""


REACHES = {
    # the fastest vehicles dive with 3 m/s; a wave lifts one that floats
    "m": ChannelReach(rate=5.0, jump=10.0),
    # crossing a front or a halocline
    "kg m-3": ChannelReach(rate=3.0, jump=6.0),
    "degree_Celsius": ChannelReach(rate=3.0, jump=6.0),
    # a hull that is hit or turned by hand
    "rad s-1": ChannelReach(rate=3.0, jump=3.0),
    "m s-2": ChannelReach(rate=40.0, jump=40.0),
    # the largest pumps of real gliders
    "cm3": ChannelReach(rate=200.0, jump=600.0),
}
"""Reaches of measured channels, by unit; commands and angles may jump and have none"""


class ChannelGuard:
    """Guard that keeps each channel's last good value and its age."""

    def __init__(self, channels: Sequence[str], period: float):
        """Start before the first sample; `period` [s] is the time between samples."""
        self.channels = tuple(channels)
        self.period = period
        units = ["" if c.startswith("commanded_") else variable(c).units for c in self.channels]
        reaches = (REACHES.get(unit, ChannelReach()) for unit in units)
        limits = map(recorded_limits, self.channels)
        self.bounds = np.array([(*a, *b) for a, b in zip(limits, reaches, strict=True)])
        self._rows = self.bounds.tolist()
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._last = [math.nan] * len(self.channels)
        self._age = [0] * len(self.channels)  # samples since the good one; 0: none so far
        self.held: tuple[str, ...] = ()
        """Channels whose last good value replaced the sample's value"""

    def step(self, sample: Mapping[str, float]) -> dict[str, float] | None:
        """Accept a sample and return good values; None until every channel has had a good value.

        Args:
          sample: values of `channels`, in the schema's units; a missing value counts as NaN.
        """
        held = []
        for k, (name, row) in enumerate(zip(self.channels, self._rows, strict=True)):
            low, high, rate, jump = row
            value, age = float(sample.get(name, math.nan)), self._age[k]
            good = low <= value <= high  # never true of NaN
            if good and age:
                good = abs(value - self._last[k]) <= jump + rate * age * self.period
            if good:
                self._last[k], self._age[k] = value, 1
            else:
                held.append(name)
                self._age[k] += bool(age)
        self.held = tuple(held)
        return dict(zip(self.channels, self._last, strict=True)) if all(self._age) else None

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays by name that determine the next step."""
        return {"last": np.array(self._last), "age": np.array(self._age, np.float64)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from the state that `state` returned.

        Raises:
          InputError: the state belongs to other channels.
        """
        last, age = (np.asarray(state.get(name, ())) for name in ("last", "age"))
        if last.shape != age.shape or last.shape != (len(self.channels),):
            raise InputError("this state is of other channels: make the guard as it was")
        self._last, self._age = last.tolist(), [int(a) for a in age]

    def c_statements(self) -> str:
        """C99 statements that put good values in `sample`, or return 0 until all channels have one.

        They need `float last[n], age[n]; int held;` in `state`, and C_PRELUDE.
        """
        calls = (
            f"seen &= gt_kept(&kept.{name}, &state->last[{k}], &state->age[{k}], "
            f"&state->held, {', '.join(number(v) for v in self._rows[k])});"
            for k, name in enumerate(self.channels)
        )
        begin = "glider_sample kept = *sample;\nint seen = 1;\nstate->held = 0;"
        return "\n".join((begin, *calls, "if (!seen)\n    return 0;\nsample = &kept;"))


C_PRELUDE = """\
/* The value to go on with: this one, or the last good one where this is missing, impossible or out
 * of reach. 0: there has been no good one yet. */
static inline int gt_kept(float *value, float *last, float *age, int *held, float low, float high,
                          float rate, float jump)
{
    int good = *value >= low && *value <= high;
    if (good && *age > 0.0f)
        good = fabsf(*value - *last) <= jump + rate * *age * GLIDER_PERIOD;
    if (good) {
        *last = *value;
        *age = 1.0f;
        return 1;
    }
    *held += 1;
    *value = *last;
    if (!(*age > 0.0f))
        return 0;
    *age += 1.0f;
    return 1;
}
"""
