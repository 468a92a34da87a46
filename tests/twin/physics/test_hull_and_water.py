"""The hull in its water: weighed, squeezed and warmed, in both models."""

import numpy as np
import pytest
from physics import held

import twin
from twin.errors import InputError, VehicleError
from twin.fossen import FossenModel, FossenState
from twin.mission.controller import Schedule
from twin.physics.native.hydrodynamics import immersion
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Ballast, Start, weighed
from twin.vehicle.vehicle import load_vehicle
from twin.water.density import DensityProfile

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
