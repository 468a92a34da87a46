"""Glides: steady dives and climbs of a glider that is not as its file says."""

import dataclasses

import numpy as np

from twin.vehicle.steady_motion import balance
from twin.vehicle.vehicle import load_vehicle
from twin.water.density import STANDARD_OCEAN

PERIOD = 0.5
LEG = 500
"""[s] of each dive and each climb"""
DENSITY = 1026.5
GRAVITY = 9.81


def glides(vehicle, pitches=(-20.0, 24.0, -38.0, 34.0, -28.0, 18.0), tilt=0.0, ballast=0.0):
    """Signals of steady dives and climbs of `vehicle` between 100 m and more, and its surge.

    `tilt` [rad] is the forward accelerometer's error, `ballast` [kg] what it is too heavy.
    """
    samples = round(LEG / PERIOD)
    pitch = np.repeat(np.deg2rad(pitches), samples)
    pump = np.where(pitch < 0.0, -300.0, 380.0)
    depth, surge, rates = np.full(len(pitch), 100.0), np.zeros(len(pitch)), np.zeros((3, 1))
    for leg in range(len(pitches)):
        place = leg * samples
        volume = vehicle.neutral_volume + 1e-6 * pump[place]
        net = vehicle.mass + ballast - DENSITY * volume
        one = np.array([pitch[place]])
        speed, alpha, beta, gliding = balance(vehicle, np.array([net]), 0.0 * one, one, rates)
        assert gliding.all()
        sink = -np.cos(alpha) * np.sin(one) + np.sin(alpha) * np.cos(one)
        start = depth[place - 1] if leg else 200.0
        span = slice(place, place + samples)
        depth[span] = start + (speed * sink)[0] * PERIOD * np.arange(1, samples + 1)
        surge[span] = (speed * np.cos(alpha) * np.cos(beta))[0]
    shown = pitch + tilt * np.cos(pitch)
    zeros = np.zeros(len(pitch))
    signals = {
        # what a gauge makes of it that knows standard ocean alone
        "measured_depth": depth[0]
        + np.concatenate(
            [[0.0], np.cumsum(np.diff(depth) * DENSITY / (STANDARD_OCEAN[0] + 0.0047 * depth[1:]))]
        ),
        "measured_roll": zeros,
        "measured_pitch": np.rad2deg(shown),
        **{f"measured_{name}_rate": zeros for name in ("roll", "pitch", "yaw")},
        "measured_specific_force_x": GRAVITY * np.sin(shown),
        "measured_specific_force_y": zeros,
        "measured_specific_force_z": -GRAVITY * np.cos(shown),
        "measured_pump": pump,
        "measured_density": np.full(len(pitch), DENSITY),
    }
    return signals, surge, np.arange(len(pitch)) % samples > 60 / PERIOD


def changed(drag=1.0, lift=1.0):
    vehicle = load_vehicle()
    law = vehicle.flow_frame
    law = dataclasses.replace(
        law, drag=(law.drag[0] * drag, law.drag[1]), lift=(law.lift[0], law.lift[1] * lift)
    )
    return dataclasses.replace(vehicle, law=law, hull_compressibility=0.0)
