"""The Fossen model: order, conservation, symmetries, currents, steady motions, errors."""

import dataclasses
import math

import numpy as np
import pytest
from physics import reference, without_water_forces

from twin.errors import InputError, MissionError, NoSteadyState, SimulationUnstable
from twin.fossen import FossenModel, FossenState
from twin.fossen.equations import mass_distribution, rigid_body_mass
from twin.fossen.forces import damping_wrench
from twin.fossen.steady import SteadyProblem, steady_motions
from twin.frames import euler_to_quaternion, quaternion_to_matrix
from twin.mission.controller import Schedule
from twin.vehicle.steady_motion import Trim, solve_steady_state, trim_positions
from twin.vehicle.vehicle import Vehicle, load_vehicle
from twin.water.current.layers import Geostrophic
from twin.water.current.profile import Uniform
from twin.water.current.sampler import sample_gradient
from twin.water.current.tide import Inertial

DIVE = Schedule(times=[0.0], commands=[[0.02, math.radians(30), -290.0]])
CRUISE = FossenState(
    position_ned=[0.0, 0.0, 50.0],
    attitude=[0.05, -0.5, 0.3],
    v_rel=[0.4, 0.01, 0.02],
    actuators=[0.015, 0.4, -200.0],
)


@pytest.fixture(scope="module")
def seawing():
    return load_vehicle("glider")


@pytest.fixture(scope="module")
def model(seawing):
    return FossenModel(seawing)


def in_current(vehicle: Vehicle, current) -> FossenModel:
    return FossenModel(vehicle, current_program=current.compile(3600.0))


def sheared():
    return Geostrophic(baroclinic=0.5, direction_deg=40.0, scale_depth=60.0) + Inertial(
        speed=0.2, layer_depth=10.0, decay_depth=80.0, latitude_deg=60.0
    )


def test_spiral_is_reached_from_rest_at_the_surface(model):
    start = FossenState(position_ned=[0.0, 0.0, 0.0])
    schedule = Schedule(times=[0.0], commands=[[0.02, math.radians(45), -1e6 * 0.3 / 1025.0]])
    track = model.simulate(start, schedule, 600.0)
    steady = model.steady_motion(0.02, math.radians(45), 0.3)
    np.testing.assert_allclose(track.v_rel[-1], steady.nu_r[:3], atol=1e-7)
    np.testing.assert_allclose(track.rates[-1], steady.nu_r[3:], atol=1e-8)
    np.testing.assert_allclose(track.actuators[-1], schedule.commands[0], rtol=1e-9)
    # The circle over ground has the trim's radius.
    heading_rate = np.unwrap(track.attitude[-100:, 2])
    assert (heading_rate[-1] - heading_rate[0]) / 49.5 == pytest.approx(
        steady.trim.turn_rate_rad_s, rel=1e-5
    )


def test_runge_kutta_is_of_fourth_order(model):
    def final(track):
        return np.concatenate((track.position_ned[-1], track.v_rel[-1], track.quaternion[-1]))

    flight, samples = (CRUISE, DIVE, 16.0), {"sample_period": 4.0}
    exact = final(reference(model, *flight, **samples))
    errors = [
        np.linalg.norm(final(model.simulate(*flight, **samples, dt=dt)) - exact)
        for dt in (0.2, 0.1, 0.05)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 3.7) & (orders < 4.5)), (errors, orders)


@pytest.mark.parametrize(
    ("speed", "position_error"),
    # A launch from rest crosses the floor of the rate damping, a kink that costs any method
    # its order; a glider that already moves does not.
    [(0.0, 5e-4), (0.3, 1e-6)],
)
def test_default_step_is_converged_in_a_violent_manoeuvre(seawing, speed, position_error):
    model = in_current(seawing, sheared())
    schedule = Schedule(
        times=[0.0, 40.0, 80.25], commands=[[0.05, 1.5, -480], [-0.05, -1.5, 480], [0.01, 0, -100]]
    )
    start = FossenState(position_ned=[0.0, 0.0, 30.0], v_rel=[speed, 0.0, 0.01 * speed])
    track = model.simulate(start, schedule, 120.0)
    exact = reference(model, start, schedule, 120.0)
    assert np.max(np.abs(track.speed - exact.speed)) < 1e-6
    assert np.max(np.abs(track.position_ned - exact.position_ned)) < position_error
    np.testing.assert_allclose(track.actuators, exact.actuators, atol=1e-9)


