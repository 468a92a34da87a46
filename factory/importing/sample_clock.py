"""Sample clock: the time variable that advances from sample to sample.

Public tables often repeat one time for a whole profile. They keep the time of each sample under
another name, or not at all.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.tally import Tally
from twin.errors import InputError

Array = NDArray[np.float64]

TICK = 1.0
"""[s] Resolution of clocks that repeat a whole second for the samples within it."""
FEWEST = 4
"""Minimum number of samples with one time that show a standing clock. A log may write a row two or
three times."""
LONGEST = 3600.0
"""[s] Longest extent of a suspect stretch before and after its time. Across a longer silence, a
neighbouring time may come from a clock that was not set yet."""
MOST = 0.5
"""Largest fraction of samples during which a log's clock may stand."""


def standing(time: Array, columns: Mapping[str, Array]) -> NDArray[np.bool_]:
    """True for rows during which the clock stands, (rows,).

    The clock stands if `FEWEST` or more rows have one time and different values, and the times
    before and after are more than a `TICK` away.

    Args:
      time: [s], in any order, (rows,).
      columns: measured values, (rows,) each.
    """
    found = np.zeros(len(time), bool)
    known = np.flatnonzero(np.isfinite(time))
    known = known[np.argsort(time[known], kind="stable")]
    moments, first, count = np.unique(time[known], return_index=True, return_counts=True)
    step = np.concatenate([[np.inf], np.diff(moments), [np.inf]])
    still = (count >= FEWEST) & (np.minimum(step[:-1], step[1:]) > TICK)
    if not still.any():
        return found
    differs = np.zeros(first.size, bool)
    for values in columns.values():
        low, high = (f.reduceat(values[known], first) for f in (np.fmin, np.fmax))
        differs |= low < high  # False where all are NaN
    found[known] = np.repeat(still & differs, count)
    return found


def expect_going(
    name: str, time: Array, columns: Mapping[str, Array], subject: str, hint: str = ""
) -> None:
    """Raise InputError if the clock stands for most of a log.

    Args:
      name: variable or column of time.
      time, columns: see `standing`.
      subject: file, for the error.
      hint: next step, for the error.

    Raises:
      InputError: the clock stands.
    """
    still = standing(time, columns)
    if still.sum() > MOST * len(time):
        raise InputError(f"{subject}: {_why(name, time, still)}{hint}")


def _why(name: str, time: Array, still: NDArray[np.bool_]) -> str:
    times = np.unique(time[still]).size
    return (
        f"{name!r} gives {still.sum()} of {len(time)} samples no time of their own: it has "
        f"{times} time{'' if times == 1 else 's'} for them, as a profile's time that is repeated, "
        "or one without enough digits"
    )


class NoClock(InputError):
    """Error for a file in which no time variable advances from sample to sample."""


def sample_clock(
    clocks: Mapping[str, Array], columns: Mapping[str, Array], subject: str, tally: Tally
) -> str:
    """Name of the samples' clock: the usual one, unless it stands and another advances.

    Args:
      clocks: times [s] by name, the usual one first, (samples,) each.
      columns: measured values, (samples,) each.
      subject: file, for the report.

    Raises:
      NoClock: every clock that has times stands.
      InputError: no clock has a time.
    """
    known = {name: int(np.isfinite(time).sum()) for name, time in clocks.items()}
    if not any(known.values()):
        raise InputError(f"{subject} holds no measurement with a time")
    still = {name: standing(time, columns) for name, time in clocks.items()}
    most = max(known.values())
    for name in clocks:
        stands = int(still[name].sum())
        if stands <= MOST * known[name] and known[name] - stands > MOST * most:
            break
    else:
        usual = next(name for name in clocks if still[name].any())
        raise NoClock(
            f"{subject}: {_why(usual, clocks[usual], still[usual])}; take a file with the time of "
            "each sample"
        )
    usual = next(iter(clocks))
    if name != usual:
        count = int(still[usual].sum())
        why = f"{usual} stands for {count}" if count else f"{usual} has {known[usual]}"
        tally.add("note", name, known[name], f"the samples' clock: {why} of {len(clocks[usual])}")
    return name


