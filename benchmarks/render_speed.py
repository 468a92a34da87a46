"""Render speed: frames per second of `twin render` against MuJoCo's own Renderer, on one scene.

    python -m benchmarks.render_speed

Both render the same model from the same camera at the same size; ours adds close-up, labels and
readouts. They take turns frame by frame, so that a busy machine slows both equally.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.figures import measured
from twin.show.render.context import available_backend

BACKEND = available_backend()
if BACKEND is None:
    raise SystemExit("render: this machine has no OpenGL without a screen; see `twin render`")
os.environ["MUJOCO_GL"] = BACKEND  # MuJoCo's Renderer reads it when mujoco is imported

import mujoco  # noqa: E402

from twin.mission import load_mission  # noqa: E402
from twin.physics.scenario import Scenario  # noqa: E402
from twin.physics.simulation import simulate  # noqa: E402
from twin.show.render.painter import Painter, aim  # noqa: E402
from twin.show.render.subject import CAMERAS, Shot, Subject  # noqa: E402
from twin.vehicle.vehicle import load_vehicle  # noqa: E402
from twin.water.current.profile import Profile  # noqa: E402

FRAMES = 40
WARM_UP = 3
FLOOR = 0.8
"""[1] Least frame rate / frame rate of the bare Renderer, overlays included"""
CURRENT = Profile(depth=(0.0, 60.0, 150.0), north=(0.25, 0.12, 0.0), east=(0.10, 0.14, 0.05))


def bare_renderer(painter: Painter) -> tuple[mujoco.Renderer, Callable[[int], None]]:
    """MuJoCo's Renderer on the painter's scene, and a function that renders its present state."""
    size = painter.shot.height, painter.shot.width
    renderer = mujoco.Renderer(painter.model, *size, max_geom=painter.scene.maxgeom)
    renderer.scene.flags[:] = painter.scene.flags
    camera = mujoco.MjvCamera()

    def draw(index: int) -> None:
        renderer.update_scene(painter.data, camera, painter.option)
        aim(renderer.scene, painter.view(index))
        renderer.render()

    return renderer, draw


def measure(camera: str) -> tuple[float, float, float]:
    """Frames per second of ours and of the bare Renderer, and the median of their ratio."""
    scenario = Scenario(vehicle=load_vehicle(), mission=load_mission("default"), current=CURRENT)
    trajectory = simulate(scenario)
    shot = Shot(camera=camera, speed_up=30.0)
    times = shot.frame_times(trajectory.time)
    ours, bare = [], []
    subject = Subject(trajectory=trajectory, vehicle=scenario.vehicle, title="benchmark")
    with Painter(subject, shot, times) as painter:
        painter.paint(0)
        renderer, draw = bare_renderer(painter)
        with renderer:
            for i in range(FRAMES + WARM_UP):
                index = i * (painter.frames - 1) // (FRAMES + WARM_UP)
                start = time.perf_counter()
                painter.paint(index)
                middle = time.perf_counter()
                draw(index)
                end = time.perf_counter()
                if i >= WARM_UP:
                    ours.append(middle - start)
                    bare.append(end - middle)
    ratio = statistics.median(b / o for o, b in zip(ours, bare, strict=True))
    return 1 / statistics.median(ours), 1 / statistics.median(bare), ratio


def main() -> int:
    """Measure every camera; exit code 1 if one is below the floor."""
    print(f"{Path(__file__).stem}: 1280x720, {BACKEND}, {len(os.sched_getaffinity(0))} cores")
    print(f"{'camera':8} {'twin [1/s]':>11} {'Renderer [1/s]':>15} {'ratio':>6}  floor {FLOOR}")
    good, rates, ratios = True, [], []
    for camera in CAMERAS:
        ours, bare, ratio = measure(camera)
        good = good and ratio >= FLOOR
        rates.append(ours)
        ratios.append(ratio)
        verdict = "" if ratio >= FLOOR else "below the floor"
        print(f"{camera:8} {ours:11.1f} {bare:15.1f} {ratio:6.2f}  {verdict}")
    measured("render_speed", rate=rates, ratio=ratios)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
