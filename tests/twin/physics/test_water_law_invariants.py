"""Invariants of the hull law and of the models: mirror top to bottom, tumbling, density, copies."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from twin.errors import VehicleError
from twin.fossen import FossenModel, FossenState
from twin.frames import euler_to_quaternion
from twin.mission.controller import Schedule
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.vehicle.laws.flow_frame import FlowFrame, fossen_wrench, native_wrench
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.density import DensityProfile

VEHICLE = load_vehicle("glider")
DENSITY = VEHICLE.reference_density
KERNELS = {"native": lambda c, nu: np.array(native_wrench(c, DENSITY, *nu)),
           "fossen": lambda c, nu: np.array(fossen_wrench(c, DENSITY, *nu))}  # fmt: skip


def wings_only() -> Vehicle:
    """The Sea-Wing as alike above and below: its CG on the axis, its roll moment its wings'."""
    law = VEHICLE.flow_frame
    return VEHICLE.replace(
        lift=(0.0, law.lift[1]),
        pitch_moment=(0.0, *law.pitch_moment[1:]),
        roll_moment=(0.0, law.roll_moment[1]),
        roll_moment_lift=(-58.27 / 0.025,),
        roll_from_yaw=(0.0, 60.0),
        yaw_from_roll=(0.0, -90.0),
        static_cg=VEHICLE.static_cg * [1.0, 0.0, 0.0],  # the battery alone hangs low
    )


FLIP = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
"""Mirror top to bottom: heave, roll rate and pitch rate, down force, roll and pitch moment"""


@pytest.mark.parametrize("model", KERNELS)
def test_a_hull_bent_to_starboard_is_the_mirror_image_of_one_bent_to_port(model):
    """Port to starboard: sway, roll rate and yaw rate, side force, roll and yaw moment."""
    rng, sides = np.random.default_rng(4), np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    to_starboard, to_port = (VEHICLE.replace(yaw_moment_offset=(k,)).law.values() for k in (5, -5))
    wrench = KERNELS[model]
    for _ in range(300):
        nu = rng.normal(size=6) * [0.5, 0.2, 0.2, 0.05, 0.05, 0.05]
        found = wrench(to_port, sides * nu)
        np.testing.assert_allclose(found, sides * wrench(to_starboard, nu), atol=1e-12)
        for other in KERNELS.values():
            np.testing.assert_allclose(found, other(to_port, sides * nu), atol=1e-9)
    assert wrench(to_starboard, np.array([0.4, 0, 0, 0, 0, 0]))[5] == pytest.approx(5 * 0.4**2)


@pytest.mark.parametrize("model", KERNELS)
def test_upside_down_is_the_mirror_image(model):
    values, rng = wings_only().law.values(), np.random.default_rng(3)
    wrench = KERNELS[model]
    for _ in range(300):
        nu = rng.normal(size=6) * [0.5, 0.2, 0.2, 0.05, 0.05, 0.05]
        found = wrench(values, FLIP * nu)
        np.testing.assert_allclose(found, FLIP * wrench(values, nu), atol=1e-12)


def glide(vehicle, shift, rotation, net_mass):
    return dataclasses.asdict(FossenModel(vehicle).trim(shift, rotation, net_mass))


def centred_shift(vehicle: Vehicle, shift: float) -> float:
    """The battery's place at which its pitch moment is that of `shift` with the sign reversed."""
    battery = vehicle.battery
    neutral = vehicle.static_mass * vehicle.static_cg[0] + battery.mass * battery.neutral_x
    return -shift - 2.0 * neutral / battery.mass


@pytest.mark.parametrize(("rotation", "tolerance"), [(0.0, 1e-9), (0.5, 1e-3)])
def test_a_climb_is_a_dive_upside_down(rotation, tolerance):
    """Net mass, shift, rotation, roll, pitch and angle of attack reversed, the turn rate kept.

    In a spiral the battery, which hangs low in both worlds, is not mirrored.
    """
    vehicle = wings_only()
    shift = 0.02
    dive = glide(vehicle, shift, rotation, 0.3)
    climb = glide(vehicle, centred_shift(vehicle, shift), -rotation, -0.3)
    for name, sign in (
        ("speed_m_s", 1), ("pitch_deg", -1), ("angle_of_attack_deg", -1), ("roll_deg", -1),
        ("turn_rate_rad_s", 1), ("sideslip_deg", 1), ("vertical_speed_m_s", -1),
    ):  # fmt: skip
        expected = pytest.approx(sign * dive[name], rel=tolerance, abs=tolerance * 1e-3)
        assert climb[name] == expected, name
    if rotation:
        assert abs(dive["turn_rate_rad_s"]) > 1e-3


