"""C text of features, sample by sample in C99, and float32 arithmetic for small processors.

The text has its own elementary functions, because C libraries differ and some compute in double.
Their error is at most two units of the last digit. A `gt_pair` holds a value and its change, so
that a small difference of large numbers is not lost by rounding.

Features have the terms and windows of `FeatureSteps`, all in float32, which small processors
compute in hardware. A slope is computed from the changes between samples, which float32 holds
exactly; depth itself is held to 0.06 mm at 1000 m. A feature that combines terms gives its C
expression in its field `c`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from twin.errors import InputError
from twin.navigation.features.base import Feature, feature, slope_weights

PER_LINE = 8
"""Numbers in one line of a C table."""


def number(value: float) -> str:
    """C constant that is exactly the float32 of `value`."""
    text = f"{np.float32(value):.9g}"
    return f"{text if set(text) & set('.e') else text + '.0'}f"


def braced(values: Iterable[float]) -> str:
    """C initialiser of an array, `PER_LINE` numbers to a line."""
    flat = [number(v) for v in values]
    lines = [", ".join(flat[k : k + PER_LINE]) for k in range(0, len(flat), PER_LINE)]
    return "{" + ",\n    ".join(lines) + "}"


def table(name: str, values: Iterable[float]) -> str:
    """C array of constants, exact in float32."""
    return f"static const float {name}[] = {braced(values)};"


PRELUDE = """\
/* Nearest whole number of a value below four million in size. */
static inline float gt_round(float v)
{
    const float shifted = v + 12582912.0f; /* 1.5 times 2^23: units are its last place */
    return shifted - 12582912.0f;
}

static inline float gt_most(float a, float b) { return a > b ? a : b; }

/* v limited to -most..most; 0 if v is not a number. */
static inline float gt_bounded(float v, float most)
{
    return v > most ? most : v < -most ? -most : v == v ? v : 0.0f;
}

/* Sine and cosine of an angle [rad], by their series within an eighth of a turn. */
static inline void gt_direction(float angle, float *sine, float *cosine)
{
    const float quarters = gt_round(angle * 0.636619772f);
    const float v = angle - quarters * 1.5703125f - quarters * 4.83751297e-4f
        - quarters * 7.54978995e-8f;
    const float q = v * v;
    const float s = v + v * q * (-1.0f / 6.0f + q * (1.0f / 120.0f + q * (-1.0f / 5040.0f
        + q * (1.0f / 362880.0f))));
    const float c = 1.0f - 0.5f * q + q * q * (1.0f / 24.0f + q * (-1.0f / 720.0f
        + q * (1.0f / 40320.0f - q * (1.0f / 3628800.0f))));
    const int quarter = (int)quarters;
    *sine = quarter & 1 ? c : s;
    *cosine = quarter & 1 ? s : c;
    if (quarter & 2)
        *sine = -*sine;
    if ((quarter + 1) & 2)
        *cosine = -*cosine;
}

static inline float gt_sine(float angle)
{
    float sine, cosine;
    gt_direction(angle, &sine, &cosine);
    return sine;
}

static inline float gt_cosine(float angle)
{
    float sine, cosine;
    gt_direction(angle, &sine, &cosine);
    return cosine;
}

/* Arcsine [rad]: the series of Cephes' asinf (Moshier 1992) up to a sine of 0.5; beyond, the series
 * gives half of the complementary angle. */
static inline float gt_arcsine(float sine)
{
    const float size = fabsf(sine);
    const int small = !(size > 0.5f);
    const float left = 0.5f * gt_most(1.0f - size, 0.0f);
    const float v = small ? size : sqrtf(left), q = small ? size * size : left;
    const float near = v + v * q * (1.6666752422e-1f + q * (7.4953002686e-2f
        + q * (4.5470025998e-2f + q * (2.4181311049e-2f + q * 4.2163199048e-2f))));
    const float angle = small ? near : 1.57079637f - 2.0f * near;
    return sine < 0.0f ? -angle : angle;
}

/* Angle [rad] from its sine and cosine, -pi to pi. */
static inline float gt_angle(float sine, float cosine)
{
    const float most = sine < 0.0f ? -3.14159274f : 3.14159274f;
    if (fabsf(sine) > fabsf(cosine))
        return 0.5f * most - (sine < 0.0f ? -1.0f : 1.0f) * gt_arcsine(cosine);
    return cosine < 0.0f ? most - gt_arcsine(sine) : gt_arcsine(sine);
}

/* A float and its bits: comparing bits needs no branches and compiles to vector instructions. */
typedef union {
    float value;
    int bits;
} gt_bits;

