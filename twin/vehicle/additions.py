"""Additions: parts and a hull law that a program adds to a vehicle file.

The result is a complete vehicle; every command accepts its `xml` as a file.

    vehicle = with_part("glider", "airbrake", kind="airbrake", travel=(0.0, 1.0), lag=1.0, rate=0.5,
                        numbers={"drag_area": 0.02})
    Path("own.xml").write_text(vehicle.xml)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from twin.errors import InputError, VehicleError, unknown_name
from twin.frames import flip_vector
from twin.numbers import number
from twin.numbers import numbers as numeric_array
from twin.vehicle.assembly import STEERING
from twin.vehicle.laws import LAWS
from twin.vehicle.mjcf import MjcfReader
from twin.vehicle.parts import PARTS
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle

Values = float | Sequence[float]


def with_part(
    vehicle: Vehicle | str | Path,
    name: str,
    *,
    kind: str,
    travel: tuple[float, float],
    lag: float,
    rate: float,
    place: Sequence[float] = (0.0, 0.0, 0.0),
    numbers: Mapping[str, Values] | None = None,
    steers: Sequence[str] = (),
) -> Vehicle:
    """Return a vehicle with one more part, the last in the order of commands.

    Every pose (keyframe) of the file gets the part at rest.

    Args:
      vehicle: a vehicle, or an argument of `load_vehicle`.
      name: of the part, a plain word.
      kind: of vehicle part, shipped or your own; it acts at a place of the hull and moves no
        mass on a joint.
      travel: lowest and highest position, in the type's unit.
      lag: [s] of the first-order response. rate: largest rate, in the unit per second.
      place: [m], body forward-starboard-down about the CB, shape (3,).
      numbers: the type's own numbers by name, as in a vehicle file (axes there are forward,
        port, up).
      steers: controls that guidance serves by this part: of "pitch", "heading", "buoyancy",
        "speed", "trim".

    Raises:
      VehicleError: the type is unknown or needs a joint, or the part lacks or has a wrong number.
      InputError: the vehicle has values that its file lacks, or an argument is not a number.
    """
    file = _VehicleText(vehicle)
    if kind not in PARTS:
        raise VehicleError(f"part {name!r}: {unknown_name('vehicle part', kind, PARTS)}")
    if PARTS[kind].joint is not None:
        at_sites = [one for one in PARTS if PARTS[one].joint is None]
        raise VehicleError(
            f"part {name!r}: a {kind} moves a mass on a joint, which is a body of the file: write "
            f"that, or take one of {', '.join(sorted(at_sites))}"
        )
    low, high = (number(one, f"part {name!r}: travel") for one in travel)
    response = number(lag, f"part {name!r}: lag"), number(rate, f"part {name!r}: rate")
    x, y, z = flip_vector(numeric_array(place, f"part {name!r}: place"))
    hull = file.reader.body("hull")
    before = next((k for k, one in enumerate(hull) if one.tag == "body"), len(hull))
    hull.insert(before, _element("site", name=name, pos=_text((x, y, z))))
    file.put("text", f"{name}.kind", kind)
    file.put_numbers(numbers, f"{name}.")
    for axis in steers:
        if axis not in STEERING:
            raise InputError(f"part {name!r}: {unknown_name('steers', axis, STEERING)}")
        file.put("text", f"steer.{axis}", name)
    ends = _text((low, high))
    file.reader.one("actuator").append(
        _element(
            "general", name=name, site=name, gear="0 0 1 0 0 0", dyntype="user", actdim="1",
            dynprm=_text(response),
            gaintype="fixed", gainprm="0", biastype="none", ctrlrange=ends, actearly="true",
            actlimited="true", actrange=ends,
        )
    )  # fmt: skip
    rest = _text((file.vehicle().part(name).rest,))
    for pose in file.reader.root.iterfind("./keyframe/key"):
        for attribute in ("act", "ctrl"):
            if attribute in pose.attrib:
                pose.set(attribute, f"{pose.get(attribute)} {rest}")
    return file.vehicle()


def with_law(
    vehicle: Vehicle | str | Path, kind: str, numbers: Mapping[str, Values] | None = None
) -> Vehicle:
    """Return a vehicle whose bare hull has another law.

    Args:
      vehicle: a vehicle, or an argument of `load_vehicle`.
      kind: of hull law, shipped or your own.
      numbers: numbers that the law reads from the file, by name.

    Raises:
      VehicleError: the type is unknown, or a number is missing or wrong.
      InputError: the vehicle has values that its file lacks, or an argument is not a number.
    """
    file = _VehicleText(vehicle)
    if kind not in LAWS:
        raise VehicleError(f"hull law: {unknown_name('hull_law', kind, LAWS)}")
    file.put("text", "hull_law", kind)
    file.put_numbers(numbers)
    return file.vehicle()


class _VehicleText:
    """Editable text of a vehicle file; comments, which hold the sources, stay."""

    def __init__(self, vehicle: Vehicle | str | Path):
        given = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
        if changed := given.changes():
            raise InputError(
                f"vehicle {given.name!r} has other values than its file ({', '.join(changed)}): "
                "add to the vehicle of the file, and change values afterwards"
            )
        self.path = given.path
        self.reader = MjcfReader(given.xml, given.path)
        keeping = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
        self.reader.root = ElementTree.fromstring(given.xml, keeping)
        self._head = given.xml[: given.xml.index("<mujoco")]

    def put_numbers(self, numbers: Mapping[str, Values] | None, prefix: str = "") -> None:
        """Add or replace numbers under <custom>."""
        for key, value in (numbers or {}).items():
            values = numeric_array(
                [value] if isinstance(value, int | float) else value, prefix + key
            )
            self.put("numeric", prefix + key, _text(values))

    def put(self, tag: str, name: str, data: str) -> None:
        """Add or replace an element under <custom>."""
        custom = self.reader.one("custom")
        for old in custom.findall(tag):
            if old.get("name") == name:
                custom.remove(old)
        custom.append(_element(tag, name=name, data=data))

    def vehicle(self) -> Vehicle:
        """Parse the vehicle from the text; raises VehicleError."""
        text = ElementTree.tostring(self.reader.root, encoding="unicode")
        return parse_vehicle(f"{self._head}{text}\n", self.path)


def _element(tag: str, **attributes: str) -> Element:
    one = Element(tag, attributes)
    one.tail = "\n    "
    return one


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