@pytest.mark.parametrize("model", KERNELS)
@pytest.mark.parametrize("vehicle", [VEHICLE, wings_only()], ids=["printed", "wings"])
def test_a_tumbling_hull_gains_no_energy_from_its_moments(model, vehicle):
    """Turned at a constant rate about any axis in a steady stream, each full turn costs power."""
    values, rng = vehicle.law.values(), np.random.default_rng(11)
    wrench = KERNELS[model]
    angles = np.linspace(0.0, 2.0 * np.pi, 361)[:-1]
    for _ in range(25):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        stream = rng.normal(size=3)
        stream *= rng.uniform(0.1, 0.6) / np.linalg.norm(stream)
        along = axis * (axis @ stream)
        across = stream - along
        side = np.cross(axis, across)
        rate = rng.choice([-1.0, 1.0]) * 0.2
        power = 0.0
        for a in angles:
            seen = along + across * math.cos(a) - side * math.sin(a)
            power += rate * axis @ wrench(values, np.concatenate([seen, rate * axis]))[3:]
        assert power / angles.size < 0.0


def steady(density: float, net_mass: float) -> tuple[float, float, float]:
    """Pitch, angle of attack [deg] and speed [m/s] of a glide in water of `density`, both models.

    The pump is set for `net_mass` [kg] in that water.
    """
    volume = 1e6 * ((VEHICLE.mass - net_mass) / density - VEHICLE.neutral_volume)
    command = (0.02, 0.0, volume)
    start = Start(depth=300.0, pitch=-0.575, v_rel=(0.46, 0.0, 0.012), actuators=command)
    plan = Schedule(times=[0.0], commands=[command])
    ours = simulate(
        Scenario(
            vehicle=VEHICLE, mission=plan, duration=600.0, start=start,
            density=DensityProfile.constant(density),
        )
    )  # fmt: skip
    state = FossenState(
        position_ned=(0.0, 0.0, 300.0), attitude=(0.0, -0.575, 0.0), v_rel=start.v_rel,
        actuators=command,
    )  # fmt: skip
    theirs = FossenModel(VEHICLE, density=([0.0], [density])).simulate(state, plan, 600.0)
    np.testing.assert_allclose(ours.v_rel[-1], theirs.v_rel[-1], atol=1e-5)
    u, _, w = theirs.v_rel[-1]
    pitch = math.degrees(math.asin(-(down_of(theirs)[0])))
    assert ours["true_pitch"][-1] == pytest.approx(pitch, abs=1e-3)
    return pitch, math.degrees(math.atan2(w, u)), float(np.hypot(u, w))


def down_of(track) -> np.ndarray:
    """The NED down axis in body axes at the end of a track, shape (3,)."""
    w, x, y, z = track.quaternion[-1]
    return np.array([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)])


def test_water_of_another_density_changes_the_speed_and_no_angle():
    """Coefficients and added mass scale together with the water's density."""
    light, heavy = steady(1023.0, 0.3), steady(1027.5, 0.3)
    assert light[0] == pytest.approx(heavy[0], abs=1e-6)
    assert light[1] == pytest.approx(heavy[1], abs=1e-6)
    assert light[2] / heavy[2] == pytest.approx(math.sqrt(1027.5 / 1023.0), rel=1e-7)


