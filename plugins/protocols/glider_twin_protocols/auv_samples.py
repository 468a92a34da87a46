"""AUV samples: writers of sample logs of propelled vehicles: LAUV (`lsf`), Dorado and LRAUV.

IMC packets are written by `imcpy`, which has DUNE's own code. The Dorado format, a text header and
little-endian records, follows MB-System's mbauvloglist and MBARI's auv-python. Writers take times
and states as in `message_samples`, with north and east [m] of a track.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from factory.samples import Array, Flight, add_variables, named, write_netcdf
from twin.geodesy import from_tangent_plane, to_tangent_plane

SINCE_1970 = "seconds since 1970-01-01T00:00:00Z"


def track_of(time: Array, state: Mapping[str, Array]) -> tuple[Array, Array]:
    """[m] North and east of the state's track, or of the track integrated from its velocity."""
    if "north" in state:
        return state["north"], state["east"]
    heading = np.radians(state["heading"])
    cosine, sine = np.cos(heading), np.sin(heading)
    step = np.diff(time, prepend=time[0])
    north = state["surge"] * cosine - state["sway"] * sine
    east = state["surge"] * sine + state["sway"] * cosine
    return np.cumsum(north * step), np.cumsum(east * step)


def _wrapped(degrees: Array) -> Array:
    """[rad] Angles wrapped to -pi to pi."""
    return np.angle(np.exp(1j * np.radians(degrees)))


# --- DUNE ---------------------------------------------------------------------------------------

OWN = 30
"""IMC address of the vehicle."""
ENTITIES = {
    1: "Navigation", 2: "AHRS", 3: "Depth Sensor", 4: "DVL", 5: "GPS", 6: "Motor", 7: "Servos",
    8: "CTD", 9: "Main Board", 10: "Batteries",
}  # fmt: skip
ORIGINS = (49.5, -58.0), (49.5003, -57.999)
"""[degree] Latitude and longitude of the two successive origins of the vehicle's state."""
DECLINATION = -0.05
"""[rad] Magnetic declination"""


def message(kind: str, moment: float, entity: int, system: int = OWN, **fields: Any) -> bytes:
    """Make an IMC packet at a unix time [s]."""
    import imcpy

    one = imcpy.Factory.produce(kind)
    one.timestamp, one.src, one.src_ent = moment, system, entity
    for field, value in fields.items():
        setattr(one, field, value)
    return bytes(imcpy.Packet.serialize(one))


def entities(moment: float, system: int = OWN) -> bytes:
    """Make the packets in which a system names its entities, at the start of a log."""
    return b"".join(
        message("EntityInfo", moment, k, system, id=k, label=label, component="test")
        for k, label in ENTITIES.items()
    )


