"""Fit what a vehicle file needs to glide in plain MuJoCo, and write it into the file.

    python scripts/fit_plain.py             # all shipped vehicles; FILE.xml ...: your own

MuJoCo's ellipsoids carry the water: a slender one has the drag, thin discs with Kutta lift are
wings and fins, off the centre, so that lift damps the rates too. First values come from the
vehicle's coefficients; least squares fit drag, lift slope and the wings' place to steady glides of
the twin. Printed are glides that the fit has not seen; a vehicle that misses them gets a comment.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from scipy.optimize import least_squares

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from twin import load_vehicle, trim  # noqa: E402
from twin.errors import TwinError  # noqa: E402
from twin.mission import steady_glide  # noqa: E402
from twin.vehicle import trim_positions  # noqa: E402
from twin.vehicle.plain import NOTE, without_plain  # noqa: E402

RADIUS, FLATNESS = 0.05, 0.002
"""[m], [1] Radius of the discs, small as MuJoCo's Munk moment shall be; thickness / radius."""
BUOYANCY, SECONDS, DAMPED = 0.001, 600.0, 0.3
"""[kg] Mass of the body whose `gravcomp` lifts the vehicle. [s] Time of a flight. [1] Largest
product of step and rate damping at the usual speed: the integrator is explicit."""
FITTED = ((1.0, 0.8), (1.0, 1.2), (-1.0, 0.8), (-1.0, 1.2))
UNSEEN = ((0.7, 1.0), (1.4, 1.0), (-0.7, 1.1))
"""Glides: net mass and pitch, as factors of the usual dive; negative: a climb."""
MOST = (0.25, 0.25, 4.0)
"""[1], [1], [deg] Largest errors of speed, sink rate and pitch in an unseen glide."""
HIDDEN = 'rgba="0.3 0.6 1 0.25" mass="0" group="4" contype="0" conaffinity="0"'
FLUID = 'fluidshape="ellipsoid" fluidcoef="{:.5g} 0 0 {:.5g} 0"'
"""Blunt drag and Kutta lift; no slender and angular drag, no Magnus lift."""


def wanted(vehicle, factors) -> list[tuple[list[float], tuple[float, ...]]]:
    """Parts' positions, and speed [m/s], sink rate [m/s] and pitch [deg], of the twin's glides."""
    found, (pitch, net) = [], vehicle.usual_glide
    for mass, steep in factors:
        heavy = float(np.clip(mass * net, *vehicle.net_mass_range))
        shift = steady_glide(vehicle, -math.copysign(pitch * steep, mass), heavy).shift
        motion = trim(vehicle, shift, 0.0, heavy)
        parts = trim_positions(vehicle, shift, 0.0, heavy).tolist()
        found.append((parts, (motion.speed_m_s, motion.vertical_speed_m_s, motion.pitch_deg)))
    return found


def first_values(vehicle, speed: float) -> dict[str, float]:
    """Drag, lift and places from the file's coefficients (`twin.vehicle.laws.flow_frame`)."""
    law, added = vehicle.flow_frame, np.diag(vehicle.added_mass)
    step = float(re.search(r'timestep="([^"]*)"', vehicle.xml)[1])
    masses = sum(m.inertia + np.diag([0, 1, 1]) * m.mass * m.neutral_x**2 for m in vehicle.masses)
    roll, pitch, yaw = np.diag(vehicle.static_inertia + masses)

    def arm(damping: float, slope: float, inertia: float, share: float = 1.0) -> float:
        """Distance from the axis that damps as the law does, within the explicit step's limit."""
        most = share * DAMPED * inertia / (step * speed)
        return math.sqrt(min(abs(damping) * speed, most) / slope)

    lift, side = law.lift[1], abs(law.side_force[0])
    munk, height = added[[2, 1]] - added[0], arm(math.inf, side, roll, 0.5)
    return {
        "drag": law.drag[0], "induced": law.drag[1], "lift": lift, "side": side,
        "wing_x": (law.pitch_moment[1] + munk[0]) / lift,
        "wing_dx": arm(law.pitch_moment[2], lift, pitch),
        "wing_y": arm(law.roll_moment[1], lift, roll, 0.5),
        "fin_x": -(law.yaw_moment[0] - munk[1]) / side,
        "fin_dx": arm(law.yaw_moment[1], side, yaw),
        "fin_z": float(np.clip(-law.roll_moment[0] / side, -height, height)),
    }  # fmt: skip


def geoms(v: dict[str, float], density: float) -> list[str]:
    """Lines of the geoms on the hull: x forward, y port, z up."""
    area = density * math.pi * RADIUS**2
    # drag of a spheroid of length k: 1 + (k^4 - k^2) / 2 times the angle of attack squared
    long = RADIUS * math.sqrt((1.0 + math.sqrt(1.0 + 8.0 * v["induced"] / v["drag"])) / 2.0)

    def geom(name: str, place: Sequence[float], turn: str, size: Sequence[float], *fluid: float):
        pos, axes = (" ".join(f"{x:.5g}" for x in row) for row in (place, size))
        water = FLUID.format(*(x / area for x in fluid))
        start = f'<geom name="plain_{name}" type="ellipsoid" pos="{pos}" {turn}'
        return f'{start}size="{axes}" {water} {HIDDEN}/>'

    disc, upright = (RADIUS, RADIUS, RADIUS * FLATNESS), 'euler="1.57079633 0 0" '
    lines = [geom("hull", (0, 0, 0), "", (long, RADIUS, RADIUS), v["drag"], 0.0)]
    for end, way in (("fore", 1), ("aft", -1)):
        for side, hand in (("port", 1), ("starboard", -1)):
            place = (v["wing_x"] + way * v["wing_dx"], hand * v["wing_y"], 0)
            lines.append(geom(f"wing_{end}_{side}", place, "", disc, 0.0, v["lift"] / 4))
        place = (v["fin_x"] + way * v["fin_dx"], 0, v["fin_z"])
        lines.append(geom(f"fin_{end}", place, upright, disc, 0.0, v["side"] / 2))
    return lines


