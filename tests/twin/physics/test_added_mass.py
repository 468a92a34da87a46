"""The hull in its water: added mass, the ellipsoid model, weight and volume."""

import dataclasses

import mujoco
import numpy as np
import pytest
from physics import (
    added_mass_in_joint_space,
    fossen_state,
    full_mass,
    glider,
    held,
    hydrodynamic_wrench,
    set_motion,
    without_water_forces,
    zero_servos,
)

import twin
from twin.errors import InputError, VehicleError
from twin.fossen import FossenModel, FossenState
from twin.fossen.equations import mass_distribution, rigid_body_mass
from twin.frames import flip_vector
from twin.mission.controller import Schedule
from twin.physics.model_block import header
from twin.physics.mujoco_model import INTEGRATORS, compile_model
from twin.physics.native.hydrodynamics import immersion
from twin.physics.native.install import install, uninstall
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Ballast, Start, weighed
from twin.vehicle.laws.ellipsoid import SEAWATER_VISCOSITY, fluid_geoms
from twin.vehicle.vehicle import load_vehicle, parse_vehicle
from twin.water.density import DensityProfile

RATIOS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)


def scaled(ratio: float):
    """The Sea-Wing with its heave added mass at `ratio` times its rigid mass."""
    vehicle = load_vehicle("glider")
    return vehicle.replace(added_mass=vehicle.added_mass * ratio * vehicle.mass / 65.92)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_acceleration_is_the_force_over_rigid_plus_added_mass(ratio, integrator):
    vehicle = scaled(ratio)
    model, data = glider(vehicle=vehicle, integrator=integrator, timestep=1e-3)
    zero_servos(model)
    moving = {"velocity": (0.3, -0.1, 0.2), "rates": (0.02, -0.03, 0.05)}
    set_motion(data, roll=0.3, pitch=-0.5, heading=2.0, **moving)
    mujoco.mj_forward(model, data)
    with_added = full_mass(model, data)
    force = data.qfrc_smooth.copy()
    qacc = data.qacc.copy()

    uninstall()
    try:
        mujoco.mj_makeM(model, data)
    finally:
        install()
    rigid = full_mass(model, data)
    exact = rigid + added_mass_in_joint_space(model, data, vehicle.added_mass)
    np.testing.assert_allclose(with_added, exact, rtol=1e-12, atol=1e-11)
    np.testing.assert_allclose(qacc, np.linalg.solve(exact, force), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("ratio", RATIOS[1:])
def test_stiff_servos_approach_the_locked_composite(ratio):
    """Released at rest, the hull moves as if the battery were bolted to it, as dt shrinks."""
    vehicle = scaled(ratio)
    actuators = (0.02, 0.4, -290.0)
    start = Start(depth=1000.0, actuators=actuators)
    given = held(vehicle, actuators, 4.0, start=start, sample_period=1.0)
    locked = FossenModel(vehicle).simulate(
        fossen_state(start), given.mission, 4.0, dt=0.01, sample_period=1.0
    )
    errors = []
    for timestep in (0.1, 0.05, 0.025):
        flown = simulate(dataclasses.replace(given, timestep=timestep))
        errors.append(np.abs(flown.v_rel - locked.v_rel).max())
    moved = np.abs(locked.v_rel).max()
    assert errors[0] < 2e-3 * moved
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


def test_mass_matrix_is_symmetric_positive_definite():
    model, data = glider()
    rng = np.random.default_rng(1)
    for _ in range(20):
        set_motion(
            data, roll=rng.uniform(-1, 1), pitch=rng.uniform(-1, 1), heading=rng.uniform(0, 6)
        )
        mujoco.mj_forward(model, data)
        mass = full_mass(model, data)
        np.testing.assert_array_equal(mass, mass.T)
        assert np.linalg.eigvalsh(mass)[0] > 0


def test_repeated_evaluation_adds_the_mass_once():
    model, data = glider()
    set_motion(data, roll=0.2, pitch=0.3, velocity=(0.4, 0, 0.1), rates=(0.01, 0.02, 0.03))
    mujoco.mj_forward(model, data)
    mass, qacc = full_mass(model, data), data.qacc.copy()
    for _ in range(3):  # skipping the position stage leaves the previous matrix in place
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, True)
    np.testing.assert_allclose(full_mass(model, data), mass, rtol=1e-14)
    np.testing.assert_allclose(data.qacc, qacc, rtol=1e-10, atol=1e-13)


