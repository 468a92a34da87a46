"""Start: a place and a time, what uses them, and what contradicts them is refused."""

import ast
import datetime
import json
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

import twin
from factory.generation.generated_store import open_exportable
from twin.errors import CurrentError, InputError, StoreError
from twin.mission import Mission, SawTooth
from twin.physics.scenario import Scenario, scenario_from_dict
from twin.physics.simulation import simulate
from twin.physics.start import Start, parse_place, utc_text
from twin.records.reader import MissionStore
from twin.water.current.axes import Origin
from twin.water.current.base import parse_current

OLD = Path(__file__).parents[2] / "data" / "e2ff189" / "scenario.json"
PLACE = {"latitude": 49.0, "longitude": -16.0, "time": "2003-08-01T00:00"}
YO = Mission(
    segments=(SawTooth(max_depth_m=40, pitch_deg=30, heading_deg=40, yos=1),),
    start_depth_m=3.0,
    start_heading_deg=30.0,
)


def test_a_mapping_takes_what_it_leaves_out_from_the_mission():
    begin = Scenario(mission=YO, start=PLACE).begin
    assert begin.depth == 3.0
    assert begin.heading == pytest.approx(np.radians(30.0))
    assert (begin.latitude, begin.longitude, begin.time) == (49.0, -16.0, "2003-08-01T00:00:00")
    assert Scenario(mission=YO, start={"depth": 7.0}).begin.depth == 7.0
    assert Scenario(mission=YO, start=Start(latitude=49.0, longitude=-16.0)).begin.depth == 0.0


@pytest.mark.parametrize(
    "time",
    [
        "2003-08-01",
        "2003-08-01T00:00Z",
        "2003-08-01T02:00+02:00",
        datetime.date(2003, 8, 1),
        datetime.datetime(2003, 8, 1),
        datetime.datetime(2003, 7, 31, 23, tzinfo=datetime.timezone(datetime.timedelta(hours=-1))),
    ],
)
def test_a_time_is_kept_as_utc_text(time):
    assert utc_text(time) == "2003-08-01T00:00:00"


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ({"lattitude": 49.0}, "unknown key 'lattitude': did you mean 'latitude'"),
        ({"latitude": 49.0}, "longitude is missing"),
        ({"longitude": 49.0}, "latitude is missing"),
        ({"latitude": 95.0, "longitude": 0.0}, r"latitude = 95.0 must be .* within -88..88"),
        ({"latitude": float("nan"), "longitude": 0.0}, "latitude = nan"),
        ({"latitude": "49", "longitude": 0.0}, "latitude = '49'"),
        ({"latitude": 49.0, "longitude": 361.0}, r"within -360..360"),
        ({"latitude": 49.0, "longitude": 0.0, "north": 5.0}, "leave north and east out"),
        ({"time": "yesterday"}, "time 'yesterday' is not ISO 8601"),
        ({"time": 3.0}, "time 3.0 is not ISO 8601"),
    ],
)
def test_what_cannot_be_used_is_refused(start, message):
    with pytest.raises(InputError, match=message):
        Scenario(mission=YO, start=start)


def test_origin_and_start_must_agree():
    same = Origin(latitude_deg=49.0, longitude_deg=344.0)
    assert Scenario(mission=YO, start=PLACE, origin=same).place.time == "2003-08-01T00:00:00"
    with pytest.raises(InputError, match="leave origin out"):
        Scenario(mission=YO, start=PLACE, origin=Origin(latitude_deg=48.0, longitude_deg=-16.0))
    dated = Origin(latitude_deg=49.0, longitude_deg=-16.0, time="2003-08-02")
    with pytest.raises(InputError, match=r"the origin's 2003-08-02: leave origin"):
        Scenario(mission=YO, start=PLACE, origin=dated)
    time_only = Scenario(mission=YO, start={"time": "2003-08-01"}, origin=same).place
    assert (time_only.latitude_deg, time_only.time) == (49.0, "2003-08-01T00:00:00")


@pytest.mark.parametrize("setting", ["lat=48,lon=-16", "time=2003-08-02"])
def test_a_grid_elsewhere_is_refused_before_its_file_is_read(setting):
    current = parse_current(f"uniform:0.1,0+grid:absent.nc,{setting}")
    with pytest.raises(CurrentError, match="is not the mission's start"):
        Scenario(mission=YO, start=PLACE, current=current)


