"""Sea floor and obstacles: what the hull touches, at which altitude dives turn, and its replay."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

import twin
from twin.errors import FloorError, InputError, MissionError, VehicleError
from twin.mission import Mission, SawTooth
from twin.mission.controller import MissionController
from twin.physics.fleet import Fleet
from twin.physics.model_block import Tables, write_tables
from twin.physics.mujoco_model import compile_model
from twin.physics.scenario import Scenario, Start, scenario_from_dict
from twin.physics.simulation import Simulation, simulate
from twin.records.mission_dataset import summarise
from twin.vehicle.presets import asset_path
from twin.vehicle.vehicle import load_vehicle, parse_vehicle
from twin.water.current.profile import Uniform
from twin.water.floor import Bathymetry, FlatFloor, GridFloor

VEHICLE = load_vehicle("glider")
TEXT = asset_path("glider.xml").read_text()
YO = Mission(segments=(SawTooth(max_depth_m=60.0, yos=1),), duration_s=600.0)
AXIS = np.arange(-1000.0, 1001.0, 100.0)
NORTH, EAST = np.meshgrid(AXIS, AXIS, indexing="ij")
SLOPE = GridFloor(north_m=AXIS, east_m=AXIS, depth_m=50.0 - 0.15 * NORTH + 0.1 * EAST)
ROUGH = GridFloor(
    north_m=AXIS,
    east_m=AXIS,
    depth_m=55.0 - 0.1 * NORTH + np.random.default_rng(1).uniform(-4.0, 4.0, NORTH.shape),
)
PLANE = '<worldbody><geom name="rock" type="plane" pos="0 0 -30" size="0 0 1"/>'
OFF = 'contact="disable" constraint="disable"'


def yo(**segment):
    return Mission(segments=(SawTooth(max_depth_m=60.0, yos=1, **segment),), duration_s=600.0)


def test_a_glider_comes_to_rest_on_the_floor():
    run = twin.simulate(mission=YO, floor="depth:30")
    assert run["true_depth"].max() < 30.0
    late = run.time > 400.0
    assert np.ptp(run["true_north"][late]) < 0.2
    assert run["true_velocity_down"][late].max() < 0.01
    assert run["true_contact"][late].all()
    assert not run["true_contact"][run.time < 100.0].any()
    figures = summarise(run)
    assert figures["grounded"]
    assert 100.0 < figures["first_contact_s"] < 130.0
    assert figures["min_altitude_m"] == pytest.approx(run["true_altitude"].min())
    assert 0.0 < figures["min_altitude_m"] < 1.0


def test_a_hull_on_a_slope_touches_the_slope():
    run = twin.simulate(mission=YO, floor=SLOPE)
    late = run.time > 400.0
    pitch, heading = (np.deg2rad(run[f"true_{n}"][late]) for n in ("pitch", "heading"))
    reach = VEHICLE.hull_length / 2 - VEHICLE.hull_diameter / 2
    north = run["true_north"][late] + reach * np.cos(pitch) * np.cos(heading)
    east = run["true_east"][late] + reach * np.cos(pitch) * np.sin(heading)
    nose = run["true_depth"][late] - reach * np.sin(pitch)
    above = (50.0 - 0.15 * north + 0.1 * east - nose) / np.sqrt(1.0 + 0.15**2 + 0.1**2)
    np.testing.assert_allclose(above, VEHICLE.hull_diameter / 2, atol=0.02)


def test_a_floor_out_of_reach_changes_nothing():
    scenario = Scenario(mission=yo(heading_deg=40.0), current=Uniform(north=0.1, east=-0.05))
    without = simulate(scenario)
    above = simulate(Scenario(**{**vars(scenario), "floor": FlatFloor(depth_m=90.0)}))
    np.testing.assert_array_equal(without.states, above.states)
    assert set(above) - set(without) == {"true_altitude", "true_contact"}
    np.testing.assert_allclose(above["true_altitude"], 90.0 - above["true_depth"], atol=1e-12)
    assert not summarise(above)["grounded"]
    assert summarise(above)["first_contact_s"] is None
    assert "grounded" not in summarise(without)


def test_without_anything_to_hit_mujoco_does_not_look_for_contacts():
    model = compile_model("glider", lean=True)
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    assert model.nmocap == 0
    assert model.ngeom == 4  # the ellipsoids of the other law
    # a skid alone has nothing to touch either
    skid = '<geom name="skid" type="sphere" pos="0.7 0 -1" size="0.05" mass="0"/><site name="cb"'
    lonely = parse_vehicle(TEXT.replace('<site name="cb"', skid, 1), Path("glider.xml"))
    assert compile_model(lonely).opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT


def test_a_fleet_meets_the_same_floor():
    scenarios = [
        Scenario(mission=YO, duration=300.0, floor=floor)
        for floor in (SLOPE, FlatFloor(depth_m=25.0), ROUGH)
    ]
    for alone, batched in zip(map(simulate, scenarios), Fleet(scenarios).run(), strict=True):
        np.testing.assert_array_equal(alone.states, batched.states)
        np.testing.assert_array_equal(alone["true_contact"], batched["true_contact"])
        assert alone["true_contact"].max() > 0.0


@pytest.mark.parametrize("floor", [FlatFloor(depth_m=50.0), SLOPE, ROUGH])
def test_dives_turn_at_an_altitude(floor):
    run = twin.simulate(mission=yo(min_altitude_m=12.0), floor=floor)
    turned = np.flatnonzero(run["commanded_pitch"] > 0)[0]
    assert run["true_altitude"][turned] <= 12.0 < run["true_altitude"][turned - 2]
    assert 8.0 < run["true_altitude"].min() < 12.0  # the overshoot of an inflection
    assert not summarise(run)["grounded"]
    deeper = twin.simulate(mission=yo(min_altitude_m=12.0), floor="depth:500")
    shallower = twin.simulate(mission=yo())
    np.testing.assert_array_equal(deeper.states, shallower.states)  # the depth comes first


def test_a_dive_below_its_altitude_climbs_at_once():
    """Two segments: the second begins nearer to the floor than it may dive."""
    first, second = (
        SawTooth(max_depth_m=60.0, yos=0.5),
        SawTooth(max_depth_m=60.0, min_altitude_m=45.0, yos=1),
    )
    mission = Mission(segments=(first, second), duration_s=900.0)
    run = twin.simulate(mission=mission, floor="depth:70")
    begun = np.flatnonzero(run["commanded_segment"] == 1)[0]
    assert (run["commanded_pitch"][begun : begun + 20] > 0).all()
    again = run["true_depth"][run.time > run.time[begun] + 300.0]
    assert again.max() < 29.0  # the next dive turns at 70 - 45 m


def test_guidance_in_python_turns_at_the_same_altitude():
    mission = yo(min_altitude_m=12.0)
    native = simulate(Scenario(mission=mission, floor=ROUGH))
    scenario = Scenario(duration=600.0, floor=ROUGH, start=Scenario(mission=YO).usual_start())
    python = simulate(scenario, MissionController(mission, VEHICLE))
    assert native["true_altitude"].min() == pytest.approx(python["true_altitude"].min(), abs=0.05)
    assert python["true_altitude"].min() > 8.0
    with pytest.raises(MissionError, match="the observation has no altitude"):
        simulate(Scenario(duration=60.0), MissionController(mission, VEHICLE))


def test_an_altitude_without_a_floor_is_refused():
    with pytest.raises(MissionError, match="the scenario has no sea floor"):
        Scenario(mission=yo(min_altitude_m=12.0))
    with pytest.raises(MissionError, match="min_altitude_m = 0 is not possible"):
        yo(min_altitude_m=0)


def test_a_start_needs_water_under_it():
    with pytest.raises(FloorError, match="at a depth of 300 m, where the sea floor is at 200 m"):
        simulate(Scenario(mission=YO, floor=FlatFloor(depth_m=200.0), start=Start(depth=300.0)))
    with pytest.raises(FloorError, match=r"20 m above the sea: start elsewhere$"):
        simulate(Scenario(mission=YO, floor=GridFloor(
            north_m=AXIS, east_m=AXIS, depth_m=0.0 * NORTH - 20.0
        )))  # fmt: skip
    land = GridFloor(north_m=AXIS, east_m=AXIS, depth_m=NORTH - 10.0)
    with pytest.raises(FloorError, match="on land, 10 m above the sea"):
        simulate(Scenario(mission=YO, floor=land))
    with pytest.raises(FloorError, match="the sea is 15 m deep"):
        simulate(Scenario(mission=yo(min_altitude_m=12.0), floor=FlatFloor(depth_m=15.0)))
    with pytest.raises(FloorError, match="where the mission starts"):
        Scenario(mission=YO, floor=Bathymetry(path="gebco.nc"))


def test_contacts_need_the_discrete_integrator():
    implicit = {"integrator": "implicitfast", "timestep": 0.02}
    with pytest.raises(InputError, match="needs integrator discrete"):
        Simulation(Scenario(mission=YO, floor=FlatFloor(depth_m=30.0), **implicit))
    Simulation(Scenario(mission=YO, **implicit))


@pytest.mark.parametrize("current", [None, Uniform(north=0.6, east=0.3)])
def test_a_grounded_glider_stays_sound_in_a_current_and_at_a_short_step(current):
    scenario = Scenario(mission=YO, floor=ROUGH, current=current, timestep=0.02)
    for each in (scenario, Scenario(mission=YO, floor=ROUGH, current=current)):
        run = simulate(each)
        assert run.complete
        assert run["true_contact"].any()
        assert np.linalg.norm(run.v_rel, axis=1).max() < 1.0


def test_a_described_floor_flies_again():
    scenario = Scenario(mission=yo(min_altitude_m=12.0), floor=ROUGH, duration=300.0)
    described = json.loads(json.dumps(scenario.describe()))
    np.testing.assert_array_equal(
        simulate(scenario).states, simulate(scenario_from_dict(described)).states
    )
    older = {name: value for name, value in described.items() if name != "floor"}
    older["plan"]["segments"][0].pop("min_altitude_m")
    assert scenario_from_dict(older).floor is None


# --- obstacles of the vehicle file ------------------------------------------------------------


def with_obstacle(text: str = TEXT) -> twin.Vehicle:
    return parse_vehicle(text.replace("<worldbody>", PLANE), Path("glider.xml"))


def test_an_obstacle_of_the_file_stays_in_every_run():
    scenario = Scenario(vehicle=with_obstacle(), mission=YO)
    alone, full = simulate(scenario), Simulation(scenario, lean=False).run()
    (batched,) = Fleet([scenario]).run()
    for run in (alone, full, batched):
        assert 25.0 < run["true_depth"].max() < 30.0
        assert summarise(run)["grounded"]
        np.testing.assert_array_equal(run.states, alone.states)
    assert "true_altitude" not in alone  # it is no sea floor


@pytest.mark.parametrize("name", twin.vehicle_names())
def test_every_shipped_vehicle_meets_what_is_in_its_way(name):
    vehicle = load_vehicle(name)
    text = vehicle.xml.replace("<worldbody>", PLANE)
    rock = compile_model(parse_vehicle(text, Path(f"{name}.xml")), lean=True)
    floor = compile_model(vehicle, tables=Tables(floor=FlatFloor(depth_m=30.0).compile(0.0)))
    for model in (rock, floor):
        data = mujoco.MjData(model)
        data.qpos[2] = -30.0 + 0.4 * vehicle.hull_diameter
        data.act[:] = data.ctrl[:] = vehicle.rest
        mujoco.mj_step(model, data, nstep=3)
        assert data.ncon > 0
        mujoco.mj_step(model, data, nstep=round(30.0 / model.opt.timestep))
        assert data.qpos[2] > -30.0


def test_a_colliding_geom_of_the_vehicle_is_its_shape():
    """A skid 1 m below the hull keeps it that much higher."""
    skid = '<geom name="skid" type="sphere" pos="0.7 0 -1" size="0.05" mass="0"/><site name="cb"'
    text = TEXT.replace('<site name="cb"', skid, 1)
    higher = simulate(Scenario(vehicle=with_obstacle(text), mission=YO))
    usual = simulate(Scenario(vehicle=with_obstacle(), mission=YO))
    assert higher["true_depth"].max() < usual["true_depth"].max() - 0.3


def test_an_obstacle_that_could_not_be_hit_is_refused():
    flagless = '<flag autoreset="disable"/>'
    assert flagless in TEXT
    vehicle = with_obstacle(TEXT.replace(flagless, f"<flag {OFF}/>"))
    with pytest.raises(VehicleError, match=r"'rock' stands in the water.*pass through it"):
        compile_model(vehicle)
    drawn = PLANE.replace("size=", 'contype="0" conaffinity="0" size=')
    compile_model(parse_vehicle(TEXT.replace("<worldbody>", drawn), Path("glider.xml")))


def test_a_file_that_switches_contacts_off_still_meets_the_sea_floor():
    text = TEXT.replace('<flag autoreset="disable"/>', f"<flag {OFF}/>")
    run = twin.simulate(
        vehicle=parse_vehicle(text, Path("glider.xml")), mission=YO, floor="depth:30"
    )
    np.testing.assert_array_equal(run.states, twin.simulate(mission=YO, floor="depth:30").states)


def test_tables_with_a_floor_need_a_model_with_one():
    model = compile_model("glider", lean=True, reserve=100)
    with pytest.raises(FloorError, match="compiled without a sea floor"):
        write_tables(model, Tables(floor=FlatFloor(depth_m=50.0).compile(0.0)))


def test_an_environment_keeps_its_floor_when_the_water_changes():
    physics_module = pytest.importorskip("twin.control.physics")
    tables = Tables(floor=FlatFloor(depth_m=30.0).compile(0.0))
    model = compile_model("glider", tables=tables, reserve=500)
    physics = physics_module.Physics.from_model(model)
    with physics.reset_context():
        physics.set_current(Uniform(north=0.1, east=0.0), 100.0)
        physics.set_start(Start(depth=29.0))
    physics.data.ctrl[:] = [0.0, 0.0, VEHICLE.pump_for_net_mass(0.3)]
    physics.step(600)
    assert 29.0 < physics.depth() < 30.0
    assert physics.data.ncon > 0


def test_sensors_see_the_floor_and_nothing_else_beside_it():
    with pytest.raises(InputError, match="a floor or a bottom_depth, not both"):
        twin.simulate(mission=YO, floor="depth:90", sensors="ideal", bottom_depth=90.0)
    run = twin.simulate(mission=YO, floor="depth:90", sensors="ideal")
    np.testing.assert_array_equal(run["measured_altitude"], run["true_altitude"])
    assert "measured_altitude" not in twin.simulate(mission=YO, sensors="ideal")
    near = twin.simulate(mission=yo(min_altitude_m=10.0), floor=SLOPE, sensors="field")
    assert (near["measured_dvl_mode"] == 1).mean() > 0.5  # the Doppler log sees the same bottom


def test_the_plane_under_the_hull_is_turned_as_the_slope():
    """z of the plane along the floor's normal, by a quaternion of length 1."""
    simulation = Simulation(Scenario(mission=YO, floor=SLOPE))
    mujoco.mj_step(simulation.model, simulation.data, nstep=10)
    (turn,) = simulation.data.mocap_quat
    assert np.linalg.norm(turn) == pytest.approx(1.0, abs=1e-12)
    normal = np.zeros(3)
    mujoco.mju_rotVecQuat(normal, np.array([0.0, 0.0, 1.0]), turn)
    # x is north and y is west: the floor rises by 0.15 to the north and by 0.1 to the west
    np.testing.assert_allclose(normal / normal[2], [-0.15, -0.1, 1.0], atol=1e-6)
