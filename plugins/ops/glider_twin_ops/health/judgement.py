"""Judgement: likelihood of each fault against drift, its first dive and its size.

A Kalman filter follows the level of each channel, a random walk from dive to dive; its innovations
are white for a sound vehicle. A fault adds its signature, times its size, from its first dive on.
The innovations are linear in that size, so that the likelihood ratio of each kind and first dive
against drift has a closed form (Willsky and Jones, IEEE TAC 21, 1976). The size has a normal prior
of the kind's usual size; the ratio is that of the marginal likelihoods. A flown signature is known
to `UNSURE` in each channel, over which the likelihood is averaged, so that kinds whose signatures
lie within that of each other share the probability.

Levels of alarms and probabilities are learned from simulated deployments of preset `piloted`, of
three vehicles (`--each 3 --sound 16`: Slocum 200, seed 4001; Seaglider, 4002; SeaExplorer, 4003):

    python -m benchmarks.health_learning FILE ...

A level is the higher of that of their sound dives and that of channels with the stated noise and
walk. Other seeds, other vehicles and real logs tell whether they hold: docs/results/health.md and
docs/results/health_real.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, log_ndtr, logsumexp

from glider_twin_ops.health.channels import FLOWN, NOISE, WALK
from glider_twin_ops.health.signatures import Hypothesis
from twin.errors import InputError
from twin.numbers import Array

CLIP, FARTHEST = 3.5, 30.0
"""[standard deviations] CLIP: a larger innovation counts as one of larger noise, since one dive
alone proves little. FARTHEST: a larger signature is clipped."""
LEARNED, LATE = 8.0, 2
"""LEARNED: dives that a channel's prior noise counts as. LATE: number of last dives that do not
update the noise, since a fault would raise it"""
LEAST, MOST = 0.4, 40.0
"""Variance of a channel over its prior variance. LEAST: smallest. MOST: largest"""
UNSURE = 0.25
"""[1] Standard deviation of a flown signature in each channel, over the signature"""
SIZE_STEP = 0.28
SIZES = np.exp(np.arange(-2.8, 1.5, SIZE_STEP))
"""Sizes of a fault over their prior standard deviation, over which a likelihood is summed"""
ROUNDS = 6
"""Rounds in which a size and the errors of its signature are found together"""
FIRST = 5
"""Dives before the earliest fault: a difference from the first dive on belongs to the vehicle"""
UNKNOWN = 100.0
"""Standard deviation of a level before its first dive, in noises"""
RARE = 200.0
"""Prior: a fault begins once in this many dives"""
ENDS, BELOW = 0.0, 1.0
"""ENDS: log odds below which an alarm ends; no fault is then as likely. BELOW: drop below a lower
threshold that ends an alarm, so that it does not flap"""
NONE = "none"
"""Kind of a healthy deployment"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Levels:
    """Filtered levels of all channels of a deployment, each (dives, channels)."""

    level: Array
    """Level after each dive"""
    deviation: Array
    """Standard deviation of the level"""
    innovation: Array
    """Innovation over its standard deviation; NaN where the log has no value"""
    expected: Array
    """Variance of each innovation"""
    gain: Array
    """Kalman gain of each update, 0 without a value"""


