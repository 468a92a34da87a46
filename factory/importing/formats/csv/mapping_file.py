"""Mapping file: the TOML text of a mapping, checked key by key.

Errors about unknown keys, signals and units name the nearest known one.

An error about a value of the wrong type names its key.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import fnmatch
import math
from collections.abc import Mapping as Dict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from factory.importing.formats.csv.mapping import (
    CLOCK_UNITS,
    FRAMES,
    HEADINGS,
    LOCKS,
    LOG_ONLY,
    MADE,
    SHIPPED,
    Clock,
    Correction,
    Mapping,
    Signal,
)
from factory.importing.sample_clock import in_utc
from factory.importing.units import in_unit, known_units
from twin.bounded import compile_pattern, read_toml
from twin.errors import InputError, unknown_name
from twin.records.schema import VARIABLES


def known_keys(label: str, values: Dict[str, Any], allowed: Sequence[str]) -> None:
    """Refuse a key that is not allowed, and offer the nearest one."""
    for key in values:
        if key not in allowed:
            raise InputError(f"{label}: {unknown_name('key', key, allowed)}")


def table(label: str, key: str, value: object) -> Dict[str, Any]:
    """Check that a value is a table of keys."""
    if not isinstance(value, dict):
        raise InputError(f"{label}: {key or 'it'} must be a table of keys, not {value!r}")
    return value


def list_of(label: str, key: str, value: object) -> list[Any]:
    """Check that a value is a list."""
    if not isinstance(value, list):
        raise InputError(f"{label}: {key} must be a list, not {value!r}")
    return value


def text(label: str, key: str, value: object) -> str:
    """Check that a value is a text that is not blank."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{label}: {key} must be a text, not {value!r}")
    return value


def number(label: str, key: str, value: object) -> float:
    """Check that a value is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{label}: {key} must be a finite number, not {value!r}")
    return float(value)


def positive(label: str, key: str, value: object) -> float:
    """Check that a value is a number above 0."""
    found = number(label, key, value)
    if not found > 0.0:
        raise InputError(f"{label}: {key} must be above 0, not {found:g}")
    return found


def one_of(label: str, key: str, value: object, allowed: Sequence[str]) -> Any:
    """Check that a value is one of the allowed words."""
    if value not in allowed:
        raise InputError(f"{label}: {unknown_name(key, str(value), allowed)}")
    return value


def moment(label: str, value: object) -> float:
    """Unix time of a TOML date or time, or of a written one; without a zone it is UTC."""
    found: Any = value
    if isinstance(value, datetime.date | str):
        with contextlib.suppress(ValueError):
            found = datetime.datetime.fromisoformat(str(value))
    if not isinstance(found, datetime.datetime):
        raise InputError(
            f"{label}: start must be a time such as 2022-06-25T08:00:00Z, not {value!r}"
        )
    return in_utc(found)


def load_mapping(name: str | Path, *, timed: bool = False) -> Mapping:
    """Load a mapping by the path of its file, or by the name of a shipped one.

    Args:
      timed: the log has its own times, as messages have. A table [time] is then refused, and rows
        end at gaps unless the mapping states otherwise.

    Raises:
      InputError: no such file; not TOML; an unknown or wrong key, signal, unit or reason.
    """
    path = Path(name)
    if not path.is_file():
        path = SHIPPED / f"{name}.toml"
    if not path.is_file():
        nearest = unknown_name("shipped mapping", str(name), shipped_names())
        raise InputError(
            f"no mapping file {name}: {nearest}; docs/howto/import_tables.md shows how to write one"
        )
    return parse_mapping(read_toml(path, "mapping"), path.name, timed=timed)


def shipped_names() -> list[str]:
    """Names of the mappings that come with the program."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def parse_mapping(data: Dict[str, Any], label: str, *, timed: bool = False) -> Mapping:
    """Make a mapping from the contents of its TOML file; errors as in `load_mapping`."""
    label = f"mapping {label}"
    own = ("start",) if timed else ("time", "deployment", "corrections", "columns")
    common = ("vehicle", "frame", "dvl_lock", "model", "rows", "gap_s", "period_s", "signals")
    known_keys(label, data, (*common, "ignored", *own))
    for key in ("vehicle", "signals") if timed else ("vehicle", "time", "signals"):
        if key not in data:
            raise InputError(
                f"{label}: {key} is missing; docs/howto/import_tables.md shows a whole mapping"
            )
    model = text(label, "model", data["model"]) if "model" in data else None
    if model is not None:
        declare_model(model)
    signals = {
        name: _signal(f"{label}, signals.{name}", name, entry, model)
        for name, entry in table(label, "signals", data["signals"]).items()
    }
    for name, other in (
        ("latitude", "longitude"),
        ("gps_latitude", "gps_longitude"),
        ("onboard_north", "onboard_east"),
    ):
        if (name in signals) != (other in signals):
            raise InputError(f"{label}: {name} and {other} belong together; map both or neither")
    if "gps_fix" in signals and "gps_latitude" not in signals and not timed:
        raise InputError(f"{label}: gps_fix judges gps_latitude and gps_longitude; map these too")
    ignored = table(label, "ignored", data.get("ignored", {}))
    for pattern, why in ignored.items():
        if not isinstance(why, str) or not why.strip():
            raise InputError(f"{label}: ignored.{pattern} needs a reason, as a text, not {why!r}")
        for name, signal in signals.items():
            if fnmatch.fnmatchcase(signal.column, pattern):
                raise InputError(
                    f"{label}: column {signal.column!r} is {name} and ignored as {pattern!r} too; "
                    "do one"
                )
    dvl_lock = data.get("dvl_lock")
    if dvl_lock is not None:
        one_of(label, "dvl_lock", dvl_lock, tuple(LOCKS))
        if "measured_dvl_mode" in signals:
            raise InputError(f"{label}: dvl_lock and measured_dvl_mode mean the same; give one")
        if "measured_dvl_surge" not in signals:
            raise InputError(f"{label}: dvl_lock needs measured_dvl_surge; map it, or leave it out")
    columns = [
        text(label, "columns", c) for c in list_of(label, "columns", data.get("columns", []))
    ]
    for column in columns:
        if columns.count(column) > 1:
            raise InputError(f"{label}: columns names {column!r} twice; give each its own name")
    deployment, word = _deployment(label, data.get("deployment", "file"))
    rows, minutes = _rows(label, data.get("rows", "gaps" if timed else "dives"))
    if not timed and rows == "dives" and not {"measured_depth", "measured_pressure"} & set(signals):
        raise InputError(
            f'{label}: rows = "dives" needs measured_depth or measured_pressure; map one, or write '
            'rows = "file", rows = "gaps" or a number of minutes'
        )
    start = moment(label, data["start"]) if "start" in data else None
    return Mapping(
        name=label,
        vehicle=text(label, "vehicle", data["vehicle"]),
        time=Clock(column="", start=start) if timed else _clock(f"{label}, time", data["time"]),
        signals=signals,
        ignored=ignored,
        corrections=tuple(
            _correction(f"{label}, corrections[{k}]", one, signals)
            for k, one in enumerate(list_of(label, "corrections", data.get("corrections", [])))
        ),
        columns=tuple(columns),
        frame=one_of(label, "frame", data.get("frame", "FRD"), FRAMES),
        dvl_lock=dvl_lock,
        model=model,
        deployment=deployment,
        deployment_word=word,
        rows=rows,
        minutes=minutes,
        gap_s=positive(label, "gap_s", data.get("gap_s", Mapping.gap_s)),
        period_s=positive(label, "period_s", data["period_s"]) if "period_s" in data else None,
    )


