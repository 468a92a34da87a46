"""The ellipsoid model: MuJoCo's own law in still water, but at the water-relative velocity."""

import mujoco
import numpy as np
import pytest
from physics import glider, hydrodynamic_wrench, set_motion

from twin.errors import VehicleError
from twin.frames import flip_vector
from twin.physics.model_block import header
from twin.physics.mujoco_model import compile_model
from twin.physics.native.install import install, uninstall
from twin.vehicle.laws.ellipsoid import SEAWATER_VISCOSITY, fluid_geoms
from twin.vehicle.vehicle import load_vehicle, parse_vehicle


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