def test_a_grid_is_read_at_the_start(tmp_path):
    xr = pytest.importorskip("xarray")
    days = np.array(["2003-07-31", "2003-08-01", "2003-08-02"], "datetime64[ns]")
    latitude, longitude = np.arange(47.0, 52.0), np.arange(-18.0, -13.0)
    shape = (3, 5, 5)
    east = 0.1 * np.ones(shape) * (latitude - 48.0)[None, :, None]  # 0.1 m/s at 49 N
    north = np.zeros(shape)
    north[1:] = 0.2
    axes = ("time", "lat", "lon")
    data = xr.Dataset(
        {
            "u": (axes, east, {"standard_name": "eastward_sea_water_velocity", "units": "m s-1"}),
            "v": (axes, north, {"standard_name": "northward_sea_water_velocity", "units": "m s-1"}),
        },
        {
            "time": days,
            "lat": ("lat", latitude, {"units": "degrees_north"}),
            "lon": ("lon", longitude, {"units": "degrees_east"}),
        },
    )
    path = tmp_path / "water.nc"
    data.to_netcdf(path)
    run = twin.simulate(mission=YO, start=PLACE, current=f"grid:{path}", duration=60.0)
    assert run["true_current_east"][0] == pytest.approx(0.1, abs=1e-6)
    assert run["true_current_north"][0] == pytest.approx(0.2, abs=1e-6)
    scenario = scenario_from_dict(json.loads(run.provenance["scenario"]))
    np.testing.assert_array_equal(simulate(scenario).states, run.states)


def test_density_and_pressure_follow_the_latitude():
    def fly(**options: object) -> twin.Trajectory:
        return twin.simulate(
            mission=YO, density="thermocline", sensors="ideal", duration=120.0, **options
        )

    default, named = fly(), fly(start={"latitude": 36.8, "longitude": -122.4})
    np.testing.assert_array_equal(default.states, named.states)
    north = fly(start={"latitude": 80.0, "longitude": 0.0})
    assert np.abs(north["true_density"] - default["true_density"]).max() > 1e-4
    deep = default["true_depth"].argmax()
    gained = north["measured_pressure"][deep] / north["true_depth"][deep]
    usual = default["measured_pressure"][deep] / default["true_depth"][deep]
    assert 0.0015 < gained / usual - 1.0 < 0.005  # gravity at 80 degree over that at 36.8: 0.32 %


def test_a_scenario_comes_back_with_its_place():
    for options in (
        {"start": PLACE},
        {"start": {"time": "2003-08-01"}},
        {"origin": Origin(latitude_deg=49.0)},
        {},
    ):
        scenario = Scenario(mission=YO, **options)
        again = scenario_from_dict(json.loads(json.dumps(scenario.describe())))
        assert (again.place, again.has_place) == (scenario.place, scenario.has_place)
        assert again.describe() == scenario.describe()


def test_a_scenario_of_an_earlier_version_is_read():
    described = json.loads(OLD.read_text())
    scenario = scenario_from_dict(described)
    assert scenario.place == Origin(latitude_deg=49.0, longitude_deg=-16.0, time="2003-08-01T00:00")
    assert scenario.begin.actuators == (0.001, 0.0, 20.0)
    again = json.loads(json.dumps(scenario.describe()))
    for name in described.keys() - {"start"}:
        assert again[name] == described[name], name
    assert described["start"].items() <= again["start"].items()


@pytest.mark.parametrize("ending", [".zarr", ".nc"])
@pytest.mark.parametrize("given", [True, False])
def test_stores_hold_the_place_and_give_it_back(tmp_path, ending, given):
    run = twin.simulate(mission=YO, duration=30.0, **({"start": PLACE} if given else {}))
    assert run.provenance.get("start_nominal") == (None if given else "place and date")
    path = run.save(tmp_path / f"run{ending}")
    again = twin.open_trajectory(path)
    for name in ("start_latitude", "start_longitude", "start_time", "start_nominal"):
        assert again.provenance.get(name) == run.provenance.get(name), name
    latitude, longitude = again.geographic_position()
    begin = np.datetime64("2003-08-01" if given else "2020-01-01", "ns")
    assert latitude[0] == pytest.approx(49.0 if given else 36.8, abs=1e-9 if given else 1e-4)
    assert longitude[-1] != longitude[0]
    assert again.to_xarray()["datetime"].values[-1] == begin + np.timedelta64(30, "s")
    assert again.to_xarray().attrs.get("start_nominal") == run.provenance.get("start_nominal")
    with xr.open_dataset(path, **({"engine": "zarr"} if ending == ".zarr" else {})) as store:
        assert store["datetime"].values[0, 0] == begin
        assert store["start_latitude"].attrs["units"] == "degree_north"
        if not given:
            flag = store["start_nominal"]
            words = flag.attrs["flag_meanings"].split()
            assert words[int(flag[0])] == "place_and_date"
            assert float(store["latitude"][0, 0]) == pytest.approx(36.8, abs=1e-4)


def test_a_place_without_a_date_leaves_the_date_nominal():
    said = twin.simulate(mission=YO, start={"latitude": 49.0, "longitude": -16.0}, duration=30.0)
    assert said.provenance["start_nominal"] == "date"


