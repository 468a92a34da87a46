"""Data dictionary: a page with every variable of the project's stores and files.

The page is made from the tables that define the variables: the schema, the parts of the shipped
vehicles, the parameters, the sensors, and the variables of imports and of `twin flight`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from docs_markdown import escaped, table  # noqa: E402

from factory.generation.completion import (  # noqa: E402
    FAILED,
    FAILURE,
    LENGTH,
    PLANNED,
    SEGMENT,
    SENSOR_PREFIX,
    constant_attributes,
)
from factory.importing.dives.dive_rows import NUMBERS, OF_ROWS  # noqa: E402
from factory.importing.payload import KNOWN  # noqa: E402
from factory.sampling.distribution import Choice, Parameter, parse_distribution  # noqa: E402
from factory.sampling.mission_kinds import propelled  # noqa: E402
from factory.sampling.parameters import parameter_table  # noqa: E402
from twin.logs.flight_dataset import (  # noqa: E402
    COPIED,
    DAC,
    FIX_ATTRIBUTES,
    FLOWN,
    GPS_FIX,
    OF_DIVES,
    OF_FLIGHTS,
    PER_DIVE,
)  # fmt: skip
from twin.physics.true_signals import energy_variables, part_variables  # noqa: E402
from twin.records import coordinates, schema  # noqa: E402
from twin.records.attributes import (  # noqa: E402
    ATTEMPT,
    AXES,
    DURATION,
    N_SAMPLES,
    OF_MISSIONS,
    SPLIT,
)  # fmt: skip
from twin.records.mission_dataset import STATE, STATE_ATTRIBUTES, STATES  # noqa: E402
from twin.records.schema import MISSION, TIME, Variable  # noqa: E402
from twin.records.schema.limits import recorded_limits, simulated_limits  # noqa: E402
from twin.sensors.base import SENSORS  # noqa: E402
from twin.vehicle.parts.base import PARTS  # noqa: E402
from twin.vehicle.presets import shipped_files  # noqa: E402
from twin.vehicle.vehicle import Vehicle, load_vehicle  # noqa: E402

INTRODUCTION = """\
---
hide: [toc]
---

# Data dictionary

Every variable that a store of missions, a store of logs or a file of `twin flight` can hold, with
its unit as CF writes it; `1` has no dimension. In the stores each variable says the same of itself,
in its attributes `units`, `long_name` and `comment`.

