"""Lanes against the scalar Fossen model, against MuJoCo, and against limits that must hold."""

import dataclasses
import hashlib
import itertools
import math

import numba
import numpy as np
import pytest
import xarray as xr
from numba import types
from physics import fossen_state
from scipy.spatial.transform import Rotation

import twin
from twin.checks import agreement
from twin.errors import FloorError, InaccurateStep, InputError, SimulationUnstable, StepTooLong
from twin.fossen import FossenModel, lanes
from twin.fossen.equations import mass_distribution
from twin.fossen.lane_block import LANES
from twin.fossen.structure import Arithmetic
from twin.mission.controller import FollowedPositions, Schedule
from twin.physics.lanes import Aground, Lane, flown_abreast, fly_in_lanes
from twin.physics.stiffness import file_timestep
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.grid import Grid
from twin.water.current.profile import Profile
from twin.water.density import DensityProfile
from twin.water.floor.base import GridFloor

STRAIGHT = Schedule(times=[0.0], commands=[(0.02, 0.0, -200.0)])


def scenario(**changes):
    given = {
        "vehicle": load_vehicle("glider"),
        "mission": STRAIGHT,
        "duration": 120.0,
        "start": {"depth": 100.0, "pitch": -0.4, "v_rel": (0.35, 0.0, 0.01)},
        "engine": "lanes",
    }
    return twin.Scenario(**(given | changes))


def digest(trajectory):
    found = hashlib.sha256(np.ascontiguousarray(trajectory.states).tobytes())
    for name in sorted(trajectory.signals):
        found.update(np.ascontiguousarray(trajectory[name]).tobytes())
    return found.hexdigest()


def fossen_of(vehicle, manoeuvre, duration, dt):
    water = twin.Scenario(vehicle=vehicle, mission=manoeuvre.schedule, duration=duration).density
    model = FossenModel(
        vehicle,
        current_program=manoeuvre.current.compile(duration),
        density=None if water is None else (water.depth, water.values),
    )
    at = tuple(manoeuvre.start.positions(vehicle.part_names, vehicle.rest))
    state = fossen_state(dataclasses.replace(manoeuvre.start, actuators=at))
    return model.simulate(state, manoeuvre.schedule, duration, dt=dt)


def in_lanes(vehicle, manoeuvre, duration, **changes):
    given = scenario(
        vehicle=vehicle, mission=manoeuvre.schedule, duration=duration, start=manoeuvre.start,
        current=manoeuvre.current, **changes,
    )  # fmt: skip
    return twin.simulate(given)


@pytest.mark.parametrize("name", vehicle_names())
def test_every_shipped_vehicle_flies_as_the_scalar_model_does(name):
    """At its own step, through random commands in a sheared current that changes in time."""
    vehicle, duration = load_vehicle(name), 150.0
    manoeuvre = agreement.draw_manoeuvre(vehicle, 5, duration)
    reference = fossen_of(vehicle, manoeuvre, duration, min(0.025, file_timestep(vehicle) / 2.0))
    found = agreement.compare(in_lanes(vehicle, manoeuvre, duration), reference, 5)
    assert found.speed_m_s < 3e-4
    assert found.attitude_deg < 0.3
    assert found.position_percent < 0.1


@pytest.fixture(scope="module")
def across(tmp_path_factory):
    """A current that grows to the north and to the east, by 0.02 m/s a metre, at every depth."""
    north = np.array([-400.0, 0.0, 400.0])
    degree = 111_194.9
    grown = 0.02 * north
    shape = (1, 2, len(north), len(north))
    axes = ("time", "depth", "latitude", "longitude")
    data = xr.Dataset(
        {name: (axes, np.empty(shape)) for name in ("vo", "uo")},
        {
            "time": np.array(["2000-01-01"], "datetime64[ns]"),
            "depth": [0.0, 2000.0],
            "latitude": north / degree,
            "longitude": north / degree,
        },
    )
    data["vo"][:], data["uo"][:] = grown[:, None], grown
    for name in data.data_vars:
        data[name].attrs["units"] = "m s-1"
    path = tmp_path_factory.mktemp("across") / "across.nc"
    data.to_netcdf(path)
    return Grid(path=str(path), latitude_deg=0.0, longitude_deg=0.0, time="2000-01-01")


DEEP = Profile(depth=(0.0, 2000.0), north=(0.0, 4.0), east=(1.0, 0.0))


