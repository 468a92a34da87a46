"""Plausibility: signs and scales of a log compared with how gliders move.

A glider sinks nose down, and rises nose up with more volume than in the descent. Its speed exceeds
the noise of its sensors and stays below the speed of a thruster. Contradictions are reported.

`unreachable` finds samples that no vehicle could reach from the rest of its log. `lone_zeros` and
`stale` find what a restarted pressure sensor writes before its first measurement. `DiveRules` holds
the limits by which a log is cut into dives and its GPS fixes are judged.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import Channel, DeploymentLog
from factory.importing.tally import Tally

Array = NDArray[np.float64]

_BELOW = 5.0
"""[m] Depth beyond which samples are judged: waves and the surfacing are above."""
_MOVING = 0.04
"""[m/s] Smallest vertical speed of a glide."""
_ENOUGH = 20
"""Minimum number of samples of the descent, and as many of the climb, that allow a judgement."""
FASTEST, SLOWEST = 2.0, 0.04
"""[m/s] Limits of a glider's speed along its pitch; usual are 0.2 to 0.6."""
_STEEP = 8.0
"""[degree] Smallest pitch at which the vertical speed gives the speed along the pitch."""
_ROLLED = 45.0
"""[degree] Largest plausible median of a glider's roll under water, without its sign."""


def vertical_speed(depth: Channel) -> Array:
    """[m/s] Vertical speed, down positive, at the channel's samples."""
    if len(depth) < 3:
        return np.zeros(len(depth))
    return np.asarray(np.gradient(depth.values, depth.time), np.float64)


def speed_along_pitch(depth: Channel, pitch: Channel) -> float:
    """[m/s] Median of vertical speed over sin(pitch) in glides; NaN with too few samples."""
    if not len(depth) or not len(pitch):
        return float("nan")
    angle = pitch.at(depth.time)
    rate = np.abs(vertical_speed(depth))
    level = 0.1 * float(np.percentile(rate, 90.0))
    use = (np.abs(angle) > _STEEP) & (rate > level) & pitch.covers(depth.time)
    if use.sum() < _ENOUGH:
        return float("nan")
    return float(np.median(rate[use] / np.sin(np.radians(np.abs(angle[use])))))


_AGREE = 0.9
"""Smallest fraction of moving samples with nose down in descents, or else with nose up in them."""


def sinks_in_radian(time: Array, depth: Array, pitch: Array) -> bool | None:
    """True if the vertical speed fits the pitch in radian and is impossible in degrees.

    None if the log has no descent or no climb: a vehicle that only sinks may hang nose down.

    Args:
      time: [s] increasing, (samples,).
      depth: [m] at the same times, NaN where unknown.
      pitch: small numbers, in degrees or in radian.
    """
    there = np.isfinite(depth)
    moving = Channel(time[there], depth[there])
    known = np.isfinite(pitch) & (np.abs(pitch) > _LEVEL)
    rate = Channel(moving.time, vertical_speed(moving)).at(time[known])
    below = moving.at(time[known]) > _BELOW
    angle, use = pitch[known], below & (np.abs(rate) > _MOVING)
    rate, angle = rate[use], angle[use]
    if min((rate > 0.0).sum(), (rate < 0.0).sum()) < _ENOUGH:
        return None
    agree = float(np.mean(np.sign(rate) == -np.sign(angle)))
    as_degrees = float(np.median(np.abs(rate) / np.sin(np.radians(np.abs(angle)))))
    as_radian = float(np.median(np.abs(rate) / np.sin(np.abs(angle))))
    one_way = max(agree, 1.0 - agree) > _AGREE  # a wrong sign is another fault
    return one_way and as_degrees > FASTEST and SLOWEST < as_radian < FASTEST


_LEVEL = 1e-6
"""Smallest pitch of a glide, in degrees or in radian."""


