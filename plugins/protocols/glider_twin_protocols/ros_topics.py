"""ROS topics: messages from the signals of a store's mission or of a vehicle in simulation.

A signal goes into a standard message if there is one, or else into std_msgs/Float64. True signals
are below /truth, measured ones below /measured and commanded ones below /commanded. Units are those
of REP 103: metre, radian, second, pascal, cubic metre.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from glider_twin_protocols.cdr import body, orientation, to_body, world
from twin.records import FIXES
from twin.records.schema import VARIABLES
from twin.sensors import Imu

Array = NDArray[np.float64]

MAP, BASE, IMU = "map", "base_link", "imu_link"
TRUE = "_true"
"""Suffix of the true vehicle's frames; frames without it are the estimated vehicle's"""
GROUPS = {"true": "truth", "measured": "measured", "commanded": "commanded"}
"""Namespace by the first word of a signal"""
SURFACE_PRESSURE, PASCAL = 101_325.0, 1e4
"""[Pa] SURFACE_PRESSURE: of air; only FluidPressure includes it. PASCAL: one dbar"""
SI = {
    "degree": ("rad", np.pi / 180.0),
    "degree s-1": ("rad s-1", np.pi / 180.0),
    "cm3": ("m3", 1e-6),
    "dbar": ("Pa", PASCAL),
}
"""SI unit and factor by the store's unit"""
RATES = ("roll_rate", "pitch_rate", "yaw_rate")
FORCES = ("specific_force_x", "specific_force_y", "specific_force_z")
ANGLES = ("roll", "pitch", "heading")
CURRENT = ("current_north", "current_east", "current_down")
DVL_MODES = {"bottom": 1, "water": 2}
UNKNOWN, APPROXIMATED = 0, 1
"""Covariance types of a NavSatFix"""
FIX, GPS = 0, 1
"""Status and service of a NavSatFix"""
NOT_MEASURED = (-1.0, *(0.0,) * 8)
"""Covariance that marks a quantity as not measured by an Imu"""


