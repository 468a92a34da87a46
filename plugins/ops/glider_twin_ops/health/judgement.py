"""Judgement: likelihood of each fault against drift, its first dive and its size.

A Kalman filter follows the level of each channel, a random walk from dive to dive; its innovations
are white for a sound vehicle. A fault adds its signature, times its size, from its first dive on.
The innovations are linear in that size, so that the likelihood ratio of each kind and first dive
against drift has a closed form (Willsky and Jones, IEEE TAC 21, 1976). The size has a normal prior
of the kind's usual size; the ratio is that of the marginal likelihoods.

The evidence that is an alarm follows from the accepted rate of false alarms. A threshold is the
higher of two. One is that of simulated deployments of preset `faulty` that were sound, and of what
came before the fault in others: 1073 days of Slocum 200, Sea-Wing, SeaExplorer and Seaglider (of
each vehicle `--each 1 --sound 6 --seed 2003` and `--each 2 --sound 24 --seed 2004`). They are
quieter in most channels than real ones. The other is that of channels as loud, all of them, as
`channels` states their noise and walks: 400 deployments of five days. Both are by

    python -m benchmarks.health --judge FILE ... --thresholds

Deployments of other seeds and real logs tell whether the rate holds: docs/results/health.md and
docs/results/health_real.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from glider_twin_ops.health.channels import NOISE, WALK
from glider_twin_ops.health.signatures import Hypothesis
from twin.errors import InputError
from twin.numbers import Array

CLIP, FARTHEST = 3.5, 30.0
"""Standard deviations at which an innovation is clipped, since one dive alone proves little; and
those at which a signature is clipped"""
LEARNED, LATE = 8.0, 2
"""Dives that a channel's prior noise counts as; and last dives that do not update the noise, since
a fault would raise it"""
LEAST, MOST = 0.4, 40.0
"""Smallest and largest variance of a channel over its prior variance"""
STEP = 2.0
"""Step of a level, in noises, per unit of changed settings beyond 1: a model's error differs at
another depth, pitch and volume"""
FIRST = 5
"""Dives before the earliest fault: a difference from the first dive on belongs to the vehicle"""
UNKNOWN = 100.0
"""Standard deviation of a level before its first dive, in noises"""
RARE = 200.0
"""Prior: a fault begins once in this many dives"""
ENDS, BELOW = 0.0, 1.0
"""Log odds below which an alarm ends, since no fault is then as likely; and the drop below a lower
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


def follow(values: Array, changes: Array | None = None, wander: Array | None = None) -> Levels:
    """Follow every channel of a deployment.

    Args:
      values: (dives, channels), NaN where the log has none.
      changes: change of settings from the dive before, (dives,). Levels may step where it is above
        1. None: no settings change.
      wander: standard deviation of each channel's further step from the dive before,
        (dives, channels).
    """
    count, width = values.shape
    noise, walk = NOISE**2, WALK**2
    level, variance = np.zeros(width), UNKNOWN**2 * noise
    seen, squares = np.zeros(width), np.zeros((count, width))
    scale = np.ones(width)
    found = np.full((5, count, width), math.nan)
    for d, value in enumerate(values):
        known = np.isfinite(value)
        step = 0.0 if changes is None else STEP * max(float(changes[d]) - 1.0, 0.0)
        variance = variance + (walk + noise * step**2) * scale
        variance = variance if wander is None else variance + wander[d] ** 2
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
    told = np.isfinite(levels.innovation)
    innovation = np.clip(np.where(told, levels.innovation, 0.0), -CLIP, CLIP)
    known = np.stack([np.isfinite(np.atleast_2d(h.signature)).all(axis=0) for h in hypotheses])
    signatures = np.stack(
        [np.broadcast_to(np.nan_to_num(h.signature), levels.innovation.shape) for h in hypotheses]
    )  # 0 where no flight predicts the channel
    scale, usual, grows, signed = np.array(
        [(h.scale, _usual(h), h.fault.grows, h.fault.signed) for h in hypotheses]
    ).T
    by_dives = np.ptp(signatures, axis=1).any(axis=1)
    # the first onset stands for a fault from before the log
    onsets = np.array([0, *range(FIRST, count)])
    answer = np.zeros((len(onsets), size, width))
    info, score = np.zeros((2, len(onsets), size))
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
        weighted = response / spread[d] * told[d]
        info += (weighted**2).sum(axis=2)
        score += (weighted * innovation[d]).sum(axis=2)
        added = always[:, d] - shared
        shared = shared + gain * added
        beside = added / spread[d] * told[d]
        across += weighted @ beside.T
        precision = precision + beside @ beside.T
        told_always = told_always + beside @ innovation[d]
        taken = across @ np.linalg.inv(precision)
        left = info - (taken * across).sum(axis=2), score - taken @ told_always
        ratio = _ratio(*left, usual, signed > 0.0)
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
    answer, info, score = np.zeros(width), 1.0 / _usual(hypothesis) ** 2, 0.0
    for d in range(onset, count):
        grown = days[d] - days[onset] + _half(days, d) if hypothesis.fault.grows else 1.0
        response = grown * signature[d] - answer
        answer = answer + np.nan_to_num(levels.gain[d]) * response
        known = np.isfinite(levels.innovation[d])
        weighted = (response / np.sqrt(levels.expected[d]))[known]
        info += float(weighted @ weighted)
        score += float(weighted @ levels.innovation[d][known])
    return score / info, 1.0 / math.sqrt(info)


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


def _ratio(info: Array, score: Array, usual: Array, signed: Array) -> Array:
    """Log ratio of marginal likelihoods with and without a fault, (onsets, hypotheses)."""
    precision = info + 1.0 / usual**2
    two_sided = 0.5 * score**2 / precision - 0.5 * np.log(precision * usual**2)
    positive = math.log(2.0) + log_ndtr(score / np.sqrt(precision))
    return two_sided + np.where(signed, 0.0, positive)


RATES: tuple[tuple[float, float, float], ...] = (
    (3.0, -8.58, -5.38),
    (10.0, -6.07, -3.86),
    (30.0, -4.49, -2.86),
    (100.0, -2.83, -1.75),
    (300.0, -0.43, -0.52),
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
