"""The log of one deployment: channels at their native rates, in the schema's names and units.

One file after the other: what cannot be read is reported and left out, the rest is read.
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
    """In the unit of its name in `twin.records.schema`, shape (samples,)."""

    @classmethod
    def finite(cls, time: Array, values: Array) -> Channel:
        """The samples that have a value, of columns at increasing times."""
        there = np.isfinite(values)
        return cls(time[there], values[there])

    def __len__(self) -> int:
        return len(self.time)

    @functools.cached_property
    def spacing(self) -> float:
        """[s] Median time between samples; NaN for fewer than two."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else float("nan")

    def within(self, start: float, end: float) -> Channel:
        """The samples from `start` to `end` [s], both included."""
        first, last = np.searchsorted(self.time, [start, end], side="left")
        if last < len(self.time) and self.time[last] == end:
            last += 1
        return Channel(self.time[first:last], self.values[first:last])

    def at(self, times: Array) -> Array:
        """Linear interpolation, the end values held outside; NaN for an empty channel."""
        return np.interp(times, self.time, self.values) if len(self) else times * np.nan

    def known(self, times: Array) -> Array:
        """Linear interpolation where the channel covers the times; NaN elsewhere."""
        return np.where(self.covers(times), self.at(times), np.nan)

    def covers(self, times: Array) -> NDArray[np.bool_]:
        """Whether the times lie between samples that are near enough to be joined by a line, or
        beside one, within three of the spacings that are usual there.

        A sensor that is silent again and again reports on change: all between its samples is
        covered, and what is beside them for as long as it was ever silent.
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
        """Whether it is silent again and again, as what is reported on change or rarely is."""
        if len(self) < 3:
            return False
        holes = int((np.diff(self.time) > max(NEAR, _USUAL_HOLE * self.spacing)).sum())
        return holes >= _AGAIN and holes > _OFTEN * len(self)

    def usual_spacing(self, times: Array) -> Array:
        """[s] Median of the spacings around each time."""
        if len(self) < 3:
            return np.full(np.shape(times), self.spacing)
        spacing = np.diff(self.time)
        half = _AROUND // 2
        padded = np.pad(spacing, half, mode="reflect" if len(spacing) > half else "edge")
        usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, _AROUND), axis=1)
        at = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(spacing) - 1)
        return np.asarray(usual[at])


NEAR = 120.0
"""[s] No hole is shorter; a glider crosses less than 25 m in it."""
_USUAL_HOLE = 3.0
"""Spacings that a hole of a sensor which goes on has at most."""
_AGAIN, _OFTEN = 2, 0.02
"""So many holes, and more than this part of the samples, are no accident."""
_AT_SAMPLE = 1e-3
"""[s] So near to a sample the value is the sample's own."""
_AROUND = 9
"""Spacings of which the median is the usual one."""

EMPTY = Channel(np.zeros(0), np.zeros(0))


def joined(pieces: Sequence[Channel]) -> Channel:
    """Pieces of one channel in time order, repeated times once."""
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
        """The fixes of columns at increasing times that have a time and a place."""
        fixes = cls(time, latitude, longitude)
        return fixes.keep(np.isfinite(time) & np.isfinite(latitude) & np.isfinite(longitude))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def middle(self) -> tuple[float, float]:
        """Median latitude and longitude [degree]; on the equator where there is none."""
        if not len(self):
            return 0.0, 0.0
        return float(np.median(self.latitude)), float(np.median(self.longitude))

    def channels(self, prefix: str = "") -> dict[str, Channel]:
        """Latitude and longitude as channels of these names, behind a prefix."""
        return {
            f"{prefix}latitude": Channel(self.time, self.latitude),
            f"{prefix}longitude": Channel(self.time, self.longitude),
        }

    def keep(self, mask: NDArray[np.bool_] | NDArray[np.intp]) -> LoggedFixes:
        """The fixes where `mask` is true, or at these indices."""
        return LoggedFixes(self.time[mask], self.latitude[mask], self.longitude[mask])

    def once(self) -> LoggedFixes:
        """The fixes in time order, each time once."""
        return self.keep(np.unique(self.time, return_index=True)[1])

    def within(self, start: float, end: float) -> LoggedFixes:
        """The fixes from `start` to `end` [s], both included."""
        return self.keep((self.time >= start) & (self.time <= end))

    def at(self, times: Array) -> tuple[Array, Array]:
        """Latitude, and longitude from 0 to 360 [degree], on straight lines between the fixes, the
        first and last held outside; 0 without any."""
        if not len(self):
            return np.zeros(np.shape(times)), np.zeros(np.shape(times))
        longitude = np.interp(times, self.time, np.unwrap(self.longitude, period=360.0))
        return np.interp(times, self.time, self.latitude), np.mod(longitude, 360.0)


NO_FIXES = LoggedFixes(np.zeros(0), np.zeros(0), np.zeros(0))


