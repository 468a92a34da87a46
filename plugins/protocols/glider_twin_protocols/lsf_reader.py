"""LSF reader: logs of LSTS's vehicles (.lsf, .lsf.gz), which DUNE writes on a LAUV.

Body axes are forward, starboard, down, and world axes north, east, down, as in stores; angles are
in rad (IMC.xml of github.com/LSTS/imc). A topic is a message with the label of its source entity
(`Temperature/CTD`) or with a servo's or thruster's number (`ServoPosition/2`). Two topics are made
here: `DVL` from both velocities of a Doppler log, and `Fins` from the four servos. `Pressure` needs
a mapping: some sensors include the air's pressure, others do not.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Sequence
from collections.abc import Mapping as Dict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing import DeploymentLog, ReadOptions, Signal, Tally, each_file, note_unread
from factory.importing.messages import (
    MessageTable,
    log_of_messages,
    mapping_of,
    valued,
    wanted_fields,
    with_standard,
)
from glider_twin_protocols.lsf_packets import Packets, Source, read_packets
from twin.geodesy import from_tangent_plane
from twin.sensors import DVL_MODES

Array = NDArray[np.float64]

MODEL = "remus"
"""Vehicle file that replaces the vehicle's own if no mapping names another"""
GAP = 10.0
"""[s] Gap between two samples above which the vehicle was off and a new row begins"""
GRAVITY, FAR = 9.81, 0.2
"""[m s-2] GRAVITY. FAR: [1] largest relative difference of a median specific force from it"""
PING = 0.5
"""[s] Time within which velocities belong to one ping, for a log without two distinct times"""
VALID_POSITION, MEASURED = 0x0004, (0, 1)
"""GpsFix. VALID_POSITION: bit of `validity`. MEASURED: measured types (standalone, differential)"""
VELOCITY = {"x": 0x01, "y": 0x02, "z": 0x04}
"""Validity bit of each component of a velocity"""

_SPEEDS = ("validity", *VELOCITY)
FIELDS: dict[str, tuple[str, ...]] = {
    "EstimatedState": ("lat", "lon", "x", "y", "phi", "theta", "psi", "p", "q", "r", "depth"),
    "EulerAngles": ("phi", "theta", "psi", "psi_magnetic"),
    "AngularVelocity": ("x", "y", "z"),
    "Acceleration": ("x", "y", "z"),
    "Depth": ("value",),
    "GroundVelocity": _SPEEDS,
    "WaterVelocity": _SPEEDS,
    "GpsFix": ("validity", "type", "lat", "lon"),
    "Rpm": ("value",),
    "ServoPosition": ("value",),
    "SetServoPosition": ("value",),
    "Temperature": ("value",),
    "Salinity": ("value",),
    "Conductivity": ("value",),
    "Voltage": ("value",),
    "Current": ("value",),
}
"""Fields to read, by message"""