def tell_standing(
    time: Array, columns: Mapping[str, Array], subject: str, tally: Tally, deployment: str = ""
) -> None:
    """Mark the stretches during which the clock stands as suspect.

    Args: see `standing`; deployment: deployment of the rows, if known.
    """
    still = standing(time, columns)
    if not still.any():
        return
    moments = np.unique(time[np.isfinite(time)])
    at, rows = np.unique(np.searchsorted(moments, time[still]), return_counts=True)
    first = np.flatnonzero(np.append(True, np.diff(at) > 1))
    last = np.append(first[1:], len(at)) - 1
    for begin, end in zip(first, last, strict=True):
        # the samples' true times lie between the times before and after
        tally.doubt(
            subject,
            "several samples have one time and other values: the clock stands",
            rows[begin : end + 1],
            deployment=deployment,
            start=float(max(moments[max(at[begin] - 1, 0)], moments[at[begin]] - LONGEST)),
            end=float(min(moments[min(at[end] + 1, len(moments) - 1)], moments[at[end]] + LONGEST)),
        )


CSV_FORMATS = ("%d/%m/%Y %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S")
"""Formats of SeaExplorer's time stamps."""

FIRST_SECOND, LAST_SECOND = 3.0e8, 4.2e9
"""Unix seconds that a log's time can be: 1979 to 2103."""

AHEAD = 86400.0
"""[s] Longest time by which a sound log is ahead of this computer's clock."""


def parse_stamps(words: NDArray[Any], layouts: Sequence[str] = CSV_FORMATS) -> Array:
    """Parse written times to unix seconds; NaN where there is none.

    Args:
      layouts: `strptime` formats for times that are not ISO 8601.
    """
    return np.array([_stamp(str(word), layouts) for word in words], np.float64)


def _stamp(word: str, layouts: Sequence[str]) -> float:
    word = word.removesuffix("UTC").removesuffix("GMT").rstrip()
    with contextlib.suppress(ValueError):
        return in_utc(datetime.fromisoformat(word))
    for layout in layouts:
        with contextlib.suppress(ValueError):
            return in_utc(datetime.strptime(word, layout))
    return math.nan


def in_utc(moment: datetime) -> float:
    """[s] Unix time of a moment; without a time zone, the moment is UTC."""
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def unix_seconds(time: Array, subject: str, tally: Tally) -> Array:
    """Convert times to unix seconds from ms, us, ns, days or MATLAB days; count the conversion.

    Units other than seconds must not place the log in the future.

    Raises:
      InputError: the numbers cannot be times of a log.
    """
    good = time[np.isfinite(time)]
    if not good.size:
        return time
    middle, today = float(np.median(good)), datetime.now(UTC).timestamp()
    for unit, (factor, offset) in _CLOCKS.items():
        latest = today + AHEAD if unit else LAST_SECOND
        if FIRST_SECOND <= (middle + offset) * factor <= latest:
            if unit:
                tally.add("repaired", subject, good.size, f"time was in {unit}, not in seconds")
            return (time + offset) * factor
    raise InputError(
        f"{subject}: time {middle:g} is not a unix time in seconds; logs begin in 1979 or later"
    )


_CLOCKS = {
    "": (1.0, 0.0),
    "milliseconds": (1e-3, 0.0),
    "microseconds": (1e-6, 0.0),
    "nanoseconds": (1e-9, 0.0),
    "MATLAB days": (86400.0, -719529.0),
    "days since 1970": (86400.0, 0.0),
    "days since 1950": (86400.0, -7305.0),
}
"""Units of clocks: the unit [s], and the number to add so that 1970 is 0."""