def signal_names() -> list[str]:
    """Every signal that a column can be mapped to."""
    return [*(name for name in VARIABLES if name not in MADE), *LOG_ONLY]


def declare_model(model: str) -> None:
    """Declare the controls of a vehicle in the schema."""
    from twin.physics.true_signals import declare_parts
    from twin.vehicle.vehicle import load_vehicle

    declare_parts(load_vehicle(model))


def _signal(label: str, name: str, entry: object, model: str | None) -> Signal:
    allowed = signal_names()
    if name in MADE:
        raise InputError(
            f"{label}: the import makes {name} itself; map gps_latitude and gps_longitude, or "
            "latitude and longitude of the vehicle's own track"
        )
    if name not in allowed:
        hint = '; for controls of parts name the vehicle: model = "tethys" or an own vehicle.xml'
        raise InputError(f"{label}: {unknown_name('signal', name, allowed)}{'' if model else hint}")
    values = table(label, "", {"column": entry} if isinstance(entry, str) else entry)
    known_keys(label, values, _FIELDS)
    if "column" not in values:
        raise InputError(f"{label}: column is missing: which column of the table is it?")
    signal = Signal(**_checked(label, name, values))
    wanted = signal.wanted(name)
    if not signal.unit and signal.needs_unit(name):
        raise InputError(f"{label}: unit is missing; take one of {', '.join(known_units(wanted))}")
    in_unit(np.zeros(0), signal.unit, wanted, label)
    return signal


_FIELDS = tuple(field.name for field in dataclasses.fields(Signal))


