"""Speed: the velocity through the water that a calibrated vehicle had in a log.

In steady flight the forces are in balance at every sample.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from twin.compiled import jit
from twin.errors import InputError, unknown_name
from twin.identify.calibration import Array, Calibration, Mask, load_calibration
from twin.identify.logged_missions import AFLOAT, Log, load_logs
from twin.identify.translation import AttitudeFlight, Translation, Velocity, fly
from twin.vehicle.parts.pump import CUBIC_CM
from twin.vehicle.vehicle import Vehicle

FlightModel = Literal["flight", "steady"]
MODELS: tuple[FlightModel, ...] = ("flight", "steady")

LEAST_IMMERSION = 0.3
"""Part of the hull that the water acts on at the surface: half of it, less what waves uncover."""
START_PITCH = np.deg2rad(5.0)
"""[rad] of pitch from which depth rate and pitch tell the speed at the first sample"""
FASTEST_START = 1.0
"""[m/s] of that speed"""
STEADY_WINDOW = 10.0
"""[s] average of the attitude in the steady model."""
STEADY_MARGIN = 45.0
"""[s] before and after the pump or the pitch changes that no flight is steady."""
STEADY_PUMP, STEADY_PITCH = 40.0, np.deg2rad(8.0)
"""[cm3], [rad] of change within the margin that ends a steady flight."""
STEADY_LEAST_PITCH = np.deg2rad(10.0)
"""[rad] flatter than this no buoyancy glider glides."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpeedEstimate:
    """Velocities of one mission, (time,)."""

    index: int
    """Row in the store."""
    period: float
    """[s]"""
    motion: Translation
    """Surge, sway and heave through the water [m/s]."""
    sink_rate: Array
    """[m/s] downward through the water, which the vehicle's depth rate would be in still water."""
    water_rise: Array
    """[m/s] filtered depth rate less the model's: downward motion of the water plus model error."""
    velocity_north: Array
    """[m/s] through the water"""
    velocity_east: Array
    """[m/s] through the water"""
    use: Mask
    """Under water and measured."""

    @property
    def speed(self) -> Array:
        """[m/s] through the water."""
        return self.motion.speed

    @property
    def angle_of_attack(self) -> Array:
        """[rad]"""
        return self.motion.angle_of_attack

    def track(self) -> Array:
        """North, east [m] through the water since the first sample, (time, 2)."""
        return way_of(np.stack([self.velocity_north, self.velocity_east], axis=1), self.period)


def way_of(velocity: Array, period: float) -> Array:
    """Displacement [m] since the first sample of velocities [m/s] every `period` [s], (time, 2)."""
    steps = 0.5 * period * (velocity[1:] + velocity[:-1])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def density_of(log: Log, calibration: Calibration) -> Array:
    """In-situ density [kg/m3], (time,): as measured, or the calibration's without a CTD."""
    return calibration.sea_density(log.depth) if log.density is None else log.density


def motion_of(
    log: Log,
    calibration: Calibration,
    model: FlightModel = "flight",
    *,
    start: Velocity | None = None,
) -> Translation:
    """Velocity through the water, body FRD, that the model gives for a log.

    Args:
      start: velocity [m/s] at the first sample, which the steady model does not know; by default
        that of `start_of`.

    Raises:
      InputError: an unknown model, or a speed beyond every bound.
    """
    if model not in MODELS:
        raise InputError(unknown_name("flight model", model, MODELS))
    if model == "steady":
        return _steady_motion(log, calibration)
    return fly([_flight(log, calibration, start)])[0]


def motions_of(
    logs: Sequence[Log], calibrations: Sequence[Calibration], model: FlightModel = "flight"
) -> list[list[Translation]]:
    """`motion_of` every log by every calibration, side by side: of each calibration, of each log.

    Raises:
      InputError: as `motion_of`.
    """
    if model != "flight":
        return [[motion_of(log, one, model) for log in logs] for one in calibrations]
    flown = fly([_flight(log, one) for one in calibrations for log in logs])
    return [flown[k : k + len(logs)] for k in range(0, len(flown), max(len(logs), 1))]


def net_mass_of(log: Log, calibration: Calibration) -> Array:
    """Net buoyancy mass [kg], + = heavy, fully immersed, (time,)."""
    return calibration.net_mass(
        density_of(log, calibration),
        np.maximum(log.depth, 0.0),
        log.pump,
        log.hull_warming(calibration.thermal_lag),
    )


