"""Water that accelerates, shears and strains: limits that hold whatever the vehicle's law is.

docs/physics/equations.md says what the impulse takes of a gradient, and what it leaves out: one
glide is flown here with another account of the added mass, in plain NumPy.
"""

import functools
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from fossen_terms import quaternion_rate, rotation
from physics import fly_both as both
from physics import without_water_forces
from scipy.integrate import solve_ivp

from twin import seams
from twin.compiled import jit
from twin.fossen.equations import (
    acceleration,
    mass_distribution,
    rigid_body_mass,
    turned_water,
)
from twin.fossen.forces import parameters_of
from twin.frames import euler_to_quaternion
from twin.mission import Mission, SawTooth
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.current import register
from twin.water.current.base import Current, parse_current
from twin.water.current.sampler import sample_gradient

VEHICLE = load_vehicle("glider")
NEUTRAL = (0.0, 0.0, 0.0)
ONE_DENSITY = (np.zeros(1), np.array([VEHICLE.reference_density]))
FLIGHT = 900.0


@jit
def linear_kernel(program, start, size, t, north, east, depth):  # type: ignore[no-untyped-def]
    """V = A (x - x0), steady: x0 (3), A (9)."""
    x, y, z = north - program[start], east - program[start + 1], depth - program[start + 2]
    a = program[start + 3 : start + 12]
    return (
        a[0] * x + a[1] * y + a[2] * z,
        a[3] * x + a[4] * y + a[5] * z,
        a[6] * x + a[7] * y + a[8] * z,
        *(0.0, 0.0, 0.0, a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]),
    )


@dataclass(frozen=True, kw_only=True)
class Linear(Current):
    """A current that is linear in place: strain, shear or rotation."""

    kind: ClassVar[str] = "test-linear"
    payload_size: ClassVar[int] = 12
    kernel: ClassVar[Any] = linear_kernel
    usage: ClassVar[dict[str, str]] = {"test-linear:centre=..., gradient=...": "V = A (x - x0)"}

    centre: tuple[float, ...]
    gradient: tuple[float, ...]

    def records(self, duration_s, origin):
        return [self.record(self.centre, self.gradient)]


@pytest.fixture(scope="module", autouse=True)
def linear_kind():
    register(Linear)
    yield
    seams.CURRENTS.unregister(Linear.kind)


def bare(**changes: Any) -> Vehicle:
    """The vehicle without a force of its law, its CG in the CB."""
    battery = VEHICLE.battery
    moment = battery.mass * np.array([battery.neutral_x, 0.0, battery.eccentricity])
    return without_water_forces(VEHICLE).replace(static_cg=-moment / VEHICLE.static_mass, **changes)


def fly_both(vehicle, start, current, duration, command=NEUTRAL):
    """(MuJoCo's trajectory, Fossen's) with one command held."""
    return both(vehicle, start, command, duration, current=current)


def place_of(found):
    """Places NED [m], shape (time, 3), of either model."""
    return found.position if hasattr(found, "position") else found.position_ned


CURRENTS = (
    "uniform:0.3,-0.2",
    "tide:m2=0.5",
    "tide:m2=0.5,minor=0.2,k1=0.3,phase=70",
    "inertial:speed=0.4,lat=40",
    "gauss-markov:speed=0.2,std=0.1,direction=90,direction_std=40,time=1800,seed=1",
    "geostrophic:speed=0.5,direction=30,scale=100",
    "ekman:stress=0.2,lat=40,direction=20",
    "log-layer:friction=0.02,direction=70,bottom=400",
)


@functools.cache
def at_rest():
    """The neutral hull in still water, in both models."""
    return fly_both(VEHICLE, Start(depth=300.0), None, FLIGHT)


@pytest.mark.parametrize("text", CURRENTS)
def test_a_neutral_hull_follows_the_water(text):
    """It starts with the water and stays with it, in both models: below 0.01 mm/s."""
    start = Start(depth=300.0)
    moving = fly_both(VEHICLE, start, parse_current(text), FLIGHT)
    for found, still in zip(moving, at_rest(), strict=True):
        assert np.abs(found.v_rel - still.v_rel).max() < 1e-5