_Standard = tuple[str, str, str, str]
STANDARD: tuple[_Standard, ...] = (
    ("measured_roll", "EstimatedState", "phi", "rad"),
    ("measured_pitch", "EstimatedState", "theta", "rad"),
    ("measured_heading", "EstimatedState", "psi", "rad"),
    ("measured_roll", "EulerAngles", "phi", "rad"),
    ("measured_pitch", "EulerAngles", "theta", "rad"),
    ("measured_heading", "EulerAngles", "psi", "rad"),
    ("measured_roll_rate", "AngularVelocity", "x", "rad/s"),
    ("measured_pitch_rate", "AngularVelocity", "y", "rad/s"),
    ("measured_yaw_rate", "AngularVelocity", "z", "rad/s"),
    ("measured_roll_rate", "EstimatedState", "p", "rad/s"),
    ("measured_pitch_rate", "EstimatedState", "q", "rad/s"),
    ("measured_yaw_rate", "EstimatedState", "r", "rad/s"),
    ("measured_specific_force_x", "Acceleration", "x", "m/s2"),
    ("measured_specific_force_y", "Acceleration", "y", "m/s2"),
    ("measured_specific_force_z", "Acceleration", "z", "m/s2"),
    ("measured_depth", "Depth", "value", "m"),
    ("measured_depth", "EstimatedState", "depth", "m"),
    ("measured_dvl_surge", "DVL", "x", "m/s"),
    ("measured_dvl_sway", "DVL", "y", "m/s"),
    ("measured_dvl_heave", "DVL", "z", "m/s"),
    ("measured_dvl_mode", "DVL", "mode", "1"),
    ("measured_bottom_surge", "GroundVelocity", "x", "m/s"),
    ("measured_bottom_sway", "GroundVelocity", "y", "m/s"),
    ("measured_bottom_heave", "GroundVelocity", "z", "m/s"),
    ("measured_propeller", "Rpm", "value", "rpm"),
    ("measured_rudder", "Fins", "rudder", "rad"),
    ("measured_elevator", "Fins", "elevator", "rad"),
    ("commanded_rudder", "SetFins", "rudder", "rad"),
    ("commanded_elevator", "SetFins", "elevator", "rad"),
    ("measured_temperature", "Temperature", "value", "degC"),
    ("measured_salinity", "Salinity", "value", "1"),
    ("conductivity", "Conductivity", "value", "S/m"),
    ("measured_voltage", "Voltage", "value", "V"),
    ("measured_battery_current", "Current", "value", "A"),
    ("gps_latitude", "GpsFix", "lat", "rad"),
    ("gps_longitude", "GpsFix", "lon", "rad"),
    ("latitude", "EstimatedState", "latitude", "deg"),
    ("longitude", "EstimatedState", "longitude", "deg"),
)
"""Signal, message, field and unit; a signal's first source in the log counts"""
HELD = ("measured_dvl_mode", "commanded_rudder", "commanded_elevator")
FINS = {"rudder": (0, 3), "elevator": (1, 2)}
"""Servos of each pair of fins (DUNE's Control/AUV/Allocator). Positive angles turn the vehicle to
port and pitch the nose down, as for the parts of `remus`"""
PAIRS = {"ServoPosition": "Fins", "SetServoPosition": "SetFins"}


