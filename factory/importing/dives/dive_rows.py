"""Dive rows: the dataset of an import, one row for each dive, ready to be written as a store."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.deployment_log import Array
from factory.importing.dives.positions import CURRENT_METHOD, Positions
from factory.importing.dives.segments import NOWHERE, PHASES, LogSegment
from twin.records.attributes import (
    COMMENT,
    CONVENTIONS,
    DEPLOYMENT,
    DIVE,
    DIVE_DURATION,
    N_SAMPLES,
    PROGRAM_VERSION,
    READER_VERSION,
    SAMPLE_PERIOD,
    SPLIT,
    SPLITS,
    SUSPECT,
    TITLE,
)
from twin.records.coordinates import (
    ATTRIBUTES,
    DATETIME,
    LATITUDE,
    LOGGED,
    LONGITUDE,
    METHOD,
    START_LATITUDE,
    START_LONGITUDE,
    START_TIME,
    method_array,
    padded,
    sample_variables,
    unix_milliseconds,
)
from twin.records.logged import CELLS
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.trajectory import sample_times
from twin.version import IMPORT_VERSION, __version__

if TYPE_CHECKING:
    import xarray as xr

SHARES = (0.6, 0.2, 0.2)
"""Fractions of a deployment's dives for training, validation and test, in this order of time."""
FRAMES = (
    "On one time grid. NED frame with its origin at each row's start; body axes forward, "
    "starboard, down. Headings are true."
)
"""Last sentences of a store's comment."""
_PHASE_FLAGS = sorted(PHASES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveRow:
    """Row of the store: one dive."""

    deployment: str
    """Name of the deployment."""
    platform: str
    """Make of the vehicle."""
    segment: LogSegment
    signals: dict[str, Array]
    numbers: dict[str, float]
    """Numbers of the row that are not in `segment`, by a name of NUMBERS; also `dive`, if the
    vehicle counts its dives."""
    positions: Positions
    cells: Array | None = None
    """Doppler log's cells, (time, cells, 3): the signals of `twin.records.logged.CELLS`."""
    suspect: str = ""
    """Reason why no ocean or vehicle allows the row's values; empty for a sound row."""


NUMBERS: dict[str, tuple[str, str]] = {
    "end_latitude": ("degree_north", "latitude of the first fix after the dive"),
    "end_longitude": ("degree_east", "longitude of the first fix after the dive"),
    "displacement_north": ("m", "displacement over ground between the fixes, north"),
    "displacement_east": ("m", "displacement over ground between the fixes, east"),
    DIVE_DURATION: ("s", "time between the row's start and end"),
    "surface_duration": ("s", "time between the fixes at the surface before the dive"),
    "surface_drift_north": ("m s-1", "drift at the surface before the dive, north"),
    "surface_drift_east": ("m s-1", "drift at the surface before the dive, east"),
    "magnetic_variation": ("degree", "magnetic variation that was applied, east positive"),
    "vehicle_dac_north": ("m s-1", "depth-averaged northward current by the vehicle"),
    "vehicle_dac_east": ("m s-1", "depth-averaged eastward current by the vehicle"),
    "dac_north": ("m s-1", "depth-averaged northward current"),
    "dac_east": ("m s-1", "depth-averaged eastward current"),
    "thruster_fraction": ("1", "part of the row's time with the thruster on"),
}
"""Units and meaning of the per-row numbers."""
OF_ROWS: Mapping[str, Mapping[str, Any]] = {
    MISSION: {"long_name": "row of the store"},
    TIME: {"units": "s", "long_name": "time since the start of the row"},
    N_SAMPLES: {
        "units": "1",
        "long_name": "number of samples of the row",
        "comment": "later ones are padding",
    },
    DIVE: {"units": "1", "long_name": "number of the dive: the vehicle's own, or counted from 0"},
    DEPLOYMENT: {"long_name": "deployment that the row belongs to"},
    SUSPECT: {
        "long_name": "why the row holds what no ocean or vehicle allows",
        "comment": "empty where it does not",
    },
    SPLIT: {
        "flag_values": np.arange(len(SPLITS), dtype=np.int8),
        "flag_meanings": " ".join(SPLITS),
        "long_name": "part of the data set, by dive in blocks of time",
    },
}
"""CF attributes of the axes and the per-row variables."""
_STANDARD_NAMES = {
    "dac_north": "northward_sea_water_velocity",
    "dac_east": "eastward_sea_water_velocity",
}
"""CF standard names of our currents and of the vehicle's."""


def rows_dataset(rows: Sequence[DiveRow], period: float, attributes: dict[str, Any]) -> xr.Dataset:
    """Dataset of the rows, padded with NaN to the longest, without variables that no row has."""
    import xarray as xr

    lengths = np.array([len(row.signals["measured_gap"]) for row in rows], np.int32)
    longest = int(lengths.max())
    variables: dict[str, Any] = {N_SAMPLES: _described(N_SAMPLES, lengths)}
    for name in [name for name in VARIABLES if any(name in row.signals for row in rows)]:
        values = np.full((len(rows), longest), np.nan, np.float32)
        for i, row in enumerate(rows):
            if name in row.signals:
                values[i, : lengths[i]] = row.signals[name]
        described: dict[str, Any] = dict(VARIABLES[name].attributes())
        if name == "measured_phase":
            described["flag_values"] = np.array(_PHASE_FLAGS, np.float32)
            described["flag_meanings"] = " ".join(PHASES[flag] for flag in _PHASE_FLAGS)
        variables[name] = ((MISSION, TIME), values, described)
    most = max((row.cells.shape[1] for row in rows if row.cells is not None), default=0)
    cells = np.full((len(rows), longest, most, len(CELLS)), np.nan, np.float32)
    for i, row in enumerate(rows):
        if row.cells is not None:
            cells[i, : lengths[i], : row.cells.shape[1]] = row.cells
    for k, (name, about) in enumerate(CELLS.items() if most else ()):
        variables[name] = ((MISSION, TIME, "cell"), cells[..., k], about)
    variables |= _per_row(rows)
    variables[METHOD] = method_array([row.positions.method for row in rows])
    coordinates: dict[str, Any] = {
        **_start(rows),
        **_where_and_when(rows, longest, period),
        MISSION: _described(MISSION, np.arange(len(rows))),
        TIME: (TIME, period * np.arange(longest), dict(OF_ROWS[TIME])),
    }
    common = {
        **CONVENTIONS,
        TITLE: "Underwater glider logs",
        COMMENT: f"Recorded by vehicles at sea. {FRAMES}",
        SAMPLE_PERIOD: period,
        PROGRAM_VERSION: __version__,
        READER_VERSION: IMPORT_VERSION,
    }
    return xr.Dataset(variables, coordinates, {**common, **attributes})


def _described(name: str, values: NDArray[Any]) -> tuple[str, NDArray[Any], dict[str, Any]]:
    """Variable along the rows, with its attributes of `OF_ROWS`."""
    return MISSION, values, dict(OF_ROWS[name])


def dive_numbers(rows: Sequence[DiveRow]) -> NDArray[np.int32]:
    """Number of each dive, (mission,): the vehicle's own, or its index in its deployment."""
    counts = Counter[str]()
    found = []
    for row in rows:
        found.append(int(row.numbers.get(DIVE, counts[row.deployment])))
        counts[row.deployment] += 1
    return np.array(found, np.int32)


def split_rows(rows: Sequence[DiveRow]) -> NDArray[np.int8]:
    """Flag of `SPLITS` of each row: blocks of consecutive dives of each deployment.

    Neighbouring dives share water, trim and biofouling, so that a random split would leak. Rows
    with and without truth are divided separately, so that all parts have truth where there is
    enough. If each deployment is a single row, such as one run of a vehicle, the runs of each
    vehicle are divided instead.
    """
    flags = np.full(len(rows), SPLITS.index("test"), np.int8)
    names = [row.deployment for row in rows]
    if len(set(names)) == len(names):
        names = [row.platform for row in rows]
    groups: dict[tuple[str, bool], list[int]] = {}
    for k, row in enumerate(rows):
        truth = [values for name, values in row.signals.items() if name.startswith("true_")]
        known = any(np.isfinite(values).any() for values in truth)
        groups.setdefault((names[k], known), []).append(k)
    for members in groups.values():
        flags[members] = blocks(len(members))
    return flags


def blocks(count: int) -> NDArray[np.int8]:
    """Flags of `count` dives in order of time; a single dive is test, two are train, then test."""
    test = max(1, round(SHARES[2] * count))
    validation = min(max(1, round(SHARES[1] * count)), max(count - test - 1, 0))
    parts = (count - test - validation, validation, test)
    return np.repeat(np.arange(len(SPLITS), dtype=np.int8), parts)


def _start(rows: Sequence[DiveRow]) -> dict[str, Any]:
    """Time and position of the starts, (mission,); the position is NaN without a fix."""
    fixes = [row.segment.start_fix or NOWHERE for row in rows]
    fix = "of the fix before the dive"
    return {
        name: (MISSION, np.array(values, np.float64), {**ATTRIBUTES[name], "comment": comment})
        for name, values, comment in (
            (
                START_TIME, [row.segment.start for row in rows],
                "of the row's first sample: the fix before the dive, if any",
            ),
            (START_LATITUDE, [latitude for latitude, _ in fixes], fix),
            (START_LONGITUDE, [longitude for _, longitude in fixes], fix),
        )
    }  # fmt: skip


def _where_and_when(rows: Sequence[DiveRow], longest: int, period: float) -> dict[str, Any]:
    """Time and position of the samples, (mission, time)."""
    latitudes = [row.positions.latitude for row in rows]
    times = [
        unix_milliseconds(row.segment.start, sample_times(len(latitude), period))
        for row, latitude in zip(rows, latitudes, strict=True)
    ]
    longitudes = [row.positions.longitude for row in rows]
    arrays: dict[str, Sequence[NDArray[Any]]]
    arrays = {DATETIME: times, LATITUDE: latitudes, LONGITUDE: longitudes}
    whole = {name: padded(name, values, longest) for name, values in arrays.items()}
    return sample_variables(whole, LOGGED, (MISSION, TIME))


def _per_row(rows: Sequence[DiveRow]) -> dict[str, Any]:
    numbers = []
    for row in rows:
        segment = row.segment
        own = zip(
            list(NUMBERS)[:8],
            (*(segment.end_fix or NOWHERE), *segment.displacement, segment.duration,
             segment.surface_duration, *segment.surface_drift), strict=True,
        )  # fmt: skip
        numbers.append({**dict(own), **row.numbers})
    variables: dict[str, Any] = {}
    for name, (units, long_name) in NUMBERS.items():
        if any(name in entry for entry in numbers):
            values = np.array([entry.get(name, np.nan) for entry in numbers], np.float64)
            described = {"units": units, "long_name": long_name}
            standard = _STANDARD_NAMES.get(name.removeprefix("vehicle_"))
            if standard is not None:
                described["standard_name"] = standard
            if name.startswith("dac_"):
                described["comment"] = CURRENT_METHOD
            variables[name] = (MISSION, values, described)
    owners, doubts = ([getattr(row, name) for row in rows] for name in ("deployment", "suspect"))
    return variables | {
        DIVE: _described(DIVE, dive_numbers(rows)),
        DEPLOYMENT: _described(DEPLOYMENT, np.array(owners, object)),  # zarr warns of fixed widths
        SUSPECT: _described(SUSPECT, np.array(doubts, object)),
        SPLIT: _described(SPLIT, split_rows(rows)),
    }