def with_reason(xml: str, reason: str) -> str:
    """MJCF text with a comment that it does not glide."""
    line = f"  {NOTE}the file poses there in vacuum and does not glide: {reason}. -->\n"
    return xml.replace("  <option", f"{line}  <option", 1)


def with_plain(xml: str, vehicle, values: dict[str, float]) -> str:
    """MJCF text with the set; `xml` has none."""
    density = vehicle.reference_density
    still = f'type="sphere" size="0.001" {FLUID.format(0, 0)} {HIDDEN}/>'
    lift = (vehicle.mass + BUOYANCY) / BUOYANCY
    inertial = f'<inertial pos="0 0 0" mass="{BUOYANCY:g}" diaginertia="1e-7 1e-7 1e-7"/>'
    inside = [
        f"{NOTE}drag, lift, buoyancy, by scripts/fit_plain.py; left out by the twin -->",
        *geoms(values, density),
        f'<body name="plain_buoyancy" gravcomp="{lift:.10g}">{inertial}'
        f'<geom name="plain_still" {still}</body>',
        "",
    ]
    hull = "".join(f"\n      {line}" for line in inside)
    edits = [
        (r'(<option\b[^<>]* density=")0', rf"\g<1>{density:g}"),
        (r'(<geom name="fluid_[^<>]* fluidshape=")ellipsoid', r"\g<1>none"),
        (r'(<general\b[^<>]* dyntype=")user', r"\g<1>filterexact"),
        (r"<worldbody>", r'<worldbody>\n    <site name="plain_world" pos="0 0 0" group="3"/>'),
        (r'\n *(?=<site name="cb")', lambda _: hull),
        (rf'(<general name="{vehicle.steering["buoyancy"]}"[^<>]* gainprm=")0"',
         rf'\g<1>{1e-6 * density * vehicle.gravity:.10g}" refsite="plain_world"'),
    ]  # fmt: skip
    for name in (mass.name for mass in vehicle.masses):
        edits.append(
            (rf'<body name="{name}"[^<>]*>', rf'\g<0>\n        <geom name="plain_{name}" {still}')
        )
    for pattern, text in edits:
        xml, count = re.subn(pattern, text, xml)
        assert count, f"{vehicle.path}: nothing in it matches {pattern}"
    return xml


def errors(model: mujoco.MjModel, glides) -> np.ndarray:
    """Errors of speed and sink rate [1] and of pitch [deg] after SECONDS from rest, (glides, 3)."""
    rows = []
    for positions, wish in glides:
        data = mujoco.MjData(model)
        data.ctrl[:] = positions
        mujoco.mj_step(model, data, nstep=round(SECONDS / model.opt.timestep))
        nose = math.degrees(math.asin(data.body("hull").xmat[6]))
        speed, sink = np.linalg.norm(data.qvel[:3]), -data.qvel[2]
        rows.append((speed / wish[0] - 1.0, sink / wish[1] - 1.0, nose - wish[2]))
    return np.nan_to_num(np.array(rows), nan=1e3)


def fitted(path: Path) -> tuple[str, str]:
    """New text of a vehicle file, and a line to print."""
    xml, vehicle = without_plain(path.read_text("utf-8"), path), load_vehicle(path)
    try:
        vehicle.flow_frame  # noqa: B018
        first = first_values(vehicle, wanted(vehicle, ((1.0, 1.0),))[0][1][0])
        glides, unseen = wanted(vehicle, FITTED), wanted(vehicle, UNSEEN)
    except TwinError as error:
        return with_reason(xml, str(error)), f"{path.stem}: {error}"

    def candidate(x: np.ndarray) -> str:
        drag, lift, arm = x[0], x[1], 0.05 * (x[2] - 1.0)
        values = first | {"drag": first["drag"] * drag, "induced": first["induced"] * drag}
        values |= {"lift": first["lift"] * lift, "wing_x": first["wing_x"] + arm}
        return with_plain(xml, vehicle, values)

    def residuals(x: np.ndarray) -> np.ndarray:
        return (errors(mujoco.MjModel.from_xml_string(candidate(x)), glides) / MOST).ravel()

    found = least_squares(residuals, np.ones(3), diff_step=1e-2, bounds=(0.2, 5.0))
    text = candidate(found.x)
    worst = np.abs(errors(mujoco.MjModel.from_xml_string(text), unseen)).max(axis=0)
    line = "{}: unseen glides within {:.1%} in speed, {:.1%} in sink rate, {:.2f} deg in pitch"
    if max(worst / MOST) > 1.0:
        text = with_reason(xml, "its glides there differ too much")
    return text, line.format(path.stem, *worst)


def main(given: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    for path in parser.parse_args(given).files or sorted((ROOT / "assets").glob("*.xml")):
        text, line = fitted(path)
        print(line, flush=True)
        path.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
