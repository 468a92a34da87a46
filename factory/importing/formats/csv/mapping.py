"""Mapping: a TOML file that says what the columns of a table are.

Every key that a person can write is a field of a class here; unknown keys, signals and units are
refused with the nearest known one.
"""

from __future__ import annotations

import dataclasses
import datetime
import fnmatch
import math
from collections.abc import Mapping as Dict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from factory.importing.reading.units import SECONDS, in_unit, known_units
from twin.bounded import compile_pattern, read_toml
from twin.errors import InputError, unknown_name
from twin.records.schema import VARIABLES

Frame = Literal["FRD", "FLU"]

SHIPPED = Path(__file__).parent / "mappings"
"""Folder of the mappings that come with the program, by name."""
FRAMES = ("FRD", "FLU")
"""Body axes: forward-starboard-down, which stores have, and forward-port-up."""
LOCKS = {"bottom": 1.0, "water": 2.0}
"""`measured_dvl_mode` of each lock; 0 is none."""
TURNED = frozenset(
    f"{group}_{name}"
    for group in ("measured", "true", "commanded")
    for name in (
        "pitch", "pitch_rate", "yaw_rate", "specific_force_y", "specific_force_z", "dvl_sway",
        "dvl_heave", "sway", "heave",
    )
)  # fmt: skip
"""Signals whose sign FLU turns: what is along or about the second and third axis. Roll is about
the first; a heading says itself where it begins and which way it turns."""
HEADINGS = frozenset({"measured_heading", "commanded_heading", "true_heading"})
LOG_ONLY: dict[str, tuple[str, str]] = {
    "latitude": ("degree", "the vehicle's own track"),
    "longitude": ("degree", "the vehicle's own track"),
    "gps_latitude": ("degree", "GPS fixes; a position that repeats is one fix"),
    "gps_longitude": ("degree", "GPS fixes"),
    "conductivity": ("S m-1", "of the CTD; salinity and density are made of it"),
    "magnetic_variation": ("degree", "east positive"),
    "dive": ("1", "the vehicle's own number of the dive"),
    "thruster": ("1", "above 0 where a propeller drives"),
    "dac_north": ("m s-1", "depth-averaged current that the vehicle reports"),
    "dac_east": ("m s-1", "depth-averaged current that the vehicle reports"),
}
"""Signals that rows are made from and stores do not hold as they are: unit and meaning."""
_MADE = frozenset(
    name
    for name in VARIABLES
    if name.startswith(("measured_gps", "measured_onboard"))
    or name in ("measured_phase", "measured_gap", "true_north", "true_east")
)
"""Signals that the import makes itself."""
ISO = "iso"
_CLOCK_UNITS = (*SECONDS, ISO)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Signal:
    """What one column is; `[signals.NAME]` of a mapping, NAME as in stores."""

    column: str
    """Name of the column."""
    unit: str = ""
    """As in `factory.importing.reading.units`; may be left out where the signal has none."""
    frame: Frame | None = None
    """Body axes of this column, instead of the file's."""
    sign: float = 1.0
    """-1 where the column counts the other way than the frame says."""
    sentinels: tuple[float, ...] = ()
    """Values, as the file has them, that mean no measurement."""
    possible: tuple[float, float] | None = None
    """Lowest and highest possible value, in the store's unit."""
    optional: bool = False
    """Whether files may lack the column."""
    held: bool = False
    """Whether the last value holds until the next one, instead of a straight line."""
    zero: Literal["north", "east"] = "north"
    """Where a heading is 0."""
    turns: Literal["clockwise", "counterclockwise"] = "clockwise"
    """Which way a heading grows, seen from above."""
    north: Literal["true", "magnetic"] = "true"
    """Which north a heading is from."""

    def wanted(self, name: str) -> str:
        """Unit of the signal in a store."""
        return LOG_ONLY[name][0] if name in LOG_ONLY else VARIABLES[name].units

    def turn(self, name: str, frame: Frame) -> float:
        """Sign between the column and the store."""
        turned = (self.frame or frame) == "FLU" and name in TURNED
        return -self.sign if turned else self.sign


