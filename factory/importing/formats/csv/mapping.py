"""Mapping: a TOML file that gives the meaning of a table's columns.

Every key of the file is a field of a class here; `mapping_file` reads the file.

`row_times` finds where rows begin and end in a log that is not cut into dives.
"""

from __future__ import annotations

import dataclasses
import fnmatch
from collections.abc import Mapping as Dict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from factory.importing.units import PRACTICAL, SECONDS, unit_of
from twin.records.schema import VARIABLES

Frame = Literal["FRD", "FLU"]

SHIPPED = Path(__file__).parent / "mappings"
"""Folder of the mappings that come with the program, by name."""
FRAMES = ("FRD", "FLU")
"""Body axes: forward-starboard-down, which stores have, and forward-port-up."""
LOCKS = {"bottom": 1.0, "water": 2.0}
"""Values of `measured_dvl_mode` by lock; 0 means no lock."""
TURNED = frozenset(
    f"{group}_{name}"
    for group in ("measured", "true", "commanded")
    for name in (
        "pitch", "pitch_rate", "yaw_rate", "specific_force_y", "specific_force_z", "dvl_sway",
        "dvl_heave", "sway", "heave",
    )
)  # fmt: skip
"""Signals whose sign differs in FLU: those along or about the second and third axis. Roll is about
the first axis; a heading has its own keys for zero and direction."""
HEADINGS = frozenset({"measured_heading", "commanded_heading", "true_heading"})
LOG_ONLY: dict[str, tuple[str, str]] = {
    "latitude": ("degree", "the vehicle's own track"),
    "longitude": ("degree", "the vehicle's own track"),
    "onboard_north": ("m", "the vehicle's own track, from any origin"),
    "onboard_east": ("m", "the vehicle's own track, from any origin"),
    "gps_latitude": ("degree", "GPS fixes; a position that repeats is one fix"),
    "gps_longitude": ("degree", "GPS fixes"),
    "gps_fix": ("1", "above 0 where the receiver has a fix: a quality, a number of satellites"),
    "conductivity": ("S m-1", "of the CTD; salinity and density are made of it"),
    "magnetic_variation": ("degree", "east positive"),
    "dive": ("1", "the vehicle's own number of the dive"),
    "thruster": ("1", "above 0 where a propeller drives"),
    "dac_north": ("m s-1", "depth-averaged current that the vehicle reports"),
    "dac_east": ("m s-1", "depth-averaged current that the vehicle reports"),
}
"""Columns from which the import makes signals of other names: unit and meaning by name."""
MADE = frozenset(
    name
    for name in VARIABLES
    if name.startswith(("measured_gps", "measured_onboard"))
    or name in ("measured_phase", "measured_gap", "true_north", "true_east")
)
"""Signals that the import makes itself."""
ISO = "iso"
CLOCK_UNITS = (*SECONDS, ISO)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Signal:
    """Meaning of one column; `[signals.NAME]` of a mapping, NAME as in stores."""

    column: str
    """Name of the column."""
    unit: str = ""
    """Unit, as in `factory.importing.units`; may be left out if the signal has none."""
    frame: Frame | None = None
    """Body axes of this column, instead of the file's."""
    sign: float = 1.0
    """Sign: -1 if the column counts opposite to the frame."""
    sentinels: tuple[float, ...] = ()
    """Values, as the file has them, that mean no measurement."""
    possible: tuple[float, float] | None = None
    """Lowest and highest possible value, in the store's unit."""
    optional: bool = False
    """True if files may lack the column."""
    held: bool = False
    """True if the last value holds until the next one, without interpolation."""
    zero: Literal["north", "east"] = "north"
    """Direction in which a heading is 0."""
    turns: Literal["clockwise", "counterclockwise"] = "clockwise"
    """Direction in which a heading grows, seen from above."""
    north: Literal["true", "magnetic"] = "true"
    """North that a heading is measured from."""

    def wanted(self, name: str) -> str:
        """Unit of the signal in a store; `PRACTICAL` for practical salinity, which has none."""
        return LOG_ONLY[name][0] if name in LOG_ONLY else unit_of(name)

    def needs_unit(self, name: str) -> bool:
        """True if a mapping must state the unit: plain numbers have none."""
        return self.wanted(name) not in ("1", PRACTICAL)

    def turn(self, name: str, frame: Frame) -> float:
        """Sign that turns the column into the store's axes."""
        turned = (self.frame or frame) == "FLU" and name in TURNED
        return -self.sign if turned else self.sign