HEAVY = (0.02, 0.0, VEHICLE.pump_for_net_mass(0.3))
GLIDE = Start(depth=100.0, pitch=-0.5755, v_rel=(0.4728, 0.0, 0.012), actuators=HEAVY)


@functools.cache
def still_glide():
    """In both models; the heading does not enter."""
    return fly_both(VEHICLE, GLIDE, None, FLIGHT, HEAVY)


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5])
def test_a_steady_glide_in_a_tide_is_that_of_still_water(heading):
    """The whole vehicle feels the water's acceleration as a tilt of gravity of 7 microradian."""
    start = Start(**{**vars(GLIDE), "heading": heading})
    tide = parse_current("tide:m2=0.5,phase=90")
    in_tide = fly_both(VEHICLE, start, tide, FLIGHT, HEAVY)
    for found, still in zip(in_tide, still_glide(), strict=True):
        difference = np.abs(found.v_rel - still.v_rel)
        settled = found.time > 600.0
        assert difference[settled].max() < 1e-6


def test_a_mission_in_a_tide_is_flown_as_in_still_water():
    """Closed loop on depth, pitch and heading; two yos with their turns."""
    mission = Mission(
        segments=(SawTooth(max_depth_m=120, heading_deg=60, pitch_deg=28, yos=2),),
        start_heading_deg=40,
        duration_s=2400.0,
    )
    runs = [
        simulate(Scenario(vehicle=VEHICLE, mission=mission, current=current))
        for current in (parse_current("tide:m2=0.5,phase=90"), None)
    ]
    deep = runs[1]["true_depth"] > 3.0  # at the surface a wave of rounding grows
    assert np.abs(runs[0].v_rel - runs[1].v_rel)[deep].max() < 1e-5
    assert np.abs(runs[0]["true_heading"] - runs[1]["true_heading"])[deep].max() < 5e-3  # 0.1 mrad


STRAIN = 0.02
"""[1/s]"""


@pytest.mark.parametrize("added", [0.0, 0.5, 2.0])
def test_a_neutral_sphere_in_a_strain_flow_moves_as_taylor_has_it(added):
    """Exact: x = x0 cosh(a t) + v0 / a sinh(a t), at any added mass and any slip.

    In V = (a x, -a y, 0) the water accelerates at a^2 (x, y, 0), and a sphere at (m_d + m_a) /
    (m + m_a) of that along its own path (G. I. Taylor, Proc. R. Soc. A 120 (1928) 260-283): a
    neutral one as a^2 x whatever its speed is, for only x enters, not the slip.
    """
    sphere = added * VEHICLE.mass * np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    vehicle = bare(added_mass=sphere)
    flow = Linear(centre=(0.0, 0.0, 300.0), gradient=(STRAIN, 0, 0, 0, -STRAIN, 0, 0, 0, 0))
    start = Start(north=5.0, east=-8.0, depth=300.0, heading=0.7, v_rel=(0.2, -0.1, 0.0))
    over_ground = start.v_rel[0] * np.array([np.cos(0.7), np.sin(0.7)])
    over_ground += start.v_rel[1] * np.array([-np.sin(0.7), np.cos(0.7)])
    over_ground += STRAIN * np.array([5.0, 8.0])
    for found, tolerance in zip(fly_both(vehicle, start, flow, 60.0), (2e-4, 1e-5), strict=True):
        t = STRAIN * found.time
        north = 5.0 * np.cosh(t) + over_ground[0] / STRAIN * np.sinh(t)
        east = -8.0 * np.cosh(t) + over_ground[1] / STRAIN * np.sinh(t)
        place = place_of(found)
        np.testing.assert_allclose(place[:, 0], north, atol=tolerance * np.abs(north).max())
        np.testing.assert_allclose(place[:, 1], east, atol=tolerance * np.abs(east).max())


