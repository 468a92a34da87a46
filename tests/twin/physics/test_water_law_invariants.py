"""Invariants of the hull law and of the models: mirror, tumbling, damping, continuity, density."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from physics import fossen_state

from twin.errors import VehicleError
from twin.fossen import FossenModel
from twin.fossen.forces import damping_wrench
from twin.frames import euler_to_quaternion
from twin.mission.controller import Schedule
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.vehicle.laws.flow_frame import FlowFrame, fossen_wrench, native_wrench
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle
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
    water = DensityProfile.constant(density)
    ours = simulate(
        Scenario(vehicle=VEHICLE, mission=plan, duration=600.0, start=start, density=water)
    )
    model = FossenModel(VEHICLE, density=([0.0], [density]))
    theirs = model.simulate(fossen_state(start), plan, 600.0)
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
    "trim_pid", "depth_pid", "buoyancy_pid", "station_pid", "control_period", "source", "summary",
    "usual_glide",
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
    column = None if water is None else (water.depth, water.values)
    model = FossenModel(vehicle, density=column)
    return ours, model.simulate(
        fossen_state(start), plan, 30.0, dt=0.02, sample_period=scenario.sample_period
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


@pytest.mark.parametrize("place", ["0 0.02", "0 -0.02", "0.02 0"])
def test_a_battery_off_its_axis_is_refused(place):
    assert 'pos="0.4016 0 0"' in VEHICLE.xml
    text = VEHICLE.xml.replace('pos="0.4016 0 0"', f'pos="0.4016 {place}"')
    with pytest.raises(VehicleError, match="on the hull's axis"):
        parse_vehicle(text, VEHICLE.path)


# --- at any pair of flow angles ------------------------------------------------------------------


VALUES = VEHICLE.law.values()
DAMPING = np.array([-19.83, -205.64, -389.30])
"""[N m s2/(m2 rad)] K_p, K_q, K_r of Zhang et al. (2013)"""
RATES = (0.01, 0.02, 0.03)
LIMITS = (10.0, 20.0)
"""[deg] where the identified range ends and where the cross-flow law is complete"""


def flow(alpha, beta, speed=0.5):
    """Velocity (3,) at these flow angles [rad]."""
    ahead, down = math.cos(alpha) * math.cos(beta), math.sin(alpha) * math.cos(beta)
    return speed * np.array([ahead, math.sin(beta), down])


def wrench(alpha, beta, rates=RATES, speed=0.5):
    """Force and moment (6,) at these flow angles [rad]."""
    return np.array(native_wrench(VALUES, DENSITY, *flow(alpha, beta, speed), *rates))


def rate_moment(alpha, beta, rates, speed=0.5):
    """The part of the moment (3,) that the rates make."""
    return (wrench(alpha, beta, rates, speed) - wrench(alpha, beta, (0, 0, 0), speed))[3:]


ASIDE = st.tuples(st.floats(-10, 10), st.floats(20, 89.9) | st.floats(-89.9, -20))
BELOW = st.tuples(st.floats(20, 180), st.floats(-89.9, 89.9))


@pytest.mark.parametrize("angles", [ASIDE, BELOW], ids=["from the side", "from below"])
@given(data=st.data(), rates=st.tuples(*[st.floats(-1, 1)] * 3))
def test_rates_are_damped_axis_by_axis_across_the_flow(angles, data, rates):
    """docs/physics/equations.md: beyond 20 deg of EITHER angle the axes are those of the body."""
    found = rate_moment(*np.radians(data.draw(angles)), rates)
    np.testing.assert_allclose(found, DAMPING * rates * 0.5**2, atol=1e-9)


def test_damping_never_falls_below_that_of_a_tenth_of_a_metre_per_second():
    """docs/physics/equations.md: 0.1 m/s: a hull that turns in still water is damped too."""
    for speed in (0.0, 0.03, 0.0999):
        found = rate_moment(0.0, 0.0, RATES, speed)
        np.testing.assert_allclose(found, DAMPING * RATES * 0.1**2, rtol=1e-12)
    faster = rate_moment(0.0, 0.0, RATES, 0.2)
    np.testing.assert_allclose(faster, DAMPING * RATES * 0.2**2, rtol=1e-9)


@given(
    limit=st.sampled_from(LIMITS),
    side=st.sampled_from((1.0, -1.0)),
    other=st.floats(-85, 85),
    which=st.sampled_from(("alpha", "beta", "both")),
)
def test_the_law_is_continuous_where_it_changes(limit, side, other, which):
    """Across 10 and 20 deg of one angle at any other, and of both at once.

    Not across 90 deg of sideslip: the angle of attack has no value there.
    """
    step, edge = 1e-7, math.radians(side * limit)
    sides = []
    for angle in (edge - step, edge + step):
        pair = {
            "alpha": (angle, math.radians(other)),
            "beta": (math.radians(2.0 * other), angle),
            "both": (angle, math.copysign(angle, other)),
        }[which]
        sides.append(wrench(*pair))
    # the steepest slope of the law is some 100 N/rad and N m/rad at 0.5 m/s
    np.testing.assert_allclose(*sides, atol=1e-4)


def test_the_law_is_continuous_where_the_angle_of_attack_wraps():
    for beta in (0.0, 0.3, -1.2):
        ahead, behind = (wrench(angle, beta) for angle in (math.pi - 1e-7, -math.pi + 1e-7))
        np.testing.assert_allclose(ahead, behind, atol=1e-4)


def test_the_law_is_continuous_at_ninety_degrees_of_sideslip():
    """With v alone there is no angle of attack: the force must not depend on how v is reached."""
    forces = [wrench(alpha, math.pi / 2 - 1e-7)[:3] for alpha in np.linspace(-math.pi, math.pi, 9)]
    np.testing.assert_allclose(np.ptp(forces, axis=0), 0.0, atol=1e-3)


@given(
    alpha=st.floats(-180, 180),
    beta=st.floats(-89, 89),
    rates=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
)
def test_the_law_is_that_of_the_fossen_model_at_every_flow_angle(alpha, beta, rates):
    """Two codes after one paper, also where no manoeuvre of `twin check` goes."""
    a, b = math.radians(alpha), math.radians(beta)
    p = FossenModel(VEHICLE).parameters
    theirs = damping_wrench(p, np.concatenate([flow(a, b), rates]), DENSITY)
    np.testing.assert_allclose(wrench(a, b, rates), theirs, atol=1e-9)


@settings(max_examples=200, deadline=None)
@given(
    speed=st.floats(0.1, 1.0),
    alpha=st.floats(-10, 10),
    beta=st.floats(-10, 10),
    rates=st.tuples(*[st.floats(-0.05, 0.05)] * 3),
)
def test_the_water_takes_power_inside_the_identified_range(speed, alpha, beta, rates):
    a, b = math.radians(alpha), math.radians(beta)
    found = wrench(a, b, rates, speed)
    drag = found[:3] @ flow(a, b, speed)
    assert drag <= 0.0
    assert drag + found[3:] @ rates <= 0.0


@settings(max_examples=200, deadline=None)
@given(alpha=st.floats(-180, 180), beta=st.floats(-89, 89), speed=st.floats(0.0, 2.0))
def test_drag_power_is_never_positive(alpha, beta, speed):
    a, b = math.radians(alpha), math.radians(beta)
    assert wrench(a, b, (0.0, 0.0, 0.0), speed)[:3] @ flow(a, b, speed) <= 1e-12