def test_finite_difference_linearisation_leaves_the_state_alone():
    model, data = glider()
    set_motion(data, pitch=-0.5, velocity=(0.35, 0, 0.2))
    mujoco.mj_forward(model, data)
    before = full_mass(model, data)
    n = 2 * model.nv + model.na
    a = np.zeros((n, n))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, a, None, None, None)
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(full_mass(model, data), before)
    assert np.isfinite(a).all()
    assert np.abs(a).max() > 0.5


def test_added_mass_does_no_net_work():
    """Drag-free and neutral, the energy of body plus entrained water stays constant."""
    vehicle = without_water_forces()
    start = Start(depth=1000.0, pitch=-0.2, v_rel=(0.5, 0.02, 0.05), rates=(0.02, 0.05, -0.04))
    energies = {}
    for timestep in (0.02, 0.01):
        scenario = held(vehicle, (0.0, 0.0, 0.0), 10.0, start=start, timestep=timestep)
        energies[timestep] = kinetic_and_potential(vehicle, simulate(scenario))
    coarse, fine = (np.abs(e / e[0] - 1).max() for e in energies.values())
    # a tumbling hull: the drift is the integrator's, and vanishes with the step
    assert coarse < 0.02
    assert fine < 0.6 * coarse


def kinetic_and_potential(vehicle, trajectory):
    """Energy [J] of the locked composite with added mass, from the logged signals."""
    total, moment, inertia = mass_distribution(FossenModel(vehicle).parameters, np.zeros(3))
    mass = rigid_body_mass(total, moment / total, inertia) + vehicle.added_mass
    rates = np.stack([trajectory[f"true_{n}_rate"] for n in ("roll", "pitch", "yaw")], -1)
    twist = np.concatenate([trajectory.v_rel, rates], axis=1)
    kinetic = 0.5 * np.einsum("ti,ij,tj->t", twist, mass, twist)
    roll, pitch = (np.deg2rad(trajectory[f"true_{n}"]) for n in ("roll", "pitch"))
    down = np.stack(
        [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)], -1
    )
    return kinetic - vehicle.gravity * down @ moment


def test_munk_moment_has_the_right_sign_and_size():
    """At an angle of attack the added mass pitches the hull further: (Z - X) u w."""
    vehicle = without_water_forces()
    model, data = glider(vehicle=vehicle)
    u, w = 0.5, 0.05
    set_motion(data, velocity=(u, 0, w))
    wrench = hydrodynamic_wrench(model, data)
    expected = (vehicle.added_mass[2, 2] - vehicle.added_mass[0, 0]) * u * w
    assert wrench[4] == pytest.approx(expected, rel=1e-12)


# --- the ellipsoid model, at the water-relative velocity ------------------------------------------


@pytest.mark.parametrize("vehicle", ["glider", "rogue"])
def test_still_water_wrench_equals_mujocos_fluid(vehicle):
    """Ours less M_A (omega x v), which belongs to the world-frame acceleration, is qfrc_fluid."""
    model, data = glider(vehicle=vehicle, hydrodynamics="ellipsoid")
    rng = np.random.default_rng(3)
    for _ in range(10):
        roll, pitch, heading = rng.uniform(-1, 1, 3) * [1.0, 1.0, 3.0]
        velocity, rates = rng.normal(0, 0.3, 3), rng.normal(0, 0.2, 3)
        set_motion(data, roll=roll, pitch=pitch, heading=heading, velocity=velocity, rates=rates)
        ours = hydrodynamic_wrench(model, data)
        to_body = data.body("hull").xmat.reshape(3, 3).T
        v = flip_vector(to_body @ data.qvel[:3])
        rates = flip_vector(data.qvel[3:6])
        added = header(model)["added_mass"]
        ours = ours - added[:, :3] @ np.cross(rates, v)

        # MuJoCo would give the battery, which has no fluid geom, its inertia-box drag
        battery = model.body("battery")
        mass = float(battery.mass[0])
        model.body_mass[battery.id] = 0.0
        model.opt.density = load_vehicle(vehicle).reference_density
        model.opt.viscosity = SEAWATER_VISCOSITY
        uninstall()
        try:
            mujoco.mj_forward(model, data)
            fluid = data.qfrc_fluid[:6].copy()
        finally:
            install()
            model.opt.density = model.opt.viscosity = 0.0
            model.body_mass[battery.id] = mass
        expected = np.concatenate([flip_vector(to_body @ fluid[:3]), flip_vector(fluid[3:])])
        np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-10)


