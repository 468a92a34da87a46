"""Deployment log: channels at their native rates, in the schema's names and units.

`each_file` reads one file after the other; it reports and leaves out unreadable files.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from factory.importing.tally import Doubt, OtherKind, Tally, by_reason, summarise
from twin.errors import InputError

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Channel:
    """One signal: finite values at strictly increasing times."""

    time: Array
    """[s] since 1970-01-01 UTC, shape (samples,)."""
    values: Array
    """Values in the unit that `twin.records.schema` gives the channel, shape (samples,)."""

    @classmethod
    def finite(cls, time: Array, values: Array) -> Channel:
        """Make a channel of the samples that have a value; `time` increases."""
        there = np.isfinite(values)
        return cls(time[there], values[there])

    def __len__(self) -> int:
        return len(self.time)

    @functools.cached_property
    def spacing(self) -> float:
        """[s] Median time between samples; NaN for fewer than two."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else float("nan")

    def within(self, start: float, end: float) -> Channel:
        """Samples from `start` to `end` [s], both included."""
        first, last = np.searchsorted(self.time, [start, end], side="left")
        if last < len(self.time) and self.time[last] == end:
            last += 1
        return Channel(self.time[first:last], self.values[first:last])

    def at(self, times: Array) -> Array:
        """Interpolate linearly, with the end values held outside; NaN for an empty channel."""
        return np.interp(times, self.time, self.values) if len(self) else times * np.nan

    def known(self, times: Array) -> Array:
        """Interpolate linearly where the channel covers the times; NaN elsewhere."""
        return np.where(self.covers(times), self.at(times), np.nan)

    def covers(self, times: Array) -> NDArray[np.bool_]:
        """Tell which times are covered: between two near samples, or close to one sample.

        Two samples bridge a gap of at most `NEAR` or three usual spacings, whichever is longer. One
        sample covers three usual spacings on either side. A channel reported on change covers all
        times between its samples, and beyond its ends as long as its longest gap.
        """
        times = np.asarray(times, np.float64)
        if not len(self):
            return np.zeros(times.shape, bool)
        at = np.searchsorted(self.time, times, side="right")
        left, right = np.maximum(at - 1, 0), np.minimum(at, len(self) - 1)
        before, after = np.abs(times - self.time[left]), np.abs(self.time[right] - times)
        distance = np.minimum(before, after)
        inside = (at > 0) & (at < len(self))
        if self.on_change:
            return np.asarray(inside | (distance <= float(np.diff(self.time).max())))
        near = _USUAL_HOLE * np.nan_to_num(self.usual_spacing(times))
        bridged = inside & (self.time[right] - self.time[left] <= np.maximum(NEAR, near))
        return np.asarray(bridged | (distance <= np.maximum(near, _AT_SAMPLE)))

    @functools.cached_property
    def on_change(self) -> bool:
        """True if many gaps show that the channel is reported on change, or rarely."""
        if len(self) < 3:
            return False
        holes = int((np.diff(self.time) > max(NEAR, _USUAL_HOLE * self.spacing)).sum())
        return holes >= _AGAIN and holes > _OFTEN * len(self)

    def usual_spacing(self, times: Array) -> Array:
        """[s] Running median of the sample spacing around each time."""
        if len(self) < 3:
            return np.full(np.shape(times), self.spacing)
        spacing = np.diff(self.time)
        half = _AROUND // 2
        padded = np.pad(spacing, half, mode="reflect" if len(spacing) > half else "edge")
        usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, _AROUND), axis=1)
        at = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(spacing) - 1)
        return np.asarray(usual[at])


NEAR = 120.0
"""[s] Longest gap always covered; a glider's depth changes by less than 25 m in it."""
_USUAL_HOLE = 3.0
"""Longest gap that is covered, in usual sample spacings."""
_AGAIN, _OFTEN = 2, 0.02
"""A channel reported on change has at least _AGAIN gaps, and more than _OFTEN gaps per sample."""
_AT_SAMPLE = 1e-3
"""[s] Distance from a sample within which its value always holds."""
_AROUND = 9
"""Number of spacings in the running median."""

EMPTY = Channel(np.zeros(0), np.zeros(0))


def joined(pieces: Sequence[Channel]) -> Channel:
    """Join chunks of one channel in time order; the first value at a repeated time is kept."""
    if not pieces:
        return EMPTY
    time = np.concatenate([piece.time for piece in pieces])
    values = np.concatenate([piece.values for piece in pieces])
    unique, first = np.unique(time, return_index=True)
    return Channel(unique, values[first])