@dataclasses.dataclass(frozen=True, kw_only=True)
class Clock:
    """Where times come from; `[time]` of a mapping."""

    column: str
    unit: str = "s"
    """s, ms, us, ns, min, h, days; iso for written times."""
    start: float | None = None
    """[s] unix time of the clock's zero; None: the column says the whole time."""
    start_from_name: str | None = None
    """Regular expression whose group is the date, ISO 8601, in a file's name."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Correction:
    """Some files whose column is not what the mapping says; `[[corrections]]`."""

    files: str
    """Pattern of the files' names, such as 20220719_*."""
    signal: str
    reason: str
    changes: Dict[str, Any]
    """Fields of `Signal` that are different in these files."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mapping:
    """What the columns of a vehicle's tables are."""

    name: str
    """Of the mapping file, for messages."""
    vehicle: str
    """Name of the vehicle or its make."""
    time: Clock
    signals: Dict[str, Signal]
    ignored: Dict[str, str] = dataclasses.field(default_factory=dict)
    """Patterns of columns that are left out, and why."""
    corrections: tuple[Correction, ...] = ()
    frame: Frame = "FRD"
    """Body axes of the file."""
    dvl_lock: Literal["bottom", "water"] | None = None
    """What the Doppler log measures against, where no column says it: its lock is that wherever
    it has a velocity."""
    model: str | None = None
    """Vehicle file whose parts the controls are; it stands for the vehicle in the store."""
    deployment: Literal["file", "name", "column"] = "file"
    """What tells deployments apart."""
    deployment_word: str = ""
    """Name of the deployment, or of the column that has it."""
    rows: Literal["dives", "file", "gaps", "minutes"] = "dives"
    """What a row of the store is."""
    minutes: float = 0.0
    """[min] of a row, with `rows` of minutes."""
    gap_s: float = 60.0
    """[s] A longer hole in the times ends a row, where rows are not dives."""
    period_s: float | None = None
    """[s] Period of the store; None: the table's usual spacing."""

    def reason(self, column: str) -> str | None:
        """Why a column is left out; None where the mapping does not say."""
        for pattern, why in self.ignored.items():
            if fnmatch.fnmatchcase(column, pattern):
                return why
        return None

    def signals_of(self, path: Path) -> dict[str, tuple[Signal, str]]:
        """The signals of one file, each with the reason of its correction or ""."""
        found = {name: (signal, "") for name, signal in self.signals.items()}
        for one in self.corrections:
            if fnmatch.fnmatchcase(path.name, one.files):
                signal = dataclasses.replace(found[one.signal][0], **one.changes)
                found[one.signal] = (signal, one.reason)
        return found