def packets(time: Array, state: Mapping[str, Array]) -> list[bytes]:
    """Make the packets of each sample time, preceded by the entities' names."""
    found = [entities(float(time[0]))]
    latitudes, longitudes = from_tangent_plane(*track_of(time, state), *ORIGINS[0])
    headings = _wrapped(state["heading"]).tolist()
    for k, moment in enumerate(time.tolist()):
        now = {name: float(values[k]) for name, values in state.items()}
        roll, pitch, heading = (
            np.radians(now.get("roll", 0.0)),
            np.radians(now["pitch"]),
            headings[k],
        )
        origin = ORIGINS[k >= len(time) // 2]  # a vehicle moves its origin after a long distance
        x, y = to_tangent_plane(latitudes[k], longitudes[k], *origin)
        some = [
            message("EstimatedState", moment, 1, lat=np.radians(origin[0]),
                    lon=np.radians(origin[1]), x=x, y=y, z=0.0, phi=roll, theta=pitch, psi=heading,
                    p=0.001, q=0.002, r=0.003, depth=now["depth"], alt=-1.0),
            message("EulerAngles", moment, 2, phi=roll + 0.1, theta=pitch + 0.1,
                    psi=heading - DECLINATION, psi_magnetic=heading - DECLINATION),
            message("AngularVelocity", moment, 2, x=0.01, y=-0.02, z=now.get("yaw_rate", 0.0)),
            message("Acceleration", moment, 2, x=0.1, y=-0.2, z=-9.8),
            message("Depth", moment, 3, value=now["depth"]),
            message("Pressure", moment, 3, value=100.0 * now["depth"] * 1.0065),
            message("Temperature", moment, 9, value=45.0),
        ]  # fmt: skip
        if "surge" in now:
            some += _propelled(moment, k, now)
        if "latitude" in now:
            there = np.isfinite(now["latitude"])
            place = [np.radians(now[n]) if there else 0.0 for n in ("latitude", "longitude")]
            some.append(
                message("GpsFix", moment, 5, validity=0x0007 if there else 0x0003,
                        lat=place[0], lon=place[1], satellites=8)
            )  # fmt: skip
        found.append(b"".join(some))
    return found


def _propelled(moment: float, k: int, now: Mapping[str, float]) -> list[bytes]:
    """Make packets of a Doppler log, a motor, four servos, a CTD and two voltmeters."""
    ping = k % 50  # the last ten of 50 lack bottom lock; the first and last five lack water lock
    servos = [0.10, -0.05, -0.07, 0.14]
    return [
        message("GroundVelocity", moment, 4, validity=7 if ping < 40 else 0, x=now["surge"],
                y=now["sway"], z=0.01),
        message("WaterVelocity", moment + 0.01, 4, validity=7 if 5 <= ping < 45 else 0,
                x=now["surge"] + 0.1, y=0.02, z=-0.03),
        message("Rpm", moment, 6, value=round(now["rpm"])),
        *(message("ServoPosition", moment, 7, id=i, value=a) for i, a in enumerate(servos)),
        *(message("SetServoPosition", moment, 1, id=i, value=2 * a) for i, a in enumerate(servos)),
        message("SetThrusterActuation", moment, 1, id=0, value=0.4),
        message("Temperature", moment, 8, value=14.0), message("Salinity", moment, 8, value=35.0),
        message("Conductivity", moment, 8, value=4.2),
        message("Voltage", moment, 9, value=12.0), message("Voltage", moment, 10, value=25.5),
        message("Current", moment, 10, value=3.5),
    ]  # fmt: skip


def write_lsf(folder: Path, flight: Flight) -> list[Path]:
    """Write dives as a DUNE log."""
    path = folder / "Data.lsf"
    path.write_bytes(b"".join(packets(*flight.with_fixes())))
    return [path]


LSF = {"lsf": write_lsf}

# --- Dorado -------------------------------------------------------------------------------------

SIZES = {"timeTag": "<f8", "double": "<f8", "angle": "<f8", "float": "<f4", "integer": "<i4",
         "short": "<i2"}  # fmt: skip
Field = tuple[str, str, Array]
"""Type as in a header, field name, values"""


def instruments(
    time: Array, state: Mapping[str, Array], *, west: bool = False
) -> dict[str, list[Field]]:
    """Fields of each instrument's log, by instrument.

    Args:
      west: the GPS receiver's longitudes are positive westward, as in the vehicle's own logs.
    """
    nothing = np.zeros(len(time))
    north, east = track_of(time, state)
    found: dict[str, list[Field]] = {
        "navigation": [
            ("timeTag", "time", time), ("double", "mPos_x", 4_060_000.0 + north),
            ("double", "mPos_y", 600_000.0 + east), ("double", "mDepth", state["depth"]),
            ("integer", "mGpsValid", nothing),
            ("double", "mPhi", np.radians(state.get("roll", nothing))),
            ("double", "mTheta", np.radians(state["pitch"])),
            ("double", "mPsi", _wrapped(state["heading"])),
            ("double", "mOmega_x", nothing + 0.01), ("double", "mOmega_y", nothing - 0.02),
            ("double", "mOmega_z", state.get("yaw_rate", nothing)),
            ("double", "mWaterSpeed", nothing + 1.5),
        ],
        "tailCone": [
            ("timeTag", "time", time + 0.05), ("integer", "status", nothing),
            ("integer", "propRpm", np.round(state.get("rpm", nothing) * np.pi / 30.0)),
            ("float", "elevatorAngle", nothing + 0.06), ("float", "rudderAngle", nothing - 0.12),
        ],
    }  # fmt: skip
    if "latitude" in state:
        fixed = np.isfinite(state["latitude"])
        places = np.radians([np.nan_to_num(state[n]) for n in ("latitude", "longitude")])
        inside = np.flatnonzero(fixed)
        held = [np.interp(np.arange(len(time)), inside, one[inside]) for one in places]
        found["gps"] = [
            ("timeTag", "time", time), ("angle", "latitude", places[0]),
            ("angle", "longitude", -places[1] if west else places[1]),
            ("short", "quality", fixed.astype(float)), ("short", "numberOfSatellites", nothing + 8),
        ]  # fmt: skip
        found["navigation"] += [("double", "latitude", held[0]), ("double", "longitude", held[1])]
    return found


def write_log(path: Path, fields: Sequence[Field]) -> Path:
    """Write an instrument's log in the vehicle's format."""
    lines = [f"# binary {path.name.partition('.')[0]}"]
    lines += [f"# {kind} {name} %8.8e ,{name} ,UNKNOWN" for kind, name, _ in fields]
    records = np.zeros(len(fields[0][2]), [(name, SIZES[kind]) for kind, name, _ in fields])
    for _, name, values in fields:
        records[name] = values
    path.write_bytes(("\n".join([*lines, "# begin"]) + "\n").encode() + records.tobytes())
    return path


def write_along(path: Path, fields: Mapping[str, Array]) -> Path:
    """Write variables with one time axis as netCDF; `time` [s unix] is one of them."""
    about = {"time": [SINCE_1970]}
    return write_netcdf(
        path, {n: (("time",), values, *about.get(n, ())) for n, values in fields.items()}
    )


def write_dorado(folder: Path, flight: Flight) -> list[Path]:
    """Write dives as the vehicle's own logs."""
    every = instruments(*flight.with_fixes(), west=True)
    return [write_log(folder / f"{name}.log", fields) for name, fields in every.items()]


def write_dorado_netcdf(folder: Path, flight: Flight) -> list[Path]:
    """Write dives as one netCDF file per instrument."""
    return [
        write_along(folder / f"{name}.nc", {n: v for _, n, v in fields})
        for name, fields in instruments(*flight.with_fixes()).items()
    ]


def write_dorado_product(folder: Path, flight: Flight) -> list[Path]:
    """Write dives as a product file, resampled to 1 s, with angles in degree."""
    time = np.arange(flight.time[0], flight.time[-1], 1.0)
    state = flight.state(time)
    latitude, longitude = flight.position(time)
    fields = {
        "time": time, "depth": state["depth"], "latitude": latitude, "longitude": longitude,
        "navigation_pitch": state["pitch"], "navigation_roll": np.zeros(len(time)),
        "navigation_yaw": state["heading"], "ctd1_temperature": 12.0 - 0.05 * state["depth"],
        "ctd1_salinity": 33.5 + 0.01 * state["depth"], "navigation_mWaterSpeed": 1.0 + 0.0 * time,
    }  # fmt: skip
    return [write_along(folder / "dorado_2011.256.02_1S.nc", fields)]


DORADO = {"log": write_dorado, "netcdf": write_dorado_netcdf, "product": write_dorado_product}

# --- LRAUV --------------------------------------------------------------------------------------


def write_mat(path: Path, flight: Flight) -> Path:
    """Write HDF5 groups of time (MATLAB days), value and units, with every sample twice."""
    import netCDF4

    time = flight.time[::5]
    state = flight.state(time)
    surfaced = state["under"] == 0.0
    latitude, longitude = flight.position(time)
    signals = {
        "depth": (time, state["depth"], "m"),
        "latitude_fix": (time[surfaced], latitude[surfaced], "arcdeg"),
        "longitude_fix": (time[surfaced] + 0.001, longitude[surfaced], "arcdeg"),
        "sea_water_temperature": (time, np.full(len(time), 283.15), "K"),
    }
    with netCDF4.Dataset(path, "w") as file:
        for name, (at, values, unit) in signals.items():
            days, twice = np.repeat(at / 86400.0 + 719529.0, 2), np.repeat(values, 2)
            columns = {
                "time": (("n", "one"), days[:, None]),
                "value": (("n", "one"), twice[:, None]),
                "units": (("u", "one"), np.array([[ord(c)] for c in unit], np.uint16)),
            }
            add_variables(file.createGroup(name), columns)
    return path


def write_nc4(path: Path, flight: Flight) -> Path:
    """Write netCDF-4 in which each variable has its own time axis."""
    state = flight.state(flight.time)
    signals = {
        "depth": (state["depth"], "m"),
        "platform_pitch_angle": (np.radians(state["pitch"]), "rad"),
        "platform_buoyancy_position": (state["pump"] * 1e-6, "m3"),
    }
    variables: dict[str, Any] = {}
    for name, one in signals.items():
        clock = f"{name}_time"
        variables |= {clock: ((clock,), flight.time, SINCE_1970), name: ((clock,), *one)}
    return write_netcdf(path, variables)


LRAUV = {"mat": named(write_mat, "log.mat"), "nc4": named(write_nc4, "log.nc4")}
