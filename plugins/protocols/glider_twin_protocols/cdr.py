"""CDR: encode many messages of one ROS 2 type at once, as rows of bytes.

ROS 2 writes messages in the Common Data Representation (OMG DDS-XTypes 1.3, 7.4, XCDR version 1).
After a header of four bytes come the fields, each number at a multiple of its own size. Messages
with equal lengths of texts and lists share one layout. A topic of a mission is then one table of
bytes, which numpy fills a hundred times faster than a loop over messages.

Also here: functions from the store's axes to those of ROS.
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
"""Header of plain CDR, little endian"""
PRIMITIVES = {
    name: np.dtype(np.uint8 if name in ("bool", "byte", "char") else name).newbyteorder("<")
    for name in (
        *("bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32"),
        *("int64", "uint64", "float32", "float64"),
    )
}
LENGTH = np.dtype("<u4")
"""Type of the length before a text or a list"""


def encode(types: Typestore, name: str, values: Mapping[str, Any], count: int) -> Bytes:
    """Encode messages of one type, (count, bytes).

    Args:
      types: typestore of a ROS 2 distribution.
      name: name of the type, such as sensor_msgs/msg/Imu.
      values: values by field. An array has one row per message; a number, text, tuple or list is
        the same in all messages. A nested message is a mapping, a list of messages is a list of
        mappings. Missing fields are zero or empty.
      count: number of messages.

    Raises:
      KeyError: the type lacks a given field.
    """
    columns = _Columns(types, count)
    columns.message(name, values)
    return columns.rows()


class _Columns:
    """Encoded fields with their byte offsets."""

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
        else:  # a list of messages or numbers, of equal length in all messages
            items = value or []
            self._numbers(LENGTH, len(items))
            for item in items:
                self._field(what[0], item)

    def _numbers(self, kind: np.dtype[Any], value: Any) -> None:
        """Add numbers at the next multiple of their size."""
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
    """Vector in ROS world axes, east, north, up, (samples, 3), in any unit."""
    return np.stack([east, north, -down], axis=1)


def body(forward: Array, starboard: Array, down: Array) -> Array:
    """Vector or rates in ROS body axes, forward, left, up, (samples, 3), in any unit."""
    return np.stack([forward, -starboard, -down], axis=1)


def orientation(roll: Array, pitch: Array, heading: Array) -> Array:
    """Quaternion (x, y, z, w), (samples, 4), from body (forward, left, up) to east, north, up.

    Args:
      roll, pitch: [degree] starboard down and nose up.
      heading: [degree] from true north, clockwise.
    """
    angles = (np.radians(roll), -np.radians(pitch), np.radians(90.0 - heading))
    w, x, y, z = euler_to_quaternion(*angles).T
    return np.stack([x, y, z, w], axis=1)


def to_body(quaternion: Array, vector: Array) -> Array:
    """Rotate a vector from the world to the body, (samples, 3).

    Args:
      quaternion: result of `orientation`.
      vector: components east, north, up.
    """
    axis, w = -quaternion[:, :3], quaternion[:, 3:]
    across = 2.0 * np.cross(axis, vector)
    return vector + w * across + np.cross(axis, across)
