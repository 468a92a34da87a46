"""Far targets: places that no mission goes to, refused with the place that was likely meant."""

from __future__ import annotations

import math
from collections.abc import Iterator

from twin.errors import MissionError
from twin.geodesy import great_circle

FARTHEST = 1000e3
"""[m] of a target from the start: farther, the plane in which missions are flown bends too much
(its error grows as the cube of the distance), and nearly always the place is a slip"""


def check_reachable(label: str, place: tuple[float, float], start: tuple[float, float]) -> None:
    """Raise MissionError for a target too far from the start; both latitude, longitude [degree]."""
    metres = great_circle(*place, *start)
    if metres <= FARTHEST:
        return
    near = [(great_circle(*one, *start), one, why) for one, why in _slips(*place)]
    likely = min((one for one in near if one[0] <= FARTHEST), default=None)
    hint = "check its signs (south and west are negative), and --start or --from"
    if likely is not None:
        (latitude, longitude), why = likely[1:]
        hint = f"did you mean {latitude:g}, {longitude:g} ({why})?"
    raise MissionError(
        f"{label} at {place[0]:g}, {place[1]:g} degree is {metres / 1e3:.0f} km from the start at "
        f"{start[0]:g}, {start[1]:g}; at most {FARTHEST / 1e3:.0f} km are flown: {hint}"
    )


def check_near(label: str, north: float, east: float) -> None:
    """Raise MissionError for a target too far from the origin; both in metres."""
    metres = math.hypot(north, east)
    if metres > FARTHEST:
        raise MissionError(
            f"{label} is {metres / 1e3:.0f} km from the origin; at most {FARTHEST / 1e3:.0f} km "
            "are flown: north_m and east_m are metres"
        )


def _slips(latitude: float, longitude: float) -> Iterator[tuple[tuple[float, float], str]]:
    """Places that could be meant, and by which slip they were missed."""
    yield (latitude, -longitude), "the sign of the longitude; west is negative"
    yield (-latitude, longitude), "the sign of the latitude; south is negative"
    yield (-latitude, -longitude), "the signs"
    for north, east in ((longitude, latitude), (longitude, -latitude), (-longitude, latitude)):
        if abs(north) <= 90.0:
            yield (north, east), "latitude comes first"
    north, east = _as_minutes(latitude), _as_minutes(longitude)
    if abs(north) <= 90.0 and abs(east) <= 180.0:
        yield (
            (north, east),
            "a Slocum file has DDMM.mmm, degrees and minutes: "
            f"longitude {_dm(east):.3f}, latitude {_dm(north):.3f}",
        )


def _as_minutes(degrees: float) -> float:
    """The number that was read as DDMM.mmm and gave these degrees."""
    return round(_dm(degrees), 6)


def _dm(degrees: float) -> float:
    """Degrees as DDMM.mmm."""
    part, whole = math.modf(abs(degrees))
    return math.copysign(100.0 * whole + 60.0 * part, degrees)