def test_added_mass_of_the_hull_is_that_of_an_ellipsoid():
    """Lamb (1932): a slender ellipsoid entrains little along its axis, much across."""
    model = compile_model("glider", hydrodynamics="ellipsoid", lean=True)
    added = header(model)["added_mass"]
    np.testing.assert_allclose(added, added.T, atol=1e-12)
    assert np.linalg.eigvalsh(added)[0] > 0
    hull = fluid_geoms(load_vehicle("glider").xml)[0]
    displaced = 1025 * 4 / 3 * np.pi * np.prod(hull[12:15])
    assert displaced == pytest.approx(65.28, rel=2e-3)
    assert 0.02 * displaced < 1025 * hull[21] < 0.06 * displaced
    assert 0.85 * displaced < 1025 * hull[22] < displaced


def test_without_fluid_geoms_the_way_out_is_named():
    vehicle = load_vehicle("glider")
    bare = parse_vehicle(vehicle.xml.replace('fluidshape="ellipsoid"', ""), vehicle.path)
    with pytest.raises(VehicleError, match=r"fluidshape.*--hydrodynamics coefficients"):
        compile_model(bare, hydrodynamics="ellipsoid")


# --- the hull weighed, squeezed and warmed --------------------------------------------------------


VEHICLE = load_vehicle("glider")
WATER = DensityProfile.thermocline(max_depth=400.0)
EXPANSION = 7e-5
SOFT = VEHICLE.replace(
    hull_thermal_expansion=EXPANSION, hull_thermal_lag=300.0, hull_compressibility=4e-10
)
DIVE = (0.02, 0.0, VEHICLE.pump_for_net_mass(0.3))


def fly(vehicle, *, duration=900.0, depth=20.0, density=WATER, command=DIVE, ballast=None):
    start = Start(depth=depth, pitch=-0.55, v_rel=(0.4, 0.0, 0.01), actuators=command)
    water = {"density": density, "ballast": ballast}
    return simulate(held(vehicle, command, duration, start=start, **water))


def test_a_cooling_hull_sinks_alike_in_both_models():
    model = FossenModel(
        SOFT, density=(WATER.depth, WATER.values), temperature=(WATER.depth, WATER.temperature)
    )
    state = FossenState(
        position_ned=(0.0, 0.0, 20.0), attitude=(0.0, -0.55, 0.0), v_rel=(0.4, 0.0, 0.01),
        actuators=DIVE,
    )  # fmt: skip
    theirs = model.simulate(state, Schedule(times=[0.0], commands=[DIVE]), 900.0)
    warm, cold = fly(VEHICLE), fly(SOFT)
    assert cold["true_depth"][-1] - warm["true_depth"][-1] > 5.0  # it matters
    np.testing.assert_allclose(cold.position, theirs.position_ned, atol=0.05)
    np.testing.assert_allclose(cold.v_rel, theirs.v_rel, atol=2e-5)


def test_net_mass_is_that_of_the_lagged_temperature():
    """The logged net mass against the law by which identification reads logs."""
    run = fly(SOFT)
    depth, time = run["true_depth"], run.time
    water = WATER.temperature_salinity(depth)[0]
    hull = np.empty_like(water)
    hull[0] = water[0]
    for k in range(1, len(time)):
        share = -np.expm1(-(time[k] - time[k - 1]) / 300.0)
        hull[k] = hull[k - 1] + share * (0.5 * (water[k] + water[k - 1]) - hull[k - 1])
    pressure = VEHICLE.reference_density * VEHICLE.gravity * depth
    strain = EXPANSION * (hull - 10.0) - 4e-10 * pressure
    volume = (VEHICLE.neutral_volume + 1e-6 * DIVE[2]) * (1.0 + strain)
    expected = VEHICLE.mass - WATER.density(depth) * volume
    np.testing.assert_allclose(run["true_net_mass"], expected, atol=3e-5)
    assert np.ptp(EXPANSION * (water - hull)) * VEHICLE.mass > 0.005  # the lag matters


