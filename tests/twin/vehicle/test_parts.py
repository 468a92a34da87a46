"""Parts and hull laws: two codes of one law, figures by hand, signs, and what is refused."""

import dataclasses
import math
import re
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from physics import full_mass, glider, set_motion

from twin.errors import InputError, VehicleError
from twin.fossen import FossenModel
from twin.fossen.equations import still_acceleration
from twin.fossen.forces import displaced_mass, pumped
from twin.fossen.steady import down_axis
from twin.mission.controller import Schedule
from twin.physics.model_block import header
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation, simulate
from twin.physics.start import Ballast, Start
from twin.physics.true_signals import part_variables
from twin.vehicle import laws, parts
from twin.vehicle.consumption import Consumption
from twin.vehicle.laws import LAWS, BodyAxes
from twin.vehicle.parts import PARTS, DropWeight, Move, Part, Propeller, Quantity
from twin.vehicle.vehicle import load_vehicle, parse_vehicle

ROV = load_vehicle("bluerov2")
GLIDER = load_vehicle("glider")
TORPEDO = load_vehicle(Path(__file__).parents[2] / "vehicles" / "torpedo.xml")
WEIGHT, PLACE = 0.6, (0.2, 0.03, 0.1)
DENSITY = 1025.0


def with_weight():
    """The glider with a drop weight of 0.6 kg on its hull; `PLACE` is FRD."""
    x, y, z = PLACE
    site = f'<site name="weight" pos="{x} {-y} {-z}" size="0.01" group="3"/>'
    actuator = (
        '<general name="weight" site="weight" gear="0 0 1 0 0 0" dyntype="user" actdim="1" '
        'dynprm="0.1 10" gaintype="fixed" gainprm="0" biastype="none" ctrlrange="0 1" '
        'actearly="true" actlimited="true" actrange="0 1"/>'
    )
    kind = '<text name="weight.kind" data="drop-weight"/>'
    kind += f'<numeric name="weight.mass" data="{WEIGHT}"/>'
    text = re.sub(r"<keyframe>.*</keyframe>", "", GLIDER.xml, flags=re.DOTALL)
    for old, new in (('<site name="imu"', site), ("</actuator>", actuator), ("</custom>", kind)):
        assert old in text
        text = text.replace(old, new + old, 1)
    return parse_vehicle(text, Path("weighted.xml"))


CARRIER = with_weight()
SHIPPED = {
    "battery-slide": [GLIDER.part("shift")],
    "battery-hinge": [GLIDER.part("rotation")],
    "pump": [GLIDER.part("pump")],
    "propeller": [TORPEDO.part("propeller")],
    "fin": [
        TORPEDO.part("rudder"),
        TORPEDO.part("elevator"),
        dataclasses.replace(TORPEDO.part("elevator"), in_hull=True),
        dataclasses.replace(TORPEDO.part("rudder"), induced_drag=0.06),
    ],
    "drop-weight": [CARRIER.part("weight")],
    "thruster": [ROV.part(f"thruster_{k}") for k in (1, 4, 6)],
    "tether": [ROV.part("tether")],
}
LAW_OF = {
    "flow-frame": GLIDER.law,
    "body-axes": TORPEDO.law,
    "ellipsoid": GLIDER.with_law("ellipsoid").law,
}


def motions(count=60):
    """Random motions through the water, some backward and some at rest, shape (count, 6)."""
    rng = np.random.default_rng(4)
    nu = rng.normal(size=(count, 6)) * [1.0, 0.4, 0.4, 0.3, 0.3, 0.3]
    nu[0], nu[1, :3] = 0.0, 0.0
    return nu


# --- two codes of one law ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", PARTS)
def test_both_codes_of_a_part_agree(kind):
    rng = np.random.default_rng(5)
    for part in SHIPPED[kind]:
        values = np.array(part.values())
        place = np.array([-0.6, 0.07, 0.12])
        for nu in motions():
            position = rng.uniform(1.2 * part.low, 1.2 * part.high)
            depth = rng.choice([100.0, rng.uniform(-0.1, 0.1)])
            for effect in ("volume", "mass"):
                native, fossen = (getattr(part, f"{m}_{effect}") for m in ("native", "fossen"))
                if native is not None:
                    assert native(values, position) == pytest.approx(
                        fossen(values, position), rel=1e-9
                    )
            if part.native_wrench is not None:
                ours = part.native_wrench(values, place, position, *nu, DENSITY, depth)
                theirs = part.fossen_wrench(values, place, position, *nu, DENSITY, depth)
                np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", LAWS)
