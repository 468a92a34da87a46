"""Forecast speed: seconds of `twin forecast`, 200 members of a 6 h dive, and of its first result.

    python -m benchmarks.forecast_speed

The batched engine and MuJoCo run one after the other. Before the batched engine is timed, a short
forecast compiles the vehicle's structure; `first_call_s` is that time. Other work on the machine
lengthens wall time; processor time is the cost.
"""

from __future__ import annotations

import json
import os
import sys
import time

from benchmarks import command
from glider_twin_ops.forecast import Request, forecast, known_without_logs, mission_to
from glider_twin_ops.forecast.request import LEAST_MEMBERS
from twin.physics.scenario import ENGINES
from twin.vehicle.vehicle import load_vehicle
from twin.water.current import Origin

HOUR = 3600.0
PLACE = Origin(latitude_deg=36.8, longitude_deg=-122.4, time="2026-11-22T12:00:00")
UNIX = 1.795e9


def measure(
    vehicle: str, members: int, hours: float, threads: int, engine: str
) -> dict[str, float]:
    """Time one forecast of a dive of the same duration."""
    mission = mission_to(
        "38,-122.4", depth=200.0, pitch_deg=26.0, surface_after_s=0.93 * HOUR * hours, radius=500.0
    )
    request = Request(
        vehicle=load_vehicle(vehicle), mission=mission, place=PLACE, hours=hours, members=members,
        engine=engine,
    )  # fmt: skip
    known = known_without_logs(PLACE.latitude_deg, UNIX)
    moments: list[float] = []
    begun, used = time.perf_counter(), time.process_time()
    found = forecast(
        request, known, threads=threads,
        refined=lambda _: moments.append(time.perf_counter() - begun),
    )  # fmt: skip
    processor = time.process_time() - used
    cores = threads or os.cpu_count() or 1
    return {
        "members": found.flown, "hours": hours, "surfacings": len(found.surfacings),
        "first_result_s": moments[0], "seconds": moments[-1], "processor_s": processor,
        "processor_s_per_core": processor / cores, "cores": cores,
        **({} if found.beside_mujoco is None else {
            "position_from_mujoco_m": found.beside_mujoco.position_m,
            "speed_from_mujoco_m_s": found.beside_mujoco.speed_m_s,
        }),
    }  # fmt: skip


def main(
    *, vehicle: str = "glider", members: int = 200, hours: float = 6.0, threads: int = 0
) -> None:
    """Print the figures as JSON."""
    begun = time.perf_counter()
    measure(vehicle, LEAST_MEMBERS, 0.1, threads, "lanes")
    compiled = time.perf_counter() - begun
    found = {engine: measure(vehicle, members, hours, threads, engine) for engine in ENGINES}
    found["lanes"]["first_call_s"] = compiled
    told = {
        engine: {name: float(f"{value:.4g}") for name, value in figures.items()}
        for engine, figures in found.items()
    }
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    sys.exit(command.run(main))