CHANGES = {
    "gravity": 9.6,
    "cross_flow_drag": 900.0,
    "reference_density": 1015.0,
    "hull_length": 1.2,
    "hull_diameter": 0.4,
    "hull_compressibility": 4e-9,
    "static_mass": 54.5,
    "static_cg": VEHICLE.static_cg + np.array([0.001, 0.0004, 0.002]),
    "static_inertia": VEHICLE.static_inertia * 1.3,
    "added_mass": VEHICLE.added_mass * 1.2,
    "added_mass_coupling": False,
    "drag": (9.0, 300.0),
    "lift": (3.0, 400.0),
    "side_force": (-90.0,),
    "roll_moment": (-40.0, -30.0),
    "pitch_moment": (0.5, -70.0, -100.0),
    "yaw_moment": (20.0, -300.0),
    "side_force_lift": (-800.0,),
    "roll_moment_lift": (-900.0,),
    "yaw_moment_lift": (300.0,),
    "roll_from_yaw": (20.0, 100.0),
    "yaw_from_roll": (-15.0, -200.0),
    "yaw_moment_offset": (6.0,),
    "wing_asymmetry": (4.0,),
    "linear_angle": 0.01,
    "blend_angle": 0.04,
    "rate_damping_min_speed": 0.9,
    "shift": {"lag": 20.0, "rate": 0.001},
    "rotation": {"lag": 30.0, "high": 0.2},
    "pump": {"neutral": 30.0, "rate": 4.0},
    "battery": {"mass": 12.0, "eccentricity": 0.02, "neutral_x": 0.395},
}
"""Every field of a vehicle, its law, parts and battery that moves it"""
ALONG = {"blend_angle": {"linear_angle": 0.01}, "cross_flow_drag": {"linear_angle": 0.01}}
STILL = {
    "name", "path", "xml", "masses", "parts", "law", "imu_position", "gps_position", "pitch_pid",
    "heading_pid", "hull_thermal_expansion", "hull_thermal_lag", "hull_reference_temperature",
    "trim_pid", "depth_pid", "buoyancy_pid", "control_period", "source", "summary", "usual_glide",
    "usual_mission", "rated_depth", "cruise_speed", "steering", "spreads", "identified_angle",
    "idle", "followers",
}  # fmt: skip
"""What says nothing of how it moves under given commands in water of one temperature"""


def test_every_field_is_looked_at():
    fields = {f.name for c in (Vehicle, FlowFrame) for f in dataclasses.fields(c)}
    assert {*CHANGES, *STILL} >= fields


def fly(vehicle: Vehicle):
    """Half a minute from the surface down with all parts moving; (ours, theirs)."""
    commands = [(0.03, 0.5, -300.0), (0.01, -0.3, -400.0)]
    plan = Schedule(times=[0.0, 12.0], commands=commands)
    start = Start(depth=0.3, pitch=-0.3, roll=0.2, v_rel=(0.4, 0.05, 0.05), rates=(0.1, 0.02, 0.05))
    scenario = Scenario(vehicle=vehicle, mission=plan, duration=30.0, start=start, timestep=0.02)
    ours, water = simulate(scenario), scenario.density
    state = FossenState(
        position_ned=(0.0, 0.0, 0.3), attitude=(0.2, -0.3, 0.0), v_rel=start.v_rel,
        rates=start.rates,
    )  # fmt: skip
    column = None if water is None else (water.depth, water.values)
    period = float(ours.time[1] - ours.time[0])
    return ours, FossenModel(vehicle, density=column).simulate(
        state, plan, 30.0, dt=0.02, sample_period=period
    )


def motion(ours, theirs) -> tuple[np.ndarray, np.ndarray]:
    """Velocity, pitch and heading of both, shape (time, 5)."""
    angles = [np.deg2rad(ours[f"true_{n}"]) for n in ("roll", "pitch", "heading")]
    a = euler_to_quaternion(*angles)
    b = theirs.quaternion * np.sign(np.sum(a * theirs.quaternion, axis=1, keepdims=True))
    return np.hstack([ours.v_rel, a]), np.hstack([theirs.v_rel, b])


@pytest.fixture(scope="module")
def unchanged():
    return motion(*fly(VEHICLE))


@pytest.mark.parametrize("field", CHANGES)
def test_a_changed_field_changes_both_models_alike(field, unchanged):
    changes = {field: CHANGES[field], **ALONG.get(field, {})}
    found = motion(*fly(VEHICLE.replace(**changes)))
    moved = [np.abs(a - b).max() for a, b in zip(found, unchanged, strict=True)]
    apart = np.abs((found[0] - unchanged[0]) - (found[1] - unchanged[1])).max()
    assert min(moved) > 1e-5  # it does matter
    assert apart < max(0.03 * max(moved), 1e-4)


@pytest.mark.parametrize("height", [0.02, -0.02])
def test_a_battery_off_its_axis_is_refused(height):
    from twin.vehicle.vehicle import parse_vehicle

    text = VEHICLE.xml.replace('pos="0.4016 0 0"', f'pos="0.4016 0 {height}"')
    with pytest.raises(VehicleError, match="on the hull's axis"):
        parse_vehicle(text, VEHICLE.path)
