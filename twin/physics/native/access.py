"""Access: native reads and writes of MuJoCo's structs and of our parameter block.

A model is ours when its numeric data end in our header. All sizes are checked before native code
reads or writes through the header: they must equal the model's sizes, and every table must lie
inside the block. A mismatch raises MuJoCo's error (`FatalError`, in a batch `SimulationError`);
native code never reads or writes outside the block.

Addresses in native code are plain 64-bit integers.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from twin.compiled import inline, jit
from twin.physics.native import block as b
from twin.physics.native import struct_offsets as at


def _address_intrinsic(result: Any, element: ir.Type, load: bool) -> Any:
    """Make an intrinsic that loads the value at an address, or turns the address into a pointer."""

    @intrinsic
    def found(typingctx, address):
        def codegen(context, builder, signature, args):
            pointer = builder.inttoptr(args[0], element.as_pointer())
            return builder.load(pointer) if load else pointer

        return result(types.int64), codegen

    return found


load_f8 = _address_intrinsic(types.float64, ir.DoubleType(), True)
"""Load the float64 at an address."""
load_i8 = _address_intrinsic(types.int64, ir.IntType(64), True)
"""Load the int64 (or pointer) at an address."""
load_i4 = _address_intrinsic(types.int32, ir.IntType(32), True)
"""Load the int32 at an address."""
as_f8_pointer = _address_intrinsic(types.CPointer(types.float64), ir.DoubleType(), False)
"""Turn an address into a pointer from which `numba.carray` makes a float64 array."""
as_void_pointer = _address_intrinsic(types.voidptr, ir.IntType(8), False)
"""Turn an address into a pointer from which `numba.carray` makes an array of a given type."""
layout_table = types.ExternalFunction("glider_twin_layout", types.int64())
"""Address of the table of struct offsets from `struct_offsets.publish`."""
mismatch_text = types.ExternalFunction("glider_twin_mismatch", types.int64())
"""Address of the text MISMATCH."""
mju_error = types.ExternalFunction("mju_error", types.void(types.int64))
MISMATCH = ctypes.create_string_buffer(
    b"glider-twin: this model was changed after it was compiled, so that its sizes or tables are "
    b"not those of its parameter block; compile the vehicle again "
    b"(twin.physics.mujoco_model.compile_model)"
)
HEADER, STATE, PART = b.HEADER, b.STATE, b.PART
HEADER_WORDS, STATE_WORDS, PART_WORDS = b.HEADER_WORDS, b.STATE_WORDS, b.PART_WORDS
HEADER_BYTES = HEADER.itemsize
MAGIC, VERSION = b.MAGIC, b.VERSION


@inline
def field(table, struct, slot):
    """Pointer-sized word of `struct` at `slot` of the layout table."""
    return load_i8(struct + load_i8(table + 8 * slot))


@inline
def array(address, size):
    """Array of the `size` float64 values at `address`, without a copy."""
    return numba.carray(as_f8_pointer(address), size)


@inline
def header_at(address):
    """Header of a block at `address`."""
    return numba.carray(as_void_pointer(address), 1, HEADER)[0]


@inline
def state_of(table, data):
    """STATE at the start of `mjData.userdata`."""
    return numba.carray(as_void_pointer(field(table, data, at.D_USERDATA)), 1, STATE)[0]


@inline
def _inside(part, words):
    """Tell whether a table lies inside the block; false for numbers that cannot be sizes."""
    return part["start"] >= 0.0 and part["size"] >= 0.0 and part["start"] + part["size"] <= words


@jit
def header_address(table, model):
    """Address of the header of a model of ours; 0 for other models.

    Raises MuJoCo's error if the block does not fit the model that carries it.
    """
    count = field(table, model, at.M_NUMERIC_COUNT)
    if count < HEADER_WORDS:
        return 0
    address = field(table, model, at.M_NUMERIC_DATA) + 8 * count - HEADER_BYTES
    head = header_at(address)
    if head.magic != MAGIC or head.version != VERSION:
        return 0
    words = head.words
    body = words - HEADER_WORDS
    fits = (
        HEADER_WORDS <= words <= count
        and head.nq == field(table, model, at.M_NQ)
        and head.nv == field(table, model, at.M_NV)
        and head.nu == field(table, model, at.M_NU)
        and head.na == field(table, model, at.M_NA)
        and head.nbody == field(table, model, at.M_NBODY)
        and head.nuserdata == field(table, model, at.M_NUSERDATA)
        and 1.0 <= head.hull_body < head.nbody
        and head.nq >= 7.0
        and head.nv >= 6.0
        and head.nu == head.na
        and _inside(head.law_values, body)
        and _inside(head.parts, body)
        and head.parts["size"] == PART_WORDS * head.nu
        and _inside(head.current, body)
        and _inside(head.density, body)
        and _inside(head.temperature, body)
        and _inside(head.floor, body)
        and (head.floor["size"] == 0.0 or 0.0 <= head.floor_body < field(table, model, at.M_NMOCAP))
        and _inside(head.plan, body)
        and 0.0 <= head.plan_rows <= head.plan["size"]
        and head.log_ring >= 0.0
        and STATE_WORDS + head.log_ring * (17.0 + head.nq + head.nv + 2.0 * head.nu)
        <= head.nuserdata
    )
    if not fits:
        mju_error(mismatch_text())
        return 0
    return address


@jit
def part_address(table, model, index):
    """Address of part `index`, for the callback that runs once for each part; 0 without a part.

    Checks only the header's table of parts; the other callbacks check the whole block.
    """
    count = field(table, model, at.M_NUMERIC_COUNT)
    if count < HEADER_WORDS:
        return 0
    address = field(table, model, at.M_NUMERIC_DATA) + 8 * count - HEADER_BYTES
    head = header_at(address)
    if head.magic != MAGIC or head.version != VERSION:
        return 0
    parts = head.parts
    width = field(table, model, at.M_NU)
    if not (
        0 <= index < width
        and width == field(table, model, at.M_NA)
        and parts["start"] >= 0.0
        and parts["size"] == PART_WORDS * width
        and parts["start"] + parts["size"] <= head.words - HEADER_WORDS
        and head.words <= count
    ):
        mju_error(mismatch_text())
        return 0
    return address + HEADER_BYTES - 8 * (int(head.words) - int(parts["start"]) - PART_WORDS * index)


@inline
def block_start(address, head):
    """Address of the first number of the block."""
    return address + HEADER_BYTES - 8 * int(head.words)


@inline
def table_of(start, head, part):
    """Array of a table of the block; the array stays inside the block even while another thread
    moves the table."""
    body = int(head.words) - HEADER_WORDS
    first = min(max(int(part["start"]), 0), body)
    return array(start + 8 * first, min(max(int(part["size"]), 0), body - first))


@inline
def part_at(start, head, index):
    """Part with this index; the caller checks that the index exists."""
    return part_here(start + 8 * (int(head.parts["start"]) + PART_WORDS * index))


@inline
def part_here(address):
    """Part at `address`."""
    return numba.carray(as_void_pointer(address), 1, PART)[0]