@dataclasses.dataclass(frozen=True, kw_only=True)
class Clock:
    """Column and unit of times; `[time]` of a mapping."""

    column: str
    unit: str = "s"
    """Unit: s, ms, us, ns, min, h, days; for written times iso, or a layout of `strptime`."""
    start: float | None = None
    """[s] Unix time at which the clock reads 0; None: the column holds Unix or written times."""
    start_from_name: str | None = None
    """Regular expression whose group is the date, ISO 8601, in a file's name."""

    @property
    def written(self) -> bool:
        """True if the column holds times as text."""
        return self.unit == ISO or "%" in self.unit


@dataclasses.dataclass(frozen=True, kw_only=True)
class Correction:
    """Correction of a column that differs from the mapping in some files; `[[corrections]]`."""

    files: str
    """Pattern of the files' names, such as 20220719_*."""
    signal: str
    reason: str
    changes: Dict[str, Any]
    """Fields of `Signal` that differ in these files."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mapping:
    """Meaning of the columns of a vehicle's tables."""

    name: str
    """Name of the mapping file, for messages."""
    vehicle: str
    """Name of the vehicle or its make."""
    time: Clock
    signals: Dict[str, Signal]
    ignored: Dict[str, str] = dataclasses.field(default_factory=dict)
    """Patterns of columns that are left out, each with the reason."""
    corrections: tuple[Correction, ...] = ()
    columns: tuple[str, ...] = ()
    """Names of the columns of files without a header, whose cells are separated by blanks."""
    frame: Frame = "FRD"
    """Body axes of the file."""
    dvl_lock: Literal["bottom", "water"] | None = None
    """Reference of the Doppler log if no column gives it; it holds wherever there is a velocity."""
    model: str | None = None
    """Vehicle file by whose parts columns of controls are named; the store gets this vehicle."""
    deployment: Literal["file", "name", "column"] = "file"
    """Criterion that separates deployments: file, one name for all, or column."""
    deployment_word: str = ""
    """Name of the deployment, or of the column that has it."""
    rows: Literal["dives", "file", "gaps", "minutes"] = "dives"
    """Division into rows of the store: dives, whole files, times between gaps, or minutes."""
    minutes: float = 0.0
    """[min] Length of a row, if `rows` is minutes."""
    gap_s: float = 60.0
    """[s] Where rows are not dives, a longer gap in the times ends a row."""
    period_s: float | None = None
    """[s] Sampling interval of the store; None: the table's usual spacing."""

    def reason(self, column: str) -> str | None:
        """Reason why a column is left out; None if the mapping gives none."""
        for pattern, why in self.ignored.items():
            if fnmatch.fnmatchcase(column, pattern):
                return why
        return None

    def signals_of(self, path: Path) -> dict[str, tuple[Signal, str]]:
        """Signals of one file, each with the reason of its correction or ""."""
        found = {name: (signal, "") for name, signal in self.signals.items()}
        for one in self.corrections:
            if fnmatch.fnmatchcase(path.name, one.files):
                signal = dataclasses.replace(found[one.signal][0], **one.changes)
                found[one.signal] = (signal, one.reason)
        return found


Array = NDArray[np.float64]


def row_times(
    mapping: Mapping, time: Array, files: Sequence[Array]
) -> tuple[tuple[float, float], ...] | None:
    """Start and end [s] of each row of a deployment; None if its rows are dives.

    If rows are files, times between gaps or minutes, a gap longer than the mapping's `gap_s` ends a
    row. Rows of minutes divide the time between gaps into equal intervals of about `minutes`.

    Args:
      time: [s] of the deployment, increasing.
      files: [s] times of each of its files.
    """
    if mapping.rows == "dives":
        return None
    spans: list[tuple[float, float]] = []
    for part in files if mapping.rows == "file" else [time]:
        inside = time[(time >= np.nanmin(part)) & (time <= np.nanmax(part))]
        for run in np.split(inside, np.flatnonzero(np.diff(inside) > mapping.gap_s) + 1):
            spans += _divided(run, 60.0 * mapping.minutes)
    return tuple(sorted(spans))


def _divided(run: Array, length: float) -> list[tuple[float, float]]:
    """Divide a run without gaps into rows of about `length` [s]; skip rows without samples."""
    first, last = float(run[0]), float(run[-1])
    count = max(1, round((last - first) / length)) if length else 1
    step = (last - first) / count
    places = np.minimum((run - first) / step, count - 1) if step else np.zeros(1)
    return [
        (first + k * step, last if k + 1 == count else first + (k + 1) * step)
        for k in np.unique(places.astype(np.int64)).tolist()
    ]