def test_both_codes_of_a_hull_law_agree(kind):
    law = LAW_OF[kind]
    assert law.kind == kind
    values, biggest = law.values(), 0.0
    for nu in motions():
        ours = law.native_wrench(values, DENSITY, *nu)
        theirs = law.wrench(nu, DENSITY)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
        biggest = max(biggest, np.abs(theirs).max())
    assert biggest > 1.0


def test_the_rate_damping_of_derivatives_is_their_slope():
    law, step = TORPEDO.law, 1e-6
    for nu in motions(20)[2:]:
        found = law.native_rate_damping(law.values(), 0.1, DENSITY, *nu)
        for axis in (3, 4, 5):
            more, less = nu.copy(), nu.copy()
            more[axis] += step
            less[axis] -= step
            slope = (law.wrench(more, DENSITY) - law.wrench(less, DENSITY))[axis] / (2 * step)
            assert found[axis - 3] == pytest.approx(0.1 * slope, rel=1e-5, abs=1e-6)


# --- half kinds -------------------------------------------------------------------------------


QUANTITY = Quantity(unit="1", scale=1.0, long_name="setting")
HALF_PARTS = {
    "`fossen_wrench`": {"unit": "1", "quantity": QUANTITY, "native_wrench": lambda: None},
    "`native_mass`": {"unit": "1", "quantity": QUANTITY, "fossen_mass": lambda: None},
    "`unit`": {"quantity": QUANTITY},
    "`quantity`": {"unit": "1"},
}


@pytest.mark.parametrize("lacking", HALF_PARTS)
def test_half_a_part_is_refused(lacking):
    half = type("Half", (Part,), {"kind": "half", **HALF_PARTS[lacking]})
    with pytest.raises(VehicleError, match=f"'half' is only half there: it lacks {lacking}"):
        parts.register(half)
    assert "half" not in PARTS


@pytest.mark.parametrize("kernel", ["native_wrench", "native_rate_damping", "fossen_wrench"])
def test_half_a_hull_law_is_refused(kernel):
    half = type("Half", (BodyAxes,), {"kind": "half", kernel: None})
    with pytest.raises(VehicleError, match=f"'half' is only half there: it lacks `{kernel}`"):
        laws.register(half)
    with pytest.raises(VehicleError, match=r"a class derived from twin\.vehicle\.laws\.HullLaw"):
        laws.register(type("Stranger", (), {"kind": "stranger"}))
    assert "half" not in LAWS


# --- reading ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="propeller.diameter"', 'name="propeller.diametre"', "propeller.diameter"),
        ('name="propeller.diameter" data="0.14"', 'name="propeller.diameter" data="-1"',
         "propeller: diameter must be positive"),
        ('data="propeller"', 'data="propellor"', "propeller.kind.*'propellor'.*'propeller'"),
        ('<text name="rudder.kind" data="fin"/>', "", r"actuator 'rudder' must be of a kind"),
        ('name="rudder.area"', 'name="rudder.aera"', "rudder.area"),
        ('"rudder.axis" data="0 0 1"', '"rudder.axis" data="1 0 0"', "rudder: axis must be across"),
        ('"rudder.axis" data="0 0 1"', '"rudder.axis" data="0 0 0"', "rudder.axis"),
        ('<site name="rudder"', '<site name="ruder"', "rudder"),
        ('<general name="rudder" site="rudder" gear="0 0 1 0 0 0" dyntype="user"',
         '<general name="rudder" site="rudder" gear="0 0 1 0 0 0" dyntype="integrator"',
         "actuator 'rudder' .fin. must be one with one activation"),
        ('<text name="hull_law"', '<text name="steer.pitch" data="rudder"/><text name="hull_law"',
         "steer.pitch.*'rudder'.*elevator"),
        ('name="Xuu" data="-2.3"', 'name="Xuu" data="2.3"', "Xuu must be at most 0: drag never"),
        ('name="Yuv"', 'name="Yvu" data="1"/><numeric name="Yuv"', "one derivative: .*product"),
        ('data="body-axes"', 'data="body-axis"', "'body-axis'.*did you mean 'body-axes'"),
    ],
)  # fmt: skip
def test_a_wrong_element_is_named(old, new, message):
    assert old in TORPEDO.xml
    with pytest.raises(VehicleError, match=message):
        parse_vehicle(TORPEDO.xml.replace(old, new, 1), TORPEDO.path)


