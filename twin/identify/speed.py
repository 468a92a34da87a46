"""Speed: velocity through the water of a calibrated vehicle in a log.

The model "flight" integrates the equation of motion; in "steady" forces balance at every sample.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from twin.errors import InputError, unknown_name
from twin.identify.calibration import Array, Calibration, Mask
from twin.identify.logged_missions import AFLOAT, Log
from twin.identify.translation import AttitudeFlight, Translation, Velocity, fly
from twin.vehicle.steady_motion import balance

FlightModel = Literal["flight", "steady"]
MODELS: tuple[FlightModel, ...] = ("flight", "steady")

LEAST_IMMERSION = 0.3
"""[1] Wetted fraction of the hull at the surface: half, minus the fraction that waves uncover"""
START_PITCH = np.deg2rad(5.0)
"""[rad] Smallest pitch at which depth rate and pitch give the speed at the first sample"""
FASTEST_START = 1.0
"""[m/s] Largest speed at the first sample"""
STEADY_WINDOW = 10.0
"""[s] Window of the mean attitude in the steady model"""
STEADY_MARGIN = 45.0
"""[s] Time before and after a change of pump or pitch that does not count as steady flight"""
STEADY_PUMP, STEADY_PITCH = 40.0, np.deg2rad(8.0)
"""Change within the margin that ends steady flight. STEADY_PUMP: [cm3]. STEADY_PITCH: [rad]"""
STEADY_LEAST_PITCH = np.deg2rad(10.0)
"""[rad] Smallest pitch of a steady glide: no buoyancy glider glides flatter."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpeedEstimate:
    """Velocities of one dive, (time,)."""

    period: float
    """[s] Time between samples"""
    motion: Translation
    """[m/s] Surge, sway and heave through the water"""
    sink_rate: Array
    """[m/s] Downward velocity through the water: the vehicle's depth rate in still water"""
    water_rise: Array
    """[m/s] Filtered depth rate minus the model's: downward motion of the water plus model error"""
    velocity_north: Array
    """[m/s] Northward velocity through the water"""
    velocity_east: Array
    """[m/s] Eastward velocity through the water"""
    use: Mask
    """True where the vehicle is under water and the sample was measured"""

    @property
    def speed(self) -> Array:
        """[m/s] Speed through the water."""
        return self.motion.speed

    def track(self) -> Array:
        """Displacement north and east [m] through the water since the first sample, (time, 2)."""
        return way_of(np.stack([self.velocity_north, self.velocity_east], axis=1), self.period)


def way_of(velocity: Array, period: float) -> Array:
    """Displacement [m] since the first sample, by velocities [m/s] every `period` [s]."""
    steps = 0.5 * period * (velocity[1:] + velocity[:-1])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def density_of(log: Log, calibration: Calibration) -> Array:
    """In-situ density [kg/m3], (time,): the measured one, or the calibration's without a CTD."""
    return calibration.sea_density(log.depth) if log.density is None else log.density


def motion_of(
    log: Log,
    calibration: Calibration,
    model: FlightModel = "flight",
    *,
    start: Velocity | None = None,
) -> Translation:
    """Velocity through the water, body FRD, by a flight model with a log's inputs.

    Args:
      start: velocity [m/s] at the first sample, by default that of `start_of`; the steady model
        needs none.

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
    """Motions of every log by every calibration, [calibration][log], computed in batches.

    Raises:
      InputError: as for `motion_of`.
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
    """Velocity at which the forces balance at each sample."""
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
    """Inputs of the flight model from a log."""
    vehicle = calibration.vehicle
    pitch = calibration.true_pitch(log.pitch)
    x = np.clip((log.depth + 0.5 * vehicle.hull_diameter) / vehicle.hull_diameter, 0.0, 1.0)
    immersion = np.maximum(x * x * (3.0 - 2.0 * x), LEAST_IMMERSION)
    # a Seaglider waits nose down at the surface, with its tail out of the water
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
    """Surge, sway and heave [m/s] at the first sample: along the nose, at the log's depth rate.

    Zero at the surface, and at pitches below START_PITCH.
    """
    pitch = float(calibration.true_pitch(log.pitch)[0])
    speed = 0.0
    if log.depth[0] > AFLOAT and abs(pitch) > START_PITCH:
        speed = -float(log.depth_rate[0]) / np.sin(pitch)
    return float(np.clip(speed, 0.0, FASTEST_START)), 0.0, 0.0


def steady_parts(log: Log) -> Mask:
    """Mask of steady glides: pump and pitch at rest within the margin, the nose not flat."""
    width = 2 * max(round(STEADY_MARGIN / log.period), 1) + 1
    still = np.ones(len(log.depth), bool)
    for values, most in ((log.pump, STEADY_PUMP), (log.pitch, STEADY_PITCH)):
        spread = maximum_filter1d(values, width) - minimum_filter1d(values, width)
        still &= spread < most
    return still & (np.abs(log.pitch) > STEADY_LEAST_PITCH)


def horizontal(log: Log, calibration: Calibration, motion: Translation) -> tuple[Array, Array]:
    """North and east velocity through the water [m/s], (time,) each; zero at the surface."""
    forward, starboard = motion.level(log.roll, calibration.true_pitch(log.pitch))
    heading = calibration.true_heading(log.heading)
    under = log.depth > AFLOAT
    north = forward * np.cos(heading) - starboard * np.sin(heading)
    east = forward * np.sin(heading) + starboard * np.cos(heading)
    return np.where(under, north, 0.0), np.where(under, east, 0.0)


def estimate(log: Log, calibration: Calibration, model: FlightModel = "flight") -> SpeedEstimate:
    """Velocities of one dive from its depth, attitude, pump and density."""
    motion = motion_of(log, calibration, model)
    sink = motion.sink_rate(log.roll, calibration.true_pitch(log.pitch))
    north, east = horizontal(log, calibration, motion)
    return SpeedEstimate(
        period=log.period,
        motion=motion,
        sink_rate=sink,
        water_rise=log.depth_rate - log.filtered(sink),
        velocity_north=north,
        velocity_east=east,
        use=log.use,
    )
