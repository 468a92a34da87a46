"""ArduSub reader: ArduPilot's dataflash logs (.BIN) of ArduSub vehicles.

Body axes are forward, starboard, down. Depth is minus the barometric altitude of CTUN. Attitude is
the filter's (ATT); its heading is from true north if ArduPilot knows the declination. The track is
the position of the first filter core, from its origin.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from factory.importing import (
    DeploymentLog,
    ReadOptions,
    Signal,
    Tally,
    each_file,
    note_unread,
    unit_to_take,
)
from factory.importing.messages import (
    MessageTable,
    log_of_messages,
    mapping_of,
    wanted_fields,
    with_standard,
)
from twin.errors import InputError

GAP = 10.0
"""[s] Gap between two samples above which the vehicle was off and a new row begins"""
STANDARD = {
    "measured_depth": Signal(column="CTUN BAlt", unit="m", sign=-1.0),
    "measured_roll": Signal(column="ATT Roll", unit="deg"),
    "measured_pitch": Signal(column="ATT Pitch", unit="deg"),
    "measured_heading": Signal(column="ATT Yaw", unit="deg"),
    "measured_roll_rate": Signal(column="IMU GyrX", unit="rad/s"),
    "measured_pitch_rate": Signal(column="IMU GyrY", unit="rad/s"),
    "measured_yaw_rate": Signal(column="IMU GyrZ", unit="rad/s"),
    "measured_specific_force_x": Signal(column="IMU AccX", unit="m/s2"),
    "measured_specific_force_y": Signal(column="IMU AccY", unit="m/s2"),
    "measured_specific_force_z": Signal(column="IMU AccZ", unit="m/s2"),
    "measured_voltage": Signal(column="BAT Volt", unit="V"),
    "measured_battery_current": Signal(column="BAT Curr", unit="A"),
    "measured_charge": Signal(column="BAT CurrTot", unit="mAh"),
    "gps_latitude": Signal(column="GPS Lat", unit="deg"),
    "gps_longitude": Signal(column="GPS Lng", unit="deg"),
    "onboard_north": Signal(column="XKF1 PN", unit="m"),
    "onboard_east": Signal(column="XKF1 PE", unit="m"),
}
"""Signals with their ArduPilot fields, and units for logs that name none"""
FIRST = ("I", "Instance", "C")
"""Fields with the number of a sensor or filter core; only messages with number 0 are read"""
FIXED = 3
"""Smallest status of a GPS message that has a position"""


def read_ardusub(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Read one log from each file.

    Raises:
      ModuleNotFoundError: pymavlink is not installed.
      InputError: a file is no dataflash log, has no known message, or contradicts the mapping.
    """
    import pymavlink.DFReader  # noqa: F401  (a missing package must not look like a bad file)

    return [log for _, log in each_file(paths, lambda path: _log(path, options, tally), tally)]


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a log with pymavlink, suppress its printed messages, and always close the log."""
    from pymavlink.DFReader import DFReader_binary

    # Python cannot redirect what the compiled indexer prints, so the Python indexer is used
    quiet: Any = type(
        "Quiet", (DFReader_binary,), {"init_arrays_fast": DFReader_binary.init_arrays}
    )
    log, silent = quiet.__new__(quiet), io.StringIO()
    with contextlib.redirect_stderr(silent), contextlib.redirect_stdout(silent):
        try:
            try:
                log.__init__(str(path))
            except Exception as error:
                raise InputError(
                    f"{path.name} is no dataflash log of ArduPilot: {' '.join(str(error).split())}"
                ) from error
            yield log
        finally:
            for name in ("data_map", "filehandle"):
                if hasattr(log, name):
                    getattr(log, name).close()


def _log(path: Path, options: ReadOptions, tally: Tally) -> DeploymentLog:
    with _opened(path) as log:
        return _log_of(path, log, options, tally)


def _log_of(path: Path, log: Any, options: ReadOptions, tally: Tally) -> DeploymentLog:
    mapping = mapping_of(options, "ArduSub", None, GAP)
    formats = {one.name: one.columns for one in log.formats.values() if one.name != "FMT"}
    units = {f"{f.name} {c}": f.get_unit(c) for f in log.formats.values() for c in f.columns}
    standard = {
        name: dataclasses.replace(signal, unit=unit)
        for name, signal in STANDARD.items()
        if (said := signal.column.split())[1] in formats.get(said[0], ())
        and (unit := _unit(name, signal, units, tally)) is not None
    }
    mapping = with_standard(mapping, standard, tally)
    wanted = {t: f for t, f in wanted_fields(mapping).items() if t in formats}
    rows: dict[str, list[list[float]]] = {topic: [] for topic in wanted}
    present: dict[str, None] = {}
    while (message := log.recv_msg()) is not None:
        kind = message.get_type()
        present.setdefault(kind)
        if kind in wanted and _is_first(message, formats[kind]):
            rows[kind].append([message._timestamp, *_values(message, kind, wanted[kind])])
    note_unread("dataflash log", present, wanted, tally)
    tables = {}
    for kind, every in rows.items():
        if every:
            values = np.array(every, float).T
            tables[kind] = MessageTable(values[0], dict(zip(wanted[kind], values[1:], strict=True)))
    signals = {
        name: signal
        for name, signal in mapping.signals.items()
        if name not in standard or signal.column.split()[0] in tables
    }
    mapping = dataclasses.replace(mapping, signals=signals)
    return log_of_messages(
        path, path.name.partition(".")[0], list(present), tables, mapping, options, tally
    )


def _unit(name: str, signal: Signal, units: Mapping[str, str], tally: Tally) -> str | None:
    """Unit of a field from the log's own table, or else from STANDARD; None for a wrong unit."""
    said, wanted = units.get(signal.column, ""), signal.wanted(name)
    return unit_to_take(said, wanted, signal.column, tally, native=signal.unit)


def _is_first(message: Any, fields: Sequence[str]) -> bool:
    return all(getattr(message, name) == 0 for name in FIRST if name in fields)


def _values(message: Any, kind: str, fields: Sequence[str]) -> list[float]:
    """Numbers in a message's fields; missing fields and a GPS message without a fix give NaN."""
    if kind == "GPS" and getattr(message, "Status", FIXED) < FIXED:
        return [np.nan] * len(fields)
    found = []
    for name in fields:
        value = getattr(message, name, None)
        found.append(float(value) if isinstance(value, int | float) else np.nan)
    return found