/* e^v, by its series within half an octave; v is limited to -87..87. */
static inline float gt_exp(float v)
{
    gt_bits x = {v}, scale;
    const int size = x.bits & 0x7fffffff;
    x.bits ^= size ^ (size < 0x42ae0000 ? size : 0x42ae0000);
    const float octaves = gt_round(x.value * 1.44269504f);
    const float r = x.value - octaves * 0.693359375f + octaves * 2.12194440e-4f;
    scale.bits = ((int)octaves + 127) << 23;
    return scale.value * (1.0f + r * (1.0f + r * (1.0f / 2.0f + r * (1.0f / 6.0f
        + r * (1.0f / 24.0f + r * (1.0f / 120.0f + r * (1.0f / 720.0f + r * (1.0f / 5040.0f))))))));
}

/* A value and its change by a small step of a constant: the difference of two float32 would lose
 * the change. */
typedef struct {
    float value, change;
} gt_pair;

static inline gt_pair gt_scaled(float k, gt_pair a)
{
    const gt_pair made = {k * a.value, k * a.change};
    return made;
}

static inline gt_pair gt_plus(gt_pair a, gt_pair b)
{
    const gt_pair made = {a.value + b.value, a.change + b.change};
    return made;
}

static inline gt_pair gt_times(gt_pair a, gt_pair b)
{
    const gt_pair made = {a.value * b.value, a.change * (b.value + b.change) + a.value * b.change};
    return made;
}

static inline gt_pair gt_over(gt_pair a, gt_pair b)
{
    gt_pair made = {a.value / b.value, 0.0f};
    made.change = (a.change - made.value * b.change) / (b.value + b.change);
    return made;
}

static inline gt_pair gt_dot(const gt_pair *a, const gt_pair *b)
{
    return gt_plus(gt_times(a[0], b[0]), gt_plus(gt_times(a[1], b[1]), gt_times(a[2], b[2])));
}

static inline void gt_directed(gt_pair angle, gt_pair *sine, gt_pair *cosine)
{
    float s, c;
    gt_direction(angle.value, &sine->value, &cosine->value);
    gt_direction(0.5f * angle.change, &s, &c);
    sine->change = 2.0f * s * (cosine->value * c - sine->value * s);
    cosine->change = -2.0f * s * (sine->value * c + cosine->value * s);
}

/* a limited to -most..most; its change is 0 at the limits. */
static inline gt_pair gt_held(gt_pair a, float most)
{
    const gt_pair end = {gt_bounded(a.value, most), 0.0f};
    return fabsf(a.value) < most ? a : end;
}
"""


DEGREE = number(math.radians(1.0))
SHAPED = {
    "plain": "{value}",
    "sine": f"gt_sine({{value}} * {DEGREE})",
    "cosine": f"gt_cosine({{value}} * {DEGREE})",
    "angle": f"gt_turned({{value}} * {DEGREE}, {{before}}, state->count)",
}
"""C expression of the value that enters a window, by the term's shape."""

FEATURES_PRELUDE = """\
/* Angle [rad] plus full turns, so that it does not jump from the angle before. */
static inline float gt_turned(float angle, float before, int count)
{
    return count ? angle + 6.28318531f * gt_round((before - angle) * 0.159154943f) : angle;
}

/* Drops the oldest value and appends a new one; the first value fills the window. */
static inline void gt_push(float *window, int length, float value, int count)
{
    for (int i = 0; i + 1 < length; i++)
        window[i] = count ? window[i + 1] : value;
    window[length - 1] = value;
}

/* Appends a value to a window of changes: its change from the last value, then itself. `turn` is
 * 360 for an angle, whose change is at most half a turn; else 0. */
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

/* Mean of the last `length` values, or of all if there are fewer. */
static inline float gt_mean(const float *end, int length, int count)
{
    const int held = count < length ? count : length;
    float sum = 0.0f;
    for (int i = 1; i <= held; i++)
        sum += end[-i];
    return sum / (float)held;
}
"""


class CFeatures(NamedTuple):
    """C text of features, with the sizes that it needs."""

    channels: tuple[str, ...]
    """Schema variables that `sample` must have, in this order."""
    windows: int
    """Length of `state->window`, in numbers."""
    longest: int
    """Sample count at which `state->count` may stop rising."""
    functions: str
    """Functions that the statements call, in addition to `FEATURES_PRELUDE`."""
    statements: str
    """Statements that set `feature[...]` from `sample` and `state`; `state->count` is the number
    of earlier samples."""


def c_features(features: Sequence[str | Feature], period: float) -> CFeatures:
    """Write features in C, for one sample every `period` [s].

    Raises:
      InputError: a feature has no C expression.
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
        if changes and shape == "angle":  # in degrees, whose differences float32 holds exactly
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
            # weights of the changes between samples that give the slope of the values
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