@pytest.mark.parametrize("current", ["deep", "across"])
def test_the_step_has_order_two(current, across):
    """In currents that are linear in space, and with the rotary damping solved for."""
    vehicle = load_vehicle("glider")
    manoeuvre = agreement.draw_manoeuvre(vehicle, 1, 100.0)
    shear = DEEP if current == "deep" else across
    manoeuvre = dataclasses.replace(manoeuvre, current=shear)
    reference = fossen_of(vehicle, manoeuvre, 100.0, 0.005)
    errors = []
    for step in (0.1, 0.05, 0.025):
        flown = in_lanes(vehicle, manoeuvre, 100.0, timestep=step)
        off = flown.v_rel - reference.v_rel, flown.position - reference.position_ned
        errors.append([float(np.abs(one).max()) for one in off])
    ratios = np.array([np.divide(a, b) for a, b in itertools.pairwise(errors)])
    assert ((ratios > 3.3) & (ratios < 4.8)).all(), (errors, ratios)


def test_a_long_step_is_stable_where_the_damping_of_rates_is_stiff():
    """Twenty times the published damping: an explicit step of 0.02 s would be unstable."""
    vehicle = load_vehicle("glider")
    factors = dict.fromkeys(("k_p", "k_q", "k_r"), 20.0)
    stiff = vehicle.replace(law=vehicle.flow_frame.scaled(factors))
    given = scenario(vehicle=stiff, duration=600.0, sample_period=1.0)
    with pytest.warns(InaccurateStep, match="is too long at"):
        slow = twin.simulate(dataclasses.replace(given, timestep=0.125))
    fine = twin.simulate(dataclasses.replace(given, timestep=0.02))
    assert np.abs(slow.v_rel - fine.v_rel)[-200:].max() < 1e-3


@pytest.mark.parametrize("name", ["glider", "slocum-200", "seaglider", "spray"])
@pytest.mark.parametrize("step", [None, 0.25])
def test_what_floats_comes_to_rest(name, step):
    """Heave and pitch on the water swing by 4 1/s almost without damping: a step must not swing
    them up, as Adams and Bashforth's formula alone does by 5 % a second at 0.1 s."""
    vehicle = load_vehicle(name)
    afloat = vehicle.rest
    afloat[vehicle.steered_index("buoyancy")] = vehicle.steered("buoyancy").high
    mission = Schedule(times=[0.0], commands=[tuple(afloat.tolist())])
    given = scenario(
        vehicle=vehicle, mission=mission, duration=900.0, start={"depth": 0.1}, timestep=step,
        sample_period=1.0,
    )  # fmt: skip
    flown = twin.simulate(given)
    assert 0.9 < flown["true_immersion"][-1] < 1.0
    assert flown["true_heave"][-300:].std() < 1e-3
    assert flown["true_pitch"][-300:].std() < 0.01


def test_a_step_that_is_too_long_is_told_before_the_flight():
    rogue = scenario(vehicle=load_vehicle("rogue"), mission=None, sample_period=1.0)
    rest = Schedule(times=[0.0], commands=[tuple(rogue.vehicle.rest.tolist())])
    rogue = dataclasses.replace(rogue, mission=rest, timestep=0.5)
    said = r"timestep 0\.5 s is too long at 0\.35 m/s.* unstable; take at most"
    with pytest.raises(StepTooLong, match=said):
        twin.simulate(rogue)
    with pytest.raises(StepTooLong, match=r"take at most 0\.1 s"):
        twin.simulate(dataclasses.replace(rogue, timestep=0.2))  # it was off by 0.8 m/s
    with pytest.warns(InaccurateStep, match=r"take at most 0\.1 s"):
        twin.simulate(dataclasses.replace(rogue, timestep=0.14, sample_period=0.7))
    alone, refused = twin.simulate_many([fleet(1)[0], rogue])
    assert isinstance(refused, StepTooLong)
    assert digest(alone) == digest(twin.simulate(fleet(1)[0]))


def test_a_neutral_hull_at_rest_stays():
    vehicle = load_vehicle("glider")
    density = DensityProfile.constant(1025.0)
    _, moment, _ = mass_distribution(FossenModel(vehicle).parameters, np.array(vehicle.rest))
    start = {"depth": 50.0, "pitch": -math.atan2(moment[0], moment[2])}
    rest = Schedule(times=[0.0], commands=[tuple(vehicle.rest)])
    flown = twin.simulate(scenario(mission=rest, start=start, density=density, duration=60.0))
    assert np.abs(flown.v_rel).max() < 1e-9
    assert np.abs(flown["true_depth"] - 50.0).max() < 1e-9


