"""Header of a Slocum's binary file: the vehicle, the cache file, the number of sensors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from twin.errors import InputError

_HEADER_BYTES = 4000
"""The ASCII header of 14 lines fits."""
_LABEL = "dbd_label"
_NEEDED = ("full_filename", "sensor_list_crc", "total_num_sensors", "sensors_per_cycle")


def read_header(path: Path) -> dict[str, str]:
    """The ASCII header of a plain file.

    Raises:
      InputError: not a Slocum file, or cut within its header.
    """
    with path.open("rb") as file:
        start = file.read(_HEADER_BYTES)
    header: dict[str, str] = {}
    for line in start.split(b"\n"):
        key, colon, value = line.decode("latin-1").partition(":")
        if not colon or not key.strip().isidentifier():
            if not header:
                break
            continue
        header[key.strip()] = value.strip()
        if len(header) == int(header.get("num_ascii_tags") or 10**6):
            break
    if _LABEL not in header:
        raise InputError(f"{path.name} is not a Slocum binary file: its header lacks {_LABEL}")
    lacking = [key for key in _NEEDED if key not in header]
    if lacking:
        raise InputError(f"{path.name} is truncated within its header: no {lacking[0]}")
    return header


def vehicle_of(header: Mapping[str, str], path: Path) -> str:
    """Name of the vehicle: what `full_filename` says before the year."""
    full = header.get("full_filename", path.stem)
    return full.rsplit("-", 4)[0] or path.stem