@pytest.mark.parametrize("gravity", [1e-12, 9.81])
def test_energy_is_conserved_without_drag(seawing, gravity):
    """Neutral and drag-free, kinetic energy of M_RB + M_A plus that of the hanging CG stays."""
    model = FossenModel(without_water_forces(seawing.replace(gravity=gravity)))
    start = FossenState(
        position_ned=[0.0, 0.0, 500.0],
        attitude=[0.2, 1.5, 0.3],
        v_rel=[0.3, 0.1, -0.2],
        rates=[0.3, 0.8, -0.2],  # tumbles through the vertical
        actuators=[0.03, 0.8, 0.0],
    )
    schedule = Schedule(times=[0.0], commands=[start.actuators])
    track = model.simulate(start, schedule, 60.0, dt=0.02)
    p = model.parameters
    total, moment, inertia = mass_distribution(p, np.array([0.03, 0.8, 0.0]))
    cg = moment / total
    mass = rigid_body_mass(p.mass, cg, inertia) + p.added_mass
    nu = np.hstack((track.v_rel, track.rates))
    kinetic = 0.5 * np.einsum("ti,ij,tj->t", nu, mass, nu)
    down = quaternion_to_matrix(track.quaternion)[:, 2]
    energy = kinetic - p.mass * gravity * down @ cg
    assert np.ptp(kinetic) > 1e-3 * kinetic[0] or gravity < 1
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)
    assert np.max(np.abs(track.attitude[:, 1])) > 1.4


def test_heading_does_not_matter(model):
    turn = 2.2
    other = dataclasses.replace(CRUISE, attitude=CRUISE.attitude + np.array([0.0, 0.0, turn]))
    one, two = (model.simulate(state, DIVE, 100.0) for state in (CRUISE, other))
    np.testing.assert_allclose(two.v_rel, one.v_rel, atol=1e-11)
    rotate = quaternion_to_matrix(euler_to_quaternion(0.0, 0.0, turn))
    np.testing.assert_allclose(two.position_ned, one.position_ned @ rotate.T, atol=1e-9)


def test_port_mirrors_starboard(model):
    flip, turn = np.array([1.0, -1.0, 1.0]), np.array([-1.0, 1.0, -1.0])
    sides = {"v_rel": flip * CRUISE.v_rel, "actuators": flip * CRUISE.actuators}
    mirrored = dataclasses.replace(CRUISE, attitude=turn * CRUISE.attitude, **sides)
    schedule = Schedule(times=DIVE.times, commands=flip * DIVE.commands)
    one, two = model.simulate(CRUISE, DIVE, 100.0), model.simulate(mirrored, schedule, 100.0)
    np.testing.assert_allclose(two.v_rel, one.v_rel * flip, atol=1e-11)
    np.testing.assert_allclose(two.rates, one.rates * turn, atol=1e-11)
    np.testing.assert_allclose(two.position_ned, one.position_ned * flip, atol=1e-9)


def test_uniform_current_only_carries_the_track(seawing, model):
    current = np.array([0.6, -0.4, 0.05])
    moving = in_current(seawing, Uniform(north=0.6, east=-0.4, down=0.05))
    one, two = (m.simulate(CRUISE, DIVE, 200.0) for m in (model, moving))
    np.testing.assert_allclose(two.v_rel, one.v_rel, atol=1e-9)
    np.testing.assert_allclose(two.quaternion, one.quaternion, atol=1e-9)
    carried = one.position_ned + current * one.time[:, None]
    np.testing.assert_allclose(two.position_ned, carried, atol=1e-9)
    np.testing.assert_allclose(two.velocity_ned, one.velocity_ned + current, atol=1e-9)