def shipped_names() -> list[str]:
    """Names of the mappings that come with the program."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def load_mapping(name: str | Path) -> Mapping:
    """A mapping by the path of its file, or by the name of one that is shipped.

    Raises:
      InputError: no such file; not TOML; an unknown or wrong key, signal, unit or reason.
    """
    path = Path(name)
    if not path.is_file():
        path = SHIPPED / f"{name}.toml"
    if not path.is_file():
        raise InputError(
            f"no mapping file {name}: "
            f"{unknown_name('shipped mapping', str(name), shipped_names())}; docs/real.md shows "
            "how to write one"
        )
    return parse_mapping(read_toml(path, "mapping"), path.name)


def parse_mapping(data: Dict[str, Any], label: str) -> Mapping:
    """A mapping from what its TOML file says; errors as `load_mapping`."""
    label = f"mapping {label}"
    keys = ("vehicle", "frame", "dvl_lock", "model", "deployment", "rows", "gap_s", "period_s",
            "time", "signals", "ignored", "corrections")  # fmt: skip
    _known(label, data, keys)
    for key in ("vehicle", "time", "signals"):
        if key not in data:
            raise InputError(f"{label}: {key} is missing; docs/real.md shows a whole mapping")
    model = _text(label, "model", data["model"]) if "model" in data else None
    if model is not None:
        _declare_parts(model)
    signals = {
        name: _signal(f"{label}, signals.{name}", name, entry, model)
        for name, entry in _table(label, "signals", data["signals"]).items()
    }
    for name in ("latitude", "gps_latitude"):
        other = name.replace("latitude", "longitude")
        if (name in signals) != (other in signals):
            raise InputError(f"{label}: {name} and {other} belong together; map both or neither")
    ignored = _table(label, "ignored", data.get("ignored", {}))
    for pattern, why in ignored.items():
        if not isinstance(why, str) or not why.strip():
            raise InputError(f"{label}: ignored.{pattern} must say why, as a text, not {why!r}")
        mapped = [n for n, s in signals.items() if fnmatch.fnmatchcase(s.column, pattern)]
        if mapped:
            raise InputError(
                f"{label}: column {signals[mapped[0]].column!r} is {mapped[0]} and ignored as "
                f"{pattern!r} too; do one"
            )
    dvl_lock = data.get("dvl_lock")
    if dvl_lock is not None:
        _one_of(label, "dvl_lock", dvl_lock, tuple(LOCKS))
        if "measured_dvl_mode" in signals:
            raise InputError(f"{label}: dvl_lock and measured_dvl_mode say the same; give one")
        if "measured_dvl_surge" not in signals:
            raise InputError(f"{label}: dvl_lock needs measured_dvl_surge; map it, or leave it out")
    deployment, word = _deployment(label, data.get("deployment", "file"))
    rows, minutes = _rows(label, data.get("rows", "dives"))
    if rows == "dives" and not {"measured_depth", "measured_pressure"} & set(signals):
        raise InputError(
            f'{label}: rows = "dives" needs measured_depth or measured_pressure; map one, or say '
            'rows = "file", rows = "gaps" or a number of minutes'
        )
    return Mapping(
        name=label,
        vehicle=_text(label, "vehicle", data["vehicle"]),
        time=_clock(label, data["time"]),
        signals=signals,
        ignored=ignored,
        corrections=tuple(
            _correction(f"{label}, corrections[{k}]", one, signals)
            for k, one in enumerate(_list(label, "corrections", data.get("corrections", [])))
        ),
        frame=_one_of(label, "frame", data.get("frame", "FRD"), FRAMES),
        dvl_lock=dvl_lock,
        model=model,
        deployment=deployment,
        deployment_word=word,
        rows=rows,
        minutes=minutes,
        gap_s=_positive(label, "gap_s", data.get("gap_s", Mapping.gap_s)),
        period_s=_positive(label, "period_s", data["period_s"]) if "period_s" in data else None,
    )


def signal_names() -> list[str]:
    """Every signal that a column can be mapped to."""
    return [*(name for name in VARIABLES if name not in _MADE), *LOG_ONLY]


def _declare_parts(model: str) -> None:
    """Let the schema know the controls of a vehicle."""
    from twin.physics.part_signals import declare_parts
    from twin.vehicle.vehicle import load_vehicle

    declare_parts(load_vehicle(model))


def _signal(label: str, name: str, entry: object, model: str | None) -> Signal:
    allowed = signal_names()
    if name not in allowed:
        if name in _MADE:
            raise InputError(
                f"{label}: the import makes {name} itself; map gps_latitude and gps_longitude, or "
                "latitude and longitude of the vehicle's own track"
            )
        hint = "" if model else (
            '; for controls of a vehicle\'s parts say whose: model = "tethys" or an own vehicle.xml'
        )  # fmt: skip
        raise InputError(f"{label}: {unknown_name('signal', name, allowed)}{hint}")
    if isinstance(entry, str):
        entry = {"column": entry}
    values = dict(_table(label, "", entry))
    _known(label, values, [field.name for field in dataclasses.fields(Signal)])
    if "column" not in values:
        raise InputError(f"{label}: column is missing: which column of the table is it?")
    signal = Signal(**_checked(label, name, values))
    wanted = signal.wanted(name)
    if not signal.unit and wanted != "1":
        raise InputError(
            f"{label}: unit is missing; take one of {', '.join(known_units(wanted))}"
        )  # fmt: skip
    if signal.unit and signal.unit != wanted:
        in_unit(np.zeros(0), signal.unit, wanted, label)
    return signal


def _checked(label: str, name: str, values: Dict[str, Any]) -> dict[str, Any]:
    """Fields of a `Signal` with the types that they must have."""
    found: dict[str, Any] = dict(values)
    for key, allowed in (
        ("frame", FRAMES),
        ("zero", ("north", "east")),
        ("turns", ("clockwise", "counterclockwise")),
        ("north", ("true", "magnetic")),
    ):
        if key in found:
            _one_of(label, key, found[key], allowed)
            if key != "frame" and name not in HEADINGS:
                raise InputError(f"{label}: {key} is for headings ({', '.join(sorted(HEADINGS))})")
    for key in ("column", "unit"):
        if key in found:
            found[key] = _text(label, key, found[key])
    for key in ("optional", "held"):
        if key in found and not isinstance(found[key], bool):
            raise InputError(f"{label}: {key} must be true or false, not {found[key]!r}")
    if "sign" in found and (isinstance(found["sign"], bool) or found["sign"] not in (1, -1)):
        raise InputError(f"{label}: sign must be 1 or -1, not {found['sign']!r}")
    if "sentinels" in found:
        sentinels = _list(label, "sentinels", found["sentinels"])
        found["sentinels"] = tuple(_number(label, "sentinels", value) for value in sentinels)
    if "possible" in found:
        both = [_number(label, "possible", v) for v in _list(label, "possible", found["possible"])]
        if len(both) != 2 or not both[0] < both[1]:
            raise InputError(f"{label}: possible must be [lowest, highest], not {both}")
        found["possible"] = (both[0], both[1])
    return found


def _clock(label: str, entry: object) -> Clock:
    label = f"{label}, time"
    values = dict(_table(label, "", entry))
    _known(label, values, [field.name for field in dataclasses.fields(Clock)])
    if "column" not in values:
        raise InputError(f"{label}: column is missing: which column of the table is the time?")
    unit = str(values.get("unit", "s")).lower()
    if unit not in _CLOCK_UNITS:
        raise InputError(f"{label}: {unknown_name('unit of time', unit, _CLOCK_UNITS)}")
    if "start" in values and "start_from_name" in values:
        raise InputError(f"{label}: start and start_from_name both say when; give one")
    start = _moment(label, values["start"]) if "start" in values else None
    pattern = values.get("start_from_name")
    if pattern is not None:
        pattern = _text(label, "start_from_name", pattern)
        if compile_pattern(pattern, f"{label}: start_from_name").groups != 1:
            raise InputError(
                f"{label}: start_from_name must have one group in brackets, the date, such as "
                r"'^(\d{8})_'"
            )
    if unit == ISO and (start is not None or pattern is not None):
        raise InputError(f"{label}: iso times are whole ones; leave start and start_from_name out")
    return Clock(
        column=_text(label, "column", values["column"]),
        unit=unit,
        start=start,
        start_from_name=pattern,
    )


def _moment(label: str, value: object) -> float:
    """Unix time of a TOML date or time, or of one in a text; without a zone it is UTC."""
    moment: Any = value
    if isinstance(value, str):
        try:
            moment = datetime.datetime.fromisoformat(value)
        except ValueError:
            moment = None
    if isinstance(moment, datetime.date) and not isinstance(moment, datetime.datetime):
        moment = datetime.datetime(moment.year, moment.month, moment.day)
    if not isinstance(moment, datetime.datetime):
        raise InputError(
            f"{label}: start must be a time such as 2022-06-25T08:00:00Z, not {value!r}"
        )
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=datetime.UTC)
    return moment.timestamp()


def _correction(label: str, entry: object, signals: Dict[str, Signal]) -> Correction:
    values = dict(_table(label, "", entry))
    for key in ("files", "signal", "reason"):
        if key not in values:
            raise InputError(f"{label}: {key} is missing")
    files, signal, reason = (_text(label, k, values.pop(k)) for k in ("files", "signal", "reason"))
    if signal not in signals:
        raise InputError(f"{label}: {unknown_name('mapped signal', signal, signals)}")
    allowed = [field.name for field in dataclasses.fields(Signal)]
    _known(label, values, ["files", "signal", "reason", *allowed])
    if not values:
        raise InputError(f"{label}: it changes nothing; give one of {', '.join(allowed)}")
    return Correction(
        files=files, signal=signal, reason=reason, changes=_checked(label, signal, values)
    )


def _deployment(label: str, value: object) -> tuple[Literal["file", "name", "column"], str]:
    if value == "file":
        return "file", ""
    if isinstance(value, dict) and len(value) == 1:
        ((key, word),) = value.items()
        if key in ("name", "column"):
            return key, _text(label, f"deployment.{key}", word)
    raise InputError(
        f'{label}: deployment must be "file", {{ name = "..." }} for all files together, or '
        f'{{ column = "..." }}, not {value!r}'
    )


def _rows(
    label: str, value: object
) -> tuple[Literal["dives", "file", "gaps", "minutes"], float]:  # fmt: skip
    if isinstance(value, int | float) and not isinstance(value, bool):
        return "minutes", _positive(label, "rows", value)
    if value in ("dives", "file", "gaps"):
        return value, 0.0
    raise InputError(
        f'{label}: rows must be "dives", "file", "gaps" or a number of minutes, not {value!r}'
    )


def _known(label: str, values: Dict[str, Any], allowed: Sequence[str]) -> None:
    for key in values:
        if key not in allowed:
            raise InputError(f"{label}: {unknown_name('key', key, allowed)}")


def _table(label: str, key: str, value: object) -> Dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{label}: {key or 'it'} must be a table of keys, not {value!r}")
    return value


def _list(label: str, key: str, value: object) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{label}: {key} must be a list, not {value!r}")
    return value


def _text(label: str, key: str, value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{label}: {key} must be a text, not {value!r}")
    return value


def _number(label: str, key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{label}: {key} must be a finite number, not {value!r}")
    return float(value)


def _positive(label: str, key: str, value: object) -> float:
    number = _number(label, key, value)
    if not number > 0.0:
        raise InputError(f"{label}: {key} must be above 0, not {number:g}")
    return number


def _one_of(label: str, key: str, value: object, allowed: Sequence[str]) -> Any:
    if value not in allowed:
        raise InputError(f"{label}: {unknown_name(key, str(value), allowed)}")
    return value
