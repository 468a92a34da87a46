"""Where the files of `assets/` are: in the wheel, or at the top of a source checkout."""

from __future__ import annotations

from pathlib import Path

from twin.errors import InputError, unknown_name

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
