"""Registry: the sensors that can be in a suite, each complete; `register` adds one's own."""

from __future__ import annotations

import dataclasses
from typing import Any, cast

import numpy as np

from twin.errors import InputError
from twin.records.schema import VARIABLES, Variable, declare
from twin.registry import Registry
from twin.sensors.base import Sensor

GROUP = "glider_twin.sensors"
"""Entry points of installed distributions: NAME = "module:Class"."""
PREFIXES = ("true_", "commanded_", "measured_")


def register(sensor: type[Sensor]) -> type[Sensor]:
    """Add a sensor of your own for this process; usable as a class decorator.

    Raises:
      InputError: it is only half there (the message says what is missing), or its name, one of its
        signals or one of its constants is taken.
    """
    SENSORS.register(getattr(sensor, "name", ""), sensor)
    return sensor


def check_sensor(name: str, sensor: Any) -> type[Sensor]:
    """The sensor when it is complete, with its variables declared in the schema.

    Raises:
      InputError: as `register`.
    """

    def half(what: str) -> InputError:
        return InputError(f"sensor {name!r} is only half there: {what}")

    if not (isinstance(sensor, type) and issubclass(sensor, Sensor)):
        raise half(f"{sensor!r} must be a subclass of twin.sensors.Sensor")
    if getattr(sensor, "name", None) != name or not name.isidentifier():
        raise half("its class attribute `name` must be that name, a word without blanks")
    parameters = getattr(sensor, "__dataclass_params__", None)
    if "__dataclass_fields__" not in vars(sensor) or not (parameters and parameters.frozen):
        raise half("make it a frozen dataclass: @dataclasses.dataclass(frozen=True, kw_only=True)")
    for field in dataclasses.fields(cast(Any, sensor)):
        if field.default is field.default_factory is dataclasses.MISSING:
            raise half(f"its field {field.name!r} needs a default")
    if sensor.measure is Sensor.measure and sensor.begin is Sensor.begin:
        raise half("it needs a method `measure` or `begin`")
    if not sensor.reads and sensor.inputs is Sensor.inputs:
        raise half("`reads` must name the signals that it needs, such as true_depth")
    for signal in (*sensor.reads, *sensor.reads_if_there):
        if not signal.startswith(PREFIXES):
            raise half(f"it reads {signal!r}, which must begin with {', '.join(PREFIXES)}")
    if not sensor.writes and sensor.channels is Sensor.channels:
        raise half("`writes` must hold a twin.records.schema.Variable for each measured signal")
    for entry in sensor.writes:
        _check_variable(entry, half)
    try:
        ideal = sensor.ideal()
    except NotImplementedError:
        raise half("it needs a classmethod `ideal`: the sensor without errors") from None
    if type(ideal) is not sensor:
        raise half(f"`ideal` must return a {sensor.__name__}, not {ideal!r}")
    drawn = sensor().draw(np.random.default_rng(0))
    if list(drawn) != list(sensor.draws):
        raise half(
            f"`draw` gives {', '.join(drawn) or 'nothing'} and `draws` names "
            f"{', '.join(sensor.draws) or 'nothing'}: both must name the same constants with units"
        )
    _check_alone(name, sensor)
    for entry in sensor.writes:
        declare(entry)
    return sensor


def _check_variable(entry: Any, half: Any) -> None:
    if not isinstance(entry, Variable):
        raise half(f"`writes` holds {entry!r}: give twin.records.schema.Variable objects")
    if not entry.name.startswith("measured_"):
        raise half(f"it writes {entry.name!r}, which must begin with measured_")
    if not entry.units or not entry.long_name:
        raise half(f'{entry.name} needs units ("1" for none) and a long_name')
    if VARIABLES.get(entry.name) != entry and entry.limits is None:
        raise half(
            f"{entry.name} needs limits=(lowest, highest): what the instrument can possibly say"
        )


def _check_alone(name: str, sensor: type[Sensor]) -> None:
    """Refuse a signal or a constant that another sensor has."""
    for other in SENSORS.loaded():
        if other.name == name:
            continue
        signals = {entry.name for entry in sensor.writes} & {entry.name for entry in other.writes}
        for taken in (*sorted(signals), *sorted(sensor.draws.keys() & other.draws.keys())):
            raise InputError(
                f"sensor {name!r} has {taken!r}, which sensor {other.name!r} has too: rename it"
            )


SENSORS: Registry[type[Sensor]] = Registry(
    "sensor",
    group=GROUP,
    shipped={
        "imu": "twin.sensors.imu:Imu",
        "attitude": "twin.sensors.attitude:Attitude",
        "compass": "twin.sensors.compass:Compass",
        "pressure": "twin.sensors.pressure:Pressure",
        "altimeter": "twin.sensors.altimeter:Altimeter",
        "gps": "twin.sensors.gps:Gps",
        "dvl": "twin.sensors.dvl:Dvl",
        "encoders": "twin.sensors.encoders:Encoders",
        "onboard": "twin.sensors.onboard:Onboard",
        "ctd": "twin.sensors.ctd:Ctd",
    },
    check=check_sensor,
)
"""Every sensor by name; the shipped ones are in every suite."""


def table() -> str:
    """The shipped sensors as a markdown table, as docs/reference/sensors.md shows it."""
    rows = ["| sensor | reads | measures | a mission draws |", "|---|---|---|---|"]
    for name in SENSORS.shipped():
        sensor = SENSORS[name]
        reads = [f"`{signal}`" for signal in sensor.reads] or ["`true_PART` of each moving part"]
        writes = [f"`{entry.name}` [{entry.units}]" for entry in sensor.writes]
        draws = [f"`{constant}` [{unit}]" for constant, unit in sensor.draws.items()]
        cells = (reads, writes or ["`measured_PART` in its unit"], draws or ["nothing"])
        rows.append(f"| `{name}` | {' | '.join(', '.join(cell) for cell in cells)} |")
    return "\n".join(rows) + "\n"