def test_derivatives_have_the_names_of_their_axes_and_velocities():
    law = BodyAxes(derivatives=(("Xvv", 2.0), ("Yuv", -3.0), ("Nr", -0.5), ("Mqq", -4.0)))
    found = law.wrench(np.array([1.5, -2.0, 0.0, 0.0, -0.1, 0.2]), DENSITY)
    # in X the square of a velocity across the hull, else a drag that is odd
    np.testing.assert_allclose(found, [8.0, 9.0, 0.0, 0.0, 0.04, -0.1], atol=1e-12)
    with pytest.raises(VehicleError, match="'Xuz'"):
        BodyAxes(derivatives=(("Xuz", 1.0),)).values()


# --- figures and signs ------------------------------------------------------------------------


def test_thrust_falls_linearly_to_zero_at_its_advance():
    screw: Propeller = TORPEDO.part("propeller")
    still = 1025.0 * 0.14**4 * 0.0045 * 100.0**2
    assert screw.thrust(100.0, 0.0, DENSITY) == pytest.approx(still, rel=1e-12)
    zero = 0.16 * 100.0 * 0.14  # [m/s]
    assert screw.thrust(100.0, zero, DENSITY) == pytest.approx(0.0, abs=1e-9)
    assert screw.thrust(100.0, zero / 2, DENSITY) == pytest.approx(still / 2, rel=1e-12)
    assert screw.thrust(-100.0, 0.0, DENSITY) == pytest.approx(-still, rel=1e-12)
    values, place = np.array(screw.values()), np.array([-0.8, 0.1, 0.2])
    x, y, z, k, m, n = screw.native_wrench(values, place, 100.0, *np.zeros(6), DENSITY, 50.0)
    assert (y, z) == (0.0, 0.0)
    assert k == pytest.approx(-1025.0 * 0.14**5 * 0.0002 * 100.0**2)
    assert (m, n) == pytest.approx((0.2 * x, -0.1 * x))
    half_wet = screw.native_wrench(values, place, 100.0, *np.zeros(6), DENSITY, 0.0)
    assert half_wet[0] == pytest.approx(still / 2)


def fin_wrench(name, deflection, speed=1.5, **changes):
    fin = dataclasses.replace(TORPEDO.part(name), **changes)
    values, place = np.array(fin.values()), np.array(fin.position)
    return np.array(
        fin.native_wrench(values, place, deflection, speed, 0, 0, 0, 0, 0, DENSITY, 1e3)
    )


@pytest.mark.parametrize(
    ("deflection", "lift", "drag"),
    [
        (0.1, 3.1 * 0.1, 0.02 + 0.2 * 0.1),
        (0.4, 3.1 * 0.4, 0.02 + 0.2 * 0.4),
        (0.6, 3.1 * 0.4 - 1.0 * 0.2, 0.02 + 0.2 * 0.4 + 0.8 * 0.2),
    ],
    ids=["attached", "at the stall", "stalled"],
)
def test_a_fin_has_the_lift_and_drag_of_its_angle_of_attack(deflection, lift, drag):
    pressure = 0.5 * DENSITY * 0.03 * 1.5**2
    for sign in (1.0, -1.0):
        x, y, z, *_ = fin_wrench("elevator", sign * deflection)
        assert (x, y, z) == pytest.approx((-drag * pressure, 0.0, sign * lift * pressure))


def test_lift_of_a_finite_span_costs_drag():
    """C_L^2 / (pi e AR) beside the rest, and none where the stalled fin has lost its lift."""
    pressure = 0.5 * DENSITY * 0.03 * 1.5**2
    more = {"induced_drag": 0.06}
    found = fin_wrench("elevator", 0.1, **more) - fin_wrench("elevator", 0.1)
    assert found[:3] == pytest.approx([-0.06 * 0.31**2 * pressure, 0.0, 0.0])
    stalled = {"stalled_lift_slope": -3.0}
    np.testing.assert_allclose(
        fin_wrench("elevator", 1.5, **more, **stalled), fin_wrench("elevator", 1.5, **stalled)
    )


