"""netCDF-4 and HDF5 files (MATLAB v7.3 among them): opened with errors that say what is wrong."""

from __future__ import annotations

import atexit
import contextlib
import os
import re
import subprocess
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.columns import measurable
from factory.importing.sample_clock import parse_stamps, unix_seconds
from factory.importing.tally import Tally
from factory.importing.units import declared
from twin.bounded import check_unpacked
from twin.errors import InputError

Array = NDArray[np.float64]

HDF5 = b"\x89HDF"
"""Begins each such file, netCDF-4's too"""


class _Trial:
    """A second process that opens every HDF5 file first.

    Of a damaged one the library may never come back, which nothing within a process can end, or
    take its process with it.
    """

    LONGEST = 60.0
    """[s] A sound file takes some milliseconds"""
    PROGRAM = """
import os, sys, netCDF4
for line in sys.stdin:
    try:
        netCDF4.Dataset(os.fsdecode(bytes.fromhex(line))).close()
    except Exception:
        pass
    print(flush=True)
"""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()
        self._passed: set[tuple[str, int, int]] = set()
        self._owner = os.getpid()
        self._others: subprocess.Popen[str] | None = None

    def passes(self, path: Path) -> bool:
        """Tell whether the process comes back from the file, with an error or without."""
        self._leave()
        stat = path.stat()
        key = str(path.resolve()), stat.st_size, stat.st_mtime_ns
        with self._lock:
            if key not in self._passed and self._tried(key[0]):
                self._passed.add(key)
            return key in self._passed

    def _tried(self, path: str) -> bool:
        if self._process is not None and self._process.poll() is not None:
            self.end()  # somebody has ended it
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", self.PROGRAM],  # nothing of the folder is imported
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            )  # fmt: skip
        process, answers = self._process, list[str]()
        assert process.stdin is not None
        assert process.stdout is not None
        answer = process.stdout
        process.stdin.write(os.fsencode(path).hex() + "\n")
        process.stdin.flush()
        waiting = threading.Thread(target=lambda: answers.append(answer.readline()))
        waiting.start()
        waiting.join(self.LONGEST)
        if not answers or not answers[0]:
            process.kill()  # which ends the waiting
            waiting.join()
            self.end()
            return False
        return True

    def _leave(self) -> None:
        """Leave the process to the parent in a fork: nobody else can wait for it."""
        if self._owner != os.getpid():
            self._owner, self._lock = os.getpid(), threading.Lock()
            self._others, self._process = self._process, None

    def end(self) -> None:
        """End the process; the next file begins another."""
        self._leave()
        if self._process is not None:
            self._process.communicate()
            self._process = None


_trial = _Trial()
atexit.register(_trial.end)


@contextlib.contextmanager
def open_netcdf(path: Path) -> Iterator[Any]:
    """A netCDF or HDF5 file for reading, closed at the end.

    Raises:
      InputError: it is neither, truncated, or what its library cannot read is read within.
    """
    import netCDF4

    with path.open("rb") as raw:
        start = raw.read(8)
    if start.startswith(HDF5) and not _trial.passes(path):
        raise InputError(f"{path.name} is damaged: its library does not come back from it")
    # limits that do not fit the variable's own kind of number are not used: no word of a library
    # that names neither the file nor the variable
    warnings.filterwarnings("ignore", r"WARNING: \w+ not used since it", UserWarning)
    try:
        file = netCDF4.Dataset(path)
    except (OSError, RuntimeError) as error:
        known = start.startswith((b"CDF", HDF5)) or b"MATLAB" in start
        why = "truncated or damaged" if known else "of another format"
        raise InputError(
            f"{path.name} cannot be opened as netCDF-4 or HDF5: {why} ({type(error).__name__})"
        ) from error
    with file, warnings.catch_warnings():
        # limits of another type than their variable are left out, as netCDF's rules want it
        warnings.filterwarnings("ignore", "WARNING: ", UserWarning)
        warnings.filterwarnings("error", "invalid scale_factor", UserWarning)
        check_unpacked(_declared(file), path.stat().st_size, path.name)
        try:
            yield file
        except (RuntimeError, OSError, TypeError, UserWarning) as error:
            why = _without_scale(file) or " ".join(str(error).split())
            raise InputError(f"{path.name} is damaged: {why}") from error


def _without_scale(group: Any) -> str:
    """The first variable whose scale or offset is no number, in words; empty without one."""
    for name, variable in group.variables.items():
        for attribute in ("scale_factor", "add_offset"):
            value = getattr(variable, attribute, 1.0)
            if np.asarray(value).dtype.kind not in "fiu" or np.size(value) != 1:
                return f"{attribute} of {name} is {value!r:.40}, not one number"
    return next(filter(None, map(_without_scale, group.groups.values())), "")


