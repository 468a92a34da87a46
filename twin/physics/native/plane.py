"""Plane: the sea floor under the hull, for MuJoCo's contacts and the altitude.

Most flights have no floor, so it is compiled when one is first met.
"""

from __future__ import annotations

import math

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from twin.compiled import inline, jit
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import (
    array,
    block_start,
    field,
    header_address,
    header_at,
    layout_table,
    state_of,
    table_of,
)
from twin.physics.native.late import Late, late_address
from twin.water.floor.lookup import floor_depth

SLOT = 1


def laid(model, data):
    """`lay_plane` as a C function, for a model of ours."""
    table = layout_table()
    address = header_address(table, model)
    head = header_at(address)
    floor = table_of(block_start(address, head), head, head.floor)
    position = array(field(table, data, at.D_XPOS) + 24 * int(head.hull_body), 3)
    lay_plane(head, floor, table, data, position, state_of(table, data))


LAYER = Late(SLOT, "the sea floor", types.void(types.int64, types.int64), laid)


@intrinsic
def _laid_by(typingctx, address, model, data):
    """Call the function at an address with a model and its data."""

    def codegen(context, builder, signature, args):
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word, word])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@inline
def follow_floor(head, model, data, state):
    """Altitude of the CB, and the plane under the hull; inf where there is no floor.

    Returns whether that could be done: NaN and False where its code cannot be compiled.
    """
    state.altitude = math.inf
    if head.floor["size"] > 0.0:
        address = late_address(SLOT)
        if address == 0:
            state.altitude = math.nan
            return False
        _laid_by(address, model, data)
    return True


@jit
def lay_plane(head, floor, table, data, position, state):
    """Write the plane's place and attitude, and the altitude."""
    north, east, arm = position[0], -position[1], 0.5 * head.length
    state.altitude = floor_depth(floor, north, east) + position[2]
    ahead, behind = floor_depth(floor, north + arm, east), floor_depth(floor, north - arm, east)
    right, left = floor_depth(floor, north, east + arm), floor_depth(floor, north, east - arm)
    # the floor's rise per metre along x (north) and y (west)
    along, across = (behind - ahead) / (2.0 * arm), (right - left) / (2.0 * arm)
    body = int(head.floor_body)
    place = array(field(table, data, at.D_MOCAP_POS) + 24 * body, 3)
    turn = array(field(table, data, at.D_MOCAP_QUAT) + 32 * body, 4)
    place[0], place[1] = position[0], position[1]
    place[2] = -0.25 * (ahead + behind + right + left)
    # the quaternion that turns z into the normal (-along, -across, 1)
    scale = 1.0 / math.sqrt(1.0 + along * along + across * across)
    w = 1.0 + scale
    norm = 1.0 / math.sqrt(w * w + (along * along + across * across) * scale * scale)
    turn[0], turn[1], turn[2], turn[3] = (
        w * norm,
        across * scale * norm,
        -along * scale * norm,
        0.0,
    )