@dataclasses.dataclass(frozen=True)
class LoggedFixes:
    """GPS fixes in time order."""

    time: Array
    """[s] since 1970-01-01 UTC."""
    latitude: Array
    """[degree] north."""
    longitude: Array
    """[degree] east."""

    @classmethod
    def finite(cls, time: Array, latitude: Array, longitude: Array) -> LoggedFixes:
        """Make fixes of columns at increasing times; drop rows without a time or position."""
        fixes = cls(time, latitude, longitude)
        return fixes.keep(np.isfinite(time) & np.isfinite(latitude) & np.isfinite(longitude))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def middle(self) -> tuple[float, float]:
        """Median latitude and longitude [degree]; (0, 0) without fixes."""
        if not len(self):
            return 0.0, 0.0
        return float(np.median(self.latitude)), float(np.median(self.longitude))

    def channels(self, prefix: str = "") -> dict[str, Channel]:
        """Latitude and longitude as channels, their names behind `prefix`."""
        return {
            f"{prefix}latitude": Channel(self.time, self.latitude),
            f"{prefix}longitude": Channel(self.time, self.longitude),
        }

    def keep(self, mask: NDArray[np.bool_] | NDArray[np.intp]) -> LoggedFixes:
        """Fixes where `mask` is true, or at these indices."""
        return LoggedFixes(self.time[mask], self.latitude[mask], self.longitude[mask])

    def once(self) -> LoggedFixes:
        """Fixes in time order, without repeated times."""
        return self.keep(np.unique(self.time, return_index=True)[1])

    def within(self, start: float, end: float) -> LoggedFixes:
        """Fixes from `start` to `end` [s], both included."""
        return self.keep((self.time >= start) & (self.time <= end))

    def at(self, times: Array) -> tuple[Array, Array]:
        """Interpolate latitude, and longitude from 0 to 360 [degree], linearly between the fixes;
        the first and last fix hold outside; 0 without fixes."""
        if not len(self):
            return np.zeros(np.shape(times)), np.zeros(np.shape(times))
        longitude = np.interp(times, self.time, np.unwrap(self.longitude, period=360.0))
        return np.interp(times, self.time, self.latitude), np.mod(longitude, 360.0)


NO_FIXES = LoggedFixes(np.zeros(0), np.zeros(0), np.zeros(0))


def places_for(fixes: LoggedFixes, track: Mapping[str, Channel]) -> LoggedFixes:
    """Positions: the fixes, else the vehicle's own track (`latitude`, `longitude` [degree])."""
    latitude, longitude = (track.get(axis, EMPTY) for axis in ("latitude", "longitude"))
    if len(fixes) or not len(latitude) or not len(longitude):
        return fixes
    return LoggedFixes(latitude.time, latitude.values, longitude.at(latitude.time))


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeploymentLog:
    """Log of one deployment of one vehicle.

    `channels` are keyed by schema names (`measured_pitch` in degree ...). `auxiliary` holds signals
    that rows are made from and that a store does not keep unchanged: `dive` (number),
    `latitude`/`longitude` (on-board track, degree), `onboard_north`/`onboard_east` (m, any origin),
    `dac_north`/`dac_east` (reported depth-averaged current, m/s, at the time of the report),
    `waypoint_latitude`/`_longitude` (commanded waypoint, degree), `true_latitude`/`_longitude`
    (simulated vehicle, degree), `velocity_north/_east/_down` (true velocity through the water,
    m/s), `thruster` (1 = on), `afloat` (times at which the vehicle reports that it is at the
    surface), `awake` (times at which its computer logged anything, if sensors may log without it).
    A log that is on a store's time grid already has `measured_depth_original`,
    `measured_attitude_original`, `measured_ctd_original` (times of the original samples),
    `gap_stored` (1 where interpolated) and `phase_stored`.
    """

    deployment: str
    """Name of the deployment, stored with each row."""
    platform: str
    """Make of the vehicle."""
    channels: Mapping[str, Channel]
    fixes: LoggedFixes
    magnetic_variation: Channel
    """[degree] east positive: true heading = magnetic heading + variation; may be empty."""
    auxiliary: Mapping[str, Channel] = dataclasses.field(default_factory=dict)
    files: tuple[str, ...] = ()
    station: bool = False
    """True when a shore station has zeroed the pressure and assigned the fixes to dives."""
    simulated: bool = False
    """True when the files say that no vehicle at sea recorded them."""
    pieces: tuple[tuple[float, float], ...] | None = None
    """[s] Unix start and end of each row; None: a row is a dive, found by depth."""
    period: float | None = None
    """[s] Sampling interval of the store, if the log asks for one."""
    gridded: bool = False
    """True when the samples are on a store's time grid already; its gaps stay gaps."""
    held: frozenset[str] = frozenset()
    """Channels whose last value holds between samples."""
    said: str | None = None
    """Description of the deployment by its operators: the text of a pyglider `deployment.yml`."""
    cells: Channel = EMPTY
    """Doppler log's cells, (samples, cells, 3): the signals of `twin.records.logged.CELLS`."""
    doubts: tuple[Doubt, ...] = ()
    """Stretches whose rows are suspect."""
    model: str | None = None
    """Vehicle file that models the vehicle; None: the default for the kind of log."""

    def channel(self, name: str) -> Channel:
        """Return a channel or an auxiliary channel; empty when the log lacks both."""
        return self.channels.get(name) or self.auxiliary.get(name) or EMPTY

    @property
    def span(self) -> tuple[float, float]:
        """[s] First and last time of depth, pressure and pitch; without these, of all samples."""
        names = ("measured_depth", "measured_pressure", "measured_pitch")
        used = [c for n in names if len(c := self.channel(n))] or [*self.channels.values()]
        return min(c.time[0] for c in used), max(c.time[-1] for c in used)