@pytest.mark.parametrize("heading", [0.0, np.pi / 2])
def test_a_neutral_spheroid_along_a_strain_flow_follows_the_same_law(heading):
    """Each axis of the flow by itself: the added mass of that axis cancels out."""
    flow = Linear(centre=(0.0, 0.0, 300.0), gradient=(STRAIN, 0, 0, 0, -STRAIN, 0, 0, 0, 0))
    vehicle = bare(added_mass=np.diag([3.0, 60.0, 60.0, 0.0, 8.0, 8.0]))
    start = Start(north=10.0, depth=300.0, heading=heading)
    for found in fly_both(vehicle, start, flow, 60.0):
        place = place_of(found)
        expected = 10.0 * np.exp(STRAIN * found.time)
        np.testing.assert_allclose(place[:, 0], expected, rtol=1e-4)
        assert np.abs(found.v_rel).max() < 1e-4


def test_a_neutral_hull_turns_with_water_that_turns_as_a_whole():
    """Solid rotation at 1 deg/s about a point 50 m away: it goes round and keeps its side to it.

    What is left of slip is the rigid body's: its CG is 5 mm off the CB.
    """
    spin = np.deg2rad(1.0)
    flow = Linear(centre=(0.0, 0.0, 300.0), gradient=(0, -spin, 0, spin, 0, 0, 0, 0, 0))
    start = Start(north=50.0, depth=300.0, heading=np.pi / 2, rates=(0.0, 0.0, spin))
    for found in fly_both(VEHICLE, start, flow, 360.0):
        place = place_of(found)
        angle = spin * found.time
        circle = 50.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        assert np.abs(place[:, :2] - circle).max() < 0.05
        assert np.abs(found.v_rel).max() < 2e-4
        ours = not hasattr(found, "attitude")
        heading = np.deg2rad(found["true_heading"]) if ours else found.attitude[:, 2]
        turned = np.unwrap(heading) - heading[0]
        np.testing.assert_allclose(turned, angle, atol=np.deg2rad(0.5))


def test_an_inclined_hull_is_at_rest_in_water_that_turns_as_a_whole():
    """What goes round with the water disturbs nothing, so its added mass must feel nothing.

    Nose down in solid rotation, no force of its law, CG in the CB, and as much inertia about every
    axis, so that it needs no moment itself. An impulse of omega in place of omega_r would press it
    by -omega x h_2 and pitch it by 4.6 deg in this minute. MuJoCo's servos sag by half a
    micrometre, hence the larger limit.
    """
    vehicle = bare()
    inertia = mass_distribution(parameters_of(vehicle, *ONE_DENSITY), np.array(NEUTRAL))[2]
    alike = vehicle.static_inertia + 20.0 * np.eye(3) - inertia
    vehicle = vehicle.replace(static_inertia=alike)
    spin, pitch, duration = np.deg2rad(1.0), -0.6, 60.0
    flow = Linear(centre=(0.0, 0.0, 300.0), gradient=(0, -spin, 0, spin, 0, 0, 0, 0, 0))
    rates = spin * np.array([-np.sin(pitch), 0.0, np.cos(pitch)])
    start = Start(north=50.0, depth=300.0, heading=0.5, pitch=pitch, rates=tuple(rates))
    ours, theirs = fly_both(vehicle, start, flow, duration)
    attitude = np.deg2rad(np.stack([ours[f"true_{a}"] for a in ("roll", "pitch", "heading")], 1))
    for found, angles, allowed in ((ours, attitude, 5e-3), (theirs, theirs.attitude, 1e-9)):
        turned = np.unwrap(angles[:, 2]) - 0.5 - spin * found.time
        np.testing.assert_allclose(angles[:, 0], 0.0, atol=allowed)
        np.testing.assert_allclose(angles[:, 1], pitch, atol=allowed)
        np.testing.assert_allclose(turned, 0.0, atol=allowed)
        assert np.abs(found.v_rel).max() < allowed


