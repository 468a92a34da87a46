"""Assembly: the parts and moving masses of a vehicle file, and the parts that guidance moves.

Moving mass: a body that a slide or a hinge moves inside the hull, such as a battery.

Allocation: sharing of one control among several parts of a type. Guidance moves one part for each
of pitch, heading and speed: the lead. Parts of the lead's type with the same effect follow it: fins
of an X tail, a third rudder, a second screw. The followers' weights give the wanted moment or
thrust with the least sum of squared travels, and no other moment (Fossen 2011, section 12.3:
weighted generalised inverse of the effectiveness matrix). The matrix holds each part's wrench per
position at 1 m/s ahead. A lead without such parts moves alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError, unknown_name
from twin.vehicle.mjcf import MjcfReader
from twin.vehicle.parts import PARTS, BatteryHinge, BatterySlide, Part, Pump, Thruster

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MovingMass:
    """A mass on the hull's axis that slides along it, turns about it, or both."""

    name: str
    """Name of the body in the vehicle file."""
    mass: float
    """[kg]"""
    inertia: Array
    """[kg m2] Inertia about the mass's own CG with the hinge at 0, shape (3, 3), body FRD."""
    neutral_x: float
    """[m] Distance of the mass's CG forward of the CB with the slide at 0."""
    eccentricity: float
    """[m] Distance of the mass's CG below the axis with the hinge at 0."""
    slide: str | None = None
    """Name of the part that slides the mass; None: no part."""
    hinge: str | None = None
    """Name of the part that turns the mass; None: no part."""

    def position(self, shift: float, rotation: float) -> Array:
        """CG [m], shape (3,), body FRD, at `shift` [m] and `rotation` [rad].

        Positive rotation moves the mass to port (Zhang et al. 2013).
        """
        lateral = -self.eccentricity * math.sin(rotation)
        vertical = self.eccentricity * math.cos(rotation)
        return np.array([self.neutral_x + shift, lateral, vertical])


STEERING = {
    "pitch": "what pitches it: a battery slide or an elevator",
    "heading": "what turns it: a battery hinge or a rudder",
    "buoyancy": "what makes it heavy or light: a pump",
    "speed": "what drives it: a propeller",
    "trim": "what pitches it without speed: a battery slide beside an elevator",
}


def read_parts(reader: MjcfReader) -> tuple[Part, ...]:
    """Read the parts, one for each actuator of the file and in the file's order.

    `<text name="NAME.kind">` gives a part's type. Without it, an actuator on a slide or hinge is
    a battery, and the actuator named 'pump' at a site is a pump.

    Raises:
      VehicleError: an actuator is no part, or lacks something that its type needs.
    """
    parts: list[Part] = []
    for actuator in reader.actuators():
        name = actuator.get("name", "")
        if not name.isidentifier():
            reader.fail(f"the name {name!r} of an actuator", "a plain word, such as 'rudder'")
        if name in (part.name for part in parts):
            reader.fail(f"the name {name!r} of two actuators", "different")
        word = reader.text(f"{name}.kind", "") or _usual_kind(reader, actuator, name)
        if word not in PARTS:
            raise VehicleError(
                f"vehicle file {reader.path}: <text name='{name}.kind'>: "
                f"{unknown_name('vehicle part', word, PARTS)}"
            )
        kind = PARTS[word]
        _check_actuator(reader, actuator, kind)
        parts.append(kind.read(reader, actuator, name))
    return tuple(parts)


def _usual_kind(reader: MjcfReader, actuator: Element, name: str) -> str:
    """Type of an actuator whose file gives none."""
    joint = actuator.get("joint")
    if joint is not None:
        element = reader.joint(joint)
        return BatteryHinge.kind if element.get("type", "hinge") == "hinge" else BatterySlide.kind
    if name != "pump":
        reader.fail(
            f"actuator {name!r}",
            f"of a kind: add <text name='{name}.kind' data='KIND'/> to <custom>, one of "
            f"{', '.join(PARTS)}",
        )
    return Pump.kind


