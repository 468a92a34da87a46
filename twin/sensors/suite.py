"""Suite: the sensors of one vehicle, which measure the truth of one mission.

Every sensor has its own branch of the mission's seed, with one stream for its constants and one for
its noise. Changing one sensor therefore leaves the others' errors unchanged. A sensor may read
others as on a vehicle: the DVL removes its lever arm with the measured gyro, and the on-board track
uses measured depth, attitude, heading and GPS. Each sensor is measured after those that it reads.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError, UnknownName, unknown_name
from twin.records.schema import Variable, variable
from twin.sensors.ahrs import Attitude, Compass
from twin.sensors.altimeter import Altimeter
from twin.sensors.base import (
    DRAWN_STREAM,
    SENSORS,
    Drawn,
    Sensor,
    Signals,
    Surroundings,
    sensor_generator,
)
from twin.sensors.dvl import Dvl
from twin.sensors.imu import Imu
from twin.sensors.onboard import DVL, Onboard

PLUS = "+"
"""Separator that adds a registered sensor to a preset by name: field+turbidity."""


class SensorSuite(Mapping[str, Sensor]):
    """The sensors of a vehicle by name; immutable.

    `SensorSuite(dvl=Dvl(fitted=False), turbidity=Turbidity())` holds every shipped sensor, with
    its defaults (the `field` preset) unless given, and the registered sensors that are given.
    Sensors are attributes too: `suite.dvl`.
    """

    _sensors: Mapping[str, Sensor]

    def __init__(self, **sensors: Sensor):
        """Take sensors by name.

        Raises:
          InputError: a name is not registered, or its value is not an object of that sensor.
        """
        for name, sensor in sensors.items():
            if name not in SENSORS:
                raise UnknownName(
                    "sensor", name, SENSORS,
                    hint="; a sensor of your own must be registered first: twin.sensors.register",
                )  # fmt: skip
            if type(sensor) is not SENSORS[name]:
                raise InputError(
                    f"sensor {name!r} is {sensor!r}: give a {SENSORS[name].__name__} object"
                )
        names = (*SENSORS.shipped(), *(n for n in sensors if n not in SENSORS.shipped()))
        given = {n: sensors[n] if n in sensors else SENSORS[n]() for n in names}
        self._sensors = MappingProxyType(_in_order(given))

    @classmethod
    def preset(cls, name: str) -> SensorSuite:
        """Return a suite of `SUITE_PRESETS`, with registered sensors added: `field+turbidity`.

        Raises:
          UnknownName: there is no such preset or sensor; the nearest one is offered.
        """
        preset, *added = (word.strip() for word in name.split(PLUS))
        if preset not in SUITE_PRESETS:
            raise UnknownName("sensor preset", preset, SUITE_PRESETS)
        return SUITE_PRESETS[preset].replace(**{word: SENSORS[word]() for word in added})

    @classmethod
    def from_settings(cls, settings: Mapping[str, Mapping[str, Any]]) -> SensorSuite:
        """Rebuild the suite from its `settings()`, as stores hold them.

        Raises:
          InputError: a sensor is not registered here, or lacks one of the settings.
        """
        if not isinstance(settings, Mapping):
            raise InputError(f"sensor settings are {settings!r}: give a table of sensors")
        sensors = {}
        for name, values in settings.items():
            if name not in SENSORS:
                raise InputError(
                    f"{unknown_name('sensor', name, SENSORS)}; import the module that registers "
                    "it, or install the distribution that brings it"
                )
            if not isinstance(values, Mapping):
                raise InputError(f"settings of sensor {name!r} are {values!r}: give a table")
            known = [field.name for field in dataclasses.fields(cast(Any, SENSORS[name]))]
            for key in values:
                if key not in known:
                    raise UnknownName(f"setting of sensor {name!r}", key, known)
            plain = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
            sensors[name] = SENSORS[name](**{**SENSORS[name].unset, **plain})
        return cls(**sensors)

    def replace(self, **sensors: Sensor) -> SensorSuite:
        """Return a suite with other or further sensors; raises as the class itself."""
        return SensorSuite(**{**self._sensors, **sensors})

    def settings(self) -> dict[str, dict[str, Any]]:
        """Return every field of every sensor as JSON values."""
        return {name: dataclasses.asdict(cast(Any, s)) for name, s in self._sensors.items()}

    def __getitem__(self, name: str) -> Sensor:
        if name not in self._sensors:
            raise UnknownName("sensor of this suite", name, self._sensors)
        return self._sensors[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # asked for while a copy is made, before there are sensors
            raise AttributeError(name)
        if name not in self._sensors:
            raise AttributeError(unknown_name("sensor of this suite", name, self._sensors))
        return self._sensors[name]

    def __setattr__(self, name: str, value: Any) -> None:
        if name != "_sensors" or name in self.__dict__:
            raise AttributeError(f"a suite does not change: use suite.replace({name}=...)")
        super().__setattr__(name, value)

    def __iter__(self) -> Iterator[str]:
        return iter(self._sensors)

    def __len__(self) -> int:
        return len(self._sensors)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SensorSuite) and dict(self._sensors) == dict(other._sensors)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        changed = [f"{n}={s!r}" for n, s in self._sensors.items() if s != type(s)()]
        return f"SensorSuite({', '.join(changed)})"

    def __reduce__(self) -> tuple[Any, ...]:
        return functools.partial(SensorSuite, **self._sensors), ()

    def reads(self, signals: Iterable[str]) -> tuple[str, ...]:
        """Signals of the truth that `measure` needs from a vehicle that has `signals`."""
        names = list(signals)
        needed = (read for sensor in self.values() for read in sensor.inputs(names))
        return tuple(dict.fromkeys(name for name in needed if not name.startswith("measured_")))

    def writes(self, signals: Iterable[str]) -> tuple[Variable, ...]:
        """Variables that `measure` returns for a vehicle that has `signals`, in order."""
        names = list(signals)
        return tuple(entry for sensor in self.values() for entry in sensor.channels(names))

    def readers(self, changed: Iterable[str], signals: Iterable[str]) -> set[str]:
        """Measured signals that depend on the `changed` ones, directly or through other sensors.

        Args:
          changed: names of measured signals.
          signals: names of the vehicle's signals.
        """
        names, sources = list(signals), set(changed)
        found: set[str] = set()
        for sensor in self.values():  # sensors come after those that they read
            if sources & set(sensor.inputs(names)):
                own = {entry.name for entry in sensor.channels(names)}
                found |= own
                sources |= own
        return found

    def drawn_units(self) -> dict[str, str]:
        """Units of all constants that are sampled per mission, by name, in the order of `draw`."""
        return {name: unit for sensor in self.values() for name, unit in sensor.draws.items()}

    def draw(self, seed: np.random.SeedSequence | np.random.Generator) -> dict[str, float]:
        """Sample the constants of one mission: biases, scales, deviation (`drawn_units`).

        With the mission's SeedSequence the constants equal those that `measure` samples itself. A
        Generator gives other constants and advances.
        """
        if isinstance(seed, np.random.Generator):
            seed = np.random.SeedSequence(int(seed.integers(2**63)))
        drawn: dict[str, float] = {}
        for name, sensor in self.items():
            if sensor.draws:
                drawn |= sensor.draw(sensor_generator(seed, name, DRAWN_STREAM))
        return drawn

    def measure(
        self,
        truth: Signals,
        *,
        dt: float,
        rng_seed: np.random.SeedSequence,
        drawn: Mapping[str, float] | None = None,
        measured: Signals | None = None,
        **surroundings: Any,
    ) -> dict[str, NDArray[Any]]:
        """Measure the truth of one mission: every array of `writes`, shape (n,).

        Args:
          truth: the arrays of `reads`, shape (n,), and any others. They are not changed; a sensor
            without errors returns these arrays themselves.
          dt: [s] between samples.
          rng_seed: seed of the mission, not changed.
          drawn: the mission's constants, by default `draw(rng_seed)`.
          measured: readings of a `LiveSuite`; only sensors without a signal among them are
            measured, from these readings and the truth.
          surroundings: fields of `Surroundings`, such as latitude, density and bottom_depth.

        Raises:
          InputError: a missing or misshapen signal, a wrong dt, latitude or bottom, or a sensor
            that does not return the channels that it declares.
        """
        around = Surroundings(**surroundings)
        n = self._check(truth, dt, around.latitude, around.bottom_depth)
        drawn = self.draw(rng_seed) if drawn is None else drawn
        signals: dict[str, NDArray[Any]] = dict(truth)
        out: dict[str, NDArray[Any]] = {}
        for name, sensor in self.items():
            channels = [entry.name for entry in sensor.channels(truth)]
            if not channels:  # nothing to measure with this vehicle in this sea
                continue
            made: Mapping[str, Any] = measured or {}
            if not set(channels) <= set(made):
                known = truths(sensor, channels, truth, drawn)
                made = {}
                if len(known) < len(channels):  # some channels, such as conductivity, have no truth
                    rng = sensor_generator(rng_seed, name)
                    made = sensor.measure(signals, dt=dt, drawn=drawn, rng=rng, surroundings=around)
                    _check_made(name, made, channels, n)
                made = {**made, **{channel: truth[true] for channel, true in known.items()}}
            for channel in channels:
                out[channel] = signals[channel] = np.asarray(made[channel])
        return out

    def _check(
        self, truth: Signals, dt: float, latitude: float, bottom_depth: ArrayLike | None
    ) -> int:
        needed = self.reads(truth)
        missing = [name for name in needed if name not in truth]
        if missing:
            raise InputError(
                f"truth lacks {', '.join(missing)}: the sensors need every signal of "
                "SensorSuite.reads"
            )
        n = np.shape(truth["true_depth"])
        for name in needed:
            if np.shape(truth[name]) != n or len(n) != 1 or n[0] == 0:
                raise InputError(
                    f"{name} has shape {np.shape(truth[name])} and true_depth {n}: give vectors "
                    "of one length, one mission at a time"
                )
        if not (np.isfinite(dt) and dt > 0.0):
            raise InputError(f"dt is {dt:g} s: give the positive time step of the truth")
        if not -90.0 <= latitude <= 90.0:
            raise InputError(f"latitude {latitude:g} deg is outside -90..90")
        if bottom_depth is not None:
            bottom = np.asarray(bottom_depth, float)
            if bottom.shape not in ((), n):
                raise InputError(
                    f"bottom_depth has shape {bottom.shape}: give a number or one per sample {n}"
                )
            if not np.all(bottom > 0.0):
                raise InputError(
                    f"bottom_depth is {bottom[~(bottom > 0.0)].flat[0]:g} m: it must be above 0, "
                    "positive down; None puts the bottom out of reach"
                )
        return int(n[0])


def truths(
    sensor: Sensor, channels: Iterable[str], signals: Iterable[str], drawn: Drawn
) -> dict[str, str]:
    """True signals that an error-free sensor returns, by channel; empty for one with errors.

    Errors come from the settings, or from a constant that is given by hand.
    """
    given = any(drawn.get(constant, 0.0) for constant in sensor.draws)
    if given or not sensor.ideal_is_truth or sensor != type(sensor).ideal():
        return {}
    behind = {channel: f"true_{channel.removeprefix('measured_')}" for channel in channels}
    return {channel: true for channel, true in behind.items() if true in signals}


def _check_made(name: str, made: Any, channels: list[str], n: int) -> None:
    """Raise InputError when a sensor returns other channels, shapes or gaps than it declares."""
    if not isinstance(made, Mapping) or set(made) != set(channels):
        got = ", ".join(map(str, made)) if isinstance(made, Mapping) else repr(made)
        raise InputError(
            f"sensor {name!r} measured {got or 'nothing'}: it must return a dict of "
            f"{', '.join(channels)}"
        )
    for channel, values in made.items():
        if np.shape(values) != (n,):
            raise InputError(
                f"sensor {name!r} gave {channel} of shape {np.shape(values)}: one value for each "
                f"of the {n} samples"
            )
        if not variable(channel).gaps and np.isnan(values).any():
            raise InputError(
                f"sensor {name!r} gave NaN in {channel} at sample {int(np.isnan(values).argmax())}"
                f": where it may say nothing, declare it Variable({channel!r}, ..., gaps=True)"
            )


def _in_order(sensors: Mapping[str, Sensor]) -> dict[str, Sensor]:
    """Order the sensors so that each follows those that it reads, otherwise as given."""
    waiting, ready, written = dict(sensors), {}, set[str]()
    while waiting:
        lacking = {
            name: {read for read in sensor.inputs(()) if read.startswith("measured_")} - written
            for name, sensor in waiting.items()
        }
        name = next((name for name, names in lacking.items() if not names), None)
        if name is None:
            name, names = next(iter(lacking.items()))
            raise InputError(
                f"sensor {name!r} reads {', '.join(sorted(names))}, which no other sensor of this "
                "suite writes before it"
            )
        ready[name] = waiting.pop(name)
        written |= {entry.name for entry in ready[name].channels(())}
    return ready


TETHYS_DVL = Dvl(lever_arm=(-0.60, 0.0, 0.16))
"""DVL under the hull, at the place in the lrauv simulation."""
LEVEL_ALTIMETER = Altimeter(tilt_deg=0.0)
"""Altimeter that looks straight down, for vehicles that cruise level."""

SUITE_PRESETS: dict[str, SensorSuite] = {
    "ideal": SensorSuite(**{name: SENSORS[name].ideal() for name in SENSORS.shipped()}),
    "field": SensorSuite(),
    "field-uncalibrated": SensorSuite(compass=Compass.preset("uncalibrated")),
    "field-no-dvl": SensorSuite(dvl=Dvl(fitted=False)),
    "survey": SensorSuite(
        imu=Imu.preset("3DM-GX5-25-table"),
        attitude=Attitude(rms_deg=0.25, time_constant=0.0),
        compass=Compass.preset("table"),
        dvl=dataclasses.replace(TETHYS_DVL, misalignment_deg=0.0),
        altimeter=LEVEL_ALTIMETER,
        onboard=Onboard(speed_by=DVL),
    ),
    "survey-field": SensorSuite(
        dvl=TETHYS_DVL, altimeter=LEVEL_ALTIMETER, onboard=Onboard(speed_by=DVL)
    ),
}
"""Suites by name. `ideal`: measured equals true (GPS still only at the surface; the on-board track
is the algorithm on ideal inputs). `field`: 3DM-GX5-25, "calibrated" compass, defaults otherwise.
`survey`: a propelled vehicle's, with the numbers of the paper's two tables: accelerometer bias
instability 0.04 mg, gyro 8 deg/h, attitude 0.25 deg and heading 0.8 deg RMS, and the LinkQuest
600 kHz micro DVL of 0.3 to 110 m, 1 % +- 1 mm/s and 5 Hz, with our lost locks and outliers.
`survey-field`: the same instruments with the errors of `field`."""
