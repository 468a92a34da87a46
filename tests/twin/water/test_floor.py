"""Sea floors: lookup, bathymetry files, texts, descriptions."""

import dataclasses
import inspect
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from twin.commands.simulate import Simulate
from twin.errors import FloorError
from twin.geodesy import from_tangent_plane
from twin.physics.model_block import floor_table
from twin.physics.scenario import Scenario, Start
from twin.water.current.axes import Origin
from twin.water.floor import (
    Bathymetry,
    FlatFloor,
    GridFloor,
    RoughFloor,
    floor_from_dict,
    parse_floor,
)
from twin.water.floor.bathymetry import ROUGH_SETTINGS
from twin.water.floor.lookup import (
    beam_length,
    beyond_floor,
    floor_depth,
    floor_depths,
    shallowest_depth,
)

PAGE = (Path(__file__).parents[3] / "docs" / "physics" / "equations.md").read_text(encoding="utf-8")
RNG = np.random.default_rng(5)
NORTH = np.array([-400.0, -100.0, 0.0, 250.0, 600.0])
EAST = np.array([-300.0, 50.0, 90.0, 500.0])
DEPTH = RNG.uniform(50.0, 300.0, (5, 4))
GRID = GridFloor(north_m=NORTH, east_m=EAST, depth_m=DEPTH)
TABLE = GRID.compile(0.0)
PLACE = Origin(latitude_deg=36.8, longitude_deg=-121.8)

ROUGH = RoughFloor(
    depth_m=60.0, height_m=3.0, length_m=250.0, slope=0.01, slope_direction_deg=30.0, seed=7,
    reach_m=3e3,
)  # fmt: skip


def depths_of(floor: RoughFloor) -> np.ndarray:
    table = floor.compile(60.0)
    nodes = int(table[0])
    return table[3 + 2 * nodes :].reshape(nodes, nodes)


def test_depths_between_nodes_are_bilinear():
    judge = RegularGridInterpolator((NORTH, EAST), DEPTH)
    north, east = RNG.uniform(-400, 600, 200), RNG.uniform(-300, 500, 200)
    found = floor_depths(TABLE, north, east)
    np.testing.assert_allclose(found, judge(np.column_stack([north, east])), rtol=1e-13)


def test_the_edge_is_held_beyond_the_grid_and_told():
    assert floor_depth(TABLE, 9e3, 9e3) == DEPTH[-1, -1]
    assert floor_depth(TABLE, -9e3, 50.0) == DEPTH[0, 1]
    outside = beyond_floor(TABLE, np.array([0.0, 601.0, 0.0]), np.array([0.0, 0.0, -301.0]))
    assert outside.tolist() == [False, True, True]
    flat = FlatFloor(depth_m=200.0).compile(0.0)
    assert floor_depth(flat, 1e6, -1e6) == 200.0
    assert not beyond_floor(flat, np.array([1e6]), np.array([1e6])).any()


@pytest.mark.parametrize("table", [np.zeros(0), np.array([2.0, 2.0, 0.0, 1.0]), TABLE[:-1]])
def test_a_damaged_table_gives_nan_and_reads_nothing_else(table):
    assert np.isnan(floor_depth(table, 0.0, 0.0))


def test_a_beam_ends_at_the_floor_it_meets_first():
    axis = np.array([-100.0, 0.0, 10.0, 20.0, 300.0])
    wall = np.tile(np.array([80.0, 80.0, 30.0, 80.0, 80.0])[:, None], (1, 5))  # a ridge in the east
    table = GridFloor(north_m=axis, east_m=axis, depth_m=wall).compile(0.0)
    assert shallowest_depth(table) == 30.0
    ahead = np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    # the ridge's face: depth = 80 - 5 n between 0 and 10 m north
    along = (80.0 - 40.0) / (ahead[2] + 5.0 * ahead[0])
    assert beam_length(table, 30.0, 0.0, 0.0, 40.0, ahead, 100.0, 2.0) == pytest.approx(
        along, abs=2e-4
    )
    plumb = np.array([0.0, 0.0, 1.0])
    assert beam_length(table, 30.0, -50.0, 0.0, 40.0, plumb, 100.0, 2.0) == pytest.approx(
        40.0, abs=2e-4
    )
    assert beam_length(table, 30.0, -50.0, 0.0, 40.0, plumb, 39.0, 2.0) == np.inf
    assert beam_length(table, 30.0, -50.0, 0.0, 80.5, plumb, 39.0, 2.0) == 0.0
    # from above all of the floor the search begins at its shallowest depth
    high = beam_length(table, 30.0, -60.0, 0.0, 5.0, ahead, 100.0, 2.0)
    assert high == pytest.approx(75.0 / ahead[2], abs=2e-4)
    assert beam_length(table, 30.0, -12.0, 0.0, 5.0, ahead, 100.0, 2.0) < 60.0
    assert beam_length(table, 30.0, -60.0, 0.0, 5.0, ahead, 25.0, 2.0) == np.inf