def check_signs(log: DeploymentLog, tally: Tally) -> None:
    """Report channels as suspect if their sign or scale contradicts the dives."""

    def doubt(name: str, why: str) -> None:
        tally.doubt(name, f"{log.deployment} {why}", len(log.channel(name)))

    depth, roll, pitch, pump = (
        log.channel(f"measured_{name}") for name in ("depth", "roll", "pitch", "pump")
    )
    rate = vertical_speed(depth)
    below = depth.values > _BELOW
    rolled = below & roll.covers(depth.time)
    if rolled.sum() > _ENOUGH:
        usual = float(np.median(np.abs(roll.at(depth.time[rolled]))))
        if usual > _ROLLED:
            doubt("measured_roll", f"rolls by {usual:.0f} degree: wrong unit or column")
    # gaps of pitch and pump are left out: their signs are unknown while the computer is silent
    known = below & (pitch or pump).covers(depth.time)
    down, up = known & (rate > _MOVING), known & (rate < -_MOVING)
    if min(down.sum(), up.sum()) < _ENOUGH:
        return
    if len(pitch):
        angle = pitch.at(depth.time)
        if np.median(angle[down]) > np.median(angle[up]):
            doubt("measured_pitch", "sinks nose up: wrong sign or column")
        speed = speed_along_pitch(depth, pitch)
        if speed > FASTEST or speed < SLOWEST:
            why = f"would move at {speed:.2g} m/s: wrong unit of depth or pitch"
            doubt("measured_depth", why)
    thruster = log.channel("thruster").values
    propelled = len(thruster) and np.mean(thruster) > 0.0
    volume = pump.at(depth.time)
    if len(pump) and not propelled and np.median(volume[down]) > np.median(volume[up]):
        why = "sinks with more volume than it rises with: wrong sign or column"
        doubt("measured_pump", why)


_BESIDE = 2
"""Number of samples on either side of a cut that can be removed one by one."""
_BACK = 200
"""Number of earlier pieces of which one can precede a piece; bad stretches have fewer pieces."""


def unreachable(time: Array, values: Array, *, rate: float, jump: float) -> NDArray[np.bool_]:
    """True for samples outside the longest chain in which nothing changes faster than it can.

    The series is cut wherever neighbours differ by more than `jump` + `rate` [unit/s] times the
    time between them. Samples beside a cut are pieces of their own, so that one wrong sample does
    not remove days. The chain is the sequence of pieces with possible rates between them and the
    most samples. A sentinel stays outside, whether it lasts one sample or minutes.

    Args:
      time: [s] increasing strictly, shape (samples,).
      values: finite, shape (samples,).
    """
    count = len(values)
    if count < 2:
        return np.zeros(count, bool)
    cuts = np.flatnonzero(np.abs(np.diff(values)) > jump + rate * np.diff(time)) + 1
    if not cuts.size:
        return np.zeros(count, bool)
    beside = np.arange(-_BESIDE, _BESIDE + 1)
    cuts = np.unique(np.clip((cuts[:, None] + beside).ravel(), 1, count - 1))
    first = np.concatenate([[0], cuts])
    last = np.concatenate([cuts, [count]]) - 1
    total = (last - first + 1).astype(np.float64)
    before = np.full(len(first), -1)
    for i in range(1, len(first)):
        earlier = np.arange(max(0, i - _BACK), i)
        ends = last[earlier]
        reach = jump + rate * (time[first[i]] - time[ends])
        fits = np.abs(values[first[i]] - values[ends]) <= reach
        if fits.any():
            best = earlier[fits][np.argmax(total[earlier[fits]])]
            before[i] = best
            total[i] += total[best]
    bad = np.ones(count, bool)
    piece = int(np.argmax(total))
    while piece >= 0:
        bad[first[piece] : last[piece] + 1] = False
        piece = int(before[piece])
    return bad


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveRules:
    """Limits by which a log is cut into rows; depths count from the surface as the log has it."""

    min_depth: float = 5.0
    """[m] An interval between fixes that goes deeper is a dive; otherwise it is surface time."""
    min_stretch: float = 30.0
    """[s] A dive is below `min_depth` for this long at a stretch. A sensor at the surface shows
    single depths of 5 to 14 m when air and waves pass it."""
    min_duration: float = 60.0
    """[s] Shorter dives are left out and counted."""
    surface_depth: float = 1.5
    """[m] Shallower samples count as at the surface if no fix shows it."""
    longest_gap: float = 3600.0
    """[s] Without fixes, a longer gap in depth and attitude ends a row. A longer gap in the fixes
    interrupts a surface interval."""
    fix_depth: float = 2.0
    """[m] Greatest depth at which a GPS antenna receives."""
    fix_lag: float = 30.0
    """[s] Time after leaving the surface in which a receiver goes on with its last velocity, and
    vehicles log these positions."""
    coast: float = 40.0
    """[m] A fix logged within `fix_lag` is used if it is nearer than this to the last surface fix.
    Good fixes can differ by as much. With 0 no such fix is used: rows start at a fix afloat."""
    coast_speed: float = 3.5
    """[m/s] Three or more steps at one velocity above this are no drift: the receiver coasts."""
    fix_speed: float = 4.0
    """[m/s] Fixes that need a faster drift are wrong."""
    fix_noise: float = 100.0
    """[m] Largest difference of two good fixes without any drift."""
    drift_speed: float = 2.0
    """[m/s] A faster surface drift is rejected: the vehicle was carried, or a fix is wrong."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (value >= 0.0 if field.name == "coast" else value > 0.0):
                raise ValueError(f"{field.name} must be positive")


Mask = NDArray[np.bool_]

FASTEST_RESTART = 1.0
"""[m/s] Fastest depth change over a sensor's restart; faster ones are no measurement."""
_FEW = 3
"""Longest run of zeros that a restart can write."""
_HOLE = 20.0
"""[s] A sensor that is silent for longer may have been restarted."""


