"""Messages: logs of topics, each with its own clock, whose fields become signals by a mapping.

A column is a topic and a field of its messages, separated by a blank: `/imu angular_velocity.z`,
`ATT Roll`. A reader knows the fields of standard messages; a mapping file adds others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from collections.abc import Mapping as Dict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.columns import Table, tidy
from factory.importing.deployment_log import Channel, DeploymentLog
from factory.importing.formats.base import ReadOptions
from factory.importing.formats.csv.mapping import Clock, Mapping, Signal
from factory.importing.formats.csv.mapping_file import declare_model, load_mapping, signal_names
from factory.importing.formats.csv.pieces import values_of
from factory.importing.formats.csv.table_reader import channels_of, mapped_log
from factory.importing.tally import Tally
from twin.errors import InputError, unknown_name
from twin.vehicle.vehicle import load_vehicle

Array = NDArray[np.float64]

EARLIEST = 315_532_800.0
"""[s] Earliest valid time, 1980; a clock with an earlier time was never set."""
TURNING = 1.0
"""[rad/s] Speed beyond which a turning screw propels the vehicle."""


@dataclasses.dataclass(frozen=True)
class MessageTable:
    """Messages of one topic."""

    time: Array
    """[s] Unix time, as written."""
    columns: Dict[str, Array]
    """Numbers by field, NaN where a message has none."""


def mapping_of(options: ReadOptions, vehicle: str, model: str | None, gap_s: float) -> Mapping:
    """Load the user's mapping, or make one that only names the vehicle. Declare the parts of the
    vehicle file that the mapping names.

    Args:
      vehicle: name of the vehicle in the log.
      model: vehicle file that the log names.
      gap_s: [s] a longer gap ends a row.
    """
    if options.mapping is not None:
        found = load_mapping(options.mapping, timed=True)
        if model and not found.model:
            found = dataclasses.replace(found, model=model)
    else:
        found = Mapping(
            name="standard messages", vehicle=vehicle, time=Clock(column=""), signals={},
            rows="gaps", model=model, gap_s=gap_s,
        )  # fmt: skip
    if found.model:
        declare_model(found.model)
    return found


def with_standard(mapping: Mapping, standard: Dict[str, Signal], tally: Tally) -> Mapping:
    """Add signals of standard messages that the mapping does not map itself."""
    known, kept = set(signal_names()), {}
    for name, signal in standard.items():
        if name not in known or name in mapping.signals:
            continue
        why = mapping.reason(signal.column)
        if why is None:
            kept[name] = signal
        else:
            tally.add("left out", name, 1, why)
    return dataclasses.replace(mapping, signals={**kept, **mapping.signals})


def valued(
    sources: Dict[str, Sequence[Signal]], tables: Dict[str, MessageTable], tally: Tally
) -> dict[str, Signal]:
    """Choose for each signal the first source with values, or else the first; report the others.

    Args:
      sources: sources of each signal, the preferred one first.
      tables: tables that were read, by topic.
    """
    found = {}
    for name, several in sources.items():
        found[name] = next((one for one in several if _has_values(one, tables)), several[0])
        for one in several:
            topic = one.column.partition(" ")[0]
            if topic != found[name].column.partition(" ")[0]:
                tally.add("left out", topic, 1, f"{name} is taken from {found[name].column}")
    return found


def _has_values(signal: Signal, tables: Dict[str, MessageTable]) -> bool:
    topic, _, field = signal.column.partition(" ")
    columns = tables[topic].columns if topic in tables else {}
    return field in columns and bool(np.isfinite(columns[field]).any())


def wanted_fields(mapping: Mapping) -> dict[str, list[str]]:
    """Fields that a mapping reads, by topic."""
    found: dict[str, list[str]] = {}
    for column in dict.fromkeys(signal.column for signal in mapping.signals.values()):
        topic, _, field = column.partition(" ")
        found.setdefault(topic, []).append(field)
    return found


def log_of_messages(
    path: Path,
    deployment: str,
    topics: Collection[str],
    tables: Dict[str, MessageTable],
    mapping: Mapping,
    options: ReadOptions,
    tally: Tally,
) -> DeploymentLog:
    """Make the log of one recording from its topics.

    Args:
      path: recording, for errors.
      topics: names of all topics in the recording.
      tables: tables that were read, by topic.

    Raises:
      InputError: a mapped column is missing, or the vehicle's clock was never set.
    """
    channels: dict[str, Channel] = {}
    times = []
    for name, signal in mapping.signals.items():
        topic, _, field = signal.column.partition(" ")
        table = tables.get(topic)
        if table is None or field not in table.columns:
            if signal.optional:
                continue
            lacking = f"{topic} has no number {field!r} in every message"
            wrong = lacking if topic in topics else unknown_name("topic", topic, topics)
            raise InputError(
                f"{path.name}: {name}: {wrong}; correct {mapping.name}, or write optional = true"
            )
        clock = table.time + (mapping.time.start or 0.0)
        latest = np.max(clock, where=np.isfinite(clock), initial=-np.inf)
        if len(clock) and latest == -np.inf:
            tally.add("left out", name, len(clock), f"{topic} has no time in any message")
            continue
        if len(clock) and latest < EARLIEST:
            raise InputError(
                f"{path.name}: times run from {np.nanmin(clock):g} s: the vehicle's clock was not "
                "set; give what it began at in a --mapping, start = 2026-06-25T08:00:00Z"
            )
        one = Table(Path(path.name), {signal.column: table.columns[field]})
        values = values_of(one, name, signal, "", mapping, tally)
        time, columns = tidy(clock, {name: values}, name, tally)
        channels |= channels_of(deployment, time, columns, mapping, tally)
        times.append(time)
    if not channels:
        raise InputError(
            f"{path.name}: no topic of it is known; it has {', '.join(topics) or 'none'}. Name "
            "topics and fields in a --mapping (docs/howto/import_messages.md)"
        )
    log = mapped_log(
        deployment, channels, mapping, options.variation_deg, tally,
        time=np.unique(np.concatenate(times)), files=times, names=[path.name],
    )  # fmt: skip
    auxiliary = {**_thruster_channel(log), **log.auxiliary}
    return dataclasses.replace(log, period=mapping.period_s, auxiliary=auxiliary)


def _thruster_channel(log: DeploymentLog) -> dict[str, Channel]:
    """Channel `thruster`: 1 while the first logged screw of the vehicle file turns."""
    if log.model is None:
        return {}
    for part in load_vehicle(log.model).parts:
        spin = log.channel(f"measured_{part.name}")
        if part.spins and len(spin):
            return {"thruster": Channel(spin.time, (np.abs(spin.values) > TURNING).astype(float))}
    return {}