def test_without_a_known_temperature_the_hull_keeps_its_reference():
    plain = DensityProfile(depth=WATER.depth, values=WATER.values)
    stiff = SOFT.replace(hull_thermal_expansion=0.0)
    same = fly(SOFT, density=plain, duration=60.0), fly(stiff, density=plain, duration=60.0)
    np.testing.assert_array_equal(same[0].position, same[1].position)


@pytest.mark.parametrize("depth", [0.0, 60.0, 250.0])
def test_ballasted_at_a_depth_it_hangs_there(depth):
    """With its pump at neutral it drifts by less than a metre in ten minutes."""
    there = max(depth, 2.0)
    weighed = {"density": WATER, "ballast": Ballast(depth=there)}
    run = simulate(held(SOFT, (0.0, 0.0, 0.0), 600.0, start=Start(depth=there), **weighed))
    assert np.abs(run["true_depth"] - there).max() < 1.0
    assert abs(run["true_net_mass"][0]) < 2e-3


def test_mass_is_weight_without_volume():
    heavier, ballast = weighed(VEHICLE, mass=VEHICLE.mass + 0.1)
    assert heavier.mass == pytest.approx(VEHICLE.mass + 0.1)
    run = fly(heavier, ballast=ballast, density=None, command=(0.02, 0.0, 0.0), duration=30.0)
    assert run["true_net_mass"][0] == pytest.approx(0.1, abs=1e-9)
    again, ballast = weighed(VEHICLE, mass=VEHICLE.mass + 0.1, ballast_at=2.0)
    run = fly(again, ballast=ballast, density=None, command=(0.02, 0.0, 0.0), duration=30.0)
    assert abs(run["true_net_mass"][0]) < 1e-9


def test_the_public_face_takes_them():
    run = twin.simulate(
        density="thermocline", ballast_at=50.0, mass=66.0, compressibility=3e-10, duration=120.0
    )
    assert run.provenance
    still = twin.simulate(density="thermocline", duration=120.0)
    assert run["true_net_mass"][0] != still["true_net_mass"][0]


def test_impossible_weights_are_refused():
    for said, name, values in (
        (r"has 65.28 kg", "mass", (9.0, 300.0, float("nan"))),
        ("from 0 to 11000 m", "ballast_at", (-1.0, 2e4, float("nan"))),
        ("hull_compressibility must be from 0 to 1e-08", "compressibility", (4e-6, -1e-10)),
    ):
        for value in values:
            with pytest.raises(InputError, match=said):
                weighed(VEHICLE, **{name: value})
    with pytest.raises(InputError, match="either a depth or a volume"):
        Ballast()
    for field, value in (("hull_thermal_expansion", -1e-5), ("hull_thermal_lag", 0.0)):
        with pytest.raises(VehicleError, match=field):
            VEHICLE.replace(**{field: value})


def test_a_compressible_hull_flies_in_water_that_is_compressed_too():
    """A deep glider comes back from 900 m; in water of one density it would sink for good."""
    deep = load_vehicle("slocum-1000")
    scenario = held(deep, deep.rest, 1.0)
    assert scenario.density.density(1000.0) == pytest.approx(1029.5, abs=0.5)
    constant = DensityProfile.constant(deep.reference_density)
    kept = Scenario(vehicle=deep, density=constant, duration=1.0, mission=scenario.mission)
    assert kept.density is constant
    assert Scenario(vehicle=VEHICLE, duration=1.0, mission=None).density is None


@pytest.mark.parametrize("share", [-0.9, -0.5, -0.2, 0.0, 0.3, 0.6, 0.95])
def test_a_level_hull_awash_is_wet_by_the_segment_of_its_circle(share):
    """The chords of the circle below the surface, summed, over those of all of it."""
    heights = (np.arange(200_000) + 0.5) / 100_000 - 1.0  # above the axis, in radii
    chords = np.sqrt(1.0 - heights**2)
    expected = chords[heights < share].sum() / chords.sum()
    mean, arm = immersion(VEHICLE.hull_length, 0.2, share * 0.1, 0.0)
    assert mean == pytest.approx(expected, abs=1e-6)
    assert arm == pytest.approx(0.0, abs=1e-12)