def test_a_steady_glide_is_the_trim():
    vehicle = load_vehicle("glider")
    motion = FossenModel(vehicle).steady_motion(shift=0.02, net_mass=0.2)
    pump = vehicle.pump_for_net_mass(0.2)
    plan = Schedule(times=[0.0], commands=[(0.02, 0.0, pump)])
    water = DensityProfile.constant(1025.0)
    flown = twin.simulate(scenario(mission=plan, density=water, duration=1500.0))
    np.testing.assert_allclose(flown.v_rel[-1], motion.nu_r[:3], atol=1e-6)


def test_the_specific_force_is_that_of_the_motion():
    """Turned to the Earth and with gravity it is the slope of the velocity over ground, where the
    current that the hull moves through has the largest part in it."""
    shear = Profile(depth=(0.0, 200.0), north=(0.0, 8.0), east=(2.0, 0.0))
    vehicle = load_vehicle("glider").replace(imu_position=(0.0, 0.0, 0.0))
    given = scenario(vehicle=vehicle, current=shear, sample_period=0.1, duration=60.0)
    flown = twin.simulate(given)
    velocity = np.stack([flown[f"true_velocity_{axis}"] for axis in ("north", "east", "down")], -1)
    rate = np.gradient(velocity, 0.1, axis=0)
    force = np.stack([flown[f"true_specific_force_{axis}"] for axis in "xyz"], -1)
    angles = np.stack([flown[f"true_{name}"] for name in ("heading", "pitch", "roll")], -1)
    felt = Rotation.from_euler("ZYX", angles, degrees=True).apply(force)
    felt[:, 2] += vehicle.gravity
    steady = slice(200, -1)
    np.testing.assert_allclose(felt[steady], rate[steady], atol=2e-4)
    assert np.abs(rate[steady, 0]).max() > 2e-3


def test_the_log_is_that_of_mujoco_row_for_row():
    given = twin.Scenario(mission=twin.load_mission("default"), duration=900.0)
    ours = twin.simulate(given)
    theirs = twin.simulate(dataclasses.replace(given, engine="lanes"))
    assert list(ours.signals) == list(theirs.signals)
    assert ours.state_columns == theirs.state_columns
    assert ours.provenance["ended"] == theirs.provenance["ended"] == "duration"
    np.testing.assert_array_equal(ours.time, theirs.time)
    assert np.abs(ours["true_depth"] - theirs["true_depth"]).max() < 0.1
    for name in ("commanded_segment", "commanded_pitch", "commanded_pump"):
        changed = np.mean(ours[name] != theirs[name])
        assert changed < 0.01, name  # a turn may fall on the next control tick


def test_a_mission_without_a_duration_ends_when_it_is_flown():
    yo = twin.Mission.from_dict(
        {"segments": [{"kind": "saw-tooth", "min_depth_m": 5, "max_depth_m": 30, "yos": 1},
                      {"kind": "surface", "duration_s": 60}]}
    )  # fmt: skip
    given = twin.Scenario(mission=yo)
    ours, theirs = twin.simulate(given), twin.simulate(dataclasses.replace(given, engine="lanes"))
    assert ours.provenance["ended"] == theirs.provenance["ended"] == "flown"
    assert abs(ours.time[-1] - theirs.time[-1]) <= 30.0


def fleet(count):
    depths = np.linspace(60.0, 140.0, count)
    return [
        scenario(
            start={"depth": float(depth), "pitch": -0.4, "v_rel": (0.35, 0.0, 0.01)},
            current=Profile(depth=(0.0, 200.0), north=(0.3, 0.0), east=(0.0, 0.1)),
            duration=60.0 + k % 3,
        )
        for k, depth in enumerate(depths)
    ]


def test_parts_move_by_vector_code():
    given = (types.float64[::1], types.int64, types.int64, types.float64)
    compiled = numba.njit(error_model="numpy")(lanes._move_parts.py_func)
    compiled.compile(given)
    arithmetic = Arithmetic.of_text(compiled.inspect_llvm(given))
    # of the lanes that fill no vector, the text has the same a second time
    assert arithmetic.packed >= arithmetic.scalar


def test_a_hull_at_the_surface_changes_no_deep_one():
    deep = scenario(duration=20.0)
    awash = scenario(duration=20.0, start={"depth": 0.2, "pitch": 0.3})
    alone = fly_in_lanes([deep])[0]
    for others in (1, 7):  # by one, and all at once
        beside = fly_in_lanes([*[awash] * others, *[deep] * (8 - others)])
        assert {digest(run) for run in beside[others:]} == {digest(alone)}
        assert beside[0]["true_immersion"].min() < 1.0 == alone["true_immersion"].min()
        floating = digest(beside[0])
    assert digest(fly_in_lanes([awash])[0]) == floating


