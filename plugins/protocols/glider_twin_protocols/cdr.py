"""CDR: many messages of one ROS 2 type at once, as rows of bytes.

ROS 2 writes messages as Common Data Representation (OMG DDS-XTypes 1.3, 7.4, XCDR version 1): the
fields one after the other, each number at a multiple of its own size after four bytes of header.
Messages whose texts and lists have the same lengths have the same layout, so that a topic of a
mission is a table of bytes, which numpy fills a hundred times faster than message by message.

Axes: from the store's frames to those of ROS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.frames import euler_to_quaternion

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


Bytes = NDArray[np.uint8]

HEADER = bytes([0, 1, 0, 0])
"""Plain CDR, little endian"""
PRIMITIVES = {
    name: np.dtype(np.uint8 if name in ("bool", "byte", "char") else name).newbyteorder("<")
    for name in (
        *("bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32"),
        *("int64", "uint64", "float32", "float64"),
    )
}
LENGTH = np.dtype("<u4")
"""Type of the numbers before texts and lists"""


def encode(types: Typestore, name: str, values: Mapping[str, Any], count: int) -> Bytes:
    """Messages of a type, (count, bytes).

    Args:
      types: of a distribution of ROS 2.
      name: such as sensor_msgs/msg/Imu.
      values: by field. An array has one row a message; a number, text, tuple or list is the same in
        all. A message inside is a mapping, a list of messages a list of mappings. What is not
        given is zero or empty.
      count: of messages.

    Raises:
      KeyError: a field that the type has not.
    """
    columns = _Columns(types, count)
    columns.message(name, values)
    return columns.rows()


class _Columns:
    """Fields that were laid out, with their places."""

    def __init__(self, types: Typestore, count: int) -> None:
        self._types, self._count = types, count
        self._parts: list[tuple[int, Bytes]] = []
        self._end = 0

    def message(self, name: str, values: Mapping[str, Any]) -> None:
        fields = self._types.fielddefs[name][1]
        unknown = set(values) - {field for field, _ in fields}
        if unknown:
            raise KeyError(f"{name} has no field {min(unknown)!r}")
        for field, described in fields:
            self._field(described, values.get(field))

    def _field(self, described: Any, value: Any) -> None:
        kind, what = described[0].name, described[1]
        if kind == "BASE" and what[0] == "string":
            text = (value or "").encode() + b"\0"
            self._numbers(LENGTH, len(text))
            self._numbers(np.dtype(np.uint8), tuple(text))
        elif kind == "BASE":
            self._numbers(PRIMITIVES[what[0]], 0 if value is None else value)
        elif kind == "NAME":
            self.message(what, value or {})
        elif kind == "ARRAY" and what[0][0].name == "BASE":
            (_, (base, _)), length = what
            self._numbers(PRIMITIVES[base], (0,) * length if value is None else value)
        else:  # a list of messages or numbers, as long in every message
            items = value or []
            self._numbers(LENGTH, len(items))
            for item in items:
                self._field(what[0], item)

    def _numbers(self, kind: np.dtype[Any], value: Any) -> None:
        """Numbers at the next multiple of their size."""
        numbers = np.asarray(value).astype(kind)
        varies = isinstance(value, np.ndarray)
        shape = (len(numbers), math.prod(numbers.shape[1:])) if varies else (1, numbers.size)
        part = np.ascontiguousarray(numbers.reshape(shape))
        start = -(-self._end // kind.itemsize) * kind.itemsize
        self._parts.append((start, part.view(np.uint8)))
        self._end = start + part.shape[1] * kind.itemsize

    def rows(self) -> Bytes:
        table = np.zeros((self._count, len(HEADER) + self._end), np.uint8)
        table[:, : len(HEADER)] = tuple(HEADER)
        for start, part in self._parts:
            table[:, len(HEADER) + start : len(HEADER) + start + part.shape[1]] = part
        return table


Array = NDArray[np.float64]


def world(north: Array, east: Array, down: Array) -> Array:
    """East, north, up, (samples, 3), of a vector in the world, any unit."""
    return np.stack([east, north, -down], axis=1)


def body(forward: Array, starboard: Array, down: Array) -> Array:
    """Forward, left, up, (samples, 3), of a vector or of rates about the axes, any unit."""
    return np.stack([forward, -starboard, -down], axis=1)


def orientation(roll: Array, pitch: Array, heading: Array) -> Array:
    """Quaternion (x, y, z, w), (samples, 4), from forward, left, up to east, north, up.

    Args:
      roll, pitch: [degree] starboard down and nose up.
      heading: [degree] from true north, clockwise.
    """
    angles = (np.radians(roll), -np.radians(pitch), np.radians(90.0 - heading))
    w, x, y, z = euler_to_quaternion(*angles).T
    return np.stack([x, y, z, w], axis=1)


def to_body(quaternion: Array, vector: Array) -> Array:
    """A vector of the world in the axes of the vehicle, (samples, 3).

    Args:
      quaternion: as `orientation` gives it.
      vector: east, north, up.
    """
    axis, w = -quaternion[:, :3], quaternion[:, 3:]
    across = 2.0 * np.cross(axis, vector)
    return vector + w * across + np.cross(axis, across)
