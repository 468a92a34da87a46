"""Start values: the shipped vehicle of a log's kind, and a glider's steady flight.

In steady flight the forces are in balance at every sample.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import jit
from twin.errors import InputError
from twin.identify.logged_missions import check_channels
from twin.records.attributes import PLATFORM, SOURCE_FORMAT
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.vehicle.parts.pump import CUBIC_CM
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle

SHALLOW_SLOCUM = {"measured_depth": 230.0, "measured_pump": 245.0}
"""[m], [cm3] beyond which a 200 m Slocum with its ballast pump does not go; deep ones have an oil
pump of 260 cm3 either way."""
KINDS = ("seaglider", "seaexplorer", "spray", "slocum")
"""Kinds of glider, as formats and platforms of logs call them."""


def start_vehicle(store: str | StorePath) -> Vehicle:
    """The vehicle file that suits a store: a simulated one's own, else that of the log's kind.

    Raises:
      StoreError: no such store, or a log of an unknown kind that no flight model can read.
      InputError: the log does not say which kind of glider it is of.
    """
    with MissionStore(store) as found:
        driven = any(f"{said}_propeller" in found for said in ("measured", "commanded"))
        if driven and not found.says_vehicle:
            raise InputError(
                f"store {store} is of a vehicle under a propeller and does not say which: give "
                "--vehicle, such as remus or tethys, or the path of its own file"
            )
        if not found.logged:
            flown = found.vehicle
            return parse_vehicle(flown.xml, flown.path)
        kind = _kind(found)
        if kind is None:
            check_channels(found, "a flight model")  # no --vehicle helps a log without them
            source, platform = _said(found)
            raise InputError(
                f"store {store} does not say which glider it is of "
                f"(source_format {source!r}, platform {platform!r}); give --vehicle, such as "
                f"{', '.join(KINDS[:2])} or slocum-200"
            )
        return load_vehicle(_slocum(found) if kind == "slocum" else kind)


def other_kind(store: str | StorePath, vehicle: Vehicle, kind: str = "") -> str:
    """A warning if a vehicle is of another kind than the log, both as they say; empty if not.

    A vehicle made from a shipped file still has its model's name; of other names nothing is known.

    Args:
      kind: of the logs in `store`, as `factory import` calls it, where that is no store yet.

    Raises:
      StoreError: no such store.
    """
    flown = _glider(kind)
    if not kind:
        with MissionStore(store) as found:
            flown = _kind(found) if found.logged else None
    model = vehicle.model
    if flown is None or model not in vehicle_names() or flown in model:
        return ""
    return (
        f"vehicle {vehicle.name} ({model}) is of another kind than that of the log {store} "
        f"({flown}): it did not fly these dives; give --vehicle of the log's kind"
    )


def _said(store: MissionStore) -> list[str]:
    """Format and platform of a log."""
    return [str(store.attributes.get(name, "")) for name in (SOURCE_FORMAT, PLATFORM)]


def _kind(store: MissionStore) -> str | None:
    """Kind of the glider, as a log says; None where it does not."""
    return _glider(*_said(store))


def _glider(*said: str) -> str | None:
    return next((k for text in said for k in KINDS if k in text.lower()), None)


def _slocum(store: MissionStore) -> str:
    """The shallow one with a ballast pump, or the deep one with an oil pump."""
    largest = 0.0
    for name, limit in SHALLOW_SLOCUM.items():
        if name in store:
            values = np.abs(store.rows(name, range(len(store))))
            known = values[np.isfinite(values)]
            if known.size:
                largest = max(largest, float(np.percentile(known, 99.5)) / limit)
    return "slocum-1000" if largest > 1.0 else "slocum-200"


Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ITERATIONS = 30
"""of the fixed point, whose error shrinks by 2 K_D alpha / (K_alpha tan(path angle)) each, below
0.3 for paths steeper than 15 deg."""


def net_mass(vehicle: Vehicle, pump: Array, depth: Array) -> Array:
    """Net buoyancy mass [kg], + = heavy, that the nominal vehicle has; pump in cm3, depth in m."""
    pressure = vehicle.reference_density * vehicle.gravity * depth
    volume = (vehicle.neutral_volume + CUBIC_CM * pump) * (
        1.0 - vehicle.hull_compressibility * pressure
    )
    return vehicle.mass - vehicle.reference_density * volume


def balance(
    vehicle: Vehicle, net: Array, roll: Array, pitch: Array, rates: Array
) -> tuple[Array, Array, Array, Mask]:
    """The steady motion at each sample.

    Args:
      net: net buoyancy mass [kg], (time,).
      roll, pitch: [rad], (time,).
      rates: roll, pitch and yaw rate [rad/s], body FRD, (3, time).

    Returns:
      Speed [m/s], angle of attack and sideslip [rad], and where there is such a motion (bool):
      elsewhere the weight does not pull along the hull, as at an inflection. Each (time,).
    """
    law = vehicle.flow_frame
    inertia = vehicle.mass * np.eye(3) + vehicle.added_mass[:3, :3]
    speed, alpha, beta = (np.zeros(len(pitch)) for _ in range(3))
    gliding: Mask = np.zeros(len(pitch), bool)
    coefficients = np.array([*law.drag[:2], *law.lift[:2], law.side_force[0], law.blend_angle])
    _balance(
        vehicle.gravity * np.asarray(net, float), np.asarray(roll, float), np.asarray(pitch, float),
        np.asarray(rates, float), inertia, coefficients, speed, alpha, beta, gliding,
    )  # fmt: skip
    return speed, alpha, beta, gliding


@jit
def _balance(  # type: ignore[no-untyped-def]
    pull, roll, pitch, rates, inertia, coefficients, speed, alpha, beta, gliding
):
    """The fixed point of each sample, into the last four; `pull` [N] is gravity's on the net mass.

    coefficients: K_D0, K_D, K_L0, K_alpha, K_beta and the largest angle [rad].
    """
    drag_0, drag = coefficients[0], coefficients[1]
    lift_0, lift = coefficients[2], coefficients[3]
    side_force, limit = coefficients[4], coefficients[5]
    momentum, velocity = np.empty(3), np.empty(3)
    for k in range(len(pitch)):
        down_x = -math.sin(pitch[k])
        down_y = math.cos(pitch[k]) * math.sin(roll[k])
        down_z = math.cos(pitch[k]) * math.cos(roll[k])
        p, q, r = rates[0, k], rates[1, k], rates[2, k]
        v, a, b, pulled = 0.0, 0.0, 0.0, False
        for _ in range(ITERATIONS):
            c_a, s_a, c_b, s_b = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
            velocity[0], velocity[1], velocity[2] = v * c_a * c_b, v * s_b, v * s_a * c_b
            for i in range(3):
                momentum[i] = 0.0
                for j in range(3):
                    momentum[i] += inertia[i, j] * velocity[j]
            x = pull[k] * down_x + momentum[1] * r - momentum[2] * q
            y = pull[k] * down_y + momentum[2] * p - momentum[0] * r
            z = pull[k] * down_z + momentum[0] * q - momentum[1] * p
            # Rows of R_BC^T (Zhang et al. 2013).
            along = c_a * c_b * x + s_b * y + s_a * c_b * z
            side = -c_a * s_b * x + c_b * y - s_a * s_b * z
            normal = -s_a * x + c_a * z
            before = v, a, b
            pulled = along > 0.0
            if pulled:
                square = along / (drag_0 + drag * a * a)
                v = math.sqrt(square)
                a = min(max((normal / square - lift_0) / lift, -limit), limit)
                b = min(max(-side / square / side_force, -limit), limit)
            else:
                v, a, b = 0.0, 0.0, 0.0
            if (v, a, b) == before:
                break
        speed[k], alpha[k], beta[k] = v, a, b
        gliding[k] = pulled and abs(a) < limit and abs(b) < limit