def test_sheared_current_obeys_newton_in_the_inertial_frame(seawing):
    """Momenta differentiated along the simulated track, in NED, without any of Fossen's terms.

    Rigid body: d(m v_cg)/dt and dH_cg/dt. Water: minus the rate of the added momentum of the
    relative velocity, whose point of application moves through the water (v_r x p).
    """
    model = in_current(seawing, sheared())
    p, h = model.parameters, 0.01
    held = Schedule(times=[0.0], commands=[CRUISE.actuators])
    track = model.simulate(CRUISE, held, 8.0, dt=h, sample_period=h)
    r = quaternion_to_matrix(track.quaternion)
    actuators = np.asarray(CRUISE.actuators)
    total, moment, inertia_cb = mass_distribution(p, actuators)
    cg = moment / total
    inertia = inertia_cb - p.mass * (cg @ cg * np.eye(3) - np.outer(cg, cg))

    def to_ned(body):
        return np.einsum("tij,tj->ti", r, body)

    def rate(values):  # fourth-order central difference
        ahead, behind = values[3:-1] - values[1:-3], values[4:] - values[:-4]
        return (8.0 * ahead - behind) / (12.0 * h)

    nu_r = np.hstack((track.v_rel, track.rates))
    places = np.c_[track.time, track.position_ned]
    flow = np.array([sample_gradient(model.program, *place) for place in places])
    gradient = flow[:, 6:].reshape(-1, 3, 3)
    turning = np.einsum("tji,tjk,tkl->til", r, gradient, r)  # body axes
    nu_w = nu_r.copy()
    nu_w[:, 3:] -= np.stack([turning[:, 2, 1], -turning[:, 2, 0], turning[:, 1, 0]], axis=1)
    added = nu_r @ p.added_mass
    # what is carried round with the hull is the impulse in the water that turns
    carried = added - nu_w @ p.added_mass
    strained = np.einsum("tji,tj->ti", turning, (nu_w @ p.added_mass)[:, :3])
    wrench = np.array([damping_wrench(p, x, p.reference_density) for x in nu_w])
    over_ground = np.zeros_like(track.position_ned)
    over_ground[2:-2] = rate(track.position_ned)
    cg_ned = to_ned(np.broadcast_to(cg, nu_r[:, :3].shape))
    inside = slice(2, -2)

    v_cg = over_ground + to_ned(np.cross(track.rates, cg))
    net = p.mass - p.reference_density * (p.neutral_volume + 1e-6 * actuators[2])
    displaced = p.mass - net
    own = flow[:, 3:6] + np.einsum("tij,tj->ti", gradient, flow[:, :3])  # the water's own rate
    water = (
        to_ned(wrench[:, :3] - strained + np.cross(track.rates, carried[:, :3])) + displaced * own
    )[inside] - rate(to_ned(added[:, :3]))
    force = water + net * p.gravity * np.array([0.0, 0.0, 1.0])
    # v_cg is itself a difference: four rows at either end hold no value.
    np.testing.assert_allclose(
        p.mass * rate(v_cg)[2:-2], force[2:-2], atol=2e-6, err_msg="translation"
    )
    water_moment = to_ned(
        wrench[:, 3:]
        - np.cross(track.v_rel, (added - carried)[:, :3])
        + np.cross(track.rates, carried[:, 3:])
    )[inside] - rate(to_ned(added[:, 3:]))
    buoyancy = -(p.mass - net) * p.gravity * np.array([0.0, 0.0, 1.0])
    moment_cg = water_moment - np.cross(cg_ned[inside], water + buoyancy)
    spin = rate(to_ned(track.rates @ inertia))
    np.testing.assert_allclose(spin[2:-2], moment_cg[2:-2], atol=2e-6, err_msg="rotation")
    # The check has teeth: the current's rate along the path is far above the tolerance.
    path_rate = p.mass * np.linalg.norm(rate(track.current_ned), axis=1)
    assert np.min(path_rate) > 1e-2