def read_lsf(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Read one log from each file.

    Raises:
      ModuleNotFoundError: imcpy is not installed.
      InputError: a file is no IMC log, has no known message, or contradicts the mapping.
    """
    import imcpy  # noqa: F401  (a missing package must not look like a bad file)

    return [log for _, log in each_file(paths, lambda path: _log(path, options, tally), tally)]


def _log(path: Path, options: ReadOptions, tally: Tally) -> DeploymentLog:
    mapping = mapping_of(options, "LAUV", MODEL, GAP)
    if options.mapping is None:
        tally.add("note", MODEL, 1, "stands for the vehicle; a --mapping may name another model")
    wanted = {name: list(fields) for name, fields in FIELDS.items()}
    for topic, fields in wanted_fields(mapping).items():
        known = wanted.setdefault(topic.partition("/")[0], [])
        known += [one for one in fields if one not in known]
    packets = read_packets(path, wanted, tally)
    topics, tables = _tables(packets, tally)
    standard = _standard(tables, mapping.signals, tally)
    mapping = with_standard(mapping, standard, tally)
    used = set(wanted_fields(mapping))
    made = [name for name in PAIRS if PAIRS[name] in used]
    made += [name for name in ("GroundVelocity", "WaterVelocity") if "DVL" in used]
    made += ["EntityInfo", "LoggingControl"]
    read = [*used, *(topic for topic in topics if topic.partition("/")[0] in made)]
    note_unread("IMC log", topics, read, tally)
    return log_of_messages(
        path, _deployment(path, packets.title), topics, tables, mapping, options, tally
    )


def _deployment(path: Path, title: str) -> str:
    """Name of the log from the vehicle, or else of its folder: DUNE calls every file Data."""
    name = path.name.partition(".")[0]
    if title:
        return title.replace("/", "_")
    return path.resolve().parent.name if name == "Data" else name


def _tables(packets: Packets, tally: Tally) -> tuple[list[str], dict[str, MessageTable]]:
    """Topics that the vehicle itself sent, and their tables, with the tables made from others."""
    systems: Counter[int] = Counter()
    for (_, system, _), count in packets.names.items():
        systems[system] += count
    (own, _), *others = systems.most_common()
    tally.add("left out", "other systems", sum(n for _, n in others), "messages that they sent")
    tables: dict[str, MessageTable] = {}
    for source, rows in packets.rows.items():
        if source[1] == own:
            values = np.array(rows, float).T
            columns = dict(zip(packets.fields[source[0]], values[1:], strict=True))
            tables[_topic(source, packets)] = MessageTable(values[0], columns)
    numbered = {name for name, _, part in packets.names if part < 0 and name in packets.fields}
    sent = {_topic(s, packets) for s in packets.names if s[1] == own and s[0] not in numbered}
    topics = sorted({*tables, *sent})
    for topic, table in tables.items():
        tables[topic] = _measured(topic, table, tally)
    dvl = _doppler(tables)
    if dvl is not None:
        tables["DVL"] = dvl
    for name, made in PAIRS.items():
        servos = {k: tables.get(f"{name}/{k}") for pair in FINS.values() for k in pair}
        there = {k: table for k, table in servos.items() if table is not None}
        if len(there) == len(servos):
            tables[made] = _pairs(there)
        elif there:
            why = f"only {len(there)} of the {len(servos)} servos: name each in a --mapping"
            tally.add("left out", name, 1, why)
    return topics, tables


def _topic(source: Source, packets: Packets) -> str:
    """Topic of a source: message and entity label, message and servo number, or the message alone
    if the number was not read."""
    name, system, part = source
    if part < 0:
        return name
    numbered = (name, system, -1) in packets.names
    label = str(part) if numbered else packets.labels.get((system, part), str(part))
    return f"{name}/{label.replace(' ', '_')}"


def _measured(topic: str, table: MessageTable, tally: Tally) -> MessageTable:
    """Table with NaN for values that its messages mark as invalid, and with derived columns."""
    columns = dict(table.columns)
    name = topic.partition("/")[0]
    if name in ("GroundVelocity", "WaterVelocity"):
        said = columns["validity"].astype(int)
        for axis, bit in VELOCITY.items():
            columns[axis] = np.where(said & bit, columns[axis], np.nan)
    elif name == "GpsFix":
        fixed = (columns["validity"].astype(int) & VALID_POSITION) > 0
        fixed &= np.isin(columns["type"], MEASURED)
        tally.add("removed", "GPS fixes", ~fixed, "the receiver says that it has none")
        columns |= {axis: np.where(fixed, columns[axis], np.nan) for axis in ("lat", "lon")}
    elif name == "EstimatedState":
        columns["depth"] = np.where(columns["depth"] < 0.0, np.nan, columns["depth"])
        columns |= _places(columns)
    return MessageTable(table.time, columns)


def _places(columns: Dict[str, Array]) -> dict[str, Array]:
    """[degree] Latitude and longitude of a state; the vehicle moves the state's origin at times."""
    origins = np.stack([columns["lat"], columns["lon"]])
    every, which = np.unique(origins, axis=1, return_inverse=True)
    places = np.zeros_like(origins)
    for k, origin in enumerate(np.degrees(every.T)):
        here = which.ravel() == k
        with np.errstate(over="ignore", invalid="ignore"):  # damaged messages have huge numbers
            places[:, here] = from_tangent_plane(columns["x"][here], columns["y"][here], *origin)
    return dict(zip(("latitude", "longitude"), places, strict=True))


def _doppler(tables: Dict[str, MessageTable]) -> MessageTable | None:
    """Table of a Doppler log: velocities through the water, or else over ground, and the mode."""
    parts = []
    for name, mode in {"WaterVelocity": "water", "GroundVelocity": "bottom"}.items():
        topic = _source(name, tables)
        if topic is None:
            parts.append((np.zeros(0), np.zeros((4, 0))))
            continue
        table = tables[topic]
        speeds = np.stack([table.columns[axis] for axis in VELOCITY])
        modes = np.where(np.isfinite(speeds[0]), DVL_MODES[mode], DVL_MODES["none"])
        parts.append((table.time, np.vstack([speeds, modes])))
    (time, water), (other, ground) = parts
    through, locked = np.isfinite(water[0]), np.isfinite(ground[0])
    spans = np.diff(np.unique(time))
    apart = 0.5 * float(np.median(spans)) if len(spans) else PING
    kept = through | ~_near(time, other[locked], apart)
    added = locked & ~_near(other, time[through], apart)
    if not len(time) and not len(other):
        return None
    moments = np.concatenate([time[kept], other[added]])
    order = np.argsort(moments, kind="stable")
    values = np.hstack([water[:, kept], ground[:, added]])[:, order]
    return MessageTable(moments[order], dict(zip((*VELOCITY, "mode"), values, strict=True)))


def _near(time: Array, others: Array, apart: float) -> NDArray[np.bool_]:
    """True for times closer than `apart` [s] to one of `others`: both belong to one ping."""
    if not len(others):
        return np.zeros(len(time), bool)
    others = np.sort(others)
    right = np.clip(np.searchsorted(others, time), 0, len(others) - 1)
    away = np.minimum(np.abs(others[right] - time), np.abs(others[np.maximum(right - 1, 0)] - time))
    return away < apart


def _pairs(servos: Dict[int, MessageTable]) -> MessageTable:
    """[rad] Rudder and elevator, means of their two fins, at the times of the first servo."""
    time = servos[0].time
    at = {k: np.interp(time, table.time, table.columns["value"]) for k, table in servos.items()}
    return MessageTable(time, {n: (at[a] + at[b]) / 2.0 for n, (a, b) in FINS.items()})


def _standard(
    tables: Dict[str, MessageTable], mapped: Container[str], tally: Tally
) -> dict[str, Signal]:
    """Signals of the known messages' fields, each with one source, without those `mapped`."""
    sources: dict[str, list[Signal]] = {}
    for signal, name, field, unit in STANDARD:
        topic = _source(name, tables)
        if topic is None or signal in mapped:
            continue
        if name == "Acceleration" and not _is_specific_force(tables[topic]):
            why = "not the specific force on an accelerometer: without gravity, or z up"
            tally.add("left out", topic, 1, why)
            continue
        one = Signal(
            column=f"{topic} {field}", unit=unit, held=signal in HELD,
            north="magnetic" if _is_magnetic(name, field, tables[topic]) else "true",
        )  # fmt: skip
        sources.setdefault(signal, []).append(one)
    return valued(sources, tables, tally)


def _source(name: str, tables: Dict[str, MessageTable]) -> str | None:
    """Topic of a message to read: the CTD's, the batteries', or the one with the most values."""
    if name in tables:
        return name
    topics = sorted(t for t in tables if t.partition("/")[0] == name)
    kept = topics
    if name in ("Temperature", "Salinity"):
        measuring = {t.partition("/")[2] for t in tables if t.startswith("Conductivity/")}
        kept = [t for t in topics if t.partition("/")[2] in measuring]
    elif name in ("Voltage", "Current") and len(topics) > 1:
        kept = [t for t in topics if "batter" in t.lower()]
    if not kept:
        return None
    return max(kept, key=lambda topic: _fullness(tables[topic]))


def _fullness(table: MessageTable) -> int:
    """Number of values in the field with the most values."""
    return max((int(np.isfinite(one).sum()) for one in table.columns.values()), default=0)


def _is_magnetic(name: str, field: str, table: MessageTable) -> bool:
    """True for a sensor with magnetic heading only, which it writes in both fields."""
    if (name, field) != ("EulerAngles", "psi"):
        return False
    return bool(np.array_equal(table.columns["psi"], table.columns["psi_magnetic"]))


def _is_specific_force(table: MessageTable) -> bool:
    """True if accelerations are specific forces: about 1 g upwards. Simulators of DUNE differ."""
    force = np.median(np.stack([table.columns[axis] for axis in VELOCITY]), axis=1)
    return bool(force[2] < 0.0 and abs(np.linalg.norm(force) - GRAVITY) < FAR * GRAVITY)
