"""Bounded reading of foreign files: limits of size and depth, so that no file exhausts a machine.

A text that people write has a largest size. A file of arrays may have any size, but may not declare
many times the values that it can hold: compressed files of zeros and sparse files are small and ask
for more memory than there is. Only regular files are opened: a pipe or a device has no size and may
never end.
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
"""[byte] MOST_TEXT: largest text file with a table, a million rows of sixty characters.
MOST_SETTINGS: largest file of settings (TOML, YAML), a hundred times the usual size"""
MOST_LINE = 2000
"""[character] Longest line of settings; time to parse a dotted key grows with its square"""
LONGEST_NAME, MOST_STEM = 255, 100
"""[character] LONGEST_NAME: longest name of a file. MOST_STEM: longest made from foreign text"""
MOST_WAYS = 10**8
"""Maximum number of ways in which a pattern may divide a name; to try all takes a second or two."""
MOST_RATIO, FREE_BYTES = 300, 256 * 2**20
"""MOST_RATIO: largest ratio of declared bytes to stored bytes of an array file; real stores and
logs have 2 to 30. FREE_BYTES: [byte] declared size that is never refused."""
MOST_UNPACKED, UNPACKED_BYTES = 50, 2**25
"""MOST_UNPACKED: largest ratio of unpacked bytes to stored bytes of a foreign log. UNPACKED_BYTES:
[byte] unpacked size that is never refused; reading takes up to twenty times it in memory. Logs of
vehicles have ratios of 2 to 10, many columns of missing values forty."""

_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
}


def check_regular(path: str | Path) -> int:
    """Size [byte] of a regular file, or of a link's target; nothing is opened.

    Raises:
      OddFile: the path is no regular file, so that reading may never end. OSError: it is missing.
    """
    path = Path(path)
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        link = "a link to " if path.is_symlink() else ""
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "of a kind that is not known")
        raise OddFile(errno.EINVAL, f"it is {link}{kind}, not a file", str(path))
    return found.st_size


def regular_files(folder: Path) -> Iterator[tuple[str, int]]:
    """Iterate over all files below a folder: relative path with slashes, and size [byte].

    The order is arbitrary. A link to a file counts as that file; a link to a folder raises.

    Raises:
      OddFile: an entry is no regular file. OSError: a folder cannot be read.
    """
    below = [""]
    while below:
        prefix = below.pop()
        with os.scandir(folder / prefix) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    below.append(f"{prefix}{entry.name}/")
                    continue
                with contextlib.suppress(FileNotFoundError):  # deleted meanwhile, or a broken link
                    found = entry.stat()
                    if not stat.S_ISREG(found.st_mode):
                        check_regular(entry.path)
                    yield f"{prefix}{entry.name}", found.st_size


def read_text(
    path: str | Path, what: str, error: type[InputError] = InputError, *, most: int = MOST_TEXT
) -> str:
    """Read a text file of at most `most` bytes, UTF-8 with or without a byte-order mark.

    Args:
      what: name of the file in errors, such as "density file".

    Raises:
      InputError: (or `error`) the file cannot be read, is no regular file, too large or not UTF-8.
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
        # convert line ends as Python's text mode does
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
    """Read the tables of a TOML file; errors as `read_text`.

    Args:
      hint: end of the message for a text without any = or [, which is another kind of file.
    """
    text = read_text(path, what, error, most=MOST_SETTINGS)
    for k, line in enumerate(text.split("\n"), 1):
        if len(line) > MOST_LINE:
            raise error(f"{what} {path}: line {k} has more than {MOST_LINE} characters; break it")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise error(f"{what} {path} has tables or lists in each other without end") from None
    except ValueError as cause:  # raised also for an integer of thousands of digits
        hint = hint if not any(mark in text for mark in "=[") else ""
        raise error(f"{what} {path} is not TOML: {cause}{hint}") from cause