def test_a_left_handed_screw_rolls_to_starboard_and_takes_as_much():
    right: Propeller = TORPEDO.part("propeller")
    left = dataclasses.replace(right, torque_coefficient=-right.torque_coefficient)
    rolls = [p.wrench(100.0, np.zeros(6), DENSITY, 50.0)[3] for p in (right, left)]
    assert rolls[0] < 0.0
    assert rolls[1] == -rolls[0]
    turn = Move(100.0, 100.0, depth=0.0, pitch=0.0, duration=1.0)
    taken = [p.energy(TORPEDO, turn, Consumption()) for p in (right, left)]
    assert taken[0] == taken[1] > 0.0


DIAGRAM = {
    "diameter": 0.14, "thrust_coefficient": 0.00345, "zero_thrust_advance": 0.078,
    "standing_drag": 0.093, "torque_coefficient": 0.000258, "zero_torque_advance": 0.105,
    "standing_torque": 0.0021,
}  # fmt: skip


def screw_of(**changes: float) -> Propeller:
    return dataclasses.replace(TORPEDO.part("propeller"), **{**DIAGRAM, **changes})


def both_codes(screw: Propeller, rate: float, speed: float) -> np.ndarray:
    motion = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = screw.wrench(rate, motion, DENSITY, 50.0)
    values, place = np.array(screw.values()), np.array(screw.position)
    native = type(screw).native_wrench(values, place, rate, *motion, DENSITY, 50.0)
    np.testing.assert_allclose(native, found, rtol=1e-12, atol=1e-12)
    return found


def test_an_open_water_diagram_has_its_zeros_and_all_quadrants():
    screw = screw_of()
    for rate in (100.0, -100.0):
        free = 0.078 * rate * 0.14
        assert both_codes(screw, rate, free)[0] == pytest.approx(0.0, abs=1e-9)
        assert both_codes(screw, rate, 0.105 * rate * 0.14)[3] == pytest.approx(0.0, abs=1e-9)
        assert both_codes(screw, rate, 0.9 * free)[0] * rate > 0.0  # drives
        assert both_codes(screw, rate, 1.1 * free)[0] * rate < 0.0  # brakes
        assert both_codes(screw, rate, -free)[0] * rate > 0.0  # crash stop
    for speed in (1.0, -1.0):  # a screw that stands still is a drag
        drag = both_codes(screw, 0.0, speed)[0]
        assert drag == pytest.approx(-speed * DENSITY * 0.14**2 * 0.093)


def test_a_screw_takes_more_power_than_it_gives_and_windmills_for_nothing():
    screw = screw_of()
    assert screw.power_given < 0.0
    for rate in (30.0, 100.0, -100.0):
        for speed in np.linspace(-4.0, 4.0, 41):
            wrench = both_codes(screw, rate, float(speed))
            useful, shaft = wrench[0] * speed, -wrench[3] * rate
            assert useful <= shaft + 1e-9
            turn = Move(rate, rate, depth=0.0, pitch=0.0, duration=1.0, speed=speed)
            taken = screw.energy(TORPEDO, turn, Consumption(propeller_efficiency=1.0))
            assert taken == pytest.approx(max(shaft, 0.0), rel=1e-9, abs=1e-9)


def test_a_screw_that_speeds_up_takes_as_much_as_one_that_slows_down():
    """Neither end of a move stands for all of it: the energy lies between those of both rates."""
    moves = [Move(*ends, 0.0, 0.0, 1.0) for ends in ((60, 60), (60, 140), (140, 60), (140, 140))]
    slow, up, down, fast = (screw_of().energy(TORPEDO, one, Consumption()) for one in moves)
    assert slow < up == down < fast


def test_a_diagram_that_gives_energy_is_refused():
    with pytest.raises(VehicleError, match="no more power leaves the water"):
        dataclasses.replace(TORPEDO, parts=(screw_of(zero_torque_advance=0.07),), steering={})