class Samples(Protocol):
    """Protocol of the samples of a mission, or of one sample of a simulation, for topics."""

    names: list[str]
    """Names of the signals, as in a store"""
    count: int
    time: NDArray[np.int64]
    """[ns] Unix time of each sample"""
    latitude: Array
    longitude: Array
    """[degree] Longitude of each sample; the latitude has the same unit"""
    logged: bool
    """True if a real vehicle logged the mission, so that the truth is unknown"""
    imu_position: Array
    """[m] Position of the IMU from the centre of buoyancy, forward, starboard, down"""
    gps_deviation: float | None
    """[m] Standard deviation of the fixes per axis; None if unknown"""
    imu: Imu | None
    """IMU that measured the signals; None if unknown"""
    period: float
    """[s] Sample period"""

    def signal(self, name: str) -> Array:
        """Signal in the store's unit, (samples,)."""

    def track(self) -> tuple[Array, Array]:
        """[m] North and east of a log's positions from the origin of `map`."""

    def fixes(self) -> tuple[Array, Array]:
        """[degree] Latitude and longitude of the GPS fixes, (samples,); NaN without a fix."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Topic:
    """Messages of one topic."""

    name: str
    """Name of the topic, such as /measured/imu"""
    type: str
    """Type of the messages, such as sensor_msgs/msg/Imu"""
    values: Mapping[str, Any]
    """Fields as `cdr.encode` takes them; arrays have a row per sample"""
    known: NDArray[np.bool_]
    """True for samples with a message"""
    signals: tuple[str, ...]
    """Names of the signals in the messages"""
    frame: str = ""
    """Frame of the header; empty for a type without header"""
    units: str = ""
    """Unit of a std_msgs number; empty for other types"""


def topics(samples: Samples) -> Iterator[Topic]:
    """All topics of the samples, standard messages first."""
    used: set[str] = set()
    for topic in _standard(samples):
        used.update(topic.signals)
        yield topic
    for name in samples.names:
        if name not in used or name.endswith("_depth"):
            yield _number(samples, name)


def _standard(samples: Samples) -> Iterator[Topic]:
    simulated = not samples.logged
    for group in ("true", "measured"):
        if _all_of(samples, *_names(group, *ANGLES)):
            yield from _imu(samples, group)
        yield from _pose(samples, group)
        if _all_of(samples, f"{group}_temperature"):
            yield _stamped(
                samples, f"/{GROUPS[group]}/temperature", "sensor_msgs/msg/Temperature",
                {"temperature": samples.signal(f"{group}_temperature")}, [f"{group}_temperature"],
            )  # fmt: skip
        current = _names(group, *CURRENT)
        if _all_of(samples, *current[:2]):
            vector = world(*_vector(samples, group, *CURRENT))
            yield _stamped(
                samples, f"/{GROUPS[group]}/current", "geometry_msgs/msg/Vector3Stamped",
                {"vector": _xyz(vector)}, current, frame=MAP,
            )  # fmt: skip
    if _all_of(samples, "measured_pressure"):
        pressure = SURFACE_PRESSURE + PASCAL * samples.signal("measured_pressure")
        yield _stamped(
            samples, "/measured/pressure", "sensor_msgs/msg/FluidPressure",
            {"fluid_pressure": pressure}, ["measured_pressure"],
        )  # fmt: skip
    yield from _doppler(samples)
    if _all_of(samples, *FIXES):
        latitude, longitude = samples.fixes()
        yield _fix(samples, "/measured/fix", latitude, longitude, FIXES, samples.gps_deviation)
    name = "/truth/fix" if simulated else "/measured/track"
    yield _fix(samples, name, samples.latitude, samples.longitude, (), None)


def _imu(samples: Samples, group: str) -> Iterator[Topic]:
    """Topic of attitude, rates and specific force, which ROS calls linear acceleration."""
    suffix = TRUE if group == "true" else ""
    rates, forces = _names(group, *RATES), _names(group, *FORCES)
    angles = _names(group, *ANGLES)
    spread = _imu_covariances(samples) if group == "measured" else ((0.0,) * 9, (0.0,) * 9)
    moved, pushed = _all_of(samples, *rates), _all_of(samples, *forces)
    names = [*angles, *(rates if moved else ()), *(forces if pushed else ())]
    values = {
        "orientation": _xyzw(_orientation(samples, group)),
        "angular_velocity": _xyz(body(*_vector(samples, group, *RATES))),
        "angular_velocity_covariance": spread[0] if moved else NOT_MEASURED,
        "linear_acceleration": _xyz(body(*_vector(samples, group, *FORCES))),
        "linear_acceleration_covariance": spread[1] if pushed else NOT_MEASURED,
    }
    frame = (IMU if pushed else BASE) + suffix
    topic = f"/{GROUPS[group]}/imu"
    yield _stamped(samples, topic, "sensor_msgs/msg/Imu", values, names, frame=frame)


def _pose(samples: Samples, group: str) -> Iterator[Topic]:
    """Topics of the vehicle's pose: odometry or pose, velocity through the water, transforms."""
    measured = group == "measured"
    logged = samples.logged
    tracks = ("north", "east") if not measured else ("onboard_north", "onboard_east")
    names = [*_names(group, *tracks), f"{group}_depth", *_names(group, *ANGLES)]
    if measured and logged and _all_of(samples, *names[2:]):
        names = names[2:]
        north, east = samples.track()
    elif _all_of(samples, *names):
        north, east = _vector(samples, group, *tracks)
    else:
        return
    place = world(north, east, samples.signal(f"{group}_depth"))
    turn = _orientation(samples, group)
    child = BASE if measured else BASE + TRUE
    pose = {"position": _xyz(place), "orientation": _xyzw(turn)}
    over = _names(group, "velocity_north", "velocity_east", "velocity_down")
    rates = _names(group, *RATES)
    if _all_of(samples, *over, *rates):
        speed = to_body(turn, world(*(samples.signal(name) for name in over)))
        twist = _twist(speed, body(*_vector(samples, group, *RATES)))
        values = {"child_frame_id": child, "pose": {"pose": pose}, "twist": {"twist": twist}}
        names = [*names, *over, *rates]
        topic = f"/{GROUPS[group]}/odometry"
        yield _stamped(samples, topic, "nav_msgs/msg/Odometry", values, names, frame=MAP)
    else:
        topic = f"/{GROUPS[group]}/pose"
        values = {"pose": pose}
        yield _stamped(samples, topic, "geometry_msgs/msg/PoseStamped", values, names, frame=MAP)
    water = _names(group, "surge", "sway", "heave")
    if _all_of(samples, *water):
        through = body(*(samples.signal(name) for name in water))
        twist = _twist(through, body(*_vector(samples, group, *RATES)))
        yield _stamped(
            samples, f"/{GROUPS[group]}/velocity_through_water", "geometry_msgs/msg/TwistStamped",
            {"twist": twist}, water, frame=child,
        )  # fmt: skip
    known = np.isfinite(np.concatenate([place, turn], axis=1)).all(axis=1)
    yield _transform(samples, "/tf", (MAP, child), place, _xyzw(turn), known)
    offset = body(*(np.full(samples.count, x) for x in samples.imu_position))
    sensor = IMU if measured else IMU + TRUE
    first = np.arange(samples.count) == 0
    yield _transform(samples, "/tf_static", (child, sensor), offset, {"w": 1.0}, first)


