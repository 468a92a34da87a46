"""PD0: decode the binary ensembles of RDI's Doppler logs and current profilers to arrays.

An ensemble is a header with the places of its blocks, the blocks, and a checksum (Teledyne RDI,
"Workhorse commands and output data format"). Numbers are little endian.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

MARK = b"\x7f\x7f"
"""First bytes of every ensemble."""
FIXED, VARIABLE, VELOCITY, CORRELATION, ECHO, GOOD, BOTTOM = (
    0x0000, 0x0080, 0x0100, 0x0200, 0x0300, 0x0400, 0x0600,
)  # fmt: skip
NAMES = {
    FIXED: "fixed leader", VARIABLE: "variable leader", VELOCITY: "velocity",
    CORRELATION: "correlation", ECHO: "echo intensity", GOOD: "percent good",
    BOTTOM: "bottom track",
}  # fmt: skip
"""Names of the blocks that are read, by identifier."""
BY_CELL = {CORRELATION: "correlation", ECHO: "echo", GOOD: "good"}
"""Blocks with a byte for each cell and beam."""
LEAST = {FIXED: 36, VARIABLE: 28, BOTTOM: 44}
"""[byte] Shortest blocks; newer firmware appends fields."""
BEAMS, BAD = 4, -32768
"""BEAMS: number of beams. BAD: [mm/s] velocity that was not measured."""
FIELDS: dict[str, tuple[int, int, str, float]] = {
    "system": (FIXED, 4, "<u2", 1.0),
    "cell": (FIXED, 12, "<u2", 0.01),
    "transform": (FIXED, 25, "u1", 1.0),
    "alignment": (FIXED, 26, "<i2", 0.01),
    "first_cell": (FIXED, 32, "<u2", 0.01),
    "sound_speed": (VARIABLE, 14, "<u2", 1.0),
    "depth": (VARIABLE, 16, "<u2", 0.1),
    "heading": (VARIABLE, 18, "<u2", 0.01),
    "pitch": (VARIABLE, 20, "<i2", 0.01),
    "roll": (VARIABLE, 22, "<i2", 0.01),
}
"""Leaders' numbers by name: block, place [byte], type, and the unit in metre, m/s or degree."""

Ensembles = Mapping[str, Array]
"""Ensembles of one layout, in the order of the file: `FIELDS`, and

time: [s] unix time by the instrument's clock; NaN for an impossible date.
beam_angle: [degree] of the beams from the axis.
velocity: [m/s] of the water past the instrument, (ensembles, cells, 4); NaN if not measured.
correlation, echo, good: [count], [count] and [%], (ensembles, cells, 4). `good` of beam axes is by
beam; of others: pings with three beams, with too large an error, with fewer beams, with four.
bottom_velocity, bottom_range: [m/s] as `velocity`, and [m] vertical by beam, (ensembles, 4)."""


@dataclasses.dataclass(frozen=True)
class Pd0File:
    """Ensembles of a file, by layout, and what is none."""

    layouts: tuple[Ensembles, ...]
    damaged: int
    """Ensembles with a wrong checksum, or with impossible places of blocks."""
    cut: bool
    """True if the last ensemble is not whole."""
    blocks: frozenset[int]
    """Identifiers of all blocks in the file."""


Blocks = tuple[tuple[int, int, int], ...]
"""Identifier, place and length [byte] of each block of an ensemble."""


def read_pd0(path: Path) -> Pd0File:
    """Read a file; damaged ensembles are counted and left out.

    Raises:
      InputError: the file holds no whole ensemble.
    """
    data = np.fromfile(path, np.uint8)
    groups: dict[tuple[int, Blocks], list[int]] = {}
    damaged, cut = 0, False
    for place, size, sound in _ensembles(data):
        cut = size == 0
        blocks = _blocks(data[place : place + size].tobytes()) if sound else None
        if blocks is not None:
            groups.setdefault((size, blocks), []).append(place)
        elif not cut:
            damaged += 1
    if not groups:
        what = f"{damaged} damaged ones" if damaged else "no others"
        raise InputError(
            f"{path.name} has no whole ensemble of PD0, and {what}: it begins with "
            f"{data[:2].tobytes().hex()}, an ensemble with 7f7f. Other formats of RDI (PD3 to PD6, "
            "text) lack what is needed: let the instrument or the maker's software write PD0"
        )
    layouts = []
    for (size, blocks), places in groups.items():
        rows = data[np.array(places)[:, None] + np.arange(size)]
        layouts.append(_decoded({kind: rows[:, a : a + n] for kind, a, n in blocks}))
    present = frozenset(kind for _, blocks in groups for kind, _, _ in blocks)
    return Pd0File(tuple(layouts), damaged, cut, present)