def test_lift_of_a_stalled_fin_vanishes_and_does_not_turn_round():
    x, _, z, *_ = fin_wrench("elevator", 1.5, stalled_lift_slope=-3.0)
    assert z == pytest.approx(0.0, abs=1e-9)
    assert x < 0.0


def test_an_elevator_raises_the_nose_and_a_rudder_turns_to_starboard():
    """Turned about +y (port) the leading edge goes down, the stern with it and the nose up.

    A rudder turned about +z (up) has its leading edge to port: the stern goes there.
    """
    _, _, z, _, m, _ = fin_wrench("elevator", 0.1)
    assert z > 0.0
    assert m == pytest.approx(0.7 * z)
    assert TORPEDO.part("elevator").sense("pitch") == 1.0
    assert TORPEDO.part("elevator").controls() == ("pitch",)
    _, y, _, _, _, n = fin_wrench("rudder", 0.1)
    assert y < 0.0
    assert n == pytest.approx(-0.7 * y)
    assert TORPEDO.part("rudder").sense("heading") == 1.0
    assert TORPEDO.part("rudder").controls() == ("heading",)
    ahead = dataclasses.replace(TORPEDO.part("elevator"), position=(0.5, 0.0, 0.0))
    assert ahead.sense("pitch") == -1.0


def test_a_fin_in_the_hulls_law_adds_its_deflection_only():
    np.testing.assert_array_equal(fin_wrench("rudder", 0.0, in_hull=True), np.zeros(6))
    deflected, rest = fin_wrench("rudder", 0.2), fin_wrench("rudder", 0.0)
    np.testing.assert_allclose(
        fin_wrench("rudder", 0.2, in_hull=True), deflected - rest, atol=1e-12
    )


def pushed(vehicle, position, **motion):
    """Force and torque of the water on the hull (6,), hull in the attitude of `motion`."""
    model, data = glider(vehicle=vehicle)
    set_motion(data, **motion)
    data.act[vehicle.part_names.index("pump")] = position
    mujoco.mj_forward(model, data)
    return data.xfrc_applied[model.body("hull").id].copy()


def test_a_pump_off_the_centre_turns_the_hull():
    """200 cm3 half a metre ahead lift the nose with their buoyancy, in both models."""
    place, volume = (0.5, 0.02, 0.0), 200.0
    ahead = GLIDER.replace(pump={"position": place})
    lift = 1025.0 * volume * 1e-6 * 9.81
    change = pushed(ahead, volume) - pushed(GLIDER, volume)
    np.testing.assert_allclose(change[:3], 0.0, atol=1e-9)
    # NED: pitch up is a positive torque about east; MuJoCo's y axis points west
    assert change[4] == pytest.approx(-0.5 * lift, rel=1e-9)
    assert change[3] == pytest.approx(-0.02 * lift, rel=1e-9)
    p, q = FossenModel(ahead).parameters, FossenModel(GLIDER).parameters
    for roll, pitch in ((0.0, 0.0), (0.4, -0.6)):
        arguments = (down_axis(roll, pitch), 1000.0, np.zeros(6), np.array([0.0, 0.0, volume]))
        rates = []
        for parameters in (p, q):
            displaced = displaced_mass(parameters, 1000.0, pumped(parameters, arguments[3])[0])
            rates.append(still_acceleration(parameters, *arguments, displaced))
        ours = []
        for vehicle in (ahead, GLIDER):
            model, data = glider(vehicle=vehicle)
            set_motion(data, roll=roll, pitch=pitch)
            data.act[2] = volume
            mujoco.mj_forward(model, data)
            # the battery is held: it moves with the hull
            mass = full_mass(model, data)[:6, :6]
            ours.append(np.linalg.solve(mass, data.qfrc_smooth[:6]))
        turning = (ours[0] - ours[1])[3:] * [1.0, -1.0, -1.0]
        assert np.abs(turning).max() > 1e-3
        np.testing.assert_allclose(turning, (rates[0] - rates[1])[3:], rtol=1e-9, atol=1e-12)


# --- the drop weight --------------------------------------------------------------------------


