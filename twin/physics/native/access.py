"""Access: MuJoCo's structs and our parameter block, as native code sees them."""

from __future__ import annotations

import numba
from numba import types

from twin.compiled import inline, jit  # noqa: F401  (jit: for the other modules of this folder)
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at
from twin.physics.native.memory import as_f8_pointer, load_f8, load_i8

layout_table = types.ExternalFunction("glider_twin_layout", types.int64())
"""Address of the table of struct offsets that `layout.publish` made."""


@inline
def field(table, struct, slot):
    """The pointer-sized word of `struct` at `slot` of the layout table."""
    return load_i8(struct + load_i8(table + 8 * slot))


@inline
def block_address(table, model):
    """Address of the model's parameter block, 0 when it is not one of ours."""
    count = field(table, model, at.M_NUMERIC_COUNT)
    if count < b.PARAMETERS:
        return 0
    address = field(table, model, at.M_NUMERIC_DATA) + 8 * (count - b.PARAMETERS)
    if load_f8(address) != b.MAGIC or load_f8(address + 8) != b.VERSION:
        return 0
    return address


@inline
def array(address, size):
    """The `size` float64 values at `address`, as an array without a copy."""
    return numba.carray(as_f8_pointer(address), size)