def test_a_shear_across_the_track_turns_the_hull_as_its_yaw_damping_says():
    """At rest in V_north = g east: the water turns at -g under a hull that points north.

    Its yaw damping vanishes at r = dv_c/dx = -g sin^2(heading): the law by which a thin rod turns
    into the stream (Jeffery 1922), cot(heading) = g t from broadside.
    """
    g = 0.01
    flow = Linear(centre=(0.0, 0.0, 300.0), gradient=(0, g, 0, 0, 0, 0, 0, 0, 0))
    start = Start(depth=300.0, heading=np.pi / 2)
    ours, theirs = fly_both(VEHICLE, start, flow, 600.0)
    heading = np.unwrap(np.deg2rad(ours["true_heading"]))
    expected = np.arctan2(1.0, g * ours.time)
    assert heading[-1] < 1.0  # it has turned from 1.57
    assert np.abs(heading - expected).max() < 0.2
    assert np.abs(heading - np.unwrap(theirs.attitude[:, 2])).max() < 1e-3


# --- what the impulse of the added mass takes -----------------------------------------------------


PARAMETERS = parameters_of(VEHICLE, np.zeros(1), np.array([VEHICLE.reference_density]))
PARTS = np.array([0.02, 0.5, VEHICLE.pump_for_net_mass(0.3)])
MASS, MOMENT, INERTIA = mass_distribution(PARAMETERS, PARTS)
DISPLACED = MASS - 0.3
ADDED = np.array(VEHICLE.added_mass)
BOTH = np.linalg.inv(rigid_body_mass(MASS, MOMENT / MASS, INERTIA) + ADDED)
DURATION, STEP = 300.0, 0.2
SHEARED = (
    "geostrophic:surface=0.4,direction=90,scale=200",
    "ekman:stress=0.2,lat=40,direction=20",
)


def skew(a: Any) -> Any:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def turning(g: Any) -> Any:
    """Rotation (3,) of the water that the gradient `g` in body axes is to a hull with wings."""
    return np.array([g[2, 1], -g[2, 0], g[1, 0]])


def of_impulse(velocity: Any, omega: Any, rates: Any, g: Any) -> Any:
    """What the impulse h = M_A (velocity, rates) presses with, less what any account has."""
    h = ADDED @ np.concatenate([velocity, rates])
    force = np.concatenate(
        [np.cross(omega, h[:3]) + g.T @ h[:3], np.cross(omega, h[3:]) + np.cross(velocity, h[:3])]
    )
    return -force


def left_out(nu: Any, g: Any, change: Any) -> Any:
    """Rate of the gradient, derivative of the energy by the attitude, strain of what is displaced.

    `change` is the gradient's local rate and change along the path, in body axes.
    """
    omega = skew(nu[3:])
    h = ADDED @ np.concatenate([nu[:3], nu[3:] - turning(g)])
    tau = ADDED[:, 3:] @ turning(g @ omega - omega @ g + change)
    tau[3:] -= [h[3:] @ turning(g @ skew(e) - skew(e) @ g) for e in np.eye(3)]
    half = 0.5 * np.array([VEHICLE.hull_length, VEHICLE.hull_diameter, VEHICLE.hull_diameter])
    q = (g @ g + change) * (0.2 * DISPLACED * half**2)  # an ellipsoid's second moments
    tau[3:] += [q[2, 1] - q[1, 2], q[0, 2] - q[2, 0], q[1, 0] - q[0, 1]]
    return tau


def rate(program: Any, account: str, t: float, y: Any) -> Any:
    """dy/dt of (position, quaternion, nu_r)."""
    to_ned, nu = rotation(y[3:7]), y[7:]
    flow = np.array(sample_gradient(program, t, *y[:3]))
    a = flow[6:].reshape(3, 3)
    velocity = to_ned @ nu[:3] + flow[:3]
    g = to_ned.T @ a @ to_ned
    path, water = (to_ned.T @ (flow[3:6] + a @ v) for v in (velocity, flow[:3]))
    density = PARAMETERS.reference_density
    dnu = acceleration(
        PARAMETERS, to_ned[2].copy(), y[2], nu, PARTS, DISPLACED, density, path, water, g
    )
    if account == "omega":
        ours = of_impulse(nu[:3], nu[3:], nu[3:] - turning(g), g)
        dnu = dnu + BOTH @ (of_impulse(nu[:3], nu[3:], nu[3:], g) - ours)
    elif account == "complete":
        ahead, behind = (
            np.array(sample_gradient(program, t + s, *(y[:3] + s * velocity)))[6:].reshape(3, 3)
            for s in (0.5, -0.5)
        )
        dnu = dnu + BOTH @ left_out(nu, g, to_ned.T @ (ahead - behind) @ to_ned)
    return np.concatenate([velocity, quaternion_rate(y[3:7], nu[3:]), dnu])