def follow(values: Array, steps: Array | None = None) -> Levels:
    """Follow every channel of a deployment.

    Args:
      values: (dives, channels), NaN where the log has none.
      steps: standard deviation of each channel's further step from the dive before, by what is no
        fault, (dives, channels).
    """
    count, width = values.shape
    noise, walk = NOISE**2, WALK**2
    level, variance = np.zeros(width), UNKNOWN**2 * noise
    seen, squares = np.zeros(width), np.zeros((count, width))
    scale = np.ones(width)
    found = np.full((5, count, width), math.nan)
    for d, value in enumerate(values):
        known = np.isfinite(value)
        variance = variance + walk * scale
        variance = variance if steps is None else variance + steps[d] ** 2
        spread = variance + noise * scale
        first = known & (seen == 0)
        level = np.where(first, value, level)
        error = np.where(known, value - level, 0.0)
        gain = np.where(known, variance / spread, 0.0)
        level = level + gain * error
        variance = np.where(known, (1.0 - gain) * variance, variance)
        seen += known
        told = known & ~first
        # a difference in the first dives belongs to the vehicle: nothing is clipped there
        most = 9.0 * scale if d >= FIRST else math.inf
        squares[d] = np.where(told, np.minimum(error**2 / spread * scale, most), 0.0)
        counted = np.maximum(seen - 1.0 - LATE, 0.0)
        taught = squares[: max(d + 1 - LATE, 0)].sum(axis=0)
        scale = np.clip((LEARNED + taught) / (LEARNED + counted), LEAST, MOST)
        innovation = np.where(told, error / np.sqrt(spread), math.nan)
        found[:, d] = level, np.sqrt(variance), innovation, spread, gain
    names = ("level", "deviation", "innovation", "expected", "gain")
    return Levels(**dict(zip(names, found, strict=True)))


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """Faults of a deployment, weighed after each dive."""

    evidence: Array
    """Log odds of a fault after each dive, less the prior log odds, (dives,); -inf where no dive is
    evidence of one"""
    kinds: tuple[str, ...]
    probability: Array
    """Probability of each kind after the last dive, (kinds,)"""
    since: NDArray[np.int64]
    """Most likely first dive of each kind, (kinds,)"""
    size: Array
    """Most likely size of each, in its unit, (kinds,)"""
    size_deviation: Array
    best: tuple[int, ...]
    """Index of the likeliest hypothesis of each kind"""
    standing: tuple[Array, Array]
    """Sizes of the disturbances from the first dive on, and their standard deviations, without a
    fault, (disturbances,) each"""


def judge(
    levels: Levels,
    days: Array,
    hypotheses: Sequence[Hypothesis],
    standing: tuple[Array, Array] | None = None,
) -> Verdict:
    """Weigh every fault and every first dive against drift.

    Args:
      days: [d] middle of each dive since the first, (dives,).
      hypotheses: faults with signatures, of each dive where these differ between dives.
      standing: disturbances from the first dive on, by `channels.standing`; the likelihoods of
        faults and of drift are averaged over their sizes.
    """
    count, width = levels.innovation.shape
    always, usually = (np.zeros((0, count, width)), np.zeros(0)) if standing is None else standing
    shared = np.zeros((len(always), width))
    precision, told_always = np.diag(usually**-2.0), np.zeros(len(always))
    size = len(hypotheses)
    spread = np.sqrt(levels.expected)
    seen = np.isfinite(levels.innovation)
    innovation = np.where(seen, levels.innovation, 0.0)
    # a value far off counts as one of larger noise, for every hypothesis
    weight = seen * np.minimum(1.0, CLIP / np.maximum(np.abs(innovation), 1e-9))
    innovation = innovation * weight
    known = np.stack([np.isfinite(np.atleast_2d(h.signature)).all(axis=0) for h in hypotheses])
    signatures = np.stack(
        [np.broadcast_to(np.nan_to_num(h.signature), levels.innovation.shape) for h in hypotheses]
    )  # 0 where no flight predicts the channel
    scale, usual, grows, signed = np.array(
        [(h.scale, _usual(h), h.fault.grows, h.fault.signed) for h in hypotheses]
    ).T
    by_dives = np.ptp(signatures, axis=1).any(axis=1)
    # the first onset stands for a fault from before the log; a fault begins where it can be seen
    onsets = np.array([0, *(d for d in range(FIRST, count) if seen[d].any())])
    answer = np.zeros((len(onsets), size, width))
    told_by, told = np.zeros((2, len(onsets), size, width))
    unsure = np.where(FLOWN, UNSURE, 0.0) * np.array([not h.exact for h in hypotheses])[:, None]
    across = np.zeros((len(onsets), size, len(always)))
    evidence = np.full(count, -math.inf)
    before = np.zeros((len(onsets) - 1, size))
    prior = -math.log(RARE) - math.log(size)
    for d in range(count):
        begun = onsets <= d
        since = np.where(begun, days[d] - days[np.minimum(onsets, d)] + _half(days, d), 0.0)
        shape = np.where(grows > 0.0, since[:, None], 1.0) * begun[:, None]
        added = shape[:, :, None] * (signatures[:, d, :] * known)[None]
        limit = FARTHEST * spread[d] / scale[None, :, None]
        response = np.clip(added - answer, -limit, limit)
        gain = np.nan_to_num(levels.gain[d])
        answer = answer + gain * response * begun[:, None, None]
        weighted = response / spread[d] * weight[d]
        told_by += weighted**2
        told += weighted * innovation[d]
        added = always[:, d] - shared
        shared = shared + gain * added
        beside = added / spread[d] * weight[d]
        across += weighted @ beside.T
        precision = precision + beside @ beside.T
        told_always = told_always + beside @ innovation[d]
        taken = across @ np.linalg.inv(precision)
        lost = (taken * across).sum(axis=2), taken @ told_always
        ratio = _ratio(told_by, told, lost, usual, signed > 0.0, unsure)
        before = ratio[1:].copy()
        if by_dives.any():
            # a signature that differs between dives, as a compass' iron by heading, may have been
            # there from the first dive on: the fault is weighed against that too
            stood = logsumexp(ratio[0, by_dives]) - math.log(by_dives.sum())
            before[:, by_dives] -= np.logaddexp(0.0, stood)
        if begun[1:].any():
            alive = np.where(begun[1:, None], _gained(before) + prior, -math.inf)
            evidence[d] = float(logsumexp(alive))
    onsets = onsets[1:]
    some = len(onsets) > 0
    total = logsumexp(before + prior, axis=0) if some else np.full(size, -math.inf)
    every = float(np.logaddexp(0.0, logsumexp(total))) if some else 0.0
    places: dict[str, list[int]] = {}
    for k, one in enumerate(hypotheses):
        places.setdefault(one.kind, []).append(k)
    best = [max(mine, key=lambda k: float(total[k])) for mine in places.values()]
    first = [int(onsets[int(np.argmax(before[:, k]))]) if some else 0 for k in best]
    sizes = np.array([
        _size(levels, days, hypotheses[k], signatures[k], onset) if some else (math.nan, math.nan)
        for k, onset in zip(best, first, strict=True)
    ])  # fmt: skip
    likely = [float(np.exp(logsumexp(total[mine]) - every)) for mine in places.values()]
    return Verdict(
        evidence=evidence,
        kinds=tuple(places),
        probability=np.array(likely) if some else np.zeros(len(places)),
        since=np.array(first, np.int64),
        size=sizes[:, 0],
        size_deviation=sizes[:, 1],
        best=tuple(best),
        standing=(
            np.asarray(np.linalg.solve(precision, told_always), float),
            np.sqrt(np.diag(np.linalg.inv(precision))),
        ),
    )