def lone_zeros(time: Array, values: Array, *, rate: float, jump: float) -> Mask:
    """Find exact zeros that cannot be reached from the nearest other sample before or after.

    Args:
      time: [s] increasing strictly, shape (samples,).
      values: finite, [dbar] or [m], shape (samples,).
      rate: limit for the other samples. jump: limit for them and the zeros (see `unreachable`).
    """
    zero = values == 0.0
    bad = np.zeros(len(values), bool)
    other = np.flatnonzero(~zero)
    if not zero.any() or not other.size:
        return bad
    # sentinels among the other samples are no reference either
    other = other[~unreachable(time[other], values[other], rate=rate, jump=jump)]
    at = np.searchsorted(other, np.arange(len(values)))
    for near, there in ((at - 1, at > 0), (at, at < len(other))):
        beside = other[np.clip(near, 0, len(other) - 1)]
        reach = jump + FASTEST_RESTART * np.abs(time - time[beside])
        bad |= zero & there & (np.abs(values[beside]) > reach)
    # a longer run of zeros is the surface; then the other sample is wrong
    return bad & short_runs(zero, _FEW)


def stale(time: Array, values: Array, *, rate: float, jump: float) -> Mask:
    """Find samples after a gap that repeat the last value exactly, far from the next value.

    Args: see `lone_zeros`; `rate` is not used.
    """
    del rate  # over the gap of a restart it would allow nearly any step: FASTEST_RESTART is used
    bad = np.zeros(len(values), bool)
    if len(values) > 2:
        gap, step = np.diff(time), np.diff(values)
        again = (step[:-1] == 0.0) & (gap[:-1] > _HOLE)
        bad[1:-1] = again & (np.abs(step[1:]) > jump + FASTEST_RESTART * gap[1:])
    return bad


def runs(mask: Mask) -> NDArray[np.intp]:
    """Index of the first sample of each run of True, and of the one after its last, (runs, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[0], mask, [0]]))).reshape(-1, 2)


def short_runs(mask: Mask, longest: int) -> Mask:
    """True where `mask` is true in runs of `longest` samples at most."""
    short = np.zeros(len(mask), bool)
    for start, end in runs(mask):
        short[start:end] = end - start <= longest
    return short