def lightened():
    """The carrier whose hull never had the weight: mass, CG and inertia by hand."""
    r, m = np.array(PLACE), CARRIER.static_mass
    left = m - WEIGHT
    cg = (m * CARRIER.static_cg - WEIGHT * r) / left

    def about(mass, place):
        return mass * (place @ place * np.eye(3) - np.outer(place, place))

    inertia = CARRIER.static_inertia + about(m, CARRIER.static_cg) - about(WEIGHT, r)
    return CARRIER.replace(static_mass=left, static_cg=cg, static_inertia=inertia - about(left, cg))


def test_a_dropped_weight_leaves_the_vehicle_without_it():
    """Mass matrix and accelerations of both models, at random motions."""
    without, rng = lightened(), np.random.default_rng(6)
    pairs = [(*glider(vehicle=CARRIER), 0.0), (*glider(vehicle=without), 1.0)]
    header(pairs[1][0])["neutral_volume"] = CARRIER.neutral_volume
    dropped, never = FossenModel(CARRIER).parameters, FossenModel(without).parameters
    for nu in motions(10):
        roll, pitch, heading = rng.uniform(-1, 1, 3)
        positions = [rng.uniform(-0.05, 0.05), rng.uniform(-1, 1), rng.uniform(-300, 300)]
        found = []
        for model, data, held in pairs:
            set_motion(data, roll=roll, pitch=pitch, heading=heading, velocity=nu[:3], rates=nu[3:])
            data.qpos[7:9] = positions[:2]
            data.act[:] = data.ctrl[:] = [*positions, held]
            mujoco.mj_forward(model, data)
            found.append((full_mass(model, data), data.qacc.copy()))
        np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-8, atol=1e-8)
        displaced = displaced_mass(dropped, 500.0, positions[2])
        down = down_axis(roll, pitch)
        theirs = [
            still_acceleration(p, down, 500.0, nu, np.array([*positions, held]), displaced)
            for p, held in ((dropped, 0.0), (never, 1.0))
        ]
        np.testing.assert_allclose(*theirs, rtol=1e-9, atol=1e-12)


def test_a_dropped_weight_is_gone_for_good_and_the_vehicle_flies_as_without_it():
    steady = (0.01, 0.2, GLIDER.pump_for_net_mass(0.3))
    start = {"depth": 200.0, "pitch": -0.2, "v_rel": (0.3, 0.0, 0.0)}
    flights = []
    for vehicle, held, ballast in (
        (CARRIER, 0.0, None),
        (lightened(), 1.0, Ballast(depth=0.0, heavy=-WEIGHT)),
    ):
        plan = Schedule(times=[0.0, 10.0], commands=[(*steady, held), (*steady, 1.0)])
        scenario = Scenario(
            vehicle=vehicle, mission=plan, duration=60.0, ballast=ballast,
            start=Start(**start, actuators={"weight": held}),
        )  # fmt: skip
        flights.append(simulate(scenario))
    gone, never = flights
    np.testing.assert_array_equal(gone.states[:, 20], 0.0)  # asked for again, it stays gone
    # only the half step before the start differs, which the ballast does not reach
    np.testing.assert_allclose(gone.position, never.position, atol=1e-2)
    np.testing.assert_allclose(gone["true_net_mass"], never["true_net_mass"], atol=1e-9)
    assert gone["true_depth"][-1] < 198.0  # 0.3 kg heavy with it, 0.3 kg light without


def test_a_weight_has_weight_and_a_travel_of_one():
    weight: DropWeight = CARRIER.part("weight")
    assert weight.rest == 1.0
    for change, message in (({"mass": 0.0}, "weight: mass"), ({"high": 2.0}, "weight: actrange")):
        with pytest.raises(VehicleError, match=message):
            CARRIER.replace(weight=change)


# --- scenarios and copies ---------------------------------------------------------------------


def test_an_encoders_zero_acts_on_parts_without_a_joint():
    """20 cm3 more than the pump's encoder says: lighter by their water, and nobody knows."""
    plan = Schedule(times=[0.0], commands=[(0.01, 0.0, -200.0)])
    fields = {"mission": plan, "duration": 30.0, "start": Start(depth=200.0)}
    exact = simulate(Scenario(vehicle=GLIDER, **fields))
    off = simulate(Scenario(vehicle=GLIDER, encoder_zeros={"pump": 20.0}, **fields))
    np.testing.assert_array_equal(off["true_pump"], exact["true_pump"])
    lighter = off["true_net_mass"] - exact["true_net_mass"]
    np.testing.assert_allclose(lighter, -20e-6 * 1025.0, rtol=1e-6)
    with pytest.raises(VehicleError, match="'pmup': did you mean 'pump'"):
        Scenario(vehicle=GLIDER, encoder_zeros={"pmup": 20.0}, **fields)
    with pytest.raises(InputError, match="must be finite"):
        Scenario(vehicle=GLIDER, encoder_zeros={"pump": math.nan}, **fields)