def _ensembles(data: Bytes) -> Iterator[tuple[int, int, bool]]:
    """Place and size [byte] of each ensemble, and whether its checksum is right; the size is 0 for
    one that the file's end cuts off.

    Without a right checksum, a first block right behind it tells a header from other bytes.
    """
    content = data.tobytes()
    place = content.find(MARK)
    while place >= 0:
        size, first = (int.from_bytes(content[place + k : place + k + 2], "little") for k in (2, 6))
        end, step = place + size, 1
        header = 6 + 2 * content[place + 5] if place + 8 <= len(content) else len(content)
        if 6 < header <= first < size:
            whole = end + 2 <= len(content)
            total = int.from_bytes(content[end : end + 2], "little")
            sound = whole and int(data[place:end].sum()) % 65536 == total
            if sound or first == header:
                yield place, size if whole else 0, sound
            step = size + 2 if sound else 1
        place = content.find(MARK, place + step)


def _blocks(content: bytes) -> Blocks | None:
    """Blocks of an ensemble; None if places or lengths are impossible, or a leader is missing."""
    places = [int.from_bytes(content[k : k + 2], "little") for k in range(6, 6 + 2 * content[5], 2)]
    found = {
        int.from_bytes(content[place : place + 2], "little"): (place, end - place)
        for place, end in zip(places, [*places[1:], len(content)], strict=True)
    }
    lengths = [length for _, length in found.values()]
    if min(lengths) < 2 or VARIABLE not in found or found.get(FIXED, (0, 0))[1] < LEAST[FIXED]:
        return None
    beams, cells = content[found[FIXED][0] + 8 : found[FIXED][0] + 10]
    least = {**LEAST, VELOCITY: 2 + 2 * BEAMS * cells, **dict.fromkeys(BY_CELL, 2 + BEAMS * cells)}
    if beams != BEAMS or any(found[k][1] < n for k, n in least.items() if k in found):
        return None
    return tuple((kind, *place) for kind, place in found.items())


def _decoded(blocks: Mapping[int, Bytes]) -> Ensembles:
    """Decode the ensembles of one layout from the bytes of each block, (ensembles, bytes)."""
    fixed, leader = blocks[FIXED], blocks[VARIABLE]
    count, cells = len(fixed), int(fixed[0, 9])
    found = {
        name: _numbers(blocks[block], place, kind)[:, 0] * unit
        for name, (block, place, kind, unit) in FIELDS.items()
    }
    angle = np.array([15.0, 20.0, 30.0, np.nan])[fixed[:, 5] & 3]
    if fixed.shape[1] > 58:  # a shorter leader has the bits alone
        angle = np.where(fixed[:, 58] > 0, fixed[:, 58], angle)
    shape = (count, cells, BEAMS)
    for kind, name in BY_CELL.items():
        found[name] = np.full(shape, np.nan)
        if kind in blocks:
            found[name] = _numbers(blocks[kind], 2, "u1", BEAMS * cells).reshape(shape)
    found["velocity"] = np.full(shape, np.nan)
    if VELOCITY in blocks:
        found["velocity"] = _metres(_numbers(blocks[VELOCITY], 2, "<i2", BEAMS * cells), shape)
    found["bottom_velocity"] = found["bottom_range"] = np.full((count, BEAMS), np.nan)
    if (bottom := blocks.get(BOTTOM)) is not None:
        found["bottom_velocity"] = _metres(_numbers(bottom, 24, "<i2", BEAMS), (count, BEAMS))
        ranges = _numbers(bottom, 16, "<u2", BEAMS)
        if bottom.shape[1] >= 81:
            ranges = ranges + 65536.0 * bottom[:, 77:81]
        found["bottom_range"] = np.where(ranges > 0.0, ranges / 100.0, np.nan)
    return {**found, "time": _times(leader), "beam_angle": angle}


def _numbers(block: Bytes, place: int, kind: str, count: int = 1) -> Array:
    """Numbers of a type from a place in each row of a block, (rows, count)."""
    size = np.dtype(kind).itemsize * count
    return np.ascontiguousarray(block[:, place : place + size]).view(kind).astype(np.float64)


def _metres(values: Array, shape: tuple[int, ...]) -> Array:
    """Velocities [m/s] of numbers [mm/s]."""
    return np.where(values == BAD, np.nan, values / 1000.0).reshape(shape)


def _times(leader: Bytes) -> Array:
    """Unix times [s] of variable leaders; NaN for an impossible date."""
    year, month, day, hour, minute, second, hundredth = leader[:, 4:11].astype(np.int64).T
    months = np.where(year < 80, year + 30, year - 70) * 12 + month - 1  # since 1970
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64) + day - 1
    time = days * 86400.0 + hour * 3600.0 + minute * 60.0 + second + hundredth / 100.0
    possible = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31) & (hour < 24)
    return np.where(possible & (minute < 60) & (second < 60), time, np.nan)