def test_neither_width_nor_threads_nor_neighbours_change_a_bit():
    scenarios = fleet(LANES[-1] + 3)
    together = [digest(t) for t in fly_in_lanes(scenarios, threads=1)]
    assert together == [digest(t) for t in fly_in_lanes(scenarios, threads=2)]
    for k in (0, 17, len(scenarios) - 1):
        assert digest(twin.simulate(scenarios[k])) == together[k]
    few = fly_in_lanes(scenarios[20:25])
    assert [digest(t) for t in few] == together[20:25]
    assert len(set(together)) == len(together)


def test_one_that_goes_unstable_leaves_the_others_alone():
    scenarios = fleet(3)
    wild = dataclasses.replace(scenarios[1], start={"depth": 90.0, "v_rel": (19.0, 8.0, 8.0)})
    found = fly_in_lanes([scenarios[0], wild, scenarios[2]])
    assert isinstance(found[1], SimulationUnstable)
    assert [digest(found[k]) for k in (0, 2)] == [
        digest(twin.simulate(scenarios[k])) for k in (0, 2)
    ]


def test_errors_name_a_lane_by_its_place_among_all_scenarios():
    lane = fleet(1)[0]
    mujoco = dataclasses.replace(lane, engine="mujoco", duration=5.0)
    wild = dataclasses.replace(lane, start={"depth": 90.0, "v_rel": (19.0, 8.0, 8.0)})
    *_, found = twin.simulate_many([mujoco, lane, mujoco, wild])
    assert found.mission == 3
    assert str(found).startswith("mission 3 went unstable")
    aground = dataclasses.replace(lane, floor=twin.parse_floor("depth:62"), duration=900.0)
    with pytest.raises(FloorError, match="mission 1: the vehicle came to the sea floor"):
        twin.simulate_many([mujoco, aground])


def test_the_sea_floor_is_named_when_it_is_reached():
    deep = scenario(floor=twin.parse_floor("depth:130"), mission=None)
    deep = dataclasses.replace(deep, mission=STRAIGHT, duration=900.0)
    with pytest.raises(FloorError, match=r"came to the sea floor at .* engine='mujoco'"):
        twin.simulate(deep)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"navigate": "estimate", "mission": twin.load_mission("default")}, "navigate"),
        ({"integrator": "implicitfast"}, "integrator"),
        ({"centred": False}, "centred=False"),
        ({"hydrodynamics": "ellipsoid"}, "ellipsoid"),
        ({"timestep": 0.3}, "whole number of steps"),
    ],
)
def test_what_lanes_cannot_do_is_refused_by_name(changes, said):
    with pytest.raises((InputError, twin.errors.VehicleError), match=said):
        twin.simulate(scenario(**changes))


def test_a_controller_needs_mujoco():
    with pytest.raises(InputError, match="controller needs engine='mujoco'"):
        twin.simulate(scenario(mission=None), controller=lambda observation: twin.Command())
    with pytest.raises(InputError, match=r"twin\.simulate"):
        twin.Simulation(scenario())
    with pytest.raises(InputError, match="did you mean 'lanes'"):
        scenario(engine="lane")


def test_the_engine_is_part_of_a_scenarios_description():
    given = scenario()
    assert given.describe()["engine"] == "lanes"
    assert twin.physics.scenario.scenario_from_dict(given.describe()).engine == "lanes"
    assert "engine" not in dataclasses.replace(given, engine="mujoco").describe()


def test_encoder_zeros_and_ballast_are_those_of_the_real_vehicle():
    given = scenario(encoder_zeros={"shift": 0.004}, duration=300.0)
    ours, theirs = twin.simulate(given), twin.simulate(dataclasses.replace(given, engine="mujoco"))
    exact = twin.simulate(scenario(duration=300.0))
    assert abs(ours["true_pitch"][-1] - theirs["true_pitch"][-1]) < 0.05
    assert abs(ours["true_pitch"][-1] - exact["true_pitch"][-1]) > 1.0


def test_a_lean_log_holds_the_same_numbers():
    given = twin.Scenario(mission=twin.load_mission("default"), duration=300.0, engine="lanes")
    (whole,), (lean,) = (fly_in_lanes([given], lean=one) for one in (False, True))
    assert "true_specific_force_x" not in lean
    assert {"true_depth", "true_surge", "true_velocity_down", "true_energy_hotel"} <= set(lean)
    for name in lean:
        np.testing.assert_array_equal(lean[name], whole[name])


