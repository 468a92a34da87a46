"""netCDF-4 and HDF5 files (MATLAB v7.3 too): opened with clear errors, read sample by sample."""

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
"""First bytes of each HDF5 file, netCDF-4's too."""


class _Trial:
    """Second process that opens every HDF5 file first.

    On a damaged file the library may hang, which nothing within a process can stop, or crash the
    process.
    """

    LONGEST = 60.0
    """[s] Longest time to open a file; a sound file takes some milliseconds."""
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
        """Tell whether the process returns from the file, with an error or without."""
        self._leave_to_parent()
        stat = path.stat()
        key = str(path.resolve()), stat.st_size, stat.st_mtime_ns
        with self._lock:
            if key not in self._passed and self._comes_back(key[0]):
                self._passed.add(key)
            return key in self._passed

    def _comes_back(self, path: str) -> bool:
        if self._process is not None and self._process.poll() is not None:
            self.end()  # ended from outside
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", self.PROGRAM],  # -P: import nothing from the folder
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
            process.kill()  # ends the waiting thread
            waiting.join()
            self.end()
            return False
        return True

    def _leave_to_parent(self) -> None:
        """Leave the process to the parent after a fork: only the parent can wait for it."""
        if self._owner != os.getpid():
            self._owner, self._lock = os.getpid(), threading.Lock()
            self._others, self._process = self._process, None

    def end(self) -> None:
        """End the process; the next file starts another."""
        self._leave_to_parent()
        if self._process is not None:
            self._process.communicate()
            self._process = None


_trial = _Trial()
atexit.register(_trial.end)


@contextlib.contextmanager
def open_netcdf(path: Path) -> Iterator[Any]:
    """Open a netCDF or HDF5 file for reading; close it at the end.

    Raises:
      InputError: the file is neither, truncated, or its library fails while the file is read.
    """
    import netCDF4

    with path.open("rb") as raw:
        start = raw.read(8)
    if start.startswith(HDF5) and not _trial.passes(path):
        raise InputError(f"{path.name} is damaged: its library does not come back from it")
    # the library warns of valid ranges of another type, and names neither file nor variable
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
        # valid ranges of another type than their variable are ignored, as netCDF's rules ask
        warnings.filterwarnings("ignore", "WARNING: ", UserWarning)
        warnings.filterwarnings("error", "invalid scale_factor", UserWarning)
        check_unpacked(_declared(file), path.stat().st_size, path.name)
        try:
            yield file
        except (RuntimeError, OSError, TypeError, UserWarning) as error:
            why = _without_scale(file) or " ".join(str(error).split())
            raise InputError(f"{path.name} is damaged: {why}") from error


def _without_scale(group: Any) -> str:
    """Text on the first variable whose scale or offset is no number; empty if all are numbers."""
    for name, variable in group.variables.items():
        for attribute in ("scale_factor", "add_offset"):
            value = getattr(variable, attribute, 1.0)
            if np.asarray(value).dtype.kind not in "fiu" or np.size(value) != 1:
                return f"{attribute} of {name} is {value!r:.40}, not one number"
    return next(filter(None, map(_without_scale, group.groups.values())), "")


def _declared(group: Any) -> float:
    """[byte] Size of the values that a file or group declares; a number is read as eight bytes."""
    own = sum(
        float(variable.size) * (1 if getattr(variable.dtype, "kind", "") == "S" else 8)
        for variable in group.variables.values()
    )
    return own + sum(_declared(inner) for inner in group.groups.values())


def as_array(values: object) -> Array:
    """Convert numbers to a float64 array; masked numbers are NaN.

    Raises:
      InputError: the values are texts.
    """
    try:
        filled = np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan)
    except ValueError as error:
        words = " ".join(str(error).split())
        raise InputError(f"texts where numbers belong: {words[:80]}") from error
    return measurable(np.asarray(filled, np.float64).ravel())


def holds_arrays(path: Path) -> bool:
    """True if a file's first bytes are netCDF or HDF5; MATLAB puts 512 bytes before them."""
    with path.open("rb") as file:
        start = file.read(600)
    return start.startswith((b"CDF", b"\x89HDF")) or start[512:516] == b"\x89HDF"


def variable_names(path: Path) -> list[str]:
    """Names of the variables and groups of a netCDF or HDF5 file; errors as in `open_netcdf`."""
    with open_netcdf(path) as file:
        return [*file.variables, *file.groups]


def attributes_of(variable: Any) -> dict[str, Any]:
    """Attributes of a variable, by name."""
    return {name: variable.getncattr(name) for name in variable.ncattrs()}