def _doppler(samples: Samples) -> Iterator[Topic]:
    """Topics of the Doppler log's velocity, one over the bottom and one through the water."""
    names = _names("measured", "dvl_surge", "dvl_sway", "dvl_heave")
    if not _all_of(samples, *names, "measured_dvl_mode"):
        return
    speed = body(*(samples.signal(name) for name in names))
    twist = {"twist": {"twist": _twist(speed, body(*_vector(samples, "measured", *RATES)))}}
    mode = samples.signal("measured_dvl_mode")
    for over, code in DVL_MODES.items():
        topic = _stamped(
            samples, f"/measured/dvl/{over}", "geometry_msgs/msg/TwistWithCovarianceStamped",
            twist, [*names, "measured_dvl_mode"],
        )  # fmt: skip
        known = (mode == code) & np.isfinite(speed).all(axis=1)
        yield dataclasses.replace(topic, known=known)


def _fix(
    samples: Samples, name: str, latitude: Array, longitude: Array, signals: tuple[str, ...],
    deviation: float | None,
) -> Topic:  # fmt: skip
    """Topic of positions (NavSatFix), with altitude above the sea surface."""
    depth = next((n for n in ("true_depth", "measured_depth") if n in samples.names), None)
    deep = name != "/measured/fix" and depth is not None
    height = -samples.signal(depth) if deep and depth is not None else np.zeros(samples.count)
    variance = 0.0 if deviation is None else deviation**2
    values = {
        "status": {"status": FIX, "service": GPS},
        "latitude": latitude,
        "longitude": longitude,
        "altitude": height,
        "position_covariance": (variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, 0.0),
        "position_covariance_type": UNKNOWN if deviation is None else APPROXIMATED,
    }
    frame = BASE + (TRUE if name.startswith("/truth") else "")
    return _stamped(samples, name, "sensor_msgs/msg/NavSatFix", values, signals, frame=frame)


