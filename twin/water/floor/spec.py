"""Spec: a sea floor as the command line and descriptions give it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, cast

from twin.errors import FloorError, unknown_name
from twin.water.floor.base import Floor
from twin.water.floor.bathymetry import Bathymetry
from twin.water.floor.flat import FlatFloor
from twin.water.floor.grid import GridFloor

KINDS: dict[str, type[Floor]] = {c.kind: c for c in (FlatFloor, GridFloor, Bathymetry)}
"""Every kind of sea floor by its name in descriptions."""
NONE = "none"
DEPTH = "depth:"
SETTINGS = {
    "variable": "variable",
    "positive": "positive",
    "reach": "reach_m",
    "sha256": "sha256",
}
"""Of a file, by the names that a spec gives them"""


def parse_floor(text: str) -> Floor | None:
    """`none`, `depth:200` [m], or `FILE.nc,reach=20000`: a bathymetry file with settings.

    Raises:
      FloorError: what is given is none of these.
    """
    text = text.strip()
    if text == NONE:
        return None
    if text.startswith(DEPTH):
        return FlatFloor(depth_m=_number("depth", text.removeprefix(DEPTH)))
    path, *given = text.split(",")
    if not path or ("." not in path and "/" not in path and "\\" not in path):
        raise FloorError(
            f"sea floor {text!r}: give none, depth:METRES such as depth:200, or a bathymetry file "
            "such as GEBCO.nc"
        )
    settings: dict[str, str | float] = {}
    for item in given:
        name, sign, value = item.partition("=")
        if not sign:
            raise FloorError(f"sea floor {text!r}: {item!r} must be NAME=VALUE")
        if name.strip() not in SETTINGS:
            raise FloorError(unknown_name("setting of a bathymetry file", name.strip(), SETTINGS))
        key = SETTINGS[name.strip()]
        settings[key] = _number(name, value) if key == "reach_m" else value.strip()
    return Bathymetry(path=path, **settings)  # type: ignore[arg-type]


def floor_from_dict(data: Mapping[str, Any]) -> Floor:
    """Rebuild what `describe` wrote.

    Raises:
      FloorError: an unknown kind or setting.
    """
    kind = str(data.get("kind"))
    if kind not in KINDS:
        raise FloorError(unknown_name("kind of sea floor", kind, KINDS))
    settings = {name: value for name, value in data.items() if name != "kind"}
    known = [field.name for field in dataclasses.fields(cast(Any, KINDS[kind]))]
    for name in settings:
        if name not in known:
            raise FloorError(unknown_name(f"setting of a {kind} sea floor", name, known))
    return KINDS[kind](**settings)


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise FloorError(f"sea floor: {name} {text.strip()!r} must be a number of metres") from None