def sure(evidence: Array) -> Array:
    """Lower of the log odds after each dive and after the dive before, (dives,).

    An alarm so takes two dives in a row. `evidence` is that of a `Verdict`.
    """
    return np.minimum(evidence, np.concatenate([[-math.inf], evidence[:-1]]))


def rings(evidence: Array, threshold: float) -> list[tuple[int, int]]:
    """Indices of the first and last dive of each alarm; two dives in a row begin or end one."""
    ends = min(ENDS, threshold - BELOW)
    surely = sure(evidence)
    found: list[tuple[int, int]] = []
    ringing = False
    for d, odds in enumerate(evidence.tolist()):
        if not ringing and surely[d] > threshold:
            found.append((d, d))
            ringing = True
        elif ringing and max(odds, float(evidence[d - 1])) > ends:
            found[-1] = (found[-1][0], d)
        else:
            ringing = False
    return found


def _size(
    levels: Levels, days: Array, hypothesis: Hypothesis, signature: Array, onset: int
) -> tuple[float, float]:
    """Size of a fault with a given first dive, and its standard deviation, without clipping."""
    count, width = levels.innovation.shape
    answer, info, score = np.zeros((3, width))
    for d in range(onset, count):
        grown = days[d] - days[onset] + _half(days, d) if hypothesis.fault.grows else 1.0
        response = grown * signature[d] - answer
        answer = answer + np.nan_to_num(levels.gain[d]) * response
        known = np.isfinite(levels.innovation[d])
        weighted = np.where(known, response / np.sqrt(levels.expected[d]), 0.0)
        info += weighted**2
        score += weighted * np.nan_to_num(levels.innovation[d])
    own = np.divide(score, info, out=np.zeros(width), where=info > 0.0)
    kept, prior = info, 1.0 / _usual(hypothesis) ** 2
    for _ in range(ROUNDS):
        size = float(kept @ own) / (float(kept.sum()) + prior)
        off = UNSURE * size * FLOWN * (not hypothesis.exact)
        kept = info / (1.0 + info * off**2)
    return size, 1.0 / math.sqrt(float(kept.sum()) + prior)