def test_stratification_stops_a_dive(seawing):
    """A heavy glider sinks to the depth where its displaced mass equals its own and rests."""
    model = FossenModel(seawing, density=([0.0, 100.0], [1020.0, 1030.0]))
    start = FossenState(position_ned=[0.0, 0.0, 45.0])
    schedule = Schedule(times=[0.0], commands=[[0.0, 0.0, 0.0]])
    track = model.simulate(start, schedule, 3000.0, sample_period=5.0)
    assert track.position_ned[-200:, 2].mean() == pytest.approx(50.0, abs=0.1)
    assert track.speed[-1] < 0.02


def test_light_glider_floats(model):
    track = model.simulate(
        FossenState(position_ned=[0.0, 0.0, 0.5]),
        Schedule(times=[0.0], commands=[[0.02, 0.0, 480.0]]),
        400.0,
    )
    assert abs(track.position_ned[-1, 2]) < 0.2
    assert abs(track.velocity_ned[-1, 2]) < 1e-5
    assert track.speed[-1] < 0.02  # the hull coasts on, slower with the square of its speed


def test_tail_first_launch_stays_finite(model):
    """A climb with the block forward reverses the flow: the rates must still be damped there."""
    held = [0.02, math.radians(30), 290.0]
    start = FossenState(
        position_ned=[0, 0, 500], attitude=[0, 0.3, 0], v_rel=[0.2, 0, 0], actuators=held
    )
    track = model.simulate(start, Schedule(times=[0.0], commands=[held]), 400.0)
    assert track.v_rel[-1, 0] < -0.3
    assert np.max(np.abs(track.rates[-1])) < 0.01


def test_commands_between_samples_are_honoured(model):
    """A step inside a sample interval acts at its own time, not at the next sample."""
    schedule = Schedule(times=[0.0, 1.3], commands=[[0, 0, 0], [0.01, 0, 0]])
    track = model.simulate(CRUISE, Schedule(times=[0.0], commands=[[0, 0, 0]]), 4.0)
    stepped = model.simulate(CRUISE, schedule, 4.0, sample_period=0.5)
    np.testing.assert_array_equal(stepped.time, track.time)
    before = stepped.time <= 1.3
    np.testing.assert_allclose(stepped.actuators[before], track.actuators[before], rtol=1e-12)
    assert np.all(stepped.actuators[~before, 0] > track.actuators[~before, 0])


def test_bad_input_is_refused(model, seawing):
    with pytest.raises(MissionError, match="begins at 5 s, after the start at 0 s"):
        model.simulate(CRUISE, Schedule(times=[5.0], commands=[[0, 0, 0]]), 10.0)
    with pytest.raises(MissionError, match="must increase"):
        Schedule(times=[0.0, 0.0], commands=[[0, 0, 0], [0, 0, 0]])
    with pytest.raises(MissionError, match="times and commands must be finite"):
        Schedule(times=[0.0], commands=[[0, math.nan, 0]])
    with pytest.raises(InputError, match="dt must be above 0 s"):
        model.simulate(CRUISE, DIVE, 10.0, dt=0.0)
    with pytest.raises(InputError, match="v_rel must be finite"):
        FossenState(v_rel=[0.0, 1.0])
    with pytest.raises(InputError, match="must be finite and increase"):
        FossenModel(seawing, density=([0.0, -1.0], [1020.0, 1030.0]))


def test_instability_names_the_time_and_keeps_what_it_had(model):
    start = FossenState(position_ned=[0.0, 0.0, 50.0], rates=[0.0, 0.0, 40.0], v_rel=[3.0, 0, 0])
    with pytest.raises(SimulationUnstable, match="use a smaller dt") as caught:
        model.simulate(start, DIVE, 60.0, dt=0.5)
    partial = caught.value.partial
    assert 0 < partial.time.size < 121
    assert partial.time[-1] < caught.value.time_s
    assert np.all(np.isfinite(partial.v_rel))