- [Place and time](#place-and-time) of missions and samples
- Signals: [what happened](#what-happened-true_),
  [what the sensors said](#what-the-sensors-said-measured_),
  [what was asked for](#what-was-asked-for-commanded_), and those of the
  [parts of the vehicle](#parts-of-the-vehicle)
- [Of each mission](#of-each-mission): length, split, attempts that failed
- What `factory generate` draws: [parameters](#drawn-parameters) and
  [constants of the sensors](#constants-of-the-sensors-sensor_)
- [What imports add](#what-imports-add) and [what `twin flight` writes](#what-twin-flight-writes)

"""
SIGNALS = """\
## Signals

Signals have the dimensions (mission, time), are float32, and are NaN after the mission's end.
Limits are the values that a store may hold, whatever the vehicle: what lies outside is damage, a
sentinel or a wrong unit. Simulated missions have closer ones where they are given.

Present says which stores have a signal: *all* simulated missions, and logs where the vehicle
measured it; *logs* alone; simulated missions with a *sea floor*; or *CTD*, in water whose
temperature and salinity are known. *May be NaN* marks a signal that is missing now and then: no
fix, no lock, no setpoint.

Frames: NED is north, east, down from the mission's start; body is forward, starboard, down;
attitude turns NED to body by heading, pitch, roll in this order.
"""
GROUPS = {
    "true": ("What happened", "Of a simulation, or of a log where a Doppler log or profiler was."),
    "measured": ("What the sensors said", "With the errors of the sensor suite."),
    "commanded": ("What was asked for", "By guidance, or as the log has it."),
}
BODY = re.compile(r"(surge|sway|heave|_rate|specific_force_[xyz])$")
EARTH = re.compile(r"(north|east|down|depth|altitude)$")
ATTITUDE = re.compile(r"(roll|pitch|heading)$")
DRAWN = {
    "mission": "What the missions and their segments are.",
    "vehicle": "How the vehicle differs from its file, which guidance does not know.",
    "current": "Of the current at the vehicle.",
    "water": "Of the water column.",
    "floor": "Of the sea floor, for vehicles with a propeller.",
}
"""Descriptions of the parameter groups, by the prefix of their names"""
STORED_UNITS = {"rad": "degree", "rad/s": "rad s-1"}
"""Units of parts in stores, if they differ from the code's"""
COLUMNS = ("variable", "dimensions", "unit", "meaning")
"""Columns of the tables of variables that are no signals"""
FROM_DRAWS = ("variable", "dimensions", "unit", "meaning", "vehicles")
OF_MISSION, OF_SAMPLE = f"({MISSION})", f"({MISSION}, {TIME})"
OF_SEGMENT, OF_DAC = f"({MISSION}, {SEGMENT})", f"({DAC})"


def dictionary_page() -> str:
    """Make the page in Markdown."""
    vehicles = {name: load_vehicle(name) for name in sorted(shipped_files())}
    return "\n".join([
        INTRODUCTION + place_section(), SIGNALS, *map(signal_section, GROUPS),
        part_section(vehicles), mission_section(), draw_section(vehicles), sensor_section(),
        import_section(), flight_section(),
    ])  # fmt: skip


def row(name: str, dimensions: str, attributes: Mapping[str, Any]) -> tuple[str, ...]:
    """Table row of a variable that is no signal, from its attributes."""
    unit = "flag" if "flag_meanings" in attributes else str(attributes.get("units", ""))
    return (f"`{name}`", dimensions, unit, meaning(attributes))


def meaning(attributes: Mapping[str, Any]) -> str:
    """Meaning of a variable: long name, comment, flag words and CF name."""
    text = str(attributes["long_name"])
    if "comment" in attributes:
        text += f"; {attributes['comment']}"
    words = attributes.get("flag_meanings", "").split()
    if words and not all(word in text for word in words):  # the comment does not list them
        flags = zip(attributes["flag_values"], words, strict=True)
        text += ": " + ", ".join(f"{value} {word.replace('_', ' ')}" for value, word in flags)
    if attributes.get("standard_name"):
        text += f". CF: `{attributes['standard_name']}`"
    return escaped(text.replace("|", "/"))


# --- axes, places ------------------------------------------------------------------------------


def place_section() -> str:
    """Section on the axes of a store, and on times and places of missions and samples."""
    rows = [
        row(MISSION, OF_MISSION, AXES[MISSION]),
        row(TIME, f"({TIME})", AXES[TIME]),
        row(SEGMENT, f"({SEGMENT})", PLANNED[SEGMENT]),
        *(row(name, OF_MISSION, coordinates.ATTRIBUTES[name]) for name in coordinates.PLACE),
        row(coordinates.NOMINAL, OF_MISSION, coordinates.NOMINAL_ATTRIBUTES),
        *(row(name, OF_SAMPLE, coordinates.ATTRIBUTES[name]) for name in coordinates.COORDINATES),
    ]
    return (
        "## Place and time\n\nThe axes, and where and when missions start and samples are, in UTC "
        "and degrees WGS84. `xarray` shows moments as dates.\n\n" + table(COLUMNS, rows)
    )


# --- signals -----------------------------------------------------------------------------------


def signal_section(prefix: str) -> str:
    """Section on the signals of one group of the schema."""
    title, comment = GROUPS[prefix]
    rows = [
        (f"`{name}`", one.units, meaning(described(one)), frame(name), limits(name), present(name))
        for name, one in schema.VARIABLES.items()
        if name.startswith(f"{prefix}_") and name in OWN
    ]
    head = ("signal", "unit", "meaning", "frame", "limits", "present")
    return f"### {title}: `{prefix}_*`\n\n{comment}\n\n{table(head, rows)}"


OWN = frozenset(entry.name for entry in schema.SIGNALS)
"""Names in the schema's own table, without those that plugins declare"""


def described(entry: Variable) -> dict[str, Any]:
    """Description of a signal, without empty texts."""
    return {key: value for key, value in entry.attributes().items() if value}


def frame(name: str) -> str:
    """Axes of a signal; empty for a signal without axes."""
    for title, pattern in (("body", BODY), ("attitude", ATTITUDE), ("NED", EARTH)):
        if pattern.search(name):
            return title
    return ""


def limits(name: str) -> str:
    """Lowest and highest value of a signal in any store, and in a simulated one."""
    recorded, simulated = (
        f"±{high:g}".replace("e+0", "e") if low == -high else f"{low:g} to {high:g}"
        for low, high in (recorded_limits(name), simulated_limits(name))
    )
    return recorded if simulated == recorded else f"{recorded}; simulated {simulated}"


def present(name: str) -> str:
    """Types of stores that hold a signal."""
    sets = (("logs", schema.LOGGED_ONLY), ("CTD", schema.HYDROGRAPHY),
            ("sea floor", schema.WITH_FLOOR))  # fmt: skip
    word = next((word for word, names in sets if name in names), "all")
    return f"{word}; may be NaN" if schema.VARIABLES[name].gaps else word


def part_section(vehicles: Mapping[str, Vehicle]) -> str:
    """Section on the channels of vehicle parts, by type and by shipped vehicle."""
    kinds = [
        (f"`{kind}`", STORED_UNITS.get(PARTS[kind].unit, PARTS[kind].unit))
        for kind in PARTS.shipped()
    ]
    entries: dict[str, dict[str, Variable]] = {}
    for name, vehicle in vehicles.items():
        for entry in (*part_variables(vehicle).values(), *energy_variables(vehicle)):
            if entry.name not in OWN:
                entries.setdefault(entry.name, {})[name] = entry
    rows = []
    for name, by_vehicle in entries.items():  # each unit and meaning where vehicles differ
        units = dict.fromkeys(entry.units for entry in by_vehicle.values())
        texts = dict.fromkeys(meaning(described(entry)) for entry in by_vehicle.values())
        rows.append(
            (f"`{name}`", ", ".join(units), "; or: ".join(texts), whose(by_vehicle, vehicles))
        )
    return (
        "### Parts of the vehicle\n\n"
        "A part gives three signals by its own name, `true_PART`, `commanded_PART` and, by its "
        "encoder, `measured_PART`, and `true_energy_PART`, the electrical energy that it has taken "
        "since the start; `true_energy_hotel` is that of electronics and sensors. The unit of a "
        "position is that of the kind of part:\n\n" + table(("kind of part", "unit"), kinds) + "\n"
        "The parts of the shipped vehicles, but for positions of shift, rotation and pump, which "
        "stand above:\n\n" + table(("signal", "unit", "meaning", "vehicles"), rows)
    )


def whose(names: Iterable[str], vehicles: Mapping[str, Vehicle]) -> str:
    """Text that lists shipped vehicles."""
    found = set(names)
    driven = {name for name, vehicle in vehicles.items() if propelled(vehicle)}
    for word, those in (
        ("all", set(vehicles)), ("gliders", set(vehicles) - driven), ("with a propeller", driven),
    ):  # fmt: skip
        if found == those:
            return word
    return ", ".join(sorted(found))


# --- of each mission ---------------------------------------------------------------------------


def mission_section() -> str:
    """Section on the variables of each mission, failure and sample that are no signals."""
    rows = [
        row(N_SAMPLES, OF_MISSION, OF_MISSIONS[N_SAMPLES]),
        row(DURATION, OF_MISSION, OF_MISSIONS[DURATION]),
        row(SPLIT, OF_MISSION, PLANNED[SPLIT]),
        row(ATTEMPT, OF_MISSION, OF_MISSIONS[ATTEMPT]),
        *(row(name, f"({FAILURE})", attributes) for name, attributes in FAILED.items()),
        row(STATES, f"({MISSION}, {TIME}, {STATE})", STATE_ATTRIBUTES),
    ]
    return (
        "## Of each mission\n\n"
        "`simulation_state` is of `twin simulate` and `Trajectory.save`; its attribute `columns` "
        "names the columns. The others but `n_samples` are of `factory generate`; "
        "`failure_*` are there where an attempt failed and was replaced.\n\n" + table(COLUMNS, rows)
    )


def draw_section(vehicles: Mapping[str, Vehicle]) -> str:
    """Section on the parameters that `factory generate` samples, by group."""
    by_name: dict[str, dict[str, Parameter]] = {}
    for name, vehicle in vehicles.items():
        for parameter in parameter_table(vehicle).values():
            if parameter.name != LENGTH:
                by_name.setdefault(parameter.variable, {})[name] = parameter
    text = (
        "## Drawn parameters\n\n"
        "What `factory generate` drew for each mission, or for each of its segments. The attribute "
        "`distribution` of a variable says from what; `factory distributions` prints the table of "
        "a preset and a vehicle. A parameter that is the same for all missions is no variable: "
        "`distributions` in the store's settings has it. What is not used is NaN, a flag -1. "
        "The attribute `flag_meanings` has the words of flags.\n"
    )
    for prefix, comment in DRAWN.items():
        rows = []
        for name, by_vehicle in by_name.items():
            if not name.startswith(f"{prefix}_"):
                continue
            first, *others = by_vehicle.values()
            said = " or ".join(dict.fromkeys(one.long_name for one in (first, *others)))
            if first.why and all(one.why == first.why for one in others):
                said += f"; {first.why}"
            dimensions = OF_SEGMENT if first.per_segment else OF_MISSION
            units = "flag" if any(map(_is_word, (first, *others))) else first.unit
            rows.append(
                (f"`{name}`", dimensions, units, escaped(said), whose(by_vehicle, vehicles))
            )
        text += f"\n### `{prefix}_*`\n\n{comment}\n\n{table(FROM_DRAWS, rows)}"
    return text


def _is_word(parameter: Parameter) -> bool:
    """True if a parameter is a choice of words, stored as their index."""
    texts = (parameter.paper, parameter.field)
    drawn = [parse_distribution(text, parameter.name) for text in texts]
    options = [option for one in drawn if isinstance(one, Choice) for option in one.options]
    return any(isinstance(option, str) for option in options)


def sensor_section() -> str:
    """Section on the constants that sensors sample for a mission."""
    rows = [
        (*row(SENSOR_PREFIX + name, OF_MISSION, constant_attributes(name, drawn)), f"`{sensor}`")
        for sensor in SENSORS.shipped()
        for name, drawn in SENSORS[sensor].draws.items()
    ]
    return (
        f"## Constants of the sensors: `{SENSOR_PREFIX}*`\n\n"
        "What each sensor drew for a mission; those that are 0 in all missions are left out. "
        "[Sensors](sensors.md) says how they enter. A sensor of your own adds "
        "`sensor_NAME` for each constant of its `draws`.\n\n" + table((*COLUMNS, "sensor"), rows)
    )


# --- logs --------------------------------------------------------------------------------------


def import_section() -> str:
    """Section on the further variables of a store of logs, and the payload known by name."""
    rows = [
        *(row(n, f"({n})" if n == TIME else OF_MISSION, said) for n, said in OF_ROWS.items()),
        *(_of(name, OF_MISSION, (*about, None)) for name, about in NUMBERS.items()),
        row(coordinates.METHOD, OF_MISSION, coordinates.METHOD_ATTRIBUTES),
    ]
    payload = [
        _of(one.signal, OF_SAMPLE, (one.units or "", one.long_name, one.standard_name))
        for one in KNOWN
    ]
    return (
        "## What imports add\n\n"
        "A mission of a store of logs is a row: [one dive](import.md#rows-one-dive-each) from fix "
        "to fix. Beside the signals above and the place and time of its start and samples it has:"
        f"\n\n{table(COLUMNS, rows)}\n"
        "Of a payload these are known by name; `--payload NAME=COLUMN[UNITS]` adds "
        f"`measured_NAME` with a unit of your own.\n\n{table(COLUMNS, payload)}"
    )


def flight_section() -> str:
    """Section on the variables of a file of `twin flight`."""
    flown = [_of(name, OF_SAMPLE, about) for name, about in FLOWN.items()]
    copied = [
        row(name, OF_SAMPLE, described(schema.VARIABLES[stored])) for stored, name in COPIED.items()
    ]
    when = row(coordinates.DATETIME, OF_SAMPLE, coordinates.ATTRIBUTES[coordinates.DATETIME])
    rows: Sequence[tuple[str, ...]] = [
        *(row(n, f"({n})" if n == TIME else OF_MISSION, said) for n, said in OF_FLIGHTS.items()),
        when,
        *flown,
        row(GPS_FIX, OF_SAMPLE, FIX_ATTRIBUTES),
        *copied,
        *(_of(name, OF_DAC, about) for name, about in PER_DIVE.items()),
        *(row(name, OF_DAC, said) for name, said in OF_DIVES.items()),
    ]
    return (
        "## What `twin flight` writes\n\n"
        "[Flight and currents](../howto/flight.md) says how they are found. `depth` to `phase` are "
        "the store's own `measured_*`; `dac_*` have one value for each dive between two fixes.\n\n"
        + table(COLUMNS, rows)
    )


def _of(name: str, dimensions: str, about: tuple[str, str, str | None]) -> tuple[str, ...]:
    """Table row from a unit, a meaning and a CF standard name."""
    units, long_name, standard = about
    said = {"units": units, "long_name": long_name, "standard_name": standard}
    return row(name, dimensions, said)