def test_a_plan_that_many_share_is_compiled_once(monkeypatch):
    compiled = []
    once = twin.Mission.compile

    def counted(self, vehicle):
        compiled.append(self)
        return once(self, vehicle)

    monkeypatch.setattr(twin.Mission, "compile", counted)
    given = twin.Scenario(mission=twin.load_mission("default"), duration=60.0, engine="lanes")
    offset = dataclasses.replace(given, compass_offset=0.5)
    drag = tuple(1.2 * k for k in given.vehicle.flow_frame.drag)
    other = dataclasses.replace(given, believed=given.vehicle.replace(drag=drag))
    straight, turned, _ = fly_in_lanes([given, offset, other])
    assert len(compiled) == 2
    assert [digest(t) for t in (straight, turned)] == [
        digest(twin.simulate(one)) for one in (given, offset)
    ]
    assert digest(straight) != digest(turned)


def test_a_run_until_its_plan_is_flown_ends_before_its_duration():
    yo = twin.Mission.from_dict(
        {"segments": [{"kind": "saw-tooth", "min_depth_m": 5, "max_depth_m": 15, "yos": 1}]}
    )
    given = twin.Scenario(mission=yo, duration=3600.0, engine="lanes")
    (whole,), (ended,) = (fly_in_lanes([given], until_flown=one) for one in (False, True))
    assert whole.time[-1] == 3600.0
    assert ended.time[-1] < 1800.0
    assert ended.provenance["ended"] == "flown"
    np.testing.assert_array_equal(ended.states, whole.states[: len(ended.time)])


def test_a_followed_part_goes_where_it_is_told_from_the_start_of_each_leg():
    yo = {"kind": "saw-tooth", "min_depth_m": 5, "max_depth_m": 25, "yos": 0.5, "heading_deg": 0}
    mission = twin.Mission.from_dict({"segments": [yo, {**yo, "heading_deg": 90}]})
    vehicle = load_vehicle("glider")
    given = twin.Scenario(mission=mission, duration=600.0, engine="lanes", sample_period=1.0)
    hinge = vehicle.part_names.index(vehicle.steering["heading"])
    positions = np.array([*np.linspace(0.0, 0.3, 4), *np.linspace(0.0, -0.3, 4)])
    follow = FollowedPositions(part=hinge, period=20.0, positions=positions, legs=((0, 3), (4, 7)))
    free, led = fly_in_lanes([given, given], follow=[None, follow])
    assert digest(free) == digest(twin.simulate(given))
    said = led.states[:, led.state_columns.index(f"ctrl_{vehicle.part_names[hinge]}")]
    segment = led["commanded_segment"]
    for leg, first in ((0, 0), (1, 4)):
        when = np.flatnonzero(segment == leg)
        since = led.time[when] - led.time[when[0]]
        there = since % 20.0  # away from where a position changes, at half of a period
        clear = (np.abs(there - 10.0) > 1.0) & (led.time[when] < led.time[-1])
        wanted = positions[np.minimum(first + np.rint(since / 20.0).astype(int), first + 3)]
        np.testing.assert_array_equal(said[when][clear], wanted[clear])
        assert clear.sum() > 60


def test_a_sloping_sea_floor_is_met_where_the_track_meets_it():
    """Looked for every third step, at the place of the step between two looks."""
    north = np.array([0.0, 60.0])
    depth = np.stack([130.0 - 2.0 * north] * 2, axis=1)
    slope = GridFloor(north_m=north, east_m=north - 30.0, depth_m=depth)
    starts = [{"depth": 100.0 + 0.31 * k, "v_rel": (0.35, 0.0, 0.01)} for k in range(12)]
    given = [scenario(start=one, duration=60.0, sample_period=0.1, timestep=0.1) for one in starts]
    lanes = [Lane(dataclasses.replace(one, floor=slope)) for one in given]
    for k, found in flown_abreast(lanes):
        free = twin.simulate(given[k])
        altitude = 130.0 - 2.0 * free["true_north"] - free["true_depth"]
        looks = np.arange(1, len(free.time), 3)
        touched = looks[altitude[looks] < 0.5 * given[k].vehicle.hull_diameter]
        assert isinstance(found, Aground)
        assert found.time_s == pytest.approx(free.time[touched[0]], abs=1e-9)
