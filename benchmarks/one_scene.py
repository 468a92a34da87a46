"""One scene: cost of several gliders in one MuJoCo model, against models of one; bare steps.

python -m benchmarks.one_scene
"""

from __future__ import annotations

import statistics

import mujoco

from benchmarks.figures import measured, seconds
from twin.physics.mujoco_model import compile_model
from twin.vehicle.vehicle import load_vehicle

COUNTS = (1, 2, 10)
STEPS, ROUNDS = 2000, 9
APART = 30.0
"""[m] Distance of neighbours"""


def scene(count: int) -> mujoco.MjModel:
    """Model of `count` bare gliders side by side, without geometry for rendering and sensors."""
    glider = load_vehicle("glider")
    whole = mujoco.MjSpec()
    like = mujoco.MjSpec.from_string(glider.xml)
    whole.option, whole.visual = like.option, like.visual
    for index in range(count):
        one = mujoco.MjSpec.from_string(glider.xml)
        for item in [*one.sensors, *one.cameras, *one.lights, *one.keys]:
            one.delete(item)
        for geom in list(one.geoms):
            one.delete(geom)
        frame = whole.worldbody.add_frame(pos=[0.0, APART * index, -100.0])
        whole.attach(one, prefix=f"{index}_", frame=frame)
    for actuator in whole.actuators:
        actuator.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR  # the own type needs the water's callback
    return whole.compile()


def cost(model: mujoco.MjModel) -> float:
    """[us] Time of a step."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=100)
    return 1e6 * seconds(lambda: mujoco.mj_step(model, data, nstep=STEPS)) / STEPS


def main() -> None:
    with_water = compile_model("glider", lean=True)
    models = {count: scene(count) for count in COUNTS}
    rounds = [{n: cost(m) for n, m in models.items()} for _ in range(ROUNDS)]
    alone = statistics.median(r[1] for r in rounds)
    print(f"one glider with its water: {cost(with_water):.1f} us")
    for count in COUNTS:
        found = statistics.median(r[count] / (count * r[1]) for r in rounds)
        print(
            f"{count:3d} gliders in one model, bare: {found * count * alone:6.1f} us, "
            f"{found:.2f} of {count} models of one"
        )
        measured("one_scene", **{f"of_{count}": found})


if __name__ == "__main__":
    main()