# --- steady motions, against published and independently computed figures -------------------------


# net mass kg, block position m, rotation deg: V, alpha, beta, roll, pitch, turn rate, down.
# Computed with an independent solver of the equations of Zhang et al. (2013).
COMPUTED = [
    ((0.30, 0.4216, 45), (0.4902, 1.272, -1.285, -13.688, -35.547, 0.00385, 0.2956)),
    ((0.30, 0.4216, 10), (0.4738, 1.447, -0.325, -3.125, -33.095, 0.00087, 0.2687)),
    ((0.30, 0.4216, 0), (0.4729, 1.457, 0.0, 0.0, -32.973, 0.0, 0.2674)),
    ((0.30, 0.4116, 0), (0.3586, 2.826, 0.0, 0.0, -17.984, 0.0, 0.1274)),
    ((-0.30, 0.3816, 0), (0.4861, -1.257, 0.0, 0.0, 35.058, 0.0, -0.2879)),
]


@pytest.mark.parametrize(("setting", "expected"), COMPUTED)
def test_computed_steady_states(model, setting, expected):
    net_mass, position, rotation_deg = setting
    shift = position - model.vehicle.battery.neutral_x
    trim = model.trim(shift, math.radians(rotation_deg), net_mass)
    speed, alpha, beta, roll, pitch, turn_rate, down = expected
    assert trim.speed_m_s == pytest.approx(speed, rel=0.003)
    assert trim.angle_of_attack_deg == pytest.approx(alpha, abs=0.01)
    assert trim.sideslip_deg == pytest.approx(beta, abs=0.01)
    assert trim.roll_deg == pytest.approx(roll, abs=0.01)
    assert trim.pitch_deg == pytest.approx(pitch, abs=0.01)
    assert trim.turn_rate_rad_s == pytest.approx(turn_rate, rel=0.01, abs=1e-9)
    assert trim.vertical_speed_m_s == pytest.approx(down, rel=0.003)
    assert trim.in_identified_range
    if rotation_deg == 45:  # printed too; the other figures of that row are in published.toml
        assert trim.turn_radius_m == pytest.approx(100.5, rel=0.02)


def test_spiral_eigenvalues(seawing):
    """The listed eigenvalues belong to the misprinted block inertia I_yy = 10.16 kg m2."""
    inertia = seawing.battery.inertia.copy()
    inertia[1, 1] = 10.16
    misprinted = FossenModel(seawing.replace(battery={"inertia": inertia}))
    motion = misprinted.steady_motion(0.02, math.radians(45), 0.3)
    values = motion.eigenvalues
    np.testing.assert_allclose(values.real[:4], [-3.56, -3.00, -1.81, -1.35], atol=0.006)
    np.testing.assert_allclose(values.real[4:], [-0.585, -0.585, -0.092, -0.092], atol=0.0006)
    np.testing.assert_allclose(
        np.abs(values.imag), [0, 0, 0, 0, 0.258, 0.258, 0.0075, 0.0075], atol=0.0006
    )


def test_slow_modes_do_not_depend_on_the_misprint(model):
    motion = model.steady_motion(0.02, math.radians(45), 0.3)
    np.testing.assert_allclose(
        motion.eigenvalues.real[4:], [-0.585, -0.585, -0.092, -0.092], atol=0.001
    )
    assert motion.stable


