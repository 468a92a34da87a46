"""Cache files: lists of sensors that a Slocum's binary files refer to by number.

Here are also readers of a binary file's header: the vehicle, the cache file, the number of sensors.
Compressed files (.dcd, .ecd ..., .ccc) are unpacked to their plain names.
"""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from twin.bounded import check_unpacked
from twin.errors import InputError

_HEADER_BYTES = 4000
"""Bytes that hold the ASCII header of 14 lines."""
_LABEL = "dbd_label"
_LIST, _STATES, _TAGS = "sensor_list_crc", "state_bytes_per_cycle", "num_ascii_tags"
_NEEDED = ("full_filename", _LIST, "total_num_sensors", "sensors_per_cycle")
_CRC = re.compile(r"[0-9A-Fa-f]{8}")
"""Number of a list of sensors, which names its cache file."""
_COUNT = r"[0-9]{1,6}"
_SENSORS_A_BYTE = 4
"""Number of sensors whose state one byte of a cycle holds."""
_SHOWN = 40
"""Maximum number of characters of a wrong value that an error repeats."""


def read_header(path: Path, name: str = "") -> dict[str, str]:
    """Read the ASCII header of a plain file.

    Args:
      name: file's name in errors, such as that of the compressed file; empty: that of `path`.

    Raises:
      InputError: the file is no Slocum file, or is cut within its header.
    """
    name = name or path.name
    with path.open("rb") as file:
        start = file.read(_HEADER_BYTES)
    header: dict[str, str] = {}
    *lines, _ = start.split(b"\n")
    whole = False
    for count, line in enumerate(lines, 1):
        key, colon, value = (part.strip() for part in line.decode("latin-1").partition(":"))
        if colon and header.setdefault(key, value) != value:
            raise _damaged(name, f"{key} is {header[key][:_SHOWN]!r} and {value[:_SHOWN]!r}")
        whole = _LABEL in header and count == _number(header, _TAGS, name, len(lines) + 1)
        if whole or _LABEL not in header:
            break
    if _LABEL not in header:
        raise InputError(f"{name} is not a Slocum binary file: its header lacks {_LABEL}")
    lacking = [f"no {key}" for key in _NEEDED if key not in header]
    lacking += [] if whole else ["it has fewer lines than it says"]
    if lacking:
        raise InputError(f"{name} is truncated within its header: {lacking[0]}")
    _check_header(header, name)
    return header