Result = TypeVar("Result")

UNREADABLE = "unreadable file"
"""Report subject of files that could not be read."""
TRUNCATED = "truncated: "
"""Prefix of the reason for a file that was read and ends too early."""
OTHER_KIND = "file of another kind"
"""Report subject of files that are no logs of this kind; in a mixed folder this is no failure."""


def each_file(
    paths: Sequence[Path], read: Callable[[Path], Result], tally: Tally
) -> list[tuple[Path, Result]]:
    """Read each file in order; return the readable files with the results of `read`.

    A file at which `read` raises any error but `OF_THE_MACHINE` is left out and reported. Files
    with the same reason are reported together.

    Raises:
      InputError: no file can be read; the message gives the reasons.
    """
    found: list[tuple[Path, Result]] = []
    refused: list[tuple[Path, InputError]] = []
    for path in paths:
        try:
            found.append((path, read(path)))
        except InputError as error:
            refused.append((path, error))
        except OF_THE_MACHINE:
            raise
        except Exception as error:
            refused.append((path, failed_reading(path, error)))
    reasons = [(path.name, _reason(path, error)) for path, error in refused]
    groups: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for (_, why), one in zip(refused, reasons, strict=True):
        subject = OTHER_KIND if isinstance(why, OtherKind) else UNREADABLE
        groups.setdefault((subject, one[1]), []).append(one)
        if subject == UNREADABLE:
            tally.unreadable.append(one)
    for (subject, _), several in groups.items():
        tally.add("left out", subject, len(several), by_reason(several, len(paths))[0])
    if refused and not found:
        first = refused[0][1]
        if len(refused) == 1 or isinstance(first, OtherKind):
            raise first
        raise InputError("; ".join(by_reason(reasons, len(paths))))
    return found


OF_THE_MACHINE = (MemoryError, ImportError)
"""Errors that no file causes: memory is short, a package is missing or another version."""


def failed_reading(path: Path, error: Exception) -> InputError:
    """Make the error for a file whose reader raised an unexpected exception."""
    why = f"{path.name} is damaged, or of a kind that its reader does not know"
    return InputError(f"{why}: {_described(error)}")


def _described(error: Exception) -> str:
    """Class and message of an error."""
    return ": ".join(filter(None, (type(error).__name__, " ".join(str(error).split())[:160])))


@contextlib.contextmanager
def naming(log: DeploymentLog) -> Iterator[None]:
    """Turn exceptions raised while a log is cut into dives into InputErrors that name the log.

    Raises:
      InputError: raised inside, which passes unchanged; or in place of any other exception but
        those of OF_THE_MACHINE, which pass too.
    """
    try:
        yield
    except (InputError, *OF_THE_MACHINE):
        raise
    except Exception as error:
        what = f"{log.deployment} ({summarise(log.files, 1)}) holds what cannot be cut into dives"
        raise InputError(f"{what}: {_described(error)}") from error


def _reason(path: Path, error: InputError) -> str:
    """Message of an error, without the file name that it begins with."""
    why = str(error)
    for name in (str(path), path.name):
        why = why.removeprefix(name)
    return why