def gebco(
    latitude: np.ndarray,
    longitude: np.ndarray,
    *,
    name: str = "elevation",
    sign: float = -1.0,
    **attributes: str,
) -> xr.Dataset:
    """A file in GEBCO's layout over a sloping floor: 500 m deep in Monterey Bay's north."""
    depth = 500.0 + 4e3 * (36.8 - latitude[:, None]) - 2e3 * (np.mod(longitude, 360.0) - 238.2)
    depth = np.clip(depth, -3000.0, 9000.0)
    field = xr.DataArray(
        np.round(sign * depth).astype("i2"),
        dims=("lat", "lon"),
        coords={
            "lat": ("lat", latitude, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", longitude, {"standard_name": "longitude", "units": "degrees_east"}),
        },
        attrs={"units": "m", **attributes},
    )
    return xr.Dataset({name: field, "crs": xr.DataArray(0)})


LAT, LON = np.arange(36.5, 37.1, 1 / 240), np.arange(-122.2, -121.5, 1 / 240)
UP = {"standard_name": "height_above_mean_sea_level"}


@pytest.mark.parametrize("suffix", ["nc", "zarr"])
def test_a_gebco_file_lies_about_the_start(tmp_path, suffix):
    path = tmp_path / f"gebco.{suffix}"
    data = gebco(LAT, LON, **UP)
    data.to_netcdf(path) if suffix == "nc" else data.to_zarr(path, consolidated=False)
    table = Bathymetry(path=str(path)).compile(3600.0, PLACE)
    north, east = RNG.uniform(-5000, 5000, (2, 50))
    latitude, longitude = from_tangent_plane(north, east, 36.8, -121.8)
    judge = (
        data["elevation"]
        .astype(float)
        .interp(lat=xr.DataArray(latitude, dims="n"), lon=xr.DataArray(longitude, dims="n"))
    )
    np.testing.assert_allclose(floor_depths(table, north, east), -judge.values, atol=0.02)
    assert table.size < LAT.size * LON.size / 2  # what a mission cannot reach is not loaded


@pytest.mark.parametrize(
    ("latitude", "longitude"),
    [(LAT[::-1], LON), (LAT, np.mod(LON, 360.0)), (LAT, np.roll(LON, 40))],
)
def test_order_and_turn_of_the_axes_do_not_matter(tmp_path, latitude, longitude):
    gebco(LAT, LON, **UP).to_netcdf(tmp_path / "a.nc")
    gebco(latitude, longitude, **UP).to_netcdf(tmp_path / "b.nc")
    one, other = (
        Bathymetry(path=str(tmp_path / n)).compile(3600.0, PLACE) for n in ("a.nc", "b.nc")
    )
    np.testing.assert_allclose(one, other, atol=1e-6)


def test_the_dateline_is_no_edge(tmp_path):
    longitude = np.arange(-180.0, 180.0, 0.25)
    gebco(np.arange(36.0, 38.0, 0.25), longitude, **UP).to_netcdf(tmp_path / "world.nc")
    origin = Origin(latitude_deg=36.8, longitude_deg=179.9)
    table = Bathymetry(path=str(tmp_path / "world.nc"), reach_m=30e3).compile(0.0, origin)
    assert not beyond_floor(table, np.zeros(2), np.array([-29e3, 29e3])).any()


@pytest.mark.parametrize(
    ("name", "sign", "attributes", "positive"),
    [
        ("deptho", 1.0, {}, None),
        ("h", 1.0, {"positive": "down"}, None),
        ("h", 1.0, {"standard_name": "sea_floor_depth_below_geoid"}, None),
        ("h", 1.0, {}, "down"),
        ("z", -1.0, {}, None),
    ],
)
def test_what_counts_downward_is_told(tmp_path, name, sign, attributes, positive):
    path = str(tmp_path / "file.nc")
    gebco(LAT, LON, name=name, sign=sign, **attributes).to_netcdf(path)
    chosen = {"variable": "h"} if name == "h" else {}
    table = Bathymetry(path=path, positive=positive, **chosen).compile(3600.0, PLACE)
    assert floor_depth(table, 0.0, 0.0) == pytest.approx(500.0, abs=0.6)


def test_refusals_of_files_teach(tmp_path):
    def refused(data: xr.Dataset, place: Origin | None = PLACE, **settings) -> str:
        data.to_netcdf(tmp_path / "file.nc")
        with pytest.raises(FloorError) as error:
            Bathymetry(path=str(tmp_path / "file.nc"), **settings).compile(3600.0, place)
        return str(error.value)

    sound = gebco(LAT, LON, **UP)
    assert "--start LAT,LON" in refused(sound, None)
    far = Origin(latitude_deg=36.8, longitude_deg=58.0)
    assert "36.5..37.1 degree north" in refused(sound, far)
    assert "name it with variable=NAME" in refused(gebco(LAT, LON, name="tid"))
    assert "did you mean 'elevation'" in refused(sound, variable="elevaton")
    assert "positive=up" in refused(gebco(LAT, LON, name="h"), variable="h")
    holes = sound.astype(float).where(sound.lat < 36.8)
    assert "are missing" in refused(holes)
    fine = gebco(np.linspace(30, 40, 2500), np.linspace(-125, -115, 2500))
    assert "reach=METRES" in refused(fine, reach_m=1e6)
    sound["elevation"].attrs["units"] = "feet"
    assert "convert it to metres" in refused(sound)
    thousand = gebco(LAT, LON, **UP).astype("f4") * 1000.0
    assert "wrong units" in refused(thousand)
    with pytest.raises(FloorError, match="no bathymetry file"):
        Bathymetry(path=str(tmp_path / "none.nc")).compile(1.0, PLACE)


def test_a_recorded_floor_is_refused_when_its_file_has_changed(tmp_path):
    path = tmp_path / "gebco.nc"
    gebco(LAT, LON, **UP).to_netcdf(path)
    pinned = Bathymetry(path=str(path)).pinned(3600.0, PLACE)
    assert floor_from_dict(pinned.describe()) == pinned
    np.testing.assert_array_equal(
        pinned.compile(10.0, PLACE), Bathymetry(path=str(path)).compile(3600.0, PLACE)
    )
    (gebco(LAT, LON, **UP) + xr.Dataset({"elevation": 1})).to_netcdf(path)
    with pytest.raises(FloorError, match="does not hold the recorded sea floor any more"):
        dataclasses.replace(pinned, variable="elevation").compile(3600.0, PLACE)


def test_a_rough_floor_has_the_relief_that_it_is_given():
    """Standard deviation, correlation at one and two lengths, and slope, over 40 seeds."""
    lags, square, products = (4, 8), 0.0, np.zeros(2)
    for seed in range(40):
        relief = depths_of(dataclasses.replace(ROUGH, slope=0.0, seed=seed)) - ROUGH.depth_m
        square += np.mean(relief**2) / 40
        products += [np.mean(relief[lag:] * relief[:-lag]) / 40 for lag in lags]
    assert np.sqrt(square) == pytest.approx(ROUGH.height_m, rel=0.05)
    # r K_1(r), and the part of its variance in waves shorter than a length, which is left out
    assert products / square == pytest.approx([0.602, 0.280], abs=0.04)
    level = depths_of(dataclasses.replace(ROUGH, height_m=0.0))
    north, east = np.gradient(level, ROUGH.length_m / 4)
    assert np.hypot(north, east) == pytest.approx(0.01)
    assert np.degrees(np.arctan2(east, north)) == pytest.approx(30.0)


def test_a_rough_floor_is_the_same_wherever_it_is_laid_out():
    near, far = ROUGH.compile(60.0), dataclasses.replace(ROUGH, reach_m=6e3).compile(60.0)
    for north, east in ((0.0, 0.0), (-812.0, 1533.0), (2900.0, -2900.0)):
        assert floor_depth(near, north, east) == pytest.approx(floor_depth(far, north, east))
    assert not np.allclose(depths_of(ROUGH), depths_of(dataclasses.replace(ROUGH, seed=8)))
    cut = depths_of(dataclasses.replace(ROUGH, shallowest_m=58.0, deepest_m=61.0))
    assert (cut.min(), cut.max()) == (58.0, 61.0)
    wide = dataclasses.replace(ROUGH, reach_m=None)
    assert 2 * wide.compile(3600.0)[3] == pytest.approx(-2 * 1.5 * 3600.0, rel=0.02)
    with pytest.raises(FloorError, match="longer length_m, or a smaller reach_m"):
        wide.compile(100 * 3600.0)


def test_descriptions_rebuild_equal_floors():
    for floor in (FlatFloor(depth_m=80.0), GRID, ROUGH):
        assert floor_from_dict(floor.describe()) == floor
    with pytest.raises(FloorError, match="did you mean 'depth_m'"):
        floor_from_dict({"kind": "flat", "depth": 3.0})


def test_texts():
    assert parse_floor("none") is None
    assert parse_floor("depth:200") == FlatFloor(depth_m=200.0)
    floor = parse_floor("maps/GEBCO.nc,reach=2e4,positive=up")
    assert floor == Bathymetry(path="maps/GEBCO.nc", reach_m=2e4, positive="up")
    assert (
        parse_floor("rough:60,height=3,length=250,slope=0.01,toward=30,seed=7,reach=3e3") == ROUGH
    )
    for text, told in (
        ("rough:60,hight=3", "did you mean 'height'"),
        ("rough:60,seed=1.5", "must be a whole number"),
        ("rough:60,deepest=50", r"depth_m = 60 m must lie between"),
        ("rough:60,length=1", "at least 2 m"),
        ("deep:200", "depth:METRES"),
        ("depth:deep", "must be a number"),
        ("a.nc,reech=3", "did you mean 'reach'"),
        ("a.nc,reach", "NAME=VALUE"),
        ("a.nc,positive=north", "allowed: down, up"),
    ):
        with pytest.raises(FloorError, match=told):
            parse_floor(text)


def test_refusals_of_grids_teach():
    for changed, told in (
        ({"depth_m": DEPTH.T}, "transpose it"),
        ({"north_m": NORTH[::-1]}, "rise by"),
        ({"depth_m": np.full((5, 4), np.nan)}, "not finite"),
        ({"depth_m": DEPTH * 1000}, "wrong units"),
    ):
        with pytest.raises(FloorError, match=told):
            dataclasses.replace(GRID, **changed)
    with pytest.raises(FloorError, match="above 0"):
        FlatFloor(depth_m=0.0)


@pytest.mark.parametrize("name", ROUGH_SETTINGS)
def test_page_and_help_have_every_setting_of_a_rough_floor_with_its_default(name):
    field = ROUGH_SETTINGS[name]
    default = next(f.default for f in dataclasses.fields(RoughFloor) if f.name == field)
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{name}` |"))
    assert f"`{field}`" in row
    told = "".join(inspect.getsource(Simulate).split())
    if default is None:  # of reach: it follows from the mission
        assert f"{name}=METRES" in told
        assert "| what the mission can cover" in row
    else:
        assert f"| {float(default):g} |" in row
        assert f",{name}={float(default):g}" in told.replace("[,", ",")


@pytest.mark.parametrize(
    ("name", "sign", "other"), [("bathymetry", -1.0, "up"), ("elevation", 1.0, "down")]
)
def test_a_floor_upside_down_is_told_how_it_turns(tmp_path, name, sign, other):
    """The advice is the sense that the file was not read in, and following it helps."""
    path = str(tmp_path / "floor.nc")
    gebco(LAT, LON, name=name, sign=sign).to_netcdf(path)
    start = Start(latitude=36.8, longitude=-121.9)
    with pytest.raises(FloorError, match=rf"on land, \d+ m above.* say positive={other}\)"):
        floor_table(Scenario(floor=Bathymetry(path=path), start=start), 600.0)
    turned = Scenario(floor=Bathymetry(path=path, positive=other), start=start)
    assert floor_table(turned, 600.0).size
