"""C steps: features sample by sample in C99, for a vehicle that runs no Python.

The same terms and windows as `FeatureSteps`. A feature that combines terms says in its field `c`
how C does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from twin.errors import InputError
from twin.navigation.features.base import Feature, Term, feature, slope_weights
from twin.numbers import Array

DEGREE = "(3.14159265358979323846 / 180.0)"
SHAPED = {
    "plain": "{value}",
    "sine": f"sin({{value}} * {DEGREE})",
    "cosine": f"cos({{value}} * {DEGREE})",
    "angle": f"gt_turned({{value}} * {DEGREE}, {{before}}, state->count)",
}
"""What is made of a reading before it goes into its window."""

PRELUDE = """\
/* The angle next to the one before, without the jump at a full turn. */
static inline double gt_turned(double angle, double before, int count)
{
    const double turn = 2.0 * 3.14159265358979323846;
    const double change = angle - before;
    return count ? before + change - turn * rint(change / turn) : angle;
}

/* A value goes in behind the oldest first; before the first one a signal is taken as constant. */
static inline void gt_push(double *window, int length, double value, int count)
{
    for (int i = 0; i + 1 < length; i++)
        window[i] = count ? window[i + 1] : value;
    window[length - 1] = value;
}

static inline double gt_sum(const double *weights, const double *values, int count)
{
    double sum = 0.0;
    for (int i = 0; i < count; i++)
        sum += weights[i] * values[i];
    return sum;
}

/* Mean of the last values, fewer at the start. */
static inline double gt_mean(const double *end, int length, int count)
{
    const int held = count < length ? count : length;
    double sum = 0.0;
    for (int i = 1; i <= held; i++)
        sum += end[-i];
    return sum / held;
}
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CFeatures:
    """Features in C."""

    channels: tuple[str, ...]
    """Schema variables that `sample` has as doubles, in this order."""
    windows: int
    """Doubles of `state->window`."""
    longest: int
    """Samples after which `state->count` need not rise."""
    functions: str
    """What the statements call, beside `PRELUDE`."""
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
    signals: dict[tuple[str, str], int] = {}
    for term in terms:
        key = (term.channel, term.shape)
        signals[key] = max(signals.get(key, 1), term.samples(period))
    lines, ends, place = [], {}, 0
    for (channel, shape), length in signals.items():
        last = f"state->window[{place + length - 1}]"
        value = SHAPED[shape].format(value=f"sample->{channel}", before=last)
        lines.append(f"gt_push(state->window + {place}, {length}, {value}, state->count);")
        place += length
        ends[channel, shape] = place
    tables: dict[int, str] = {}
    lines.append(f"const int held = state->count + 1; (void)held;\ndouble term[{len(terms)}];")
    for k, term in enumerate(terms):
        end, samples = ends[term.channel, term.shape], term.samples(period)
        if term.look == "slope" and samples not in tables:
            tables[samples] = _table(f"slope_{samples}", slope_weights(samples, period))
        lines.append(f"term[{k}] = {_look(term, samples, end)};")
    functions, numbers = [], {term: k for k, term in enumerate(terms)}
    for k, f in enumerate(found):
        own = [numbers[term] for term in f.terms]
        if f.combine is None:
            lines.append(f"feature[{k}] = term[{own[0]}];")
            continue
        functions.append(_function(f))
        given = ", ".join(f"term[{n}]" for n in own)
        lines.append(f"{{ const double t[] = {{{given}}}; feature[{k}] = gt_{f.name}(t); }}")
    return CFeatures(
        channels=tuple(dict.fromkeys(term.channel for term in terms)),
        windows=place,
        longest=max(signals.values()),
        functions="\n".join(functions),
        statements="\n".join([*tables.values(), *lines]),
    )


def _look(term: Term, samples: int, end: int) -> str:
    if term.look == "last":
        return f"state->window[{end - 1}]"
    if term.look == "mean":
        return f"gt_mean(state->window + {end}, {samples}, held)"
    return f"gt_sum(slope_{samples}, state->window + {end - samples}, {samples})"


def _table(name: str, values: Array) -> str:
    numbers = ", ".join(f"{value!r}" for value in values.tolist())
    return f"static const double {name}[{len(values)}] = {{{numbers}}};"


def _function(f: Feature) -> str:
    body = "\n".join(f"    {line}" for line in f.c.strip().splitlines())
    return f"static inline double gt_{f.name}(const double *t) /* [{f.unit}] */\n{{\n{body}\n}}\n"
