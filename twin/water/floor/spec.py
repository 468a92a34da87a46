"""Spec: a sea floor as the command line and descriptions give it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, cast

from twin.errors import FloorError, unknown_name
from twin.water.floor.base import FlatFloor, Floor
from twin.water.floor.bathymetry import Bathymetry, GridFloor
from twin.water.floor.rough import RoughFloor

KINDS: dict[str, type[Floor]] = {c.kind: c for c in (FlatFloor, RoughFloor, GridFloor, Bathymetry)}
"""Every kind of sea floor by its name in descriptions."""
NONE = "none"
DEPTH = "depth:"
ROUGH = "rough:"
ROUGH_SETTINGS = {
    "height": "height_m",
    "length": "length_m",
    "slope": "slope",
    "toward": "slope_direction_deg",
    "seed": "seed",
    "shallowest": "shallowest_m",
    "deepest": "deepest_m",
    "reach": "reach_m",
}
"""Of a rough floor, by the names that a spec gives them"""
SETTINGS = {
    "variable": "variable",
    "positive": "positive",
    "reach": "reach_m",
    "sha256": "sha256",
}
"""Of a file, by the names that a spec gives them"""


def parse_floor(text: str) -> Floor | None:
    """`none`, `depth:200` [m], `rough:60,height=3,length=400,seed=1`, or `FILE.nc,reach=20000`: a
    bathymetry file with settings.

    Raises:
      FloorError: what is given is none of these.
    """
    text = text.strip()
    if text == NONE:
        return None
    if text.startswith(DEPTH):
        return FlatFloor(depth_m=_number("depth", text.removeprefix(DEPTH)))
    if text.startswith(ROUGH):
        depth, *given = text.removeprefix(ROUGH).split(",")
        numbers = {
            ROUGH_SETTINGS[name]: _whole(name, value) if name == "seed" else _number(name, value)
            for name, value in _settings(text, given, ROUGH_SETTINGS, "rough sea floor").items()
        }
        return RoughFloor(depth_m=_number("rough", depth), **numbers)  # type: ignore[arg-type]
    path, *given = text.split(",")
    if not path or ("." not in path and "/" not in path and "\\" not in path):
        raise FloorError(
            f"sea floor {text!r}: give none, depth:METRES such as depth:200, rough:METRES such as "
            "rough:60,height=3,length=400, or a bathymetry file such as GEBCO.nc"
        )
    settings = {
        SETTINGS[name]: _number(name, value) if name == "reach" else value
        for name, value in _settings(text, given, SETTINGS, "bathymetry file").items()
    }
    return Bathymetry(path=path, **settings)  # type: ignore[arg-type]


def _settings(
    text: str, given: Sequence[str], known: Mapping[str, str], noun: str
) -> dict[str, str]:
    """The values of NAME=VALUE by name."""
    settings: dict[str, str] = {}
    for item in given:
        name, sign, value = (word.strip() for word in item.partition("="))
        if not sign:
            raise FloorError(f"sea floor {text!r}: {item!r} must be NAME=VALUE")
        if name not in known:
            raise FloorError(unknown_name(f"setting of a {noun}", name, known))
        settings[name] = value
    return settings


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
        raise FloorError(f"sea floor: {name} {text.strip()!r} must be a number") from None


def _whole(name: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise FloorError(f"sea floor: {name} {text!r} must be a whole number") from None
