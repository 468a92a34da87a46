"""Presets: the shipped vehicle files by name, and the sets of numbers that a file holds.

The files lie in `assets/`: in the wheel, or at the top of a source checkout.

`<text name="presets" data="OWN OTHER ..."/>` under <custom> lists the sets of a file. The first set
is the file as it stands. Elements whose names begin with a set's name and a colon define that set:

- `<numeric name="OTHER:Xuu" data="..."/>` and `<text name="OTHER:summary" data="..."/>` replace the
  element of that name;
- `<text name="OTHER:TAG/NAME@ATTRIBUTE" data="..."/>` sets an attribute of another element of the
  file, such as `site/rudder@pos`, `general/rudder@actrange` or `body/hull/inertial@mass`;
- `<text name="OTHER:without" data="Yuv Nuv"/>` removes numbers and texts.

MuJoCo ignores these elements as custom data: it loads the first set.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from twin.bounded import read_text
from twin.errors import InputError, VehicleError, unknown_name
from twin.vehicle.mjcf import MOST_XML, MjcfReader

_PACKAGE = Path(__file__).resolve().parents[1]
_PLACES = (_PACKAGE / "assets", _PACKAGE.parent / "assets")
"""The wheel carries assets inside the package; a checkout has them beside it."""


def assets_folder() -> Path:
    """Return the folder of the shipped vehicles and scenes.

    Raises:
        InputError: the installation lacks the folder.
    """
    for place in _PLACES:
        if place.is_dir():
            return place
    raise InputError(
        f"the installation lacks its assets folder (looked at {_PLACES[0]} "
        f"and {_PLACES[1]}): install it again"
    )


def asset_path(name: str) -> Path:
    """Path of the asset `name`, such as `glider.xml`.

    Raises:
        InputError: there is no such asset; the message offers the nearest name.
    """
    folder = assets_folder()
    path = folder / name
    if not path.is_file():
        shipped = (str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())
        raise InputError(unknown_name("asset", name, shipped))
    return path


RENAMED = {"slocum": "graver-2005"}
"""Today's names of shipped vehicles by their names in earlier versions."""


def vehicle_names() -> list[str]:
    """Names of the shipped vehicles, with one name for each further preset."""
    names = []
    for name, path in sorted(shipped_files().items()):
        others = preset_names(vehicle_text(path), path)[1:]
        names += [name, *(f"{name}{SEPARATOR}{preset}" for preset in others)]
    return names


def shipped_files() -> dict[str, Path]:
    """Path of each shipped file by its name, without presets."""
    return {path.stem: path for path in assets_folder().glob("*.xml")}


def vehicle_text(path: Path) -> str:
    """Read the text of a vehicle file, shipped or not; raises VehicleError."""
    return read_text(path, "vehicle file", VehicleError, most=MOST_XML)


def unknown_vehicle(name: str) -> str:
    """Error text for an unknown vehicle; a maker's name brings a list of the maker's vehicles."""
    if Path(name).is_file():
        return f"{name} is no vehicle file: the name of one ends in .xml (MJCF)"
    kinds = [known for known in vehicle_names() if known.startswith(f"{name}-")]
    if not kinds:
        return unknown_name("vehicle", name, vehicle_names()) + " or a path to an .xml"
    formerly = f"; what earlier versions called {name!r} is {RENAMED[name]!r}" * (name in RENAMED)
    return f"unknown vehicle {name!r}: say which, {' or '.join(kinds)}{formerly}"


PRESETS = "presets"
"""Name of the `<text>` that lists the sets of a file."""
WITHOUT = "without"
"""Word after the colon in the element that removes other elements from a set."""
SEPARATOR = ":"
"""Separator between a vehicle and its set, and between a set and the element that it changes."""
_ATTRIBUTE = re.compile(r"(?P<tag>\w+)/(?P<name>[^/@]+)(?:/(?P<child>\w+))?@(?P<attribute>\w+)")


def split_preset(vehicle: str) -> tuple[str, str]:
    """Split "tethys:gazebo" into ("tethys", "gazebo"); without a set, (the whole text, "")."""
    name, colon, preset = vehicle.rpartition(SEPARATOR)
    if not (colon and preset) or "/" in preset or "\\" in preset or preset.endswith(".xml"):
        return vehicle, ""
    return name, preset