@pytest.mark.parametrize("net_mass", [0.3, -0.3])
def test_starboard_and_port_spirals_mirror(model, net_mass):
    shift = math.copysign(0.02, net_mass)
    one = model.trim(shift, math.radians(30), net_mass)
    other = model.trim(shift, math.radians(-30), net_mass)
    assert other.roll_deg == pytest.approx(-one.roll_deg, abs=1e-8)
    assert other.sideslip_deg == pytest.approx(-one.sideslip_deg, abs=1e-8)
    assert other.turn_rate_rad_s == pytest.approx(-one.turn_rate_rad_s, abs=1e-12)
    assert other.pitch_deg == pytest.approx(one.pitch_deg, abs=1e-8)
    assert other.turn_radius_m == pytest.approx(one.turn_radius_m, rel=1e-9)
    # Dive and climb turn to the same side for the same rotation.
    assert one.turn_rate_rad_s > 0
    assert one.roll_deg < 0


def test_no_steady_state_says_why(model):
    with pytest.raises(NoSteadyState, match="net mass 0 kg"):
        model.trim(0.02, 0.0, 0.0)
    with pytest.raises(NoSteadyState, match=r"at shift -0\.02 m, .* flies tail first"):
        model.trim(-0.02, 0.0, 0.3)


@pytest.mark.parametrize(("shift", "rotation_deg"), [(0.025, 90), (0.04, 70), (0.05, 45)])
def test_spin_of_a_nearly_neutral_glider_is_found(model, shift, rotation_deg):
    """No family of spirals leads from the straight glide to these; following time does."""
    trim = model.trim(shift, math.radians(rotation_deg), 0.02)
    assert trim.turn_rate_rad_s > 0.05
    assert trim.vertical_speed_m_s > 0


def test_every_usual_setting_has_one_stable_forward_motion(model):
    for net_mass in (-0.4, 0.4):
        for shift in (0.01, 0.05):
            for rotation in (0.0, 0.8, 1.5):
                signed = math.copysign(shift, net_mass)
                positions = trim_positions(model.vehicle, signed, rotation, net_mass)
                turning = model.vehicle.steered_index("heading")
                problem = SteadyProblem(model.parameters, positions, turning, driven=False)
                motions = steady_motions(problem, model.vehicle.flow_frame.linear_angle)
                assert sum(m.stable and m.forward for m in motions) == 1


def test_stall_is_flagged(model):
    """With the block at neutral the glider sinks flat, far outside the identified range."""
    trim = model.trim(0.0, 0.0, 0.3)
    assert trim.angle_of_attack_deg > 10
    assert not trim.in_identified_range


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ((0.06, 0.0, 0.3), r"shift 0.06 m is outside .* from -0.05 to 0.05 m"),
        ((0.02, 2.0, 0.3), r"rotation 114.592 deg is outside .* from -90 to 90 deg"),
        ((0.02, 0.0, 0.7), r"net mass 0.7 kg is outside .* from -0.5 to 0.5 kg"),
        ((math.nan, 0.0, 0.3), r"shift nan m is outside"),
    ],
)
def test_unreachable_positions(model, setting, message):
    with pytest.raises(InputError, match=message):
        model.trim(*setting)


def test_trim_figures_from_a_motion():
    level = {"roll": 0.0, "pitch": 0.0, "linear_angle": 0.2}
    trim = Trim.from_motion(v_rel=[0.4, 0.0, 0.3], turn_rate=-0.01, **level)
    assert trim.speed_m_s == pytest.approx(0.5)
    assert trim.vertical_speed_m_s == pytest.approx(0.3)
    assert trim.turn_radius_m == pytest.approx(40.0)
    assert trim.angle_of_attack_deg == pytest.approx(math.degrees(math.atan2(0.3, 0.4)))
    assert not trim.in_identified_range
    assert Trim.from_motion(v_rel=[1, 0, 0], turn_rate=0, **level).turn_radius_m is None


def test_root_finder_keeps_distinct_roots_only():
    roots = solve_steady_state(lambda x: x * x - 4.0, [[1.0], [1.1], [-3.0]])
    assert sorted(float(x[0]) for x in roots) == pytest.approx([-2.0, 2.0])
    assert solve_steady_state(lambda x: x * x + 1.0, [[1.0]]) == []
