"""Places: the positions that an OG1.0 file of a logged deployment holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.flight_terms import JoinedDives, reckoning
from factory.exporting.og1.flown import Flown
from factory.exporting.og1.quality import ENDING, quality
from factory.exporting.og1.terms import COORDINATES, TIME_FILL, TRACKS, VOCABULARY
from factory.exporting.og1.variables import Og1Variable, position, time_attributes
from twin.flight.place import place_of

Array = NDArray[np.float64]


def corrected_places(track: JoinedDives, found: Flown) -> Iterator[tuple[str, Og1Variable]]:
    """The corrected track, its deviation and flags."""
    methods = ", ".join(dict.fromkeys(found.tracks[mission].method for mission in track.missions))
    latitude, longitude = _degrees(track, lambda mission: found.tracks[mission].position)
    reckoned = track.gather(lambda mission: found.tracks[mission].reckoned) > 0.0
    for name, values, word, vocabulary in (
        ("LONGITUDE", longitude, "longitude of each measurement and GPS location", "LON/"),
        ("LATITUDE", latitude, "Latitude north (WGS84)", "LAT/"),
    ):
        own = {
            "interpolation_methodology": methods,
            f"{name.lower()}_vocabulary": VOCABULARY + vocabulary,
            "ancillary_variables": f"{name}{ENDING} POSITION_SD DEAD_RECKONING",
        }
        yield name, position(values, word, name.lower(), own)
        yield quality(name, values, estimated=reckoned, good=~reckoned)
    yield from reckoning(reckoned, track.gather(lambda mission: found.tracks[mission].deviation))


def tracks(track: JoinedDives) -> Iterator[tuple[str, Og1Variable]]:
    """Tracks that the store has in metres from each row's start, on Earth: nothing else would say
    where they are, since a file has no rows."""
    for stored, ending, word in TRACKS:
        names = [f"{stored}_{axis}" for axis in ("north", "east")]
        if not all(name in track.logs for name in names):
            continue

        def metres(mission: int, names: list[str] = names) -> Array:
            return np.stack([track.logs.signal(name, mission) for name in names], axis=1)

        for name, values in zip(("latitude", "longitude"), _degrees(track, metres), strict=True):
            at = {"coordinates": COORDINATES}
            yield ending.format(name.upper()), position(values, f"{name} {word}", name, at)


def gps_fixes(track: JoinedDives, time: Array) -> Iterator[tuple[str, Og1Variable]]:
    """The fixes at the ends of the dives, each at its own time beside the nearest sample."""
    logs = track.logs
    places = np.full((3, len(time)), np.nan)
    for mission in track.missions:
        start, end = logs.fixes(mission)
        begin = logs.starts[mission]
        last = begin + float(logs.log_rows[mission].duration)
        for when, fix in ((begin, start), (last, end)):
            if np.isfinite([*fix, when]).all():
                places[:, int(np.argmin(np.abs(time - when)))] = when, *fix
    at = {"coordinates": COORDINATES}
    yield (
        "TIME_GPS",
        Og1Variable(places[0], time_attributes("time of each GPS location"), TIME_FILL),
    )
    yield (
        "LONGITUDE_GPS",
        position(_wrap(places[2]), "longitude of each GPS location", "longitude", at),
    )
    yield "LATITUDE_GPS", position(places[1], "latitude of each GPS location", "latitude", at)


def _wrap(longitude: Array) -> Array:
    return np.asarray(np.mod(longitude + 180.0, 360.0) - 180.0)


def _degrees(track: JoinedDives, of: Callable[[int], Array]) -> tuple[Array, Array]:
    """Latitude and longitude [degree] of each dive's metres, (samples,) each."""
    latitude, longitude = track.gather(
        lambda m: np.stack(place_of(track.logs, m).degrees(*of(m).T), axis=1)
    ).T
    return latitude, longitude