def preset_names(xml: str, path: Path) -> tuple[str, ...]:
    """Names of a file's sets, its own first; () if the file lists none.

    Raises:
      VehicleError: the file is not MJCF.
    """
    return tuple(MjcfReader(xml, path).text(PRESETS, "").split())


def apply_preset(xml: str, path: Path, preset: str) -> str:
    """MJCF text of one set: a complete file without elements of the other sets.

    The file's own first set returns the text unchanged.

    Raises:
      VehicleError: the set is unknown (the nearest is offered), or it changes a missing element.
    """
    reader, names = MjcfReader(xml, path), preset_names(xml, path)
    if not names:
        raise VehicleError(
            f"vehicle file {path} has no presets, so {preset!r} cannot be chosen: leave "
            f"'{SEPARATOR}{preset}' out"
        )
    if preset not in names:
        raise VehicleError(f"vehicle file {path}: {unknown_name('preset', preset, names)}")
    if preset == names[0]:
        return xml
    custom = reader.one("custom")
    changes = _pop_changes(reader, custom, names)[preset]
    own = {(e.tag, e.get("name", "")): e for e in custom}
    for name, element in changes.items():
        if name == WITHOUT:
            present = {e.get("name", ""): e for e in custom}
            for left in element.get("data", "").split():
                if left not in present:
                    raise VehicleError(
                        f"vehicle file {path}: <text name='{preset}:{WITHOUT}'>: "
                        f"{unknown_name('element', left, present)}"
                    )
                custom.remove(present[left])
        elif "@" in name:
            _set_attribute(reader, preset, name, element)
        else:
            replaced = own.get((element.tag, name))
            if replaced is None:
                known = [there for tag, there in own if tag == element.tag]
                raise VehicleError(
                    f"vehicle file {path}: preset {preset!r}: "
                    f"{unknown_name(f'<{element.tag}>', name, known)}; it changes what the file "
                    "itself has"
                )
            replaced.set("data", element.get("data", ""))
    custom.remove(reader.texts[PRESETS])
    return ElementTree.tostring(reader.root, encoding="unicode") + "\n"


def _pop_changes(
    reader: MjcfReader, custom: Element, names: tuple[str, ...]
) -> dict[str, dict[str, Element]]:
    """Remove the elements of all sets but the first from the file; return them by set and name."""
    changes: dict[str, dict[str, Element]] = {name: {} for name in names[1:]}
    for element in list(custom):
        preset, colon, name = element.get("name", "").partition(SEPARATOR)
        if not colon:
            continue
        if preset not in changes:
            raise VehicleError(
                f"vehicle file {reader.path}: <{element.tag} name={element.get('name')!r}>: "
                f"{unknown_name('preset', preset, names[1:])}; <text name={PRESETS!r}> lists them, "
                "after the file's own"
            )
        changes[preset][name] = element
        custom.remove(element)
    return changes


def _set_attribute(reader: MjcfReader, preset: str, place: str, element: Element) -> None:
    label = f"<text name='{preset}{SEPARATOR}{place}'>"
    found = _ATTRIBUTE.fullmatch(place)
    if found is None or element.tag != "text":
        reader.fail(label, "a <text> named PRESET:TAG/NAME@ATTRIBUTE or .../CHILD@ATTRIBUTE")
    tag, name, child, attribute = found.group("tag", "name", "child", "attribute")
    there: Mapping[str, Element] = {e.get("name", ""): e for e in reader.root.iter(tag)}
    if name not in there:
        raise VehicleError(
            f"vehicle file {reader.path}: {label}: {unknown_name(f'<{tag}>', name, there)}"
        )
    target = there[name] if child is None else there[name].find(child)
    if target is None:
        reader.fail(label, f"of an element: <{tag} name={name!r}> has no <{child}>")
    if attribute not in target.attrib:
        raise VehicleError(
            f"vehicle file {reader.path}: {label}: "
            f"{unknown_name('attribute', attribute, target.attrib)}; it changes what is there"
        )
    target.set(attribute, element.get("data", ""))
