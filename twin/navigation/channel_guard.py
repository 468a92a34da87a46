"""Channel guard: filter that replaces impossible samples before a navigator uses them.

A good sample lies within its channel's limits. Its difference from the last good value is at most
the channel's reach, which grows with the time since that value. A sample that is missing, not
finite or not good is replaced by the last good value; depth is carried on by its mean rate.
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

UNLIMITED = 1e30
"""Rate or jump of a channel without a limit; a finite number in float32 too"""


class ChannelReach(NamedTuple):
    """Largest change of a channel since its last good value: `jump` + `rate` times the time."""

    rate: float = UNLIMITED
    """Largest rate of change, in the channel's unit per second"""
    jump: float = UNLIMITED
    """Largest change by noise, quantisation and delayed readings, in the channel's unit"""


REACHES = {
    # the fastest vehicles dive at 3 m/s; waves lift a floating vehicle
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
"""Reaches of measured channels, by unit; commands and angles may jump: they have no limit"""


CARRIED = ("measured_depth",)
"""Channels that go on with their mean rate: held still, a depth says that the vehicle stopped"""
RATE_S = 10.0
"""[s] Time constant of the mean rate: longer than noise and waves, shorter than a glide"""
MOST_CARRIED_S = 60.0
"""[s] Longest time for which a value is carried on; then it stays"""
STEP_M, STEP_RATE = 4.0, 0.5
"""[m], [m/s] Largest difference of a depth from the one carried on, beyond waves and late readings;
it grows with the time since the last good value"""
STEPPED = 2.0
"""[1] Score `lost` after a larger difference"""
LOST_S = 30.0
"""[s] Time without a good value at which the score `lost` is 1"""


class ChannelGuard:
    """Filter of samples that keeps the last good value of each channel and its age."""

    def __init__(self, channels: Sequence[str], period: float):
        """Prepare for samples of these channels, `period` [s] apart."""
        self.channels = tuple(channels)
        self.period = period
        units = ["" if c.startswith("commanded_") else variable(c).units for c in self.channels]
        reaches = (REACHES.get(unit, ChannelReach()) for unit in units)
        limits = map(recorded_limits, self.channels)
        self.bounds = np.array([(*a, *b) for a, b in zip(limits, reaches, strict=True)])
        self._rows = self.bounds.tolist()
        self._share = -math.expm1(-period / RATE_S)
        self._keep = math.exp(-period / MOST_CARRIED_S)
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._last = [math.nan] * len(self.channels)
        self._age = [0] * len(self.channels)  # samples since the last good value; 0: none so far
        self._mean_rate = [0.0] * len(self.channels)  # of CARRIED, per second
        self.held: tuple[str, ...] = ()
        """Channels whose last good value replaced the sample's value"""
        self.lost = 0.0
        """Longest time that a channel was replaced, over LOST_S, or STEPPED; it fades within
        minutes, since a wrong value that stays is believed in the end"""

    def step(self, sample: Mapping[str, float]) -> dict[str, float] | None:
        """Replace impossible values of a sample; return None until each channel had a good value.

        Args:
          sample: values of `channels`, in the schema's units; a missing value counts as NaN.
        """
        held, kept, stepped = [], [], 0.0
        for k, (name, row) in enumerate(zip(self.channels, self._rows, strict=True)):
            low, high, rate, jump = row
            value, age = float(sample.get(name, math.nan)), self._age[k]
            good = low <= value <= high  # never true of NaN
            if good and age:
                good = abs(value - self._last[k]) <= jump + rate * age * self.period
            past = age * self.period
            carried = self._last[k] + self._mean_rate[k] * min(past, MOST_CARRIED_S)
            if good:
                if age and name in CARRIED:
                    if abs(value - carried) > STEP_M + STEP_RATE * past:
                        stepped = STEPPED
                    change = (value - self._last[k]) / past - self._mean_rate[k]
                    self._mean_rate[k] += self._share * change
                self._last[k], self._age[k] = value, 1
            else:
                held.append(name)
                self._age[k] += bool(age)
                value = min(max(carried, low), high)
            kept.append(value)
        self.held = tuple(held)
        longest = (max(self._age) - 1) * self.period / LOST_S
        self.lost = max(self._keep * self.lost, longest, stepped)
        return dict(zip(self.channels, kept, strict=True)) if all(self._age) else None

    def state(self) -> dict[str, NDArray[Any]]:
        """State of the guard, as arrays by name, for `restore`."""
        names = ("last", "age", "mean_rate")
        return {n: np.array(getattr(self, f"_{n}")) for n in names} | {"lost": np.array(self.lost)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from the state that `state` returned.

        Raises:
          InputError: the state belongs to other channels.
        """
        names = ("last", "age", "mean_rate")
        last, age, rate = (np.asarray(state.get(name, ())) for name in names)
        if not last.shape == age.shape == rate.shape == (len(self.channels),):
            raise InputError("this state is of other channels: make the guard as it was")
        self._last, self._age = last.tolist(), [int(a) for a in age]
        self._mean_rate, self.lost = rate.tolist(), float(state["lost"])

    def c_statements(self) -> str:
        """C99 statements that do to `sample` what `step` does; they return 0 where it returns None.

        The statements need `float last[n], age[n], mean_rate[n], lost; int held;` in `state`, and
        C_PRELUDE.
        """
        calls = (
            f"seen &= gt_kept(&kept.{name}, &state->last[{k}], &state->age[{k}], "
            f"&state->mean_rate[{k}], {number(self._share * (name in CARRIED))}, "
            f"&state->lost, &state->held, {', '.join(number(v) for v in self._rows[k])});"
            for k, name in enumerate(self.channels)
        )
        begin = f"""\
glider_sample kept = *sample;
int seen = 1;
state->held = 0;
state->lost *= {number(self._keep)};"""
        lost = f"""\
for (int k = 0; k < {len(self.channels)}; k++)
    state->lost = gt_most(state->lost, (state->age[k] - 1.0f) * {number(self.period / LOST_S)});"""
        return "\n".join((begin, *calls, lost, "if (!seen)\n    return 0;\nsample = &kept;"))


C_PRELUDE = f"""\
/* Replaces a value that is missing, outside its limits or too far from the last good value by that
 * good value, carried on by its mean rate: of the share 0, that rate stays 0. Returns 0 if the
 * channel had no good value yet, else 1. */
static inline int gt_kept(float *value, float *last, float *age, float *mean_rate, float share,
                          float *lost, int *held, float low, float high, float rate, float jump)
{{
    const float past = *age * GLIDER_PERIOD, most = {number(MOST_CARRIED_S)};
    const float carried = *last + *mean_rate * (past < most ? past : most);
    int good = *value >= low && *value <= high;
    if (good && *age > 0.0f)
        good = fabsf(*value - *last) <= jump + rate * past;
    if (good) {{
        if (*age > 0.0f && share > 0.0f
            && fabsf(*value - carried) > {number(STEP_M)} + {number(STEP_RATE)} * past)
            *lost = gt_most(*lost, {number(STEPPED)});
        if (*age > 0.0f)
            *mean_rate += share * ((*value - *last) / past - *mean_rate);
        *last = *value;
        *age = 1.0f;
        return 1;
    }}
    *held += 1;
    *value = carried < low ? low : carried > high ? high : carried;
    if (!(*age > 0.0f))
        return 0;
    *age += 1.0f;
    return 1;
}}
"""