def unit_in(attributes: Mapping[str, Any]) -> str:
    """Unit that a variable declares; empty if it declares none."""
    return str(attributes.get("units", "")).strip()


def values_in(variable: Any, units: Mapping[str, str], tally: Tally) -> Array | None:
    """Numbers of a variable, converted as declared to the unit that `units` gives its name.

    None if they are of another quantity, which is reported.
    """
    values, name = as_array(variable[...]), str(variable.name)
    if name not in units:
        return values
    return declared(values, unit_in(attributes_of(variable)), units[name], name, tally)


def text_of(variable: Any) -> str:
    """Text of a variable, stored as a string or letter by letter; empty for None."""
    if variable is None:
        return ""
    value = variable[...]
    if getattr(value, "dtype", None) is not None and value.dtype.kind == "S":
        return b"".join(np.ma.filled(value, b"").ravel()).decode("utf-8", "replace").strip("\0 ")
    return str(value)


SINCE = " since "
"""Part of the units of every CF time."""
_SECONDS_IN = {"nanosecond": 1e-9, "microsecond": 1e-6, "millisecond": 1e-3, "second": 1.0,
               "minute": 60.0, "hour": 3600.0, "day": 86400.0}  # fmt: skip


def seconds_of(time: Array, attributes: Mapping[str, Any], subject: str, tally: Tally) -> Array:
    """Convert times to unix seconds by the variable's units, or by size if it has none.

    Raises:
      InputError: the units are no units of time.
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
    """Written moment with at most microseconds: datetime reads no more digits."""
    word = re.sub(r"(\.\d{6})\d+", r"\1", word.strip().removesuffix(" UTC").removesuffix(" GMT"))
    # two digits each, as for 2010-7-29
    date, _, clock = word.replace("T", " ").partition(" ")
    date = "-".join(part.zfill(2) for part in date.split("-"))
    return f"{date} {clock}".strip()


Index = NDArray[np.int64]

COUNTS = ("row_size", "rowsize")
"""Names, in small letters, of counts that do not name the dimension they count."""


class Geometry:
    """Samples of a file, and the index of each along every dimension.

    The layouts are those of CF's chapter 9. A variable lies along the samples. One value holds for
    a profile or a trajectory, whose samples are counted by a variable with `sample_dimension`
    (ERDDAP's `rowSize`). An index with `instance_dimension` gives the profile of each sample.
    Arrays of profiles by samples are padded.
    """

    def __init__(self, file: Any, measured: Sequence[str], subject: str) -> None:
        """Find the samples.

        Args:
          file: open netCDF file.
          measured: names of measured variables; the samples are those of the largest.
          subject: file, for errors.

        Raises:
          InputError: counts or indices do not fit the samples.
        """
        self._variables: Mapping[str, Any] = file.variables
        self._subject = subject
        there = [v for n in measured if (v := file.variables.get(n)) is not None and is_number(v)]
        variable = max(there, key=lambda one: int(one.size), default=None)
        self._along: dict[str, Index] = {}
        self._own: set[str] = set()  # dimensions of the samples themselves
        self.count = 0
        """Number of samples, including those that pad an array."""
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
        """Add a dimension whose elements are profiles or trajectories; True if one was found."""
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
        """Index of the element that counts each sample, (samples,)."""
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
        """True if the variable has numbers at the samples."""
        variable = self._variables.get(name)
        if variable is None or not self.count or not is_number(variable):
            return False
        return set(variable.dimensions) <= set(self._along)

    def single(self, name: str) -> bool:
        """True if the variable has one value for several samples."""
        return not self._own <= set(self._variables[name].dimensions)

    def column(self, name: str) -> Array:
        """Numbers of a variable at the samples, (samples,), if it `reaches` them."""
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
        """Texts of a variable at the samples, (samples,), numbers as written; None without any."""
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
        """Times [s] unix of all time variables that reach the samples, the usual one first."""
        found = {}
        for name in (usual, *(n for n in self._variables if n != usual)):
            if not self.reaches(name):
                continue
            said = attributes_of(self._variables[name])
            if name == usual:
                found[name] = seconds_of(self.column(name), said, self._subject, tally)
            elif SINCE in str(said.get("units", "")):
                with contextlib.suppress(InputError):  # units of no time: no clock
                    found[name] = seconds_of(self.column(name), said, self._subject, Tally())
        return found


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").strip("\0 ")
    return f"{value:g}" if isinstance(value, (int, float, np.number)) else str(value).strip("\0 ")


def is_number(variable: Any) -> bool:
    """True if a variable holds numbers."""
    return variable.dtype != str and getattr(variable.dtype, "kind", "") in "fiu"