def _gained(ratio: Array) -> Array:
    """Log of (likelihood ratio - 1), from log ratios; -inf for ratios below 1.

    Dives without evidence leave the ratio at 1. Without this, a fault would become likely in a long
    deployment by the number of its possible first dives alone.
    """
    more = np.maximum(ratio, 1e-300)
    return np.where(ratio > 0.0, more + np.log(-np.expm1(-more)), -math.inf)


def _half(days: Array, d: int) -> float:
    """Half the time [d] between a dive and the one before it."""
    later = max(d, 1)
    return 0.5 * float(days[later] - days[later - 1]) if len(days) > 1 else 0.0


def _usual(hypothesis: Hypothesis) -> float:
    """Prior standard deviation of the size."""
    return 1.5 * hypothesis.scale


def _ratio(
    info: Array,
    score: Array,
    lost: tuple[Array, Array],
    usual: Array,
    signed: NDArray[np.bool_],
    unsure: Array,
) -> Array:
    """Log ratio of marginal likelihoods with and without a fault, (onsets, hypotheses).

    Channel by channel the size is score / info +- info**-0.5. An error of the signature adds the
    variance (unsure * size)**2 to that, so that no channel alone can rule a fault in or out.

    Args:
      info, score: of each channel, (onsets, hypotheses, channels).
      lost: parts of the sums of info and of score that standing disturbances take.
    """
    total, pulled = info.sum(axis=2) - lost[0], score.sum(axis=2) - lost[1]
    precision = total + 1.0 / usual**2
    found = 0.5 * pulled**2 / precision - 0.5 * np.log(precision * usual**2)
    found = found + np.where(signed, 0.0, math.log(2.0) + log_ndtr(pulled / np.sqrt(precision)))
    loose = unsure.any(axis=1)
    info, score, unsure, usual = info[:, loose], score[:, loose], unsure[loose], usual[loose]
    own = np.divide(score, info, out=np.zeros_like(score), where=info > 0.0)
    part = tuple(one[:, loose] for one in lost)
    sums = []
    for share in SIZES:
        size = share * usual
        left = 1.0 / (1.0 + info * (unsure * size[:, None]) ** 2)
        kept = info * left
        even = 0.5 * ((info - kept) * own**2 + np.log(left)).sum(axis=2)
        even -= 0.5 * (kept.sum(axis=2) - part[0]).clip(0.0) * size**2
        odd = ((kept * own).sum(axis=2) - part[1]) * size
        prior = math.log(2.0 * share * SIZE_STEP / math.sqrt(2.0 * math.pi)) - 0.5 * share**2
        both = np.logaddexp(even + odd, even - odd) - math.log(2.0)
        sums.append(prior + np.where(signed[loose], both, even + odd))
    if sums:
        found[:, loose] = logsumexp(sums, axis=0)
    return found


LEVEL, SLOPE, SURE = -0.05, 0.270, 20.0
"""LEVEL, SLOPE: logistic regression, over the evidence after the last dive, of a begun fault that
is named, if one begins once in `RARE` dives. SURE: evidence from which nearly all names were
right"""


def chance(evidence: float) -> float:
    """Probability that a named fault is there, by the evidence after a dive."""
    return float(expit(LEVEL + SLOPE * min(evidence, SURE)))


RATES: tuple[tuple[float, float, float], ...] = (
    (3.0, -12.40, -5.47),
    (10.0, -7.48, -3.87),
    (30.0, -5.12, -2.66),
    (100.0, -2.78, -1.67),
    (300.0, 7.91, -0.75),
)
"""[d] of sound vehicles per false alarm; threshold of the log odds by simulated deployments, and by
channels with the stated noise and walk"""


def threshold_of(days: float) -> float:
    """Threshold of the log odds for an alarm, interpolated over log(days).

    Args:
      days: [d] of sound vehicles in which one false alarm is accepted.

    Raises:
      InputError: outside the days of `RATES`.
    """
    least, most = RATES[0][0], RATES[-1][0]
    if not least <= days <= most:
        raise InputError(
            f"--false-alarm-days {days:g} must be within {least:g} and {most:g}: more and fewer "
            "false alarms were not measured"
        )
    spans, simulated, stated = np.array(RATES).T
    return float(np.interp(np.log(days), np.log(spans), np.maximum(simulated, stated)))
