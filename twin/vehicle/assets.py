"""Where the files of `assets/` are: in the wheel, or at the top of a source checkout.

Shipped: the vehicle files that come with the program, by name.
"""

from __future__ import annotations

from pathlib import Path

from twin.bounded import read_text
from twin.errors import InputError, VehicleError, unknown_name
from twin.vehicle.file_limits import MOST_XML
from twin.vehicle.presets import SEPARATOR, preset_names

_PACKAGE = Path(__file__).resolve().parents[1]
_PLACES = (_PACKAGE / "assets", _PACKAGE.parent / "assets")
"""The wheel carries assets inside the package; a checkout has them beside it."""


def assets_folder() -> Path:
    """The folder of the shipped vehicles and scenes.

    Raises:
        InputError: the installation lacks it.
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
"""Shipped vehicles of earlier versions by their names of today"""


def vehicle_names() -> list[str]:
    """Names of the shipped vehicles, each preset of a file by a name of its own."""
    names = []
    for name, path in sorted(shipped_files().items()):
        others = preset_names(vehicle_text(path), path)[1:]
        names += [name, *(f"{name}{SEPARATOR}{preset}" for preset in others)]
    return names


def shipped_files() -> dict[str, Path]:
    """Path of each shipped file by its name, presets not told apart."""
    return {path.stem: path for path in assets_folder().glob("*.xml")}


def vehicle_text(path: Path) -> str:
    """The text of a vehicle file, shipped or not; raises VehicleError."""
    return read_text(path, "vehicle file", VehicleError, most=MOST_XML)


def unknown_vehicle(name: str) -> str:
    """One line for a name that no shipped vehicle has; a maker's name brings up its vehicles."""
    kinds = [known for known in vehicle_names() if known.startswith(f"{name}-")]
    if not kinds:
        return unknown_name("vehicle", name, vehicle_names()) + " or a path to an .xml"
    formerly = f"; what earlier versions called {name!r} is {RENAMED[name]!r}" * (name in RENAMED)
    return f"unknown vehicle {name!r}: say which, {' or '.join(kinds)}{formerly}"