def _imu_covariances(samples: Samples) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Covariances of rates [(rad/s)2] and specific force [(m/s2)2]; zeros mean unknown.

    The variance of a sample is the sum of those of white noise, bias instability and turn-on bias.
    """

    def of(density: float, instability: float, bias: float) -> tuple[float, ...]:
        variance = density**2 / samples.period + instability**2 + bias**2
        return tuple(np.diag([variance] * 3).ravel().tolist())

    imu = samples.imu
    if imu is None:
        return (0.0,) * 9, (0.0,) * 9
    return (
        of(imu.gyro_noise_density, imu.gyro_bias_instability, imu.gyro_turn_on_bias),
        of(imu.accel_noise_density, imu.accel_bias_instability, imu.accel_turn_on_bias),
    )


def in_si(name: str) -> tuple[str, float]:
    """Unit of a signal's messages, and the factor from the store's unit."""
    stored = VARIABLES[name].units
    return SI.get(stored, (stored, 1.0))


def _number(samples: Samples, name: str) -> Topic:
    """Topic of a signal without a standard message."""
    group, rest = name.split("_", 1)
    units, factor = in_si(name)
    values = samples.signal(name) * factor
    return Topic(
        name=f"/{GROUPS[group]}/{rest}", type="std_msgs/msg/Float64", values={"data": values},
        known=np.isfinite(values), signals=(name,), units=units,
    )  # fmt: skip


def _stamped(
    samples: Samples, name: str, kind: str, values: Mapping[str, Any], signals: Any, *,
    frame: str = BASE,
) -> Topic:  # fmt: skip
    """Topic with headers; samples with a gap in any field have no message."""
    suffixed = frame + TRUE if name.startswith("/truth") and frame == BASE else frame
    header = {"stamp": _stamp(samples.time), "frame_id": suffixed}
    return Topic(
        name=name, type=kind, values={"header": header, **values}, frame=suffixed,
        known=_finite(values, samples.count), signals=tuple(signals),
    )  # fmt: skip


def _transform(
    samples: Samples, name: str, frames: tuple[str, str], place: Array, turn: Mapping[str, Any],
    known: NDArray[np.bool_],
) -> Topic:  # fmt: skip
    """Topic of the pose of the second of two frames in the first."""
    transform = {
        "header": {"stamp": _stamp(samples.time), "frame_id": frames[0]},
        "child_frame_id": frames[1],
        "transform": {"translation": _xyz(place), "rotation": turn},
    }
    return Topic(
        name=name, type="tf2_msgs/msg/TFMessage", values={"transforms": [transform]}, known=known,
        signals=(), frame=frames[1],
    )  # fmt: skip


def _finite(values: Any, count: int) -> NDArray[np.bool_]:
    """True for samples whose fields are all finite."""
    known = np.ones(count, bool)
    if isinstance(values, np.ndarray):
        known &= np.isfinite(values.reshape(count, -1)).all(axis=1)
    elif isinstance(values, Mapping):
        for value in values.values():
            known &= _finite(value, count)
    return known


def _all_of(samples: Samples, *names: str) -> bool:
    return all(name in samples.names for name in names)


def _vector(samples: Samples, group: str, *names: str) -> tuple[Array, ...]:
    """Signals of a group such as `true`; zeros for missing ones."""
    return tuple(
        samples.signal(f"{group}_{name}") if f"{group}_{name}" in samples.names else
        np.zeros(samples.count)
        for name in names
    )  # fmt: skip


def _orientation(samples: Samples, group: str) -> Array:
    """Quaternion (x, y, z, w) of the vehicle, (samples, 4)."""
    return orientation(*_vector(samples, group, *ANGLES))


def _names(group: str, *names: str) -> list[str]:
    return [f"{group}_{name}" for name in names]


def _stamp(time: NDArray[np.int64]) -> dict[str, Any]:
    seconds, rest = np.divmod(time, 1_000_000_000)
    return {"sec": seconds, "nanosec": rest}


def _xyz(vector: Array) -> dict[str, Any]:
    return dict(zip("xyz", vector.T, strict=True))


def _xyzw(quaternion: Array) -> dict[str, Any]:
    return dict(zip("xyzw", quaternion.T, strict=True))


def _twist(linear: Array, angular: Array) -> dict[str, Any]:
    return {"linear": _xyz(linear), "angular": _xyz(angular)}
