"""Bounded: files of others read with limits in size and depth, so that none can exhaust a machine.

A text that people write has a largest size. A file of arrays may be of any size, but may not
declare many times the values that it can hold: compressed files of zeros and sparse files are small
and ask for more memory than there is. A pipe or a device has no size and need not end, so that only
what the system calls a regular file is opened.
"""

from __future__ import annotations

import contextlib
import errno
import gzip
import io
import itertools
import json
import math
import os
import re
import stat
import tomllib
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.errors import InputError, OddFile

if TYPE_CHECKING:
    import xarray as xr

MOST_TEXT, MOST_SETTINGS = 64 * 2**20, 256 * 2**10
"""[byte] of a text file with a table, a million rows of sixty characters; and of a file of settings
that a person writes (TOML, YAML), a hundred times a usual one"""
MOST_LINE = 2000
"""Characters of a line of settings: a key of thousands of parts takes its square in time"""
LONGEST_NAME, MOST_STEM = 255, 100
"""Characters of a file's name, and of one that comes from a text of somebody else"""
MOST_WAYS = 10**8
"""Ways in which the repeats of a pattern may share a name: a second or two"""
MOST_RATIO, FREE_BYTES = 300, 256 * 2**20
"""Bytes that an array file may declare per byte that it has, and that any file may, however small.
Real stores and logs have 2 to 30, and no row of measurements comes near."""
MOST_UNPACKED, UNPACKED_BYTES = 50, 2**25
"""Bytes that a log of somebody else may unpack to per byte that it has, and that any log may,
however small: read, they take up to twenty times as much memory. Tables, recordings and compressed
arrays of vehicles have 2 to 10, many columns of missing values forty."""

_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
}


def check_regular(path: str | Path) -> int:
    """The size [byte] of a file, or of the one that a link leads to; nothing is opened.

    Raises:
      OddFile: it is no regular file, so that reading it may never end. OSError: it is not there.
    """
    path = Path(path)
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        link = "a link to " if path.is_symlink() else ""
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "of a kind that is not known")
        raise OddFile(errno.EINVAL, f"it is {link}{kind}, not a file", str(path))
    return found.st_size


def regular_files(folder: Path) -> Iterator[tuple[str, int]]:
    """Path below a folder, with slashes, and size [byte] of every file in it and in its folders, in
    no order. A link to a file counts as the file, one to a folder is none.

    Raises:
      OddFile: one is no regular file; OSError: a folder cannot be read.
    """
    below = [""]
    while below:
        prefix = below.pop()
        with os.scandir(folder / prefix) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    below.append(f"{prefix}{entry.name}/")
                    continue
                with contextlib.suppress(FileNotFoundError):  # it went, or was a link to nothing
                    found = entry.stat()
                    if not stat.S_ISREG(found.st_mode):
                        check_regular(entry.path)
                    yield f"{prefix}{entry.name}", found.st_size


def read_text(
    path: str | Path, what: str, error: type[InputError] = InputError, *, most: int = MOST_TEXT
) -> str:
    """The text of a file of at most `most` bytes, UTF-8 with or without a mark at its beginning.

    Args:
      what: what errors call it, such as "density file".

    Raises:
      InputError: (or `error`) it cannot be read, is no regular file, is larger, or is not UTF-8.
    """
    try:
        check_regular(path)
        with Path(path).open("rb") as file:
            data = file.read(most + 1)
        if len(data) > most:
            raise error(
                f"{what} {path} is larger than {_size(most)}, which none needs: is it the right "
                "file?"
            )
        # the line ends that text mode would give
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as cause:
        raise error(f"cannot read {what} {path}: it is not UTF-8 text ({cause.reason})") from cause
    except (OSError, ValueError) as cause:  # ValueError: a path with a null character
        if isinstance(cause, InputError):
            raise
        reason = getattr(cause, "strerror", None) or str(cause)
        raise error(f"cannot read {what} {path}: {reason}") from cause


def read_toml(
    path: str | Path, what: str, error: type[InputError] = InputError, *, hint: str = ""
) -> dict[str, Any]:
    """The tables of a TOML file; errors as `read_text`.

    Args:
      hint: ends the message of a text without a single = or [, which is another kind of file.
    """
    text = read_text(path, what, error, most=MOST_SETTINGS)
    for k, line in enumerate(text.split("\n"), 1):
        if len(line) > MOST_LINE:
            raise error(f"{what} {path}: line {k} has more than {MOST_LINE} characters; break it")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise error(f"{what} {path} has tables or lists in each other without end") from None
    except ValueError as cause:  # also of a number with thousands of digits
        hint = hint if not any(mark in text for mark in "=[") else ""
        raise error(f"{what} {path} is not TOML: {cause}{hint}") from cause


def parse_json(text: str | bytes, what: str, error: type[InputError] = InputError) -> Any:
    """Content of a JSON text.

    Raises:
      InputError: (or `error`) it is not JSON, or nested without end.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise error(f"{what} has lists or objects in each other without end") from None
    except (ValueError, TypeError) as cause:
        raise error(f"{what} is not JSON: {cause}") from cause


def compile_pattern(
    pattern: str, what: str, error: type[InputError] = InputError
) -> re.Pattern[str]:
    """A regular expression that comes to an end in any name of a file.

    Python's engine tries every way in which repeats can share a text, which takes longer than
    there is time when repeats are inside each other or many. So no group is repeated, and few
    single characters are.

    Raises:
      InputError: (or `error`) it is no regular expression, or one that could take that long.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", FutureWarning)  # of sets that will change their meaning
            compiled = re.compile(pattern)
    except (re.error, FutureWarning, RecursionError, OverflowError) as cause:
        raise error(f"{what} is not a regular expression: {cause}") from None
    plain = re.sub(r"\\.|\[\^?\]?(?:\\.|[^\]\\])*\]", "x", pattern, flags=re.DOTALL)
    plain = re.sub(r"\(\?(?:P?<?[=!]?\w*>?|[=!:])", "(", plain)
    ways = LONGEST_NAME
    for group, low, high in re.findall(r"([)]?)(?:\{(\d*),(\d*)\}|[*+])[?+]?", plain):
        ways *= min(int(high or LONGEST_NAME) - int(low or 0) + 1, LONGEST_NAME)
        ways *= MOST_WAYS if group else 1
    ways *= 2 ** min(len(re.findall(r"(?<![*+}])\?", plain)), 99)
    if ways > MOST_WAYS or re.search(r"\)\{", plain):
        raise error(
            f"{what} could take without end: repeat no group, and few characters by *, + or ?"
        )
    return compiled