def _checked(label: str, name: str, values: Dict[str, Any]) -> dict[str, Any]:
    """Check the fields of a `Signal`; return them with the types that they must have."""
    found: dict[str, Any] = dict(values)
    for key, allowed in _CHOICES.items():
        if key in found:
            one_of(label, key, found[key], allowed)
            if key != "frame" and name not in HEADINGS:
                raise InputError(f"{label}: {key} is for headings ({', '.join(sorted(HEADINGS))})")
    for key in ("column", "unit"):
        if key in found:
            text(label, key, found[key])
    for key in ("optional", "held"):
        if not isinstance(found.get(key, False), bool):
            raise InputError(f"{label}: {key} must be true or false, not {found[key]!r}")
    sign = found.get("sign", 1)
    if isinstance(sign, bool) or sign not in (1, -1):
        raise InputError(f"{label}: sign must be 1 or -1, not {sign!r}")
    for key in ("sentinels", "possible"):
        if key in found:
            found[key] = tuple(number(label, key, v) for v in list_of(label, key, found[key]))
    both = found.get("possible", (0.0, 1.0))
    if len(both) != 2 or not both[0] < both[1]:
        raise InputError(f"{label}: possible must be [lowest, highest], not {list(both)}")
    return found


_CHOICES = {
    "frame": FRAMES,
    "zero": ("north", "east"),
    "turns": ("clockwise", "counterclockwise"),
    "north": ("true", "magnetic"),
}
"""Allowed words of a signal's keys."""


def _clock(label: str, entry: object) -> Clock:
    values = table(label, "", entry)
    known_keys(label, values, [field.name for field in dataclasses.fields(Clock)])
    if "column" not in values:
        raise InputError(f"{label}: column is missing: which column of the table is the time?")
    unit = str(values.get("unit", "s"))
    if "%" in unit:
        _check_layout(label, unit)
    elif (unit := unit.lower()) not in CLOCK_UNITS:
        raise InputError(f"{label}: {unknown_name('unit of time', unit, CLOCK_UNITS)}")
    if "start" in values and "start_from_name" in values:
        raise InputError(f"{label}: start and start_from_name both set the start; give one")
    start = moment(label, values["start"]) if "start" in values else None
    pattern = values.get("start_from_name")
    if pattern is not None:
        pattern = text(label, "start_from_name", pattern)
        if compile_pattern(pattern, f"{label}: start_from_name").groups != 1:
            raise InputError(
                f"{label}: start_from_name must have one group in brackets, the date, such as "
                r"'^(\d{8})_'"
            )
    column = text(label, "column", values["column"])
    clock = Clock(column=column, unit=unit, start=start, start_from_name=pattern)
    if clock.written and (start is not None or pattern is not None):
        raise InputError(
            f"{label}: written times are whole ones; leave start and start_from_name out"
        )
    return clock


def _check_layout(label: str, layout: str) -> None:
    """Refuse a `strptime` layout that reads no date."""
    moment = datetime.datetime(2019, 11, 23, 14, 58, 37)
    try:
        read = datetime.datetime.strptime(moment.strftime(layout), layout)
    except ValueError as error:
        raise InputError(f"{label}: unit = {layout!r} is no layout of strptime: {error}") from error
    if read.date() != moment.date():
        raise InputError(
            f"{label}: unit = {layout!r} has no year, month and day, such as %Y-%m-%d %H:%M:%S has"
        )


def _correction(label: str, entry: object, signals: Dict[str, Signal]) -> Correction:
    values = dict(table(label, "", entry))
    keys = ("files", "signal", "reason")
    for key in keys:
        if key not in values:
            raise InputError(f"{label}: {key} is missing")
    files, signal, reason = (text(label, key, values.pop(key)) for key in keys)
    if signal not in signals:
        raise InputError(f"{label}: {unknown_name('mapped signal', signal, signals)}")
    known_keys(label, values, (*keys, *_FIELDS))
    if not values:
        raise InputError(f"{label}: it changes nothing; give one of {', '.join(_FIELDS)}")
    changes = _checked(label, signal, values)
    return Correction(files=files, signal=signal, reason=reason, changes=changes)


def _deployment(label: str, value: object) -> tuple[Literal["file", "name", "column"], str]:
    if value == "file":
        return "file", ""
    if isinstance(value, dict) and len(value) == 1:
        ((key, word),) = value.items()
        if key in ("name", "column"):
            return key, text(label, f"deployment.{key}", word)
    raise InputError(
        f'{label}: deployment must be "file", {{ name = "..." }} for all files together, or '
        f'{{ column = "..." }}, not {value!r}'
    )


def _rows(
    label: str, value: object
) -> tuple[Literal["dives", "file", "gaps", "minutes"], float]:  # fmt: skip
    if isinstance(value, int | float) and not isinstance(value, bool):
        return "minutes", positive(label, "rows", value)
    if value in ("dives", "file", "gaps"):
        return value, 0.0
    raise InputError(
        f'{label}: rows must be "dives", "file", "gaps" or a number of minutes, not {value!r}'
    )
