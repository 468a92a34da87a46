"""Each fault of the hull, pump and instruments acts in its direction: signs and bodies by hand."""

import dataclasses
import math

import gsw
import mujoco
import numpy as np
import pytest

import twin
from twin.faults import FAULTS, condition_at
from twin.faults.base import DAY, KNOT
from twin.physics.condition import electric_signals, healthy
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


@pytest.mark.parametrize(("side", "sign"), [("port", 1.0), ("starboard", -1.0), ("both", 0.0)])
def test_the_drag_of_the_wing_that_is_left_turns_it_to_that_side(side, sign):
    """The wing that is left drags beside the axis: its moment about the vertical."""
    sound = healthy(scenario("glider"))
    law = sound.vehicle.flow_frame
    now = condition_at([FAULTS["wing_lost"](side=side)], sound, 0.0).vehicle.flow_frame
    lost = (law.drag[0] - now.drag[0]) / (1 if sign else 2)
    assert lost == pytest.approx(0.1 * law.drag[0])  # the wings have a fifth of the wetted surface
    place = [0.0, sign * 0.2 * sound.vehicle.hull_length, 0.0]
    moment = np.cross(place, [-lost, 0.0, 0.0])[2]
    assert now.yaw_moment_offset[0] - law.yaw_moment_offset[0] == pytest.approx(moment)


def of(condition, axis, field):
    return getattr(condition.vehicle.steered(axis), field)


@pytest.mark.parametrize(
    ("name", "fault", "read", "change"),
    [
        # an encoder that has slipped reads 0 where the part is ahead by the size
        ("tethys", FAULTS["turn_slips"](degrees=10.0), lambda c: c.zeros.get("rudder", 0.0),
         lambda was: was + math.pi / 18.0),
        ("glider", FAULTS["pitch_slips"](travel=0.1), lambda c: c.zeros.get("shift", 0.0),
         lambda was: was + 0.1 * 0.1),  # m of a travel from -0.05 to 0.05
        # a worn pump is slower and takes more for as much
        ("glider", FAULTS["pump_weak"](loss=0.25), lambda c: of(c, "buoyancy", "rate"),
         lambda was: 0.75 * was),
        ("glider", FAULTS["pump_weak"](loss=0.25), lambda c: 1.0 / c.consumption.pump_efficiency,
         lambda was: was / 0.75),
        ("slocum-1000", FAULTS["pump_weak"](loss=0.25), lambda c: c.consumption.pump_loss,
         lambda was: was / 0.75),
        # air of 40 of 1000 cm3 needs no work at depth
        ("rogue", FAULTS["pump_air"](volume=40.0), lambda c: 1.0 / c.consumption.pump_efficiency,
         lambda was: 0.96 * was),
        ("glider", FAULTS["pack_lost"](part=0.25), lambda c: c.packs, lambda was: 0.75 * was),
        ("glider", FAULTS["hotel_raised"](watts=0.4), lambda c: c.consumption.hotel_power,
         lambda was: was + 0.4),
        ("tethys", FAULTS["blade_lost"](part=0.5), lambda c: of(c, "speed", "thrust_coefficient"),
         lambda was: 0.5 * was),
        ("glider", FAULTS["turn_stuck"](), lambda c: 1.0 + of(c, "heading", "rate"),
         lambda was: 1.0),
        # what grows is heavy, and a wing that is gone weighs and drags nothing
        ("glider", FAULTS["fouling"](per_day=1.0, start=0.5 * KNOT - DAY), lambda c: c.vehicle.mass,
         lambda was: 1.0004 * was),
        ("glider", FAULTS["wing_lost"](side="both"), lambda c: c.vehicle.mass,
         lambda was: (1.0 - 2.0 * 0.0008) * was),
        ("glider", FAULTS["wing_lost"](side="both"), lambda c: c.vehicle.flow_frame.drag[0],
         lambda was: 0.8 * was),
    ],
    ids=lambda value: value.kind if isinstance(value, twin.faults.Fault) else None,
)  # fmt: skip
def test_a_fault_changes_its_number_by_its_size(name, fault, read, change):
    sound = healthy(dataclasses.replace(scenario("glider"), vehicle=twin.load_vehicle(name)))
    was, now = read(sound), read(condition_at([fault], sound, 0.0))
    assert now == pytest.approx(change(was), rel=1e-6)
    assert now != was


@pytest.mark.parametrize(
    ("way", "toward", "apparent"),
    [((0.3, 0.0), -90.0, (0.0, -0.3)), ((0.0, 0.3), 0.0, (0.3, 0.0))],
    ids=["north", "east"],
)
def test_a_compass_that_reads_a_degree_more_seems_to_be_set_to_port(way, toward, apparent):
    """It is reckoned to go to starboard of its true way; the fix is on the true one."""
    for fault in (FAULTS["compass_iron"](toward=toward), FAULTS["compass_turned"]()):
        found = fault.expected(np.array([way]))
        current = [found[f"current_{axis}"][0] for axis in ("north", "east")]
        np.testing.assert_allclose(current, np.radians(1.0) * np.array(apparent), atol=1e-9)


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


def test_guidance_reads_the_gauge_that_the_log_shows():
    """A drift of 10 dbar is as many metres, in the log and for guidance, as TEOS-10 says."""
    fault, zero = FAULTS["pressure_drift"](per_day=10.0, start=0.5 * KNOT - DAY), np.zeros(1)
    readings = {"measured_depth": zero, "measured_pressure": zero}
    shown = fault.readings(readings, np.array([10.0]), 1.0, None)
    offset = condition_at([fault], healthy(scenario("glider")), 0.0).depth_offset
    assert shown["measured_pressure"][0] == 10.0
    assert shown["measured_depth"][0] == pytest.approx(-gsw.z_from_p(10.0, 45.0), rel=5e-3)
    assert offset == pytest.approx(shown["measured_depth"][0])


def electric(*faults):
    """Signals of batteries and hull in one flight, without noise and with batteries of the mean."""
    flight = dataclasses.replace(scenario("glider"), duration=600.0)
    run = twin.simulate(flight)
    return [electric_signals(dataclasses.replace(flight, faults=f), run) for f in ((), faults)]


def test_half_of_the_packs_give_the_same_current_through_twice_the_resistance():
    """350 milliohm of all packs: with the pump at work it sags by as much again."""
    sound, wrong = electric(FAULTS["pack_lost"](part=0.5))
    current = sound["measured_battery_current"]
    np.testing.assert_array_equal(wrong["measured_battery_current"], current)
    sags = sound["measured_voltage"] - wrong["measured_voltage"]
    np.testing.assert_allclose(sags, 0.35 * current, atol=1e-3)
    assert sags.max() > 0.1
    assert np.ptp(sound["measured_voltage"] + 0.35 * current) < 1e-3


def test_a_litre_of_water_compresses_the_air_in_the_hull():
    """Boyle's law: the air, 35 % of the hull, has a litre less room; less vacuum is left."""
    sound, wrong = electric(FAULTS["water_taken"](per_day=1.0, start=KNOT / 2.0 - DAY))
    room = 0.35 * 1e3 * twin.load_vehicle("glider").neutral_volume  # [litre]
    before, after = (101_325.0 - one["measured_vacuum"][0] for one in (sound, wrong))
    assert after / before == pytest.approx(room / (room - 1.0), rel=1e-3)
    assert wrong["measured_vacuum"][0] < sound["measured_vacuum"][0] - 3000.0


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
