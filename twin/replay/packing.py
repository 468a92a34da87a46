"""Packing: arrays of numbers as whole numbers of a declared step, in base64, for the page's script.

A packed array is `offset + step * whole`, so that what the page shows differs from the record by
half a step at most.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError

Array = NDArray[np.float64]

WHOLES: tuple[type[np.signedinteger[Any]], ...] = (np.int8, np.int16, np.int32)
"""The narrowest that holds a range is taken; the least number of each stands for NaN"""
Packed = dict[str, Any]
"""{"type", "offset", "step", "data"}, as JSON takes it"""


def pack(values: Array, step: float) -> Packed:
    """Numbers of any shape in row order, rounded to multiples of `step` in their own unit.

    Raises:
      InputError: the range holds too many steps for 32 bits.
    """
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    offset = step * round((low + high) / 2.0 / step)
    most = max(high - offset, offset - low) / step + 1.0
    kind = next((k for k in WHOLES if most <= np.iinfo(k).max), None)
    if kind is None:
        raise InputError(f"values from {low:g} to {high:g} cannot be packed in steps of {step:g}")
    whole = np.full(values.shape, np.iinfo(kind).min, kind)
    inside = np.isfinite(values)
    whole[inside] = np.rint((values[inside] - offset) / step).astype(kind)
    return {
        "type": np.dtype(kind).name,
        "offset": offset,
        "step": step,
        "data": base64.b64encode(whole.astype(whole.dtype.newbyteorder("<")).tobytes()).decode(),
    }


def unpack(packed: Packed) -> Array:
    """The numbers of `pack`, shape (n,); NaN where there was none."""
    kind = np.dtype(packed["type"])
    whole = np.frombuffer(base64.b64decode(packed["data"]), kind.newbyteorder("<"))
    values = packed["offset"] + packed["step"] * whole.astype(float)
    return np.where(whole == np.iinfo(packed["type"]).min, np.nan, values)


def width(packed: Packed) -> int:
    """Bytes of one number."""
    return int(np.dtype(packed["type"]).itemsize)