def _check_header(header: Mapping[str, str], name: str) -> None:
    """Refuse a header that no vehicle writes.

    The number of the cache file becomes a file's name in the decoder's folder, and the counts
    become the decoder's memory, so that neither may be anything else.

    Raises:
      InputError: the header is damaged.
    """
    if not _CRC.fullmatch(header[_LIST]):
        raise _damaged(name, f"{_LIST} is {header[_LIST][:_SHOWN]!r}, not eight hexadecimal digits")
    total = _number(header, "total_num_sensors", name)
    used = _number(header, "sensors_per_cycle", name)
    if used > total:
        raise _damaged(name, f"sensors_per_cycle is {used}, and total_num_sensors {total}")
    states = -(-used // _SENSORS_A_BYTE)
    if _number(header, _STATES, name, states) != states:
        raise _damaged(name, f"{_STATES} is {header[_STATES]!r}, not {states} for {used} sensors")


def _number(header: Mapping[str, str], key: str, name: str, default: int = 0) -> int:
    """Count in the header; raises InputError if it is no number."""
    word = header.get(key, str(default))
    if not re.fullmatch(_COUNT, word):
        raise _damaged(name, f"{key} is {word[:_SHOWN]!r}, not a count")
    return int(word)


def _damaged(name: str, why: str) -> InputError:
    return InputError(f"{name} is damaged in its header: {why}")


def vehicle_of(header: Mapping[str, str], path: Path) -> str:
    """Name of the vehicle: the part of `full_filename` before the year."""
    full = header.get("full_filename", path.stem)
    return full.rsplit("-", 4)[0] or path.stem


def lists_itself(header: Mapping[str, str]) -> bool:
    """True if the file lists its sensors itself, after its header."""
    return header.get("sensor_list_factored") == "0"


def sensor_list(path: Path, header: Mapping[str, str]) -> bytes:
    """Lines of a cache file, from a plain file that lists its sensors itself.

    Raises:
      InputError: the file is cut within these lines.
    """
    total = _number(header, "total_num_sensors", path.name)
    lines = []
    with path.open("rb") as file:
        for line in file:
            if line.startswith(b"s:") and line.endswith(b"\n"):
                lines.append(line)
            elif lines:
                break
            if len(lines) == total:
                return b"".join(lines)
    raise InputError(
        f"{path.name} is truncated within its list of sensors: {len(lines)} of {total}"
    )


_BLOCK = 32 * 1024
"""[bytes] Largest size of an unpacked block."""


def is_compressed(path: Path) -> bool:
    """True if the file's ending is that of a compressed file: .dcd, .ccc."""
    ending = path.suffix.lower()
    return len(ending) == 4 and ending[2] == "c" and ending[3] in "dc" and ending != ".cac"


def unpacked(path: Path, folder: Path) -> tuple[Path, bool]:
    """Unpack a file into `folder`; return the plain file, and True if the compressed one was cut.

    Blocks before a block that is cut or damaged are unpacked.

    Raises:
      ModuleNotFoundError: lz4, which comes with the extra `slocum`, is not installed.
      InputError: not even the first block can be unpacked.
    """
    lz4: Any = import_module("lz4.block")
    ending = f".{path.suffix[1].lower()}bd" if path.suffix[-1] in "dD" else ".cac"
    target = folder / f"{path.stem}{ending}"
    packed = path.read_bytes()
    at = 0
    with target.open("wb") as plain:
        while at < len(packed):
            size = int.from_bytes(packed[at : at + 2], "big")
            try:
                plain.write(lz4.decompress(packed[at + 2 : at + 2 + size], _BLOCK))
            except lz4.LZ4BlockError as error:
                if at:
                    return target, True
                raise InputError(
                    f"{path.name} is not a compressed Slocum file, or is cut in its first "
                    f"block: {' '.join(str(error).split())}"
                ) from error
            check_unpacked(plain.tell(), len(packed), path.name)
            at += 2 + size
    return target, False


BINARY = frozenset(f".{a}{b}d" for a in "dmsent" for b in "bc")
"""Endings of logs: flight d, m, s; science e, n, t; plain b, compressed c."""
CACHES = frozenset({".cac", ".ccc"})
"""Endings of the lists of sensors that the logs refer to, plain and compressed."""


class CacheShelf:
    """Cache files at hand, and the folder from which the decoder takes them."""

    def __init__(self, folder: Path, given: Path | None, named: Sequence[Path]):
        """Make a shelf.

        Args:
          folder: empty folder: the decoder writes into it.
          given: the user's folder of cache files, searched before the folders of the logs.
          named: cache files that the user named.

        Raises:
          InputError: no such folder.
        """
        if given is not None and not given.is_dir():
            raise InputError(f"no folder {given} for cache files")
        self.folder = folder
        self._given = given
        self._named = named
        self._places: dict[Path, dict[str, Path]] = {}
        self._listing: dict[Path, dict[str, Path]] = {}
        self._reasons: dict[str, str] = {}
        self._checked: set[tuple[str, tuple[int, ...]]] = set()

    def prepare(self, path: Path, plain: Path, header: Mapping[str, str]) -> None:
        """Put the cache file that `path` names into the folder.

        If no cache file has that number, a log that lists its sensors itself gives the list.

        Args:
          path: the log, as the user named it.
          plain: the log, unpacked.
          header: header of the log.

        Raises:
          InputError: the cache file is missing, or belongs to another file.
        """
        name = header[_LIST].lower()
        total = tuple(_number(header, key, path.name) for key in _NEEDED[2:])
        if (name, total) in self._checked and not lists_itself(header):
            return
        if lists_itself(header):
            source, listing = path, sensor_list(plain, header)
        else:
            source = self._source(path, name)
            with tempfile.TemporaryDirectory() as folder:
                whole = _plain(source, Path(folder))
                if source.suffix.lower() in CACHES:
                    listing = whole.read_bytes()
                else:
                    listing = sensor_list(whole, read_header(whole, source.name))
        (self.folder / f"{name}.cac").write_bytes(listing)
        lines = listing.decode("latin-1").split("\n")
        listed = [line.split() for line in lines if line.startswith("s:")]
        used = sum(1 for words in listed if len(words) > 1 and words[1] == "T")
        if (len(listed), used) != total:
            whose = f"cache file {source.name}" if source.suffix.lower() in CACHES else source.name
            raise InputError(
                f"{whose} is not the one of {path.name}: it lists {used} of "
                f"{len(listed)} sensors, the header has {total[1]} of {total[0]}"
            )
        self._checked.add((name, total))

    def _source(self, path: Path, name: str) -> Path:
        """Find the cache file of that number, or a log that lists the same sensors itself.

        Raises:
          InputError: neither is there.
        """
        beside = [path.parent, *(cache.parent for cache in self._named)]
        folders = beside if self._given is None else [self._given, *beside]
        found: dict[str, Path] = {}
        for folder in folders:
            if folder not in self._places:
                self._places[folder] = _caches_in(folder)
            found = {**self._places[folder], **found}
        if name in found:
            return found[name]
        for folder in dict.fromkeys([path.parent, *folders]):
            if folder not in self._listing:
                self._listing[folder] = _self_listing(folder)
            if name in self._listing[folder]:
                return self._listing[folder][name]
        if name not in self._reasons:
            self._reasons[name] = _missing(name, found, folders)
        raise InputError(f"{path.name}: {self._reasons[name]}")


def _caches_in(folder: Path) -> dict[str, Path]:
    """Cache files by their number, plain ones before compressed ones."""
    every = [one for one in folder.iterdir() if one.suffix.lower() in CACHES]
    every.sort(key=lambda one: one.suffix.lower(), reverse=True)
    return {one.stem.lower(): one for one in every}


def _missing(name: str, found: Mapping[str, Path], folders: Sequence[Path]) -> str:
    """Sentence that names the missing cache file, and a folder nearby that has it."""
    others = ", ".join(sorted(one.name for one in found.values())[:4]) or "no cache file"
    places = ", ".join(dict.fromkeys(map(str, folders)))
    near = _folder_with(name, folders)
    advice = "give its folder with --cache" if near is None else f"give --cache {near}"
    return (
        f"cache file {name}.cac is missing, and no log beside it lists its sensors itself; "
        f"there is {others} in {places}; {advice}"
    )


def _plain(path: Path, folder: Path) -> Path:
    """Return the file itself, or its contents unpacked into `folder` if it is compressed."""
    return unpacked(path, folder)[0] if is_compressed(path) else path


def _self_listing(folder: Path) -> dict[str, Path]:
    """First log of each number in a folder, among logs that list their sensors themselves."""
    from factory.importing.deployment_log import OF_THE_MACHINE  # deferred: help needs no numpy

    found: dict[str, Path] = {}
    for path in sorted(one for one in folder.iterdir() if one.suffix.lower() in BINARY):
        try:
            with tempfile.TemporaryDirectory() as temporary:
                plain = _plain(path, Path(temporary))
                header = read_header(plain, path.name)
                if lists_itself(header):
                    sensor_list(plain, header)
                    found.setdefault(header[_LIST].lower(), path)
        except OF_THE_MACHINE:
            raise
        except Exception:
            continue  # gives no list; its own reading reports why
    return found


def _folder_with(name: str, folders: Sequence[Path]) -> Path | None:
    """Folder in or beside one of these that holds a cache file of this number."""
    for folder in dict.fromkeys(folders):
        for around in (folder, Path(os.path.normpath(folder / ".."))):
            # skip folders without permission
            with contextlib.suppress(OSError):
                for one in sorted(one for one in around.iterdir() if one.is_dir()):
                    if name in _caches_in(one):
                        return one
    return None