def parse_json(text: str | bytes, what: str, error: type[InputError] = InputError) -> Any:
    """Parse a JSON text.

    Raises:
      InputError: (or `error`) the text is not JSON, or is nested too deeply.
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
    """Compile a regular expression that matches any file name in bounded time.

    Python's engine tries every way to divide a text among the repeats. Nested or many repeats
    take practically forever. So a pattern may repeat no group, and only few single characters.

    Raises:
      InputError: (or `error`) the pattern is no regular expression, or could take that long.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", FutureWarning)  # character sets that will change meaning
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
    """Make safe and distinct file names from foreign texts, such as deployments' names.

    A foreign text never becomes a path itself. A name has only ASCII letters, digits and `marks`,
    begins and ends without a mark, and differs from the other names without regard to case.

    Args:
      instead: name for a text that has no letter and no digit.
      marks: further allowed characters; the first replaces every character that is not allowed.
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
    """Raise `error` when a file of `stored` bytes declares far too many bytes of values.

    Args:
      free: [byte] declared size that is never refused.
    """
    if declared > free and declared > MOST_RATIO * stored:
        raise error(
            f"{what} declares {_size(declared)} of values in {_size(stored)}: it is damaged, or "
            "made to fill the memory"
        )


def check_unpacked(unpacked: float, stored: int, what: str) -> None:
    """Raise InputError when a log of `stored` bytes unpacks to far too many bytes.

    Every reader calls this for compressed content: gzip, LZ4, zstd, parquet, and the compressed
    arrays of netCDF, HDF5 and MATLAB.

    Raises:
      InputError: the log is damaged, or made to fill the memory.
    """
    if unpacked > UNPACKED_BYTES and unpacked > MOST_UNPACKED * stored:
        raise InputError(
            f"{what} unpacks to {_size(unpacked)} of values or more from {_size(stored)}: it is "
            "damaged, or made to fill the memory"
        )


def unpacked_file(path: Path) -> io.BufferedReader:
    """Open a gzip file for reading its content; closing the reader closes the file.

    Reading raises InputError as `check_unpacked`, and EOFError, OSError or zlib.error where the
    file is cut off or damaged.
    """
    return io.BufferedReader(_Counted(gzip.open(path, "rb"), path.stat().st_size, str(path)))


class _Counted(io.RawIOBase):
    """Unpacking stream that raises when it has given far too many bytes."""

    def __init__(self, file: gzip.GzipFile, stored: int, what: str) -> None:
        self._file, self._stored, self.name, self._given = file, stored, what, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = self._file.read1(len(buffer))  # read1 returns what a truncated file still has
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
    """Apply `check_declared` to a dataset that was opened lazily.

    Args:
      path: path of the file or local folder, or a function that returns their size [byte].
    """
    declared = 0.0
    for variable in dataset.variables.values():  # reading one value unpacks its whole chunk
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
    """Apply `check_declared` to a zip archive (.npz, checkpoints); raise too if it is unreadable or
    no regular file."""
    try:
        size = len(content) if isinstance(content, bytes) else check_regular(content)
        place = content if isinstance(content, Path) else io.BytesIO(content)
        with zipfile.ZipFile(place) as archive:
            declared = sum(entry.file_size for entry in archive.infolist())
    except (OSError, ValueError, zipfile.BadZipFile, zlib.error) as cause:
        raise error(f"{what} cannot be read: {cause}") from cause
    check_declared(declared, size, what, error)


def stored_size(path: Path) -> int:
    """Size [byte] of a file, or of all files below a folder; errors as `regular_files`."""
    if not path.is_dir():
        return check_regular(path)
    return sum(size for _, size in regular_files(path))


def _size(number: float) -> str:
    """Text of a number of bytes in a readable unit, such as `3.2 MB`."""
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if number < 1000.0 or unit == "TB":
            break
        number /= 1000.0
    return f"{number:.3g} {unit}"