def test_an_export_is_at_the_true_place_and_date(tmp_path):
    from factory.exporting import EXPORTERS

    run = twin.simulate(mission=YO, start=PLACE, sensors="ideal", duration=60.0)
    store = open_exportable(run.save(tmp_path / "run.zarr"))
    (path,) = EXPORTERS["og1"].export(store, [0], tmp_path / "og1")
    with netCDF4.Dataset(path) as file:
        latitude, longitude = run.geographic_position()
        np.testing.assert_allclose(file["TRUE_LATITUDE"][:], latitude, atol=1e-7)
        np.testing.assert_allclose(file["TRUE_LONGITUDE"][:], longitude, atol=1e-7)
        assert netCDF4.num2date(file["TIME"][0], file["TIME"].units).isoformat() == (
            "2003-08-01T00:00:00"
        )
        assert file.start_date == "20030801T000000"
        assert "nominal" not in file.comment


def test_an_export_says_what_is_nominal_and_refuses_what_it_cannot_hold(tmp_path):
    from factory.exporting import EXPORTERS

    def saved(name: str, **options: object) -> Path:
        return twin.simulate(mission=YO, duration=30.0, **options).save(tmp_path / name)

    (path,) = EXPORTERS["og1"].export(
        open_exportable(saved("a.zarr", sensors="ideal")), [0], tmp_path / "og1"
    )
    with netCDF4.Dataset(path) as file:
        assert "its place and date are nominal" in file.comment
    early = saved("b.zarr", sensors="ideal", start={**PLACE, "time": "1999-01-01"})
    with pytest.raises(StoreError, match="no dates before 2001-09-09"):
        EXPORTERS["og1"].export(open_exportable(early), [0], tmp_path / "early")
    with pytest.raises(StoreError, match="flown without sensors"):
        open_exportable(saved("c.zarr"))


def test_an_environment_refuses_a_place_that_it_would_not_use():
    pytest.importorskip("dm_control")
    from twin.control.physics import Physics

    physics = Physics.from_vehicle()
    physics.set_start(Start(depth=20.0))
    assert physics.depth() == pytest.approx(20.0)
    with pytest.raises(InputError, match="have no effect here"):
        physics.set_start(Start(depth=20.0, latitude=49.0, longitude=-16.0))


def test_a_caption_says_where_and_when(tmp_path):
    from twin.show.figures.page_layout import mission_caption

    run = twin.simulate(mission=YO, start=PLACE, duration=30.0)
    caption = mission_caption(MissionStore(run.save(tmp_path / "run.zarr")), 0)
    assert "49.000°N 16.000°W, 2003-08-01 00:00 UTC, simulated" in caption


def test_nothing_outside_the_physics_writes_to_a_compiled_block():
    root = Path(twin.__file__).parents[1]
    readers = {"header", "part_table", "table", "state"}
    seen = 0
    for path in [p for name in ("twin", "factory", "learn") for p in (root / name).rglob("*.py")]:
        if (root / "twin" / "physics") in path.parents:
            continue
        nodes = list(ast.walk(ast.parse(path.read_text())))
        if not any(
            isinstance(n, ast.ImportFrom) and n.module == "twin.physics.model_block" for n in nodes
        ):
            assert "numeric_data" not in path.read_text(), path
            continue
        seen += 1
        calls = {
            ast.unparse(n): ast.unparse(n.func)
            for n in nodes
            if isinstance(n, ast.Call) and ast.unparse(n.func) in readers
        }
        live = set(calls)
        for node in nodes:
            if isinstance(node, ast.Assign):
                live |= _bound_to(node, calls)
        for node in nodes:
            if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store):
                assert ast.unparse(node.value) not in live, f"{path}:{node.lineno}"
    assert seen > 1


def _bound_to(node: ast.Assign, calls: dict[str, str]) -> set[str]:
    """Names that an assignment, plain or of tuples, binds to one of the calls."""
    names = set()
    for target in node.targets:
        pairs = [(target, node.value)]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            pairs = list(zip(target.elts, node.value.elts, strict=True))
        names |= {ast.unparse(t) for t, value in pairs if ast.unparse(value) in calls}
    return names


def test_a_place_on_the_command_line():
    assert parse_place("-33, 18") == {"latitude": -33.0, "longitude": 18.0}
    assert parse_place("49,-16,2003-08-01") == {**PLACE, "time": "2003-08-01"}
    for text in ("49", "a,b", "1,2,3,4"):
        with pytest.raises(InputError, match="write LATITUDE,LONGITUDE"):
            parse_place(text)


@pytest.mark.parametrize("pitch", [90.0, -90.0])
@pytest.mark.parametrize("engine", ["mujoco", "lanes"])
def test_a_start_straight_up_or_down_keeps_its_heading(pitch, engine):
    start = Start(depth=50.0, pitch=np.radians(pitch), heading=np.radians(130.0))
    run = twin.simulate(duration=1.0, start=start, engine=engine)
    first = [run[f"true_{name}"][0] for name in ("heading", "roll", "pitch")]
    assert first == pytest.approx([130.0, 0.0, pitch], abs=1e-4)
