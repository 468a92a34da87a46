"""Sensor cost: milliseconds per device and simulated hour at 2 Hz.

    python -m benchmarks.sensor_cost

Best of several runs after compilation; the truth is a synthetic saw-tooth of one hour.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks import figures
from twin.sensors import SUITE_PRESETS, SensorSuite, Surroundings
from twin.sensors.base import sensor_generator
from twin.water.density import DensityProfile

HOUR = 3600.0
DT = 0.5
REPEATS = 30
BOTTOM_DEPTH = 200.0
"""[m] Depth of the level bottom"""


def saw_tooth(duration: float = HOUR, dt: float = DT) -> dict[str, np.ndarray]:
    """Truth of a glider that dives and climbs at 0.15 m/s between the surface and 150 m."""
    t = np.arange(0.0, duration, dt)
    phase = np.mod(t, 2000.0)
    depth = np.where(phase < 1000.0, 0.15 * phase, 0.15 * (2000.0 - phase)) + 0.05
    pitch = np.where(phase < 1000.0, -25.0, 25.0)
    heading = np.mod(40.0 + 0.02 * t, 360.0)
    speed = 0.35
    truth = {
        "true_depth": depth,
        "true_pitch": pitch,
        "true_heading": heading,
        "true_surge": np.full_like(t, speed),
        "true_velocity_north": speed * np.cos(np.deg2rad(heading)),
        "true_velocity_east": speed * np.sin(np.deg2rad(heading)),
        "true_velocity_down": np.where(phase < 1000.0, 0.15, -0.15),
        "true_specific_force_z": np.full_like(t, -9.81),
        "true_immersion": np.where(depth < 0.11, 0.99, 1.0),
        "true_altitude": BOTTOM_DEPTH - depth,
    }
    truth["true_north"] = np.cumsum(truth["true_velocity_north"]) * dt
    truth["true_east"] = np.cumsum(truth["true_velocity_east"]) * dt
    for name in (
        "roll", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate", "specific_force_x",
        "specific_force_y", "shift", "rotation", "pump",
    ):  # fmt: skip
        truth[f"true_{name}"] = np.zeros_like(t)
    profile = DensityProfile.thermocline()
    water = profile.temperature_salinity(depth)
    truth["true_temperature"], truth["true_salinity"] = water
    truth["true_density"] = profile.density(depth)
    for part in ("shift", "rotation", "pump"):
        truth[f"commanded_{part}"] = truth[f"true_{part}"]
    return truth


def best_ms(call: Callable[[], Any]) -> float:
    """[ms] Shortest wall time of `call`, after one call for warm-up."""
    call()
    return 1e3 * min(figures.seconds(call) for _ in range(REPEATS))


def main() -> None:
    truth = saw_tooth()
    seed = np.random.SeedSequence(1)
    density = DensityProfile.thermocline()
    setting: dict[str, Any] = {
        "dt": DT, "rng_seed": seed, "bottom_depth": BOTTOM_DEPTH, "density": density
    }  # fmt: skip
    field = SensorSuite.preset("field")
    measured = field.measure(truth, **setting)
    drawn = field.draw(seed)
    surroundings = Surroundings(density=density, bottom_depth=BOTTOM_DEPTH)
    signals = truth | measured
    print("device        ms per mission-hour (field)")
    for name, sensor in field.items():
        cost = best_ms(
            functools.partial(
                sensor.measure, signals, dt=DT, drawn=drawn,
                rng=sensor_generator(seed, name), surroundings=surroundings,
            )
        )  # fmt: skip
        print(f"{name:12s} {cost:8.3f}")
        if name == "dvl":
            figures.measured("sensor_cost", dvl=cost)
    print("\nsuite          ms per mission-hour")
    for name, suite in SUITE_PRESETS.items():
        cost = best_ms(functools.partial(suite.measure, truth, **setting))
        print(f"{name:18s} {cost:8.3f}")
        if name == "field":
            figures.measured("sensor_cost", field=cost)


if __name__ == "__main__":
    main()
