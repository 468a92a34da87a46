"""Each fault of the hull, pump and instruments acts in its direction: signs and bodies by hand."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest

import twin
from twin.faults import FAULTS, condition_at
from twin.faults.base import DAY, KNOT
from twin.physics.condition import healthy
from twin.physics.simulation import Simulation

GLIDERS = ("slocum-200", "glider")


def scenario(name, *faults):
    return twin.Scenario(
        vehicle=twin.load_vehicle(name), mission=twin.load_mission("section"), duration=1800.0,
        engine="lanes", faults=faults,
    )  # fmt: skip


def phases(flight):
    """Medians in dives and in climbs of roll [degree], sinking [m/s] and battery place [m]."""
    run, battery = twin.simulate(flight), flight.vehicle.steered("pitch").name
    deep, sinking = run["true_depth"] > 20.0, run["true_velocity_down"]
    found = []
    for mask in (deep & (sinking > 0.05), deep & (sinking < -0.05)):
        names = ("true_roll", "true_velocity_down", f"true_{battery}")
        found.append(np.array([np.median(run[name][mask]) for name in names]))
    return found


@pytest.fixture(scope="module", params=GLIDERS)
def sound(request):
    return request.param, phases(scenario(request.param))


@pytest.mark.parametrize(
    ("fault", "column", "dive", "climb"),
    [
        # drag slows both ways; below the axis it lowers the nose, and the battery goes aft
        (FAULTS["attached"](drag=1.0), 1, -1.0, 1.0),
        (FAULTS["attached"](drag=1.0), 2, -1.0, -1.0),
        (FAULTS["fouling"](per_day=0.5, start=-DAY), 1, -1.0, 1.0),
        # water and lost volume pull down both ways; at the stern it wants the battery forward
        (FAULTS["water_taken"](per_day=0.06, start=-DAY, place=-0.3), 1, 1.0, 1.0),
        (FAULTS["water_taken"](per_day=0.06, start=-DAY, place=-0.3), 2, 1.0, 1.0),
        (FAULTS["water_taken"](per_day=0.06, start=-DAY, place=0.3), 2, -1.0, -1.0),
        (FAULTS["pump_air"](volume=40.0), 1, 1.0, 1.0),
    ],
    ids=lambda value: value.kind if isinstance(value, twin.faults.Fault) else None,
)
def test_a_fault_pushes_a_steady_glide_its_way(sound, fault, column, dive, climb):
    name, before = sound
    after = phases(scenario(name, fault))
    least = (math.nan, 0.002, 0.0002)[column]
    for sign, was, now in zip((dive, climb), before, after, strict=True):
        assert sign * (now[column] - was[column]) > least


@pytest.mark.parametrize(("side", "sign"), [("port", 1.0), ("starboard", -1.0)])
def test_a_lost_wing_rolls_it_to_its_side_in_dives_and_away_in_climbs(sound, side, sign):
    """The wing that is left lifts in dives and pushes down in climbs; the lighter side rises.

    A Sea-Wing rolls against the yaw moment of the wing's drag too, to hold its heading.
    """
    name, _ = sound
    dive, climb = (now[0] for now in phases(scenario(name, FAULTS["wing_lost"](side=side))))
    assert sign * (climb - dive) > 2.0
    if name == "slocum-200":
        assert sign * dive < -1.0 < 1.0 < sign * climb
        assert sign * (climb + dive) > 1.0


@pytest.mark.parametrize("heading", [20.0, 110.0, 200.0, 290.0])
def test_guidance_reads_the_compass_that_the_log_shows(heading):
    """Iron errs by a sine of the true heading, for guidance in radians, in the log in degrees."""
    fault = FAULTS["compass_iron"](degrees=12.0, toward=70.0)
    sine, cosine = condition_at([fault], healthy(scenario("glider", fault)), 0.0).iron
    true = math.radians(heading)
    shown = fault.readings({"measured_heading": np.array([heading])}, np.array([12.0]), 1.0, None)
    off = math.degrees(sine * math.sin(true) + cosine * math.cos(true))
    assert off == pytest.approx(12.0 * math.sin(math.radians(heading - 70.0)))
    assert shown["measured_heading"][0] - heading == pytest.approx(off)


def test_an_added_mass_is_two_bodies_turning_about_their_common_centre():
    """Inertia of two bodies about their common centre of gravity, by Steiner's theorem for each."""
    sound = healthy(scenario("glider"))
    mass, place = 3.0, np.array([0.4, -0.2, 0.1])
    vehicle = sound.with_mass(mass, place).vehicle
    bodies = [(sound.vehicle.static_mass, sound.vehicle.static_cg), (mass, place)]
    centre = sum(m * at for m, at in bodies) / sum(m for m, _ in bodies)
    np.testing.assert_allclose(vehicle.static_cg, centre, atol=1e-12)
    inertia = sound.vehicle.static_inertia.copy()
    for m, at in bodies:
        x, y, z = at - centre
        inertia += m * np.array(
            [[y * y + z * z, -x * y, -x * z], [-x * y, x * x + z * z, -y * z],
             [-x * z, -y * z, x * x + y * y]]
        )  # fmt: skip
    np.testing.assert_allclose(vehicle.static_inertia, inertia, rtol=1e-12, atol=1e-12)


def test_mujoco_turns_the_hull_by_the_products_of_inertia_of_a_fault():
    """Water below the axis at the stern: two bodies in MuJoCo's axes, forward, port and up."""
    fault = FAULTS["water_taken"](per_day=10.0, start=-0.1 * DAY, place=-0.4)
    flight = dataclasses.replace(scenario("glider", fault), engine="mujoco", duration=10.0)
    run, hull = Simulation(flight), healthy(flight).vehicle
    run.run()
    water = fault.at(0.5 * KNOT) * 1e-3 * hull.reference_density
    flip = np.diag([1.0, -1.0, -1.0])
    places = [hull.static_cg @ flip]
    places += [np.array([-0.4 * hull.hull_length, 0.0, -0.4 * hull.hull_diameter])]
    masses = np.array([hull.static_mass, water])
    centre = masses @ np.array(places) / masses.sum()
    inertia = flip @ hull.static_inertia @ flip
    for mass, place in zip(masses, places, strict=True):
        x, y, z = place - centre
        inertia += mass * np.array([[z * z, 0.0, -x * z], [0.0, x * x + z * z, 0.0],
                                    [-x * z, 0.0, x * x]])  # fmt: skip
        assert y == 0.0
    model = run.model
    body = model.body("hull").id
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes = turn.reshape(3, 3)
    found = axes @ np.diag(model.body_inertia[body]) @ axes.T
    assert abs(found[0, 2]) > 0.05
    np.testing.assert_allclose(found, inertia, rtol=1e-6, atol=1e-6)