def _check_actuator(reader: MjcfReader, actuator: Element, kind: type[Part]) -> None:
    name = actuator.get("name", "")
    label = f"actuator {name!r} ({kind.kind})"
    if actuator.get("dyntype") != "user" or actuator.get("actdim", "1") != "1":
        reader.fail(label, "one with one activation: dyntype='user' actdim='1'")
    if actuator.get("actlimited") != "true":
        reader.fail(label, "limited to its travel: actlimited='true' with an actrange")
    if kind.joint is None:
        if actuator.get("site") is None or float(actuator.get("gainprm", "1").split()[0]) != 0.0:
            reader.fail(label, "at a site and without a force of MuJoCo's: site='...' gainprm='0'")
        return
    joint = actuator.get("joint")
    found = reader.joint(joint) if joint is not None else None
    if found is None or found.get("type", "hinge") != kind.joint:
        reader.fail(label, f"on a {kind.joint} joint: joint='...' of that type")
    axis = reader.vector(found, "axis", 3, default="0 0 1")
    if not np.allclose(axis, [1.0, 0.0, 0.0], atol=1e-12):
        reader.fail(f"joint {joint!r} axis", "'1 0 0': masses move along and about the hull")
    if not np.allclose(reader.vector(found, "pos", 3, default="0 0 0"), 0.0, atol=1e-12):
        reader.fail(f"joint {joint!r} pos", "'0 0 0': on the hull's axis")


def read_masses(reader: MjcfReader, parts: tuple[Part, ...]) -> tuple[MovingMass, ...]:
    """Read the bodies that slides and hinges move.

    Raises:
      VehicleError: a mass is off the hull's axis, or a joint has no part or another type.
    """
    part_by_joint = {
        actuator.get("joint"): actuator.get("name")
        for actuator in reader.actuators()
        if actuator.get("joint") is not None
    }
    masses = []
    for body in reader.moving_bodies():
        name = body.get("name", "")
        drives: dict[str, str] = {}
        for joint in body.findall("joint"):
            part, kind = part_by_joint.get(joint.get("name")), joint.get("type", "hinge")
            if part is None:
                reader.fail(f"joint {joint.get('name')!r}", "driven by an actuator of its own")
            if kind in drives:
                reader.fail(
                    f"the joints of body {name!r}",
                    f"at most one slide and one hinge (type='slide', type='hinge'): "
                    f"{drives[kind]!r} and {part!r} both drive a {kind}",
                )
            drives[kind] = part
        own = reader.inertial(body, "pos")
        if not np.allclose(own[:2], 0, atol=1e-12):
            reader.fail(
                f"body {name!r} <inertial pos>", "on its own vertical axis: '0 0 -eccentricity'"
            )
        place = reader.vector(body, "pos", 3, default="0 0 0")
        if not np.allclose(place[1:], 0, atol=1e-12):
            reader.fail(
                f"body {name!r} pos", "on the hull's axis: 'X 0 0', about which its hinge turns"
            )
        masses.append(
            MovingMass(
                name=name,
                mass=float(reader.inertial(body, "mass")[0]),
                inertia=reader.inertia(body),
                neutral_x=float(place[0]),
                eccentricity=-float(own[2]),
                slide=drives.get("slide"),
                hinge=drives.get("hinge"),
            )
        )
    return tuple(masses)


def read_steering(reader: MjcfReader, parts: tuple[Part, ...]) -> dict[str, str]:
    """Name of the part that guidance moves for each control that the vehicle has.

    `<text name="steer.pitch" data="PART"/>` assigns a part, which then has no followers. Otherwise
    the first capable part without another control is taken, and others of its type follow it (see
    `followers`).

    Raises:
      VehicleError: the assigned part does not exist or cannot serve the control.
    """
    steering: dict[str, str] = {}
    for control, meaning in STEERING.items():
        able = [part.name for part in parts if control in part.controls()]
        if control == "trim":  # trim: a battery slide, where another part pitches the vehicle
            slides = [part.name for part in parts if isinstance(part, BatterySlide)]
            able = [] if steering.get("pitch") in (None, *slides) else slides
        free = [name for name in able if name not in steering.values()]
        chosen = reader.text(f"steer.{control}", free[0] if free else "")
        if not chosen:
            continue
        if chosen not in able:
            raise VehicleError(
                f"vehicle file {reader.path}: <text name='steer.{control}'>: "
                f"{unknown_name('part', chosen, able)}; it names {meaning}"
            )
        if chosen in steering.values():
            reader.fail(
                f"<text name='steer.{control}'>", f"a part of its own, not {chosen!r} again"
            )
        steering[control] = chosen
    return steering


def named_controls(reader: MjcfReader) -> tuple[str, ...]:
    """Controls whose part the file assigns; these parts have no followers."""
    return tuple(control for control in STEERING if f"steer.{control}" in reader.texts)