def _steady_motion(log: Log, calibration: Calibration) -> Translation:
    """Forces in balance at each sample."""
    pitch = calibration.true_pitch(log.pitch)
    half = max(round(STEADY_WINDOW / log.period), 1)
    roll, pitch = (uniform_filter1d(a, half) for a in (log.roll, pitch))
    rates = np.stack([uniform_filter1d(rate, half) for rate in log.rates])
    net = net_mass_of(log, calibration)
    speed, alpha, beta, gliding = balance(calibration.vehicle, net, roll, pitch, rates)
    speed = np.where(gliding & (log.depth > AFLOAT), speed, 0.0)
    return Translation(
        surge=speed * np.cos(alpha) * np.cos(beta),
        sway=speed * np.sin(beta),
        heave=speed * np.sin(alpha) * np.cos(beta),
    )


def _flight(log: Log, calibration: Calibration, start: Velocity | None = None) -> AttitudeFlight:
    """Inputs of the flight model, from a log."""
    vehicle = calibration.vehicle
    pitch = calibration.true_pitch(log.pitch)
    x = np.clip((log.depth + 0.5 * vehicle.hull_diameter) / vehicle.hull_diameter, 0.0, 1.0)
    immersion = np.maximum(x * x * (3.0 - 2.0 * x), LEAST_IMMERSION)
    # nose down, as a Seaglider waits at the surface, the tail is out of the water for longer
    tail = vehicle.hull_length * np.maximum(-np.sin(pitch), 0.0)
    return AttitudeFlight(
        vehicle=vehicle,
        period=log.period,
        net_mass=np.where(log.depth < AFLOAT + tail, 0.0, net_mass_of(log, calibration)),
        immersion=immersion,
        roll=log.roll,
        pitch=pitch,
        rates=log.rates,
        start=start_of(log, calibration) if start is None else start,
    )


def start_of(log: Log, calibration: Calibration) -> Velocity:
    """Surge, sway, heave [m/s] of a log that begins under water: along the nose at the depth rate.

    At rest at the surface, and where the nose is too flat to tell.
    """
    pitch = float(calibration.true_pitch(log.pitch)[0])
    speed = 0.0
    if log.depth[0] > AFLOAT and abs(pitch) > START_PITCH:
        speed = -float(log.depth_rate[0]) / np.sin(pitch)
    return float(np.clip(speed, 0.0, FASTEST_START)), 0.0, 0.0


def steady_parts(log: Log) -> Mask:
    """Where the vehicle glides steadily: pump and pitch at rest all around, the nose not flat."""
    width = 2 * max(round(STEADY_MARGIN / log.period), 1) + 1
    still = np.ones(len(log.depth), bool)
    for values, most in ((log.pump, STEADY_PUMP), (log.pitch, STEADY_PITCH)):
        spread = maximum_filter1d(values, width) - minimum_filter1d(values, width)
        still &= spread < most
    return still & (np.abs(log.pitch) > STEADY_LEAST_PITCH)


def horizontal(log: Log, calibration: Calibration, motion: Translation) -> tuple[Array, Array]:
    """North and east velocity through the water [m/s], (time,) each; zero afloat."""
    forward, starboard = motion.level(log.roll, calibration.true_pitch(log.pitch))
    heading = calibration.true_heading(log.heading)
    under = log.depth > AFLOAT
    north = forward * np.cos(heading) - starboard * np.sin(heading)
    east = forward * np.sin(heading) + starboard * np.cos(heading)
    return np.where(under, north, 0.0), np.where(under, east, 0.0)


def estimate(log: Log, calibration: Calibration, model: FlightModel = "flight") -> SpeedEstimate:
    """Velocities of one mission from its depth, attitude, pump and density."""
    motion = motion_of(log, calibration, model)
    sink = motion.sink_rate(log.roll, calibration.true_pitch(log.pitch))
    north, east = horizontal(log, calibration, motion)
    return SpeedEstimate(
        index=log.index,
        period=log.period,
        motion=motion,
        sink_rate=sink,
        water_rise=log.depth_rate - log.filtered(sink),
        velocity_north=north,
        velocity_east=east,
        use=log.use,
    )


def estimate_speed(
    store: str | Path,
    row: int,
    vehicle: str | Path | Calibration,
    *,
    model: FlightModel = "flight",
) -> SpeedEstimate:
    """Velocities of one mission of a store.

    Args:
      store: path of a zarr store of logs.
      row: mission in it.
      vehicle: what `twin identify` wrote, a shipped vehicle's name, or a calibration.
      model: "flight", with the vehicle's inertia, or "steady", forces in balance.

    Raises:
      StoreError: no such store, mission or channel, or no dive in it.
      VehicleError: no such vehicle.
    """
    calibration = vehicle if isinstance(vehicle, Calibration) else load_calibration(vehicle)
    return estimate(load_logs(store, [row])[0], calibration, model)


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