def test_a_rudders_zero_turns_the_vehicle():
    plan = Schedule(times=[0.0], commands=[(80.0, 0.0, 0.0)])
    fields = {"mission": plan, "duration": 20.0, "start": Start(depth=50.0, v_rel=(1.2, 0.0, 0.0))}
    straight, off = (
        Simulation(Scenario(vehicle=TORPEDO, encoder_zeros=zeros, **fields)).run()
        for zeros in ({}, {"rudder": 0.05})
    )
    assert abs(straight["true_heading"][-1]) < 5.0 or straight["true_heading"][-1] > 355.0
    assert off["true_yaw_rate"][-1] > straight["true_yaw_rate"][-1] + 0.02


def test_replace_finds_where_a_field_belongs():
    place = np.array([-0.08, 0.001, 0.003])
    changed = GLIDER.replace(
        gravity=9.8, drag=(7.0, 380.0), battery={"mass": 12.0}, pump={"lag": 5.0}, static_cg=place
    )
    assert changed.gravity == 9.8
    assert changed.flow_frame.drag == (7.0, 380.0)
    assert changed.battery.mass == 12.0
    assert changed.part("pump").lag == 5.0
    np.testing.assert_array_equal(changed.actuator_lag, [2.0, 2.0, 5.0])
    assert set(changed.changes()) == {"gravity", "drag", "battery", "pump", "static_cg"}
    assert GLIDER.part("pump").lag == 4.0
    again = GLIDER.with_changes(changed.changes())
    assert again.changes() == changed.changes()
    assert again.flow_frame.drag == (7.0, 380.0)
    np.testing.assert_array_equal(again.static_cg, place)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dragg": (1.0, 2.0)}, "'dragg': did you mean 'drag'"),
        ({"pump": {"lagg": 1.0}}, "field of 'pump' 'lagg': did you mean 'lag'"),
        ({"battery": {"weight": 1.0}}, "field of 'battery' 'weight'"),
        ({"actuator_lag": np.ones(3)}, "'actuator_lag'"),
        ({"pump": {"lag": -1.0}}, "pump: lag .dynprm. must be positive"),
    ],
)
def test_replace_names_what_is_not_there(change, message):
    with pytest.raises(VehicleError, match=message):
        GLIDER.replace(**change)


def test_what_needs_a_glider_says_so_of_a_torpedo():
    with pytest.raises(VehicleError, match=r"has 0 moving masses \(none\)"):
        TORPEDO.replace(battery={"mass": 1.0})
    with pytest.raises(VehicleError, match=r"hull law 'body-axes'.*'flow-frame'"):
        _ = TORPEDO.flow_frame
    with pytest.raises(VehicleError, match="has no pump"):
        TORPEDO.pump_for_net_mass(0.1)


def test_a_part_whose_own_fields_never_reach_its_kernels_is_refused():
    class Silent(parts.Pump):
        kind = "silent"
        values = Part.values

    with pytest.raises(VehicleError, match=r"only half there: it lacks `values`: by it neutral"):
        PARTS.add(Silent)


@pytest.mark.parametrize(
    ("unit", "limits", "known"),
    [("m", None, True), ("furlong", (0.0, 8.0), True), ("furlong", None, False)],
)
def test_a_quantity_needs_limits_where_its_unit_has_none(unit, limits, known):
    quantity = Quantity(unit=unit, scale=1.0, long_name="way", limits=limits)
    part = SimpleNamespace(name="probe", kind="probe", quantity=quantity)
    vehicle = SimpleNamespace(name="one", path=Path("one.xml"), parts=(part,))
    if known:
        assert part_variables(vehicle)["true_probe"].limits == limits
    else:
        with pytest.raises(VehicleError, match="'furlong' and no `limits`"):
            part_variables(vehicle)