SHARED = {"pitch": (4, 3, 5), "heading": (5, 3, 4), "speed": (0, 4, 5)}
"""Row of the wrench (X to N) that each shared control needs, and the rows that must stay 0."""
MOST_FOLLOWERS = 24
"""Largest number of followers in a vehicle; guidance has a table of this length."""
MOST_THRUSTERS = 12
"""Largest number of thrusters that hold a pose; guidance has a table of this length."""
NEGLIGIBLE = 1e-6
"""Smallest weight of a follower; a part with a smaller one does not follow."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Follower:
    """Part that moves along with another part, its lead, which guidance moves."""

    lead: str
    part: str
    weight: float
    """[1] Displacement of the follower from its rest, divided by the lead's from its own rest."""


def followers(
    parts: Sequence[Part], steering: Mapping[str, str], alone: Sequence[str] = ()
) -> tuple[Follower, ...]:
    """Followers of each lead, found from the wrenches of the parts; () if there are none.

    Args:
      steering: name of the part that guidance moves for each control.
      alone: controls whose part the file assigns; these have no followers.

    Raises:
      VehicleError: there are more than MOST_FOLLOWERS.
    """
    found: list[Follower] = []
    by_name = {part.name: part for part in parts}
    for control in (c for c in SHARED if c in steering and c not in alone):
        lead = by_name[steering[control]]
        able = [p for p in parts if type(p) is type(lead) and control in p.controls()]
        mates = [part for part in able if part is not lead]
        weights = _weights(control, [lead, *mates])[1:] if mates else ()
        found += [
            Follower(lead=lead.name, part=part.name, weight=float(weight))
            for part, weight in zip(mates, weights, strict=True)
            if abs(weight) > NEGLIGIBLE
        ]
    if len(found) > MOST_FOLLOWERS:
        raise VehicleError(
            f"{len(found)} fins and screws that go along with others; at most {MOST_FOLLOWERS}: "
            "name the part that steers by <text name='steer.pitch' data='PART'/>"
        )
    return tuple(found)


def _weights(control: str, team: Sequence[Part]) -> Array:
    """Displacements of a team's parts divided by the first part's, shape (parts,)."""
    travel = np.array([part.high - part.low for part in team])
    matrix = np.array([part.effectiveness() for part in team]).T[list(SHARED[control])] * travel
    share = np.linalg.pinv(matrix, rcond=1e-9) @ np.eye(3)[0]
    ways = share * travel
    if abs(ways[0]) <= NEGLIGIBLE * np.abs(ways).max():
        return np.asarray(np.eye(len(team))[0])
    return np.asarray(ways / ways[0])


def thrust_weights(parts: Sequence[Part]) -> Array | None:
    """Thrust of each part [N] per wanted X, Y, Z [N], K, M, N [N m] about the CB, (parts, 6).

    The least sum of squared thrusts (Fossen 2011, section 12.3.1). Roll and pitch, which the hull
    rights by itself, are left out if the thrusters do not span them. None: the thrusters do not
    push and turn the hull in all other axes, or there are none.

    Raises:
      VehicleError: there are more than MOST_THRUSTERS.
    """
    indices = [k for k, part in enumerate(parts) if isinstance(part, Thruster)]
    if len(indices) > MOST_THRUSTERS:
        raise VehicleError(f"{len(indices)} thrusters; at most {MOST_THRUSTERS} hold a pose")
    axes = np.array([part.axis for part in parts if isinstance(part, Thruster)]).reshape(-1, 3)
    places = np.array([parts[k].position for k in indices]).reshape(-1, 3)
    matrix = np.hstack([axes, np.cross(places, axes)]).T
    for rows in ([0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 5], [0, 1, 2, 4, 5], [0, 1, 2, 5]):
        if np.linalg.matrix_rank(matrix[rows], tol=1e-3) == len(rows):
            weights = np.zeros((len(parts), 6))
            weights[np.ix_(indices, rows)] = np.linalg.pinv(matrix[rows])
            return weights
    return None


def idle_parts(
    parts: Sequence[Part],
    steering: Mapping[str, str],
    shared: Sequence[Follower],
    alone: Sequence[str] = (),
) -> dict[str, str]:
    """Map each idle part to the part that steers in its place.

    Idle parts could serve a control but stay at rest; controls in `alone` do not count.
    """
    busy = {*steering.values(), *(follower.part for follower in shared)}
    found = {}
    for part in parts:
        able = [c for c in part.controls() if c in steering and c not in alone]
        if able and part.name not in busy:
            found[part.name] = steering[able[0]]
    return found