def _declared(group: Any) -> float:
    """Bytes of the values that a file or group says it has: a number is read as eight."""
    own = sum(
        float(variable.size) * (1 if getattr(variable.dtype, "kind", "") == "S" else 8)
        for variable in group.variables.values()
    )
    return own + sum(_declared(inner) for inner in group.groups.values())


def as_array(values: object) -> Array:
    """Any numbers as a float64 array; masked ones are NaN.

    Raises:
      InputError: texts.
    """
    try:
        filled = np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan)
    except ValueError as error:
        words = " ".join(str(error).split())
        raise InputError(f"texts where numbers belong: {words[:80]}") from error
    return measurable(np.asarray(filled, np.float64).ravel())


def holds_arrays(path: Path) -> bool:
    """Whether a file is netCDF or HDF5 by its first bytes; MATLAB puts 512 bytes before them."""
    with path.open("rb") as file:
        start = file.read(600)
    return start.startswith((b"CDF", b"\x89HDF")) or start[512:516] == b"\x89HDF"


def variable_names(path: Path) -> list[str]:
    """Names of the variables and groups of a netCDF or HDF5 file; errors as `open_netcdf`."""
    with open_netcdf(path) as file:
        return [*file.variables, *file.groups]


def attributes_of(variable: Any) -> dict[str, Any]:
    """Attributes by name."""
    return {name: variable.getncattr(name) for name in variable.ncattrs()}


def unit_in(attributes: Mapping[str, Any]) -> str:
    """The unit that a variable declares; empty where it declares none."""
    return str(attributes.get("units", "")).strip()


def values_in(variable: Any, units: Mapping[str, str], tally: Tally) -> Array | None:
    """Numbers of a variable, by what it declares in the unit that `units` gives its name.

    None where they are of another quantity, which is told.
    """
    values, name = as_array(variable[...]), str(variable.name)
    if name not in units:
        return values
    return declared(values, unit_in(attributes_of(variable)), units[name], name, tally)


def text_of(variable: Any) -> str:
    """A text, whether stored as one or letter by letter; empty for None."""
    if variable is None:
        return ""
    value = variable[...]
    if getattr(value, "dtype", None) is not None and value.dtype.kind == "S":
        return b"".join(np.ma.filled(value, b"").ravel()).decode("utf-8", "replace").strip("\0 ")
    return str(value)


SINCE = " since "
"""In the units of every CF time"""
_SECONDS_IN = {"nanosecond": 1e-9, "microsecond": 1e-6, "millisecond": 1e-3, "second": 1.0,
               "minute": 60.0, "hour": 3600.0, "day": 86400.0}  # fmt: skip


def seconds_of(time: Array, attributes: Mapping[str, Any], subject: str, tally: Tally) -> Array:
    """Unix seconds by the variable's units, or by size where it has none.

    Raises:
      InputError: units that are no times.
    """
    units = str(attributes.get("units", ""))
    if SINCE not in units:
        return unix_seconds(time, subject, tally)
    match = re.fullmatch(r"(\w+) since (.+)", units.strip())
    if match is not None:
        factor = _SECONDS_IN.get(match[1].lower().removesuffix("s"), np.nan)
        zero = parse_stamps(np.array([_whole_stamp(match[2])]))[0]
        if np.isfinite(factor * zero):
            return zero + factor * time
    raise InputError(f"{subject}: its time has unknown units {units!r}")


def _whole_stamp(word: str) -> str:
    """A written moment with microseconds at most: datetime reads no more digits."""
    word = re.sub(r"(\.\d{6})\d+", r"\1", word.strip().removesuffix(" UTC").removesuffix(" GMT"))
    # 2010-7-29 13:31:4
    date, _, clock = word.replace("T", " ").partition(" ")
    date = "-".join(part.zfill(2) for part in date.split("-"))
    return f"{date} {clock}".strip()


Index = NDArray[np.int64]

COUNTS = ("row_size", "rowsize")
"""Names, in small letters, of counts that say nothing of their dimension"""


