"""Command `twin route`: the fastest paths to a place through a current."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from glider_twin_ops.commands.forecast import begun_at, field_of, vehicle_of
from twin.cli import Console, JsonOption

if TYPE_CHECKING:
    from glider_twin_ops.forecast import Known, Request

RADIUS, USUAL_PITCH, LONGEST = 1000.0, 26.0, 240.0
"""RADIUS: [m] radius of arrival. USUAL_PITCH: [degree] pitch until the polar gives the fastest.
LONGEST: [h] longest path"""


@dataclass(frozen=True, kw_only=True)
class PlanRoute(JsonOption):
    """Find the fastest three paths to a place through a forecast of the current, beside the
    straight one, with hours, gain and their intervals by samples of the forecast's error. Example:

        twin route --vehicle slocum-200 --from 48.5,-15,2000-01-05T00:00 --to 48.8,-14.2
            --current forecast.nc
    """

    to: Annotated[str, tyro.conf.arg(metavar="LAT,LON")]
    """place to go to"""
    vehicle: str | None = None
    """vehicle, as in `twin forecast`"""
    from_: Annotated[str | None, tyro.conf.arg(name="from", metavar="LAT,LON,TIME")] = None
    """place and time of the start, UTC; default: the last fix of --logs"""
    via: Annotated[str | None, tyro.conf.arg(metavar="LAT,LON[;LAT,LON]")] = None
    """places to pass, in any order; the fastest order is taken"""
    avoid: Annotated[Path | None, tyro.conf.arg(metavar="GEOJSON")] = None
    """polygons that a path must not enter: shallow water, shipping, borders"""
    current: str | None = None
    """forecast of the current, as in `twin forecast --current`; without one, --logs must give the
    current"""
    current_error: float | None = None
    """standard deviation [m/s], north and east each, of the error of --current; default: 0.1"""
    logs: Path | None = None
    """store of logs that `factory import` wrote"""
    depth: float = 200.0
    """depth [m] of the dives"""
    pitch: float | None = None
    """pitch [deg] of dives and climbs; default: the fastest over ground"""
    surface_every: float = 6.0
    """hours under water between surfacings"""
    members: int = 16
    """number of members that fly along each path, at least 10"""
    seed: int = 0
    """seed of the samples"""
    out: Annotated[Path | None, tyro.conf.arg(metavar="GEOJSON")] = None
    """file for the paths, for a map"""
    overwrite: bool = False
    """replace an existing --out"""

    def run(self, console: Console) -> int:
        """Search the paths, fly them, print the table."""
        import json

        from glider_twin_ops.forecast import plan_routes
        from twin.errors import InputError

        if self.out is not None and self.out.exists() and not self.overwrite:
            raise InputError(f"{self.out} exists already; use --overwrite or another --out")
        vias = [] if self.via is None else [_place("--via", one) for one in self.via.split(";")]
        rings = [] if self.avoid is None else _polygons(self.avoid)
        request, known = self._request(console)
        plan = plan_routes(
            request, known, vias=vias, avoided=rings, pitch_deg=self.pitch, say=console.note
        )
        console.table([one.row() for one in plan.routes])
        console.say(f"{plan.speed:.2f} m/s through the water at {plan.pitch_deg:.0f} degree")
        if vias:
            console.say(f"vias in the order {', '.join(str(1 + k) for k in plan.order)}")
        for one in plan.routes:
            console.say(f"{one.name}: --goto '{one.goto}'")
        console.say(plan.verdict())
        if self.out is not None:
            self.out.write_text(json.dumps(plan.geojson(), indent=1) + "\n", encoding="utf-8")
            console.say(f"map: {self.out}")
        console.answer(**plan.describe())
        return 0

    def _request(self, console: Console) -> tuple[Request, Known]:
        from glider_twin_ops.forecast import Request, mission_to
        from twin.errors import InputError
        from twin.identify import identified

        if self.current_error is not None and self.current is None:
            raise InputError("--current-error is for --current, which is not given: leave it out")
        vehicle = vehicle_of(self.vehicle, self.logs)
        model = vehicle if identified(vehicle) else None
        place, known = begun_at(console, self.from_, self.logs, model)
        mission = mission_to(
            ",".join(map(str, _place("--to", self.to))),
            depth=self.depth,
            pitch_deg=self.pitch or USUAL_PITCH,
            surface_after_s=3600.0 * self.surface_every,
            radius=RADIUS,
        )
        request = Request(
            vehicle=vehicle,
            mission=mission,
            place=place,
            members=self.members,
            hours=LONGEST,
            seed=self.seed,
            **field_of(self.current, self.current_error),
        )
        return request, known


def _place(option: str, text: str) -> tuple[float, float]:
    """Latitude, longitude [degree] of an option's text."""
    from twin.errors import InputError

    try:
        latitude, longitude = (float(word) for word in text.split(","))
    except ValueError:
        latitude = math.nan
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 360.0):
        raise InputError(f"{option} {text}: write LAT,LON in degrees, such as 36.9,-122.5")
    return latitude, longitude


def _polygons(path: Path) -> list[list[tuple[float, float]]]:
    """Outer rings of a GeoJSON file's polygons, latitude and longitude [degree]."""
    from twin.bounded import parse_json, read_text
    from twin.errors import InputError

    found = parse_json(read_text(path, "--avoid"), f"--avoid {path}")
    rings = []
    try:
        for one in found["features"] if found["type"] == "FeatureCollection" else [found]:
            shape = one.get("geometry", one)
            parts = {"Polygon": [shape["coordinates"]], "MultiPolygon": shape["coordinates"]}
            for polygon in parts[shape["type"]]:
                rings.append([(float(point[1]), float(point[0])) for point in polygon[0]])
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        raise InputError(
            f"--avoid {path}: no GeoJSON of polygons ({type(error).__name__}: {error}); draw them "
            "with a GIS and save them as GeoJSON"
        ) from error
    return rings