def places_for(fixes: LoggedFixes, track: Mapping[str, Channel]) -> LoggedFixes:
    """Where the vehicle was: its fixes, else its own track (`latitude`, `longitude` [degree])."""
    latitude, longitude = (track.get(axis, EMPTY) for axis in ("latitude", "longitude"))
    if len(fixes) or not len(latitude) or not len(longitude):
        return fixes
    return LoggedFixes(latitude.time, latitude.values, longitude.at(latitude.time))


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeploymentLog:
    """One deployment of one vehicle.

    `channels` are keyed by schema names (`measured_pitch` in degree ...). `auxiliary` holds what
    rows are made from and a store does not keep as it is: `dive` (number), `latitude`/`longitude`
    (on-board track, degree), `onboard_north`/`onboard_east` (m, any origin), `dac_north`/`dac_east`
    (what the vehicle reported, m/s, at the time it became known), `waypoint_latitude`/`_longitude`
    (where it was sent, degree), `true_latitude`/`_longitude` (of a simulated one, degree),
    `velocity_north/_east/_down`
    (truth through the water, m/s), `thruster` (1 = on), `afloat` (times at which the vehicle says
    that it is at the surface), `awake` (times at which its computer logged anything, where others
    may go on without it). A log that is on a grid already has
    `measured_depth_original`, `measured_attitude_original`, `measured_ctd_original` (times of the
    samples it was made of), `gap_stored` (1 where it is interpolated) and `phase_stored`.
    """

    deployment: str
    """Name of the deployment; rows carry it."""
    platform: str
    """Make of the vehicle."""
    channels: Mapping[str, Channel]
    fixes: LoggedFixes
    magnetic_variation: Channel
    """[degree] east positive: true heading = magnetic heading + variation; may be empty."""
    auxiliary: Mapping[str, Channel] = dataclasses.field(default_factory=dict)
    files: tuple[str, ...] = ()
    station: bool = False
    """True when a shore station has zeroed the pressure and paired the fixes with the dives."""
    simulated: bool = False
    """True when the files say that no vehicle at sea recorded them."""
    pieces: tuple[tuple[float, float], ...] | None = None
    """[s] unix start and end of each row; None: a row is a dive, found by its depth."""
    period: float | None = None
    """[s] between the samples of a store, where the log asks for one."""
    gridded: bool = False
    """True when the samples are those of a store's grid already: its holes stay holes."""
    held: frozenset[str] = frozenset()
    """Channels that keep their last value between samples."""
    said: str | None = None
    """What people said of the deployment, as the text of a pyglider `deployment.yml`."""
    doubts: tuple[Doubt, ...] = ()
    """Stretches whose rows are suspect."""
    model: str | None = None
    """Vehicle file that stands for the vehicle; None: the one of its kind of log."""

    def channel(self, name: str) -> Channel:
        """A channel or an auxiliary one; empty when the log lacks it."""
        return self.channels.get(name) or self.auxiliary.get(name) or EMPTY

    @property
    def span(self) -> tuple[float, float]:
        """[s] First and last time of any depth, pressure or attitude sample; without these, of
        any sample."""
        names = ("measured_depth", "measured_pressure", "measured_pitch")
        used = [c for n in names if len(c := self.channel(n))] or [*self.channels.values()]
        return min(c.time[0] for c in used), max(c.time[-1] for c in used)


Result = TypeVar("Result")

UNREADABLE = "unreadable file"
"""Subject of the report's entries of files that could not be read."""
TRUNCATED = "truncated: "
"""Begins what is said of a file that was read and ends too early"""
OTHER_KIND = "file of another kind"
"""Subject of those that are no logs of the kind, as offload folders hold them: no failure."""


def each_file(
    paths: Sequence[Path], read: Callable[[Path], Result], tally: Tally
) -> list[tuple[Path, Result]]:
    """What `read` makes of each file that it can read, in order.

    A file at which `read` raises anything else than an error of the machine (`OF_THE_MACHINE`) is
    left out and reported, files with the same reason together.

    Raises:
      InputError: why, when none can be read.
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
"""Errors that say nothing of a file: memory is short, a package is missing or another version."""


def failed_reading(path: Path, error: Exception) -> InputError:
    """The error of a file at which its reader raised what no reader should."""
    why = f"{path.name} is damaged, or of a kind that its reader does not know"
    return InputError(f"{why}: {_described(error)}")


def _described(error: Exception) -> str:
    """The class of an error, and what it says."""
    return ": ".join(filter(None, (type(error).__name__, " ".join(str(error).split())[:160])))


@contextlib.contextmanager
def naming(log: DeploymentLog) -> Iterator[None]:
    """Make an InputError that names the log of whatever is raised while dives are cut of it.

    Raises:
      InputError: of those that were raised, and in place of others.
    """
    try:
        yield
    except (InputError, *OF_THE_MACHINE):
        raise
    except Exception as error:
        what = f"{log.deployment} ({summarise(log.files, 1)}) holds what cannot be cut into dives"
        raise InputError(f"{what}: {_described(error)}") from error


def _reason(path: Path, error: InputError) -> str:
    """What an error says behind the name of the file that it begins with."""
    why = str(error)
    for name in (str(path), path.name):
        why = why.removeprefix(name)
    return why