def file_names(texts: Iterable[str], instead: str, marks: str = "-_.") -> dict[str, str]:
    """Names for files, of texts that stand in somebody else's file, such as deployments.

    A text of a file never becomes a path itself. Its name has letters and digits of ASCII and the
    marks alone, begins and ends with no mark, and is no other text's name in small letters.

    Args:
      instead: the name of a text that has no letter and no digit.
      marks: characters that a name may have too; the first stands for whatever else a text has.
    """
    kept = f"A-Za-z0-9{re.escape(marks)}"
    found: dict[str, str] = {}
    taken: set[str] = set()
    for text in dict.fromkeys(texts):
        name = plain = re.sub(f"[^{kept}]+", marks[0], text)[:MOST_STEM].strip(marks) or instead
        numbers = itertools.count(2)
        while name.lower() in taken:
            name = f"{plain}{marks[0]}{next(numbers)}"
        taken.add(name.lower())
        found[text] = name
    return found


def check_declared(
    declared: float,
    stored: int,
    what: str,
    error: type[InputError] = InputError,
    *,
    free: float = FREE_BYTES,
) -> None:
    """Raise when a file of `stored` bytes declares values of `declared` bytes, far too many.

    Args:
      free: [byte] that it may declare anyway.
    """
    if declared > free and declared > MOST_RATIO * stored:
        raise error(
            f"{what} declares {_size(declared)} of values in {_size(stored)}: it is damaged, or "
            "made to fill the memory"
        )


def check_unpacked(unpacked: float, stored: int, what: str) -> None:
    """Raise when a log of `stored` bytes unpacks to `unpacked` bytes, far too many.

    Every reader asks it of whatever unpacks to more than the file has: gzip, LZ4, zstd, parquet,
    and the compressed arrays of netCDF, HDF5 and MATLAB.

    Raises:
      InputError: it is damaged, or made to fill the memory.
    """
    if unpacked > UNPACKED_BYTES and unpacked > MOST_UNPACKED * stored:
        raise InputError(
            f"{what} unpacks to {_size(unpacked)} of values or more from {_size(stored)}: it is "
            "damaged, or made to fill the memory"
        )


def unpacked_file(path: Path) -> io.BufferedReader:
    """Content of a gzip file, which is closed with the reader.

    Reading raises InputError as `check_unpacked`, and EOFError, OSError or zlib.error where the
    file is cut off or damaged.
    """
    return io.BufferedReader(_Counted(gzip.open(path, "rb"), path.stat().st_size, str(path)))


class _Counted(io.RawIOBase):
    """A stream that unpacks and ends with an error where it gives far too much."""

    def __init__(self, file: gzip.GzipFile, stored: int, what: str) -> None:
        self._file, self._stored, self.name, self._given = file, stored, what, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = self._file.read1(len(buffer))  # of a file that was cut off, what is there
        buffer[: len(data)] = data
        self._given += len(data)
        check_unpacked(self._given, self._stored, self.name)
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()


def check_dataset(
    dataset: xr.Dataset,
    path: str | Path | Callable[[], int],
    what: str,
    error: type[InputError] = InputError,
) -> None:
    """`check_declared` of a dataset that was opened lazily.

    Args:
      path: of its file or local folder, or what tells the size [byte] of all its files.
    """
    declared = 0.0
    for variable in dataset.variables.values():  # a chunk is read whole, however little is wanted
        sizes = [variable.encoding.get(name) for name in ("chunks", "chunksizes", "shards")]
        chunk = max((math.prod(one) for one in sizes if one), default=0)
        declared += max(variable.nbytes, variable.dtype.itemsize * chunk)
    if declared <= FREE_BYTES:
        return
    if callable(path):
        check_declared(declared, path(), what, error)
    elif Path(path).exists():
        check_declared(declared, stored_size(Path(path)), what, error)


def check_archive(content: Path | bytes, what: str, error: type[InputError] = InputError) -> None:
    """`check_declared` of a zip archive (.npz, checkpoints); raises too when it is none, or no
    regular file."""
    try:
        size = len(content) if isinstance(content, bytes) else check_regular(content)
        place = content if isinstance(content, Path) else io.BytesIO(content)
        with zipfile.ZipFile(place) as archive:
            declared = sum(entry.file_size for entry in archive.infolist())
    except (OSError, ValueError, zipfile.BadZipFile, zlib.error) as cause:
        raise error(f"{what} cannot be read: {cause}") from cause
    check_declared(declared, size, what, error)


def stored_size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder and those below; errors as `regular_files`."""
    if not path.is_dir():
        return check_regular(path)
    return sum(size for _, size in regular_files(path))


def _size(number: float) -> str:
    """[byte] in a unit that people read."""
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if number < 1000.0 or unit == "TB":
            break
        number /= 1000.0
    return f"{number:.3g} {unit}"