class Geometry:
    """Samples of a file, and where along each dimension each of them lies.

    The layouts are those of CF's chapter 9: a variable along the samples; one value for a profile
    or a trajectory whose samples lie one after the other, counted by a variable with
    `sample_dimension` (ERDDAP's `rowSize`); an index of the profile at each sample, with
    `instance_dimension`; arrays of profiles by samples, padded.
    """

    def __init__(self, file: Any, measured: Sequence[str], subject: str) -> None:
        """Find the samples.

        Args:
          file: open netCDF file.
          measured: names of variables that are measured at the samples; the largest decides.
          subject: file, for errors.

        Raises:
          InputError: counts or indices that do not fit the samples.
        """
        self._variables: Mapping[str, Any] = file.variables
        self._subject = subject
        there = [v for n in measured if (v := file.variables.get(n)) is not None and is_number(v)]
        variable = max(there, key=lambda one: int(one.size), default=None)
        self._along: dict[str, Index] = {}
        self._own: set[str] = set()  # dimensions of the samples themselves
        self.count = 0
        """Samples, those that pad an array among them"""
        if variable is None or not variable.dimensions:
            return
        self._own = {d for d in variable.dimensions if file.dimensions[d].size > 1}
        self.count = int(variable.size)
        for name, at in zip(variable.dimensions, np.indices(variable.shape), strict=True):
            self._along[name] = at.ravel()
        for name, one in file.dimensions.items():
            if one.size == 1:
                self._along.setdefault(name, np.zeros(self.count, np.int64))
        while self._add_instances():
            pass

    def _add_instances(self) -> bool:
        """Add a dimension whose elements are profiles or trajectories; whether one was found."""
        for name, variable in self._variables.items():
            if len(variable.dimensions) != 1 or variable.dtype == str or variable.dtype.kind != "i":
                continue
            own = variable.dimensions[0]
            counted = getattr(variable, "sample_dimension", None)
            if counted is None and name.lower() in COUNTS:
                rest = [d for d in self._along if d != own]
                counted = rest[0] if len(rest) == 1 else None
            named = getattr(variable, "instance_dimension", None)
            if counted in self._along and own not in self._along:
                self._along[own] = self._counted(name, self._along[str(counted)], str(counted))
                return True
            if own in self._along and named is not None and named not in self._along:
                index = as_array(variable[:])[self._along[own]]
                self._along[str(named)] = self._whole(index, name)
                return True
        return False

    def _counted(self, name: str, along: Index, counted: str) -> Index:
        """Element that counts each sample, (samples,)."""
        counts = self._whole(as_array(self._variables[name][:]), name)
        samples = along.max(initial=-1) + 1
        if counts.sum() != samples:
            raise InputError(
                f"{self._subject} is damaged: {name} counts {counts.sum()} samples, and "
                f"{counted} has {samples}"
            )
        return np.repeat(np.arange(len(counts)), counts)[along]

    def _whole(self, values: Array, name: str) -> Index:
        if not np.isfinite(values).all() or (values < 0).any():
            raise InputError(f"{self._subject} is damaged: {name} has elements without a number")
        return values.astype(np.int64)

    def reaches(self, name: str) -> bool:
        """Whether the variable has numbers at the samples."""
        variable = self._variables.get(name)
        if variable is None or not self.count or not is_number(variable):
            return False
        return set(variable.dimensions) <= set(self._along)

    def single(self, name: str) -> bool:
        """Whether the variable has one value for several samples."""
        return not self._own <= set(self._variables[name].dimensions)

    def column(self, name: str) -> Array:
        """Numbers of a variable, (samples,); of one that `reaches` them."""
        variable = self._variables[name]
        values = as_array(variable[...])
        index = tuple(self._along[d] for d in variable.dimensions)
        try:
            found = values.reshape(variable.shape)[index] if index else values
        except IndexError as error:
            raise InputError(
                f"{self._subject} is damaged: {name} has fewer elements than its index names"
            ) from error
        return np.array(np.broadcast_to(found, (self.count,)), np.float64)

    def texts(self, name: str) -> NDArray[np.object_] | None:
        """Texts of a variable, (samples,), a number as it is written; None: it has none there."""
        variable = self._variables.get(name)
        if variable is None or not self.count:
            return None
        values, dimensions = variable[...], variable.dimensions
        if getattr(values, "dtype", None) is not None and values.dtype.kind == "S" and dimensions:
            letters = np.ascontiguousarray(np.ma.filled(values, b""))
            values = letters.view(f"S{max(letters.shape[-1], 1)}")[..., 0]
        if np.ndim(values) < len(dimensions):  # the last dimension is of letters
            dimensions = dimensions[:-1]
        if not set(dimensions) <= set(self._along):
            return None
        words = np.array([_text(one) for one in np.ma.filled(values).ravel()], object)
        shape = np.shape(values)
        found = words.reshape(shape)[tuple(self._along[d] for d in dimensions)] if shape else words
        return np.broadcast_to(found, (self.count,))

    def clocks(self, usual: str, tally: Tally) -> dict[str, Array]:
        """Times [s] unix of all variables of time that reach the samples, the usual one first."""
        found = {}
        for name in (usual, *(n for n in self._variables if n != usual)):
            if not self.reaches(name):
                continue
            said = attributes_of(self._variables[name])
            if name == usual:
                found[name] = seconds_of(self.column(name), said, self._subject, tally)
            elif SINCE in str(said.get("units", "")):
                with contextlib.suppress(InputError):  # no clock: it has units that are none
                    found[name] = seconds_of(self.column(name), said, self._subject, Tally())
        return found


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").strip("\0 ")
    return f"{value:g}" if isinstance(value, (int, float, np.number)) else str(value).strip("\0 ")


def is_number(variable: Any) -> bool:
    """Whether a variable holds numbers."""
    return variable.dtype != str and getattr(variable.dtype, "kind", "") in "fiu"