@functools.cache
def track(current: str, account: str) -> Any:
    """Places (n, 3) of a turning glide."""
    program = parse_current(current).compile(2.0 * DURATION)
    y = np.zeros(13)
    y[2], y[3:7], y[7:10] = 20.0, euler_to_quaternion(0.0, -0.57, 0.4), (0.47, 0.0, 0.012)
    times = np.arange(1.0, DURATION, STEP)
    found = solve_ivp(
        lambda t, y: rate(program, account, t, y), (1.0, DURATION), y, t_eval=times, rtol=1e-9
    )
    return found.y[:3].T


def apart(current: str, account: str) -> float:
    """Largest distance from the track of our models, as a percentage of its length."""
    ours = track(current, "omega_r")
    length = np.linalg.norm(np.diff(ours, axis=0), axis=1).sum()
    return 100.0 * float(np.linalg.norm(track(current, account) - ours, axis=1).max()) / length


@pytest.mark.parametrize("current", SHEARED)
def test_an_impulse_of_the_bodys_own_rate_is_another_model_and_what_is_left_out_is_small(current):
    assert 0.08 < apart(current, "omega") < 0.2
    assert 1e-4 < apart(current, "complete") < 0.04
    assert apart(current, "omega") > 3.0 * apart(current, "complete")


def water_turning(gradient: Any, half: Any) -> Any:
    """Rotation (3,) of water under an ellipsoid of half axes `half`: what disturbs it as much.

    The disturbance has the normal velocity n . (v_r + omega x s - G s) at the surface, whose normal
    is along s_i / half_i^2 (Lamb 1932, articles 114 and 115). The part with s_j s_k of the gradient
    is that of a rotation about axis i.
    """
    square = np.square(half)
    return np.array(
        [
            (square[j] * gradient[k, j] + square[k] * gradient[j, k]) / (square[j] - square[k])
            for j, k in ((1, 2), (2, 0), (0, 1))
        ]
    )


def test_an_ellipsoid_in_a_gradient_disturbs_the_water_as_one_that_turns_against_it():
    """Of a hull with wings, in any gradient: the rotation of the equations, not none at all."""
    rng = np.random.default_rng(4)
    half = np.array([1.0, 0.3, 0.1])
    s = rng.normal(size=(50, 3))
    s *= (1.0 / np.linalg.norm(s / half, axis=1))[:, None]
    normal = s / np.square(half)
    for _ in range(5):
        g = rng.normal(size=(3, 3))
        np.fill_diagonal(g, 0.0)  # an even disturbance, which has no impulse
        strained = np.sum(normal * (s @ g.T), axis=1)
        turned = np.sum(normal * np.cross(water_turning(g, half), s), axis=1)
        np.testing.assert_allclose(turned, strained, atol=1e-12 * np.abs(strained).max())
        # of a slender hull with flat wings it is the rotation that both models take
        flat = water_turning(g, np.array([1.0, 1e-3, 1e-6]))
        np.testing.assert_allclose(flat, turning(g), atol=1e-5)
        motion = np.concatenate([np.zeros(3), rng.normal(size=3)])
        np.testing.assert_allclose(turned_water(motion, g)[3:], motion[3:] - flat, atol=1e-5)


@pytest.mark.parametrize("name", vehicle_names())
def test_shipped_hulls_are_slender_enough_for_that_rotation(name):
    """A shear of the current over depth, on a level hull: `rogue` and the ROV are the fat ones."""
    vehicle = load_vehicle(name)
    half = 0.5 * np.array([vehicle.hull_length, vehicle.hull_diameter, 0.0])
    g = np.zeros((3, 3))
    g[1, 0] = 1.0
    exact = water_turning(g, half)[2]
    fat = name.partition(":")[0] in ("rogue", "bluerov2")
    assert exact == pytest.approx(1.0, rel=0.75 if fat else 0.06)
