"""Floor: the sea floor under the vehicle, as MuJoCo's collisions and guidance have it.

MuJoCo collides the hull with a plane on a mocap body. Native code lays that plane, at every
evaluation, through the floor half a hull north, south, east and west of the CB: at the scale of a
hull any bathymetry is a plane. Collisions are found before the water acts in a step, so they use
the plane of the step before, which a glider has left by some centimetres.
"""

from __future__ import annotations

import math

from twin.compiled import inline, jit
from twin.physics.native import struct_offsets as at
from twin.physics.native.access import array, field, table_of
from twin.physics.native.memory import load_i4, load_i8
from twin.water.floor.lookup import floor_depth


@inline
def follow_floor(head, start, table, data, position, state):
    """Altitude of the CB, and the plane under the hull; inf where there is no floor."""
    state.altitude = math.inf
    if head.floor["size"] > 0.0:
        lay_plane(head, table_of(start, head, head.floor), table, data, position, state)


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


@inline
def note_contact(table, data, state):
    """Remember that the vehicle touches something now, until the next log row."""
    if load_i4(data + load_i8(table + 8 * at.D_NCON)) > 0:
        state.contact = 1.0
