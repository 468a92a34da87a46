"""C steps: features sample by sample in C99, for a vehicle that runs no Python.

The same terms and windows as `FeatureSteps`, in float32 throughout, which small processors compute
in hardware. A slope is made of the changes from sample to sample, which float32 holds exactly:
depth itself it holds to 0.06 mm at 1000 m. A feature that combines terms says in its field `c` how
C does.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from twin.errors import InputError
from twin.navigation.c_math import number, table
from twin.navigation.features.base import Feature, feature, slope_weights

DEGREE = number(math.radians(1.0))
SHAPED = {
    "plain": "{value}",
    "sine": f"gt_sine({{value}} * {DEGREE})",
    "cosine": f"gt_cosine({{value}} * {DEGREE})",
    "angle": f"gt_turned({{value}} * {DEGREE}, {{before}}, state->count)",
}
"""Expression of a reading that goes into its window, by the term's shape."""

PRELUDE = """\
/* The angle [rad] next to the one before, without the jump at a full turn. */
static inline float gt_turned(float angle, float before, int count)
{
    return count ? angle + 6.28318531f * gt_round((before - angle) * 0.159154943f) : angle;
}

/* A value goes in behind the oldest first; before the first one a signal is taken as constant. */
static inline void gt_push(float *window, int length, float value, int count)
{
    for (int i = 0; i + 1 < length; i++)
        window[i] = count ? window[i + 1] : value;
    window[length - 1] = value;
}

/* The change to a value goes in behind the oldest first, then the value; that of an angle, whose
 * turn is 360, is the short way. */
static inline void gt_change(float *window, int length, float value, float turn, int count)
{
    const float change = count ? value - window[length - 1] : 0.0f;
    gt_push(window, length - 1, change - turn * gt_round(change / 360.0f), count);
    window[length - 1] = value;
}

static inline float gt_sum(const float *weights, const float *values, int count)
{
    float sum = 0.0f;
    for (int i = 0; i < count; i++)
        sum += weights[i] * values[i];
    return sum;
}

/* Mean of the last values, fewer at the start. */
static inline float gt_mean(const float *end, int length, int count)
{
    const int held = count < length ? count : length;
    float sum = 0.0f;
    for (int i = 1; i <= held; i++)
        sum += end[-i];
    return sum / (float)held;
}
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CFeatures:
    """Features in C."""

    channels: tuple[str, ...]
    """Schema variables that `sample` has, in this order."""
    windows: int
    """Numbers of `state->window`."""
    longest: int
    """Samples after which `state->count` need not rise."""
    functions: str
    """Functions that the statements call, beside `PRELUDE`."""
    statements: str
    """From `sample` and `state` to `feature[...]`; `state->count` is how many samples there were
    before this one."""


def c_features(features: Sequence[str | Feature], period: float) -> CFeatures:
    """Features in C, with one sample every `period` [s].

    Raises:
      InputError: a feature does not say how it is computed in C.
    """
    found = [feature(f) if isinstance(f, str) else f for f in features]
    for lacking in (f for f in found if f.combine is not None and not f.c):
        raise InputError(
            f"feature {lacking.name!r} combines its terms in Python alone: give its definition "
            "the field `c`, the same in C, or train without it"
        )
    terms = tuple(dict.fromkeys(term for f in found for term in f.terms))
    signals: dict[tuple[str, str, bool], int] = {}
    for term in terms:
        key = (term.channel, term.shape, term.look == "slope")
        signals[key] = max(signals.get(key, 1), term.samples(period))
    lines, ends, place = [], {}, 0
    for (channel, shape, changes), length in signals.items():
        window, last = f"state->window + {place}, {length}", f"state->window[{place + length - 1}]"
        value = SHAPED[shape].format(value=f"sample->{channel}", before=last)
        call = "gt_push"
        if changes and shape == "angle":  # in degrees, whose differences are exact
            call, value = "gt_change", f"sample->{channel}, 360.0f"
        elif changes:
            call, value = "gt_change", f"{value}, 0.0f"
        lines.append(f"{call}({window}, {value}, state->count);")
        place += length
        ends[channel, shape, changes] = place
    tables: dict[str, str] = {}
    lines.append(f"const int held = state->count + 1; (void)held;\nfloat term[{len(terms)}];")
    for k, term in enumerate(terms):
        end, samples = ends[term.channel, term.shape, term.look == "slope"], term.samples(period)
        if term.look == "slope":
            name = f"{'turn' if term.shape == 'angle' else 'slope'}_{samples}"
            # of the last value less each, which is made of the changes between them
            weights = -np.cumsum(slope_weights(samples, period))[:-1]
            weights = np.deg2rad(weights) if term.shape == "angle" else weights
            tables[name] = table(name, weights)
            look = f"gt_sum({name}, state->window + {end - samples}, {samples - 1})"
        elif term.look == "mean":
            look = f"gt_mean(state->window + {end}, {samples}, held)"
        else:
            look = f"state->window[{end - 1}]"
        lines.append(f"term[{k}] = {look};")
    functions, numbers = [], {term: k for k, term in enumerate(terms)}
    for k, f in enumerate(found):
        own = [numbers[term] for term in f.terms]
        if f.combine is None:
            lines.append(f"feature[{k}] = term[{own[0]}];")
            continue
        body = "\n".join(f"    {line}" for line in f.c.strip().splitlines())
        head = f"static inline float gt_{f.name}(const float *t) /* [{f.unit}] */"
        functions.append(f"{head}\n{{\n{body}\n}}\n")
        given = ", ".join(f"term[{n}]" for n in own)
        lines.append(f"{{ const float t[] = {{{given}}}; feature[{k}] = gt_{f.name}(t); }}")
    return CFeatures(
        channels=tuple(dict.fromkeys(term.channel for term in terms)),
        windows=place,
        longest=max(signals.values()),
        functions="\n".join(functions),
        statements="\n".join([*tables.values(), *lines]),
    )
