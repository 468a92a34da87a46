"""Gridded currents: every layout gives the same water, every trap is caught or refused."""

import math
import shutil
from pathlib import Path

import netCDF4
import numpy as np
import pymap3d
import pytest
import xarray as xr

from twin.errors import CurrentError
from twin.water.current import Grid, Origin, current_from_dict, parse_current
from twin.water.current.grid import beyond_grid
from twin.water.current.hydrography import along_track
from twin.water.current.sampler import sample, sample_track

START = {"latitude_deg": 49.1, "longitude_deg": -16.1, "time": "2000-01-05T06:00"}
TIMES = np.datetime64("2000-01-04T12:00", "ns") + np.arange(4) * np.timedelta64(1, "D")
DEPTH = np.array([0.5, 10.0, 50.0, 200.0, 1000.0])
LATITUDE = 48.0 + 0.25 * np.arange(9)
LONGITUDE = -17.0 + 0.25 * np.arange(9)
DURATION = 36_000.0


def field(time, depth, latitude, longitude):
    """East and north velocity, multilinear: linear interpolation must reproduce it exactly."""
    days = (time - TIMES[0]) / np.timedelta64(1, "D")
    days, depth, latitude, longitude = np.meshgrid(days, depth, latitude, longitude, indexing="ij")
    east = 0.1 + 0.02 * days - 1e-4 * depth + 0.1 * (latitude - 49.0) + 0.2 * (longitude + 16.0)
    return east, -0.5 * east + 0.05 * days


def copernicus(**changes) -> xr.Dataset:
    """The layout of Copernicus Marine files; `changes` replace its coordinates."""
    axes = {"time": TIMES, "depth": DEPTH, "latitude": LATITUDE, "longitude": LONGITUDE, **changes}
    east, north = field(*axes.values())
    names = {"uo": ("eastward", east), "vo": ("northward", north)}
    data = xr.Dataset(
        {
            name: (tuple(axes), values, {"standard_name": f"{way}_sea_water_velocity",
                                          "units": "m s-1"})
            for name, (way, values) in names.items()
        },
        coords=axes,
    )  # fmt: skip
    data["depth"].attrs = {"units": "m", "positive": "down", "axis": "Z"}
    return data


def write(data: xr.Dataset, tmp_path, **options) -> str:
    path = tmp_path / "current.nc"
    data.to_netcdf(path, **options)
    return str(path)


def plain(data: xr.Dataset, east: str, north: str, units: str = "m/s") -> xr.Dataset:
    """Other variable names and no standard_name."""
    data = data.rename({"uo": east, "vo": north})
    for name in (east, north):
        data[name].attrs = {"units": units}
    return data


def packed(tmp_path):
    encoding = {v: {"dtype": "int16", "scale_factor": 1e-4, "_FillValue": -32767}
                for v in ("uo", "vo")}  # fmt: skip
    return write(copernicus(), tmp_path, encoding=encoding)


def hycom(tmp_path):
    data = plain(copernicus(), "water_u", "water_v").rename(latitude="lat", longitude="lon")
    data = data.assign_coords(lon=data.lon % 360.0)
    # HYCOM's second time cannot be decoded: it counts from "analysis".
    data["tau"] = ("time", np.zeros(4), {"units": "hours since analysis"})
    encoding = {v: {"dtype": "int16", "scale_factor": 0.001, "_FillValue": -30000}
                for v in ("water_u", "water_v")}  # fmt: skip
    encoding["time"] = {"units": "hours since 2000-01-01 00:00:00"}
    return write(data, tmp_path, encoding=encoding)


def centimetres(tmp_path):
    data = copernicus() * 100.0
    for name in ("uo", "vo"):
        data[name].attrs = {"units": "cm/s"}
    return write(data.rename(uo="U", vo="V"), tmp_path)


def standard_name_over_alias(tmp_path):
    """A variable called u that is not the current must not win over the standard name."""
    data = copernicus().rename(uo="flow_x", vo="flow_y")
    data["u"] = (("time",), np.ones(4), {"units": "m/s", "standard_name": "eastward_wind"})
    return write(data, tmp_path)


def nemo_names(tmp_path):
    """Raw NEMO names on a regular grid, land written as 0, u and v on depthu and depthv."""
    data = plain(copernicus(), "vozocrtx", "vomecrty")
    data = data.where(data.longitude < -15.2, 0.0)
    for name, way in (("vozocrtx", "u"), ("vomecrty", "v")):
        data[name].attrs = {"units": "m/s"}
        data[name] = data[name].rename(depth=f"depth{way}")
    return write(data.drop_vars("depth").rename(time="time_counter"), tmp_path)


def zarr(folder, name, version):
    copernicus().to_zarr(folder / name, zarr_format=version, consolidated=version == 2)
    return str(folder / name)


LAYOUTS = {
    "packed": packed,
    "hycom": hycom,
    "turned axes": lambda folder: write(
        copernicus().isel(depth=slice(None, None, -1), latitude=slice(None, None, -1),
                          time=[2, 0, 3, 1]).transpose("longitude", "time", "latitude", "depth"),
        folder),
    "upward depth": lambda folder: write(
        copernicus().assign_coords(depth=("depth", -DEPTH, {"units": "m", "positive": "up"})),
        folder),
    "negative depth": lambda folder: write(copernicus().assign_coords(depth=-DEPTH), folder),
    "centimetres": centimetres,
    "zarr store": lambda folder: zarr(folder, "current.zarr", 3),
    "zarr directory of another name": lambda folder: zarr(folder, "store", 2),
    "standard name over alias": standard_name_over_alias,
    "nemo names": nemo_names,
    # dimensions y and x with one-dimensional coordinates of other names
    "auxiliary coordinates": lambda folder: write(
        copernicus().rename_dims(latitude="y", longitude="x")
        .reset_index(["latitude", "longitude"]), folder),
    "an ensemble axis of one": lambda folder: write(copernicus().expand_dims("member"), folder),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_water(layout, tmp_path):
    path = LAYOUTS[layout](tmp_path)
    depth = np.array([0.5, 30.0, 700.0])
    u = Grid(path=path, **START).velocity(18_000.0, 0.0, 0.0, depth)
    time = np.array([np.datetime64("2000-01-05T11:00", "ns")])
    east, north = field(time, depth, np.array([49.1]), np.array([-16.1]))
    # int16 at 0.001 m/s rounds by half a step.
    np.testing.assert_allclose(u[:, 1], east.ravel(), atol=6e-4)
    np.testing.assert_allclose(u[:, 0], north.ravel(), atol=6e-4)
    np.testing.assert_array_equal(u[:, 2], 0.0)


@pytest.mark.parametrize("latitude", [49.1, -62.0, 0.1])
def test_metres_become_degrees_as_in_pymap3d(tmp_path, latitude):
    """A velocity that says where it is: within 1 m over 20 km of the tangent plane."""
    lat = latitude + 0.25 * np.arange(-4, 5) + 0.07
    lon = -16.1 + 0.25 * np.arange(-4, 5)
    metres = 111e3
    data = copernicus(latitude=lat, longitude=lon)
    data["uo"][:] = (data.longitude + 16.1).values
    data["vo"][:] = (data.latitude - latitude).values[:, None]
    grid = Grid(path=write(data, tmp_path), **{**START, "latitude_deg": latitude})
    angle = np.radians(np.arange(0.0, 360.0, 30.0))
    for distance, tolerance in ((2e3, 0.05), (2e4, 1.0)):
        north, east = distance * np.cos(angle), distance * np.sin(angle)
        u = grid.velocity(0.0, north, east, 10.0)
        judge = pymap3d.ned2geodetic(north, east, 0.0, latitude, -16.1, 0.0)
        error_n = (u[:, 0] - (judge[0] - latitude)) * metres
        error_e = (u[:, 1] - (judge[1] + 16.1)) * metres * math.cos(math.radians(latitude))
        assert np.hypot(error_n, error_e).max() < tolerance


@pytest.mark.parametrize("start", [179.9, -179.9, 180.0, -180.0, 180.1])
@pytest.mark.parametrize("convention", [180.0, 0.0])
def test_the_dateline_is_no_edge(tmp_path, start, convention):
    """Files in -180..180 and in 0..360 across the dateline, the same from either side of it."""
    relative = 0.25 * np.arange(-8, 9)
    lon = (180.0 + relative + convention) % 360.0 - convention
    data = copernicus(longitude=lon)
    data["uo"][:] = 0.1 * relative
    data["vo"][:] = 0.0
    grid = Grid(path=write(data.sortby("longitude"), tmp_path), latitude_deg=49.1,
                longitude_deg=start, time="2000-01-05")  # fmt: skip
    east = np.array([-20_000.0, 0.0, 20_000.0])
    u = grid.velocity(0.0, 0.0, east, 10.0)[:, 1]
    degree = 0.1 / (111.4e3 * math.cos(math.radians(49.1)))
    np.testing.assert_allclose(u, 0.1 * ((start % 360.0) - 180.0) + degree * east, atol=1e-4)


def test_a_global_file_with_a_repeated_meridian(tmp_path):
    lon = np.arange(0.0, 361.0, 5.0)
    data = copernicus(longitude=lon, latitude=np.arange(30.0, 70.0, 5.0))
    data["uo"][:] = np.cos(np.radians(lon))
    data["vo"][:] = 0.0
    grid = Grid(path=write(data, tmp_path), latitude_deg=49.1, longitude_deg=-0.001)
    u = grid.velocity(0.0, 0.0, [-50_000.0, 50_000.0], 1.0)[:, 1]
    np.testing.assert_allclose(u, 1.0, atol=5e-3)


@pytest.mark.parametrize(
    ("attributes", "sign"),
    [
        ({"standard_name": "upward_sea_water_velocity"}, -1.0),
        ({"standard_name": "downward_sea_water_velocity"}, 1.0),
        ({}, -1.0),
    ],
)
def test_vertical_velocity_is_positive_down(tmp_path, attributes, sign):
    data = copernicus()
    data["w"] = (data.uo.dims, np.full(data.uo.shape, 0.01), {"units": "m/s", **attributes})
    path = write(data, tmp_path)
    assert Grid(path=path, **START).velocity(0, 0, 0, 5.0)[2] == pytest.approx(sign * 0.01)
    assert Grid(path=path, up="none", **START).velocity(0, 0, 0, 5.0)[2] == 0.0


def test_the_shallowest_and_deepest_levels_are_held(tmp_path):
    grid = Grid(path=write(copernicus(), tmp_path), **START)
    u = grid.velocity(0.0, 0.0, 0.0, [-1.0, 0.0, 0.5, 1000.0, 4000.0])
    np.testing.assert_array_equal(u[0], u[2])
    np.testing.assert_array_equal(u[3], u[4])
    rate = sample(grid.compile(DURATION), 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.3)[3:]
    steady = sample(grid.compile(DURATION), 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0)[3:]
    assert rate == steady


def test_water_next_to_land_and_bottom_is_not_slowed(tmp_path):
    """Missing nodes take the nearest water's velocity: a uniform field stays uniform."""
    data = copernicus()
    dry = (data.longitude > -15.7) | ((data.depth > 100) & (data.latitude < 49.3))
    data["uo"] = data.uo.copy(data=np.full(data.uo.shape, 0.2)).where(~dry)
    data["vo"] = data.vo.copy(data=np.full(data.vo.shape, -0.1)).where(~dry)
    grid = Grid(path=write(data, tmp_path), **START)
    program = grid.compile(DURATION)
    random = np.random.default_rng(3)
    n = 200
    t, north, east, depth = (random.uniform(*r, n) for r in ((0, DURATION), (-2e4, 2e4),
                                                             (-2e4, 5e4), (0, 2000)))  # fmt: skip
    out = sample_track(program, t, north, east, depth, *np.ones((3, n)))
    np.testing.assert_allclose(out[:, 0], -0.1, atol=1e-7)
    np.testing.assert_allclose(out[:, 1], 0.2, atol=1e-7)
    np.testing.assert_allclose(out[:, 3:], 0.0, atol=1e-10)


def test_missing_neighbours_spread_sideways_from_water(tmp_path):
    """A dry column takes the mean of its wet neighbours, not zero and not a wrapped column."""
    data = copernicus()
    dry = (data.longitude == -17.0) & (data.latitude == 48.0)
    data = data.where(~dry).transpose(*copernicus().uo.dims)
    box, _ = Grid(path=write(data, tmp_path), reach_m=3e5, **START).load(DURATION)
    corner = box.velocity[:, :, 0, 0]
    np.testing.assert_allclose(
        corner, 0.5 * (box.velocity[:, :, 1, 0] + box.velocity[:, :, 0, 1]), rtol=1e-6
    )


def test_start_on_land_says_where_the_water_is(tmp_path):
    data = copernicus()
    data = data.where(data.longitude < -16.3).transpose(*copernicus().uo.dims)
    for name in ("uo", "vo"):
        data[name].attrs = copernicus()[name].attrs
    path = write(data, tmp_path)
    with pytest.raises(CurrentError, match=r"is on land; the nearest water is lat=49.0000,lon=-16"):
        Grid(path=path, **START).compile(DURATION)
    far = {**START, "longitude_deg": -15.1}
    with pytest.raises(CurrentError, match=r"no water within reach"):
        Grid(path=path, reach_m=1000.0, **far).compile(DURATION)


def test_zero_around_the_start_asks_what_it_means(tmp_path):
    data = copernicus()
    for name in ("uo", "vo"):
        data[name][:] = data[name].where(data.longitude < -16.3, 0.0)
    path = write(data, tmp_path)
    with pytest.raises(CurrentError, match=r"exactly 0 .* land=zero .* land=nan"):
        Grid(path=path, **START).compile(DURATION)
    with pytest.raises(CurrentError, match="is on land"):
        Grid(path=path, land="zero", **START).compile(DURATION)
    still = Grid(path=path, land="nan", **START).velocity(0, 0, 0, 5.0)
    np.testing.assert_array_equal(still, 0.0)


def test_only_the_box_the_vehicle_can_reach_is_loaded(tmp_path):
    path = write(copernicus(), tmp_path)
    grid = Grid(path=path, **START)
    box, pinned = grid.load(3600.0)
    assert box.velocity.shape == (2, 5, 2, 2, 2)
    assert pinned.reach_m >= 3600.0 * (1.0 + np.abs(box.velocity).max())
    fast = copernicus()
    fast["uo"][:] = 4.0
    box, _ = Grid(path=write(fast, tmp_path), **START).load(3600.0)
    reach = np.radians(box.longitude) * 6.39e6 * math.cos(math.radians(49.1))
    assert reach[0] < -3600.0 * 5.0
    assert reach[-1] > 3600.0 * 5.0
    assert box.longitude.size < LONGITUDE.size


def test_a_track_beyond_the_file_is_told(tmp_path):
    program = parse_current(
        f"uniform:0.1,0+grid:{write(copernicus(), tmp_path)},lat=49.1,lon=-16.1,reach=1e6"
    ).compile(3600.0)
    degree = 111.2e3
    north = degree * np.array([0.0, 0.85, 0.95, -1.05, -1.15])
    np.testing.assert_array_equal(
        beyond_grid(program, north, np.zeros(5)), [False, False, True, False, True]
    )
    assert not beyond_grid(parse_current("uniform:0.1,0").compile(1.0), north, north).any()
    # One water column has no sides.
    column = copernicus().isel(latitude=4, longitude=3, time=0)
    path = write(column, tmp_path)
    assert not beyond_grid(Grid(path=path).compile(1.0), 1e6 * north, north).any()


def test_time_range_and_hold(tmp_path):
    path = write(copernicus(), tmp_path)
    place = {"latitude_deg": 49.1, "longitude_deg": -16.1}
    early = Grid(path=path, time="2000-01-04T11:30", **place)
    np.testing.assert_array_equal(early.velocity(0, 0, 0, 5), early.velocity(1800, 0, 0, 5))
    for grid in (
        Grid(path=path, time="2000-01-04T10:30", **place),
        Grid(path=path, time="2000-01-07T12:00", **place),
        Grid(path=path, time="2015-06-01", **place),
    ):
        with pytest.raises(
            CurrentError, match=r"2000-01-04T12:00:00 to 2000-01-07T12:00:00; choose time="
        ):
            grid.compile(DURATION)
    held = Grid(path=path, time="2000-01-07T12:00", hold_s=86_400.0, **place)
    np.testing.assert_array_equal(held.velocity(0, 0, 0, 5), held.velocity(DURATION, 0, 0, 5))


def test_without_a_time_the_mission_starts_with_the_file_or_the_origin(tmp_path):
    path = write(copernicus(), tmp_path)
    place = {"latitude_deg": 49.1, "longitude_deg": -16.1}
    first = Grid(path=path, **place)
    assert first.pinned(60.0).time == "2000-01-04T12:00:00.000000000"
    origin = Origin(**START)
    np.testing.assert_array_equal(
        Grid(path=path).velocity(0, 0, 0, 5, origin), Grid(path=path, **START).velocity(0, 0, 0, 5)
    )


def test_a_snapshot_is_steady_and_a_surface_field_holds_at_depth(tmp_path):
    snapshot = Grid(path=write(copernicus().isel(time=0, depth=[0]), tmp_path), **START)
    u = snapshot.velocity([0.0, 1e6], 0, 0, [0.0, 900.0])
    np.testing.assert_array_equal(u[0], u[1])
    one_time = copernicus().isel(time=[0], depth=0)
    wrong = Grid(path=write(one_time, tmp_path), **START)
    with pytest.raises(CurrentError, match=r"the only time of .*grid:FILE,hold="):
        wrong.compile(60.0)
    right = Grid(path=write(one_time, tmp_path), **{**START, "time": "2000-01-04T12:10"})
    u = right.velocity([0.0, 1e6], 0, 0, [0.0, 900.0])
    np.testing.assert_array_equal(u[0], u[1])


def test_one_water_column_serves_every_place(tmp_path):
    column = copernicus().isel(latitude=4, longitude=3)
    u = Grid(path=write(column, tmp_path), **START).velocity(0, [0.0, 9e4], 0, 20.0)
    np.testing.assert_array_equal(u[0], u[1])
    assert u[0, 1] != 0.0


def test_description_replays_the_same_bytes_and_notices_another_file(tmp_path):
    path = write(copernicus(), tmp_path)
    text = f"grid:{path},lat=49.1,lon=-16.1,time=2000-01-05+uniform:0.1,0"
    current = parse_current(text)
    pinned = current.pinned(DURATION)
    rebuilt = current_from_dict(pinned.describe())
    assert rebuilt.compile(DURATION).tobytes() == current.compile(DURATION).tobytes()
    settings = pinned.describe()["parts"][0]
    assert settings["path"] == path
    assert settings["east"] == "uo"
    assert settings["north"] == "vo"
    assert settings["time"].startswith("2000-01-05T00:00:00")
    assert len(settings["sha256"]) == 64
    # A shorter mission of the same store reads the same box.
    assert rebuilt.compile(60.0).tobytes() == rebuilt.compile(DURATION).tobytes()
    with pytest.raises(CurrentError, match="span_s covers 36000 s"):
        rebuilt.compile(2 * DURATION)
    changed = copernicus()
    changed["uo"][1, 2, 4, 4] += 0.01
    write(changed, tmp_path)
    with pytest.raises(CurrentError, match="does not hold the recorded current any more"):
        rebuilt.compile(DURATION)


def refuse_curvilinear():
    data = copernicus().rename_dims(latitude="y", longitude="x")
    data = data.reset_index(["latitude", "longitude"]).reset_coords(drop=True)
    lat, lon = np.meshgrid(LATITUDE, LONGITUDE, indexing="ij")
    return data.assign_coords(time=TIMES, depth=DEPTH, nav_lat=(("y", "x"), lat),
                              nav_lon=(("y", "x"), lon))  # fmt: skip


def refuse_roms():
    data = plain(copernicus(), "u", "v")
    data["depth"].attrs = {"standard_name": "ocean_s_coordinate_g2", "axis": "Z"}
    return data.rename(depth="s_rho", latitude="eta_u", longitude="xi_u", time="ocean_time")


def refuse_projected():
    data = copernicus().rename(latitude="Y", longitude="X")
    for axis in "XY":
        data[axis].attrs = {"standard_name": f"projection_{axis.lower()}_coordinate", "units": "km"}
    return data


def refuse_grid_relative():
    data = copernicus().rename(uo="u", vo="v")
    data["u"].attrs["standard_name"] = "x_sea_water_velocity"
    data["v"].attrs["standard_name"] = "y_sea_water_velocity"
    return data


def refuse_staggered():
    data = copernicus()
    data["vo"] = data.vo.assign_coords(latitude=LATITUDE + 0.125).rename(latitude="lat_v")
    return data


def refuse_staggered_w():
    data = copernicus()
    w = data.uo.assign_coords(depth=DEPTH + 1.0).rename(depth="depthw")
    data["wo"] = w.assign_attrs(standard_name="upward_sea_water_velocity")
    return data


def refuse_pressure():
    data = copernicus().rename(depth="pres")
    data["pres"].attrs = {"standard_name": "sea_water_pressure", "units": "dbar"}
    return data


def changed(name, **attributes):
    """A file whose variable has other attributes; None: it lacks them."""
    data = copernicus()
    data[name].attrs |= attributes
    data[name].attrs = {k: v for k, v in data[name].attrs.items() if v is not None}
    return data


def undeclared_fill():
    data = copernicus()
    data["uo"][:, -1] = 1e20
    return data


REFUSED = {
    "curvilinear": (refuse_curvilinear, r"two-dimensional coordinate 'nav_lat'.*regrid"),
    "roms": (refuse_roms, r"terrain-following levels 's_rho'; interpolate"),
    "projected": (refuse_projected, r"projected grid \(dimension 'Y'\).*rotate"),
    "relative": (refuse_grid_relative, r"'u' is relative to the model's own axes.*rotate"),
    "staggered": (refuse_staggered, r"'uo' and 'vo' have different latitude points"),
    "staggered w": (refuse_staggered_w, r"different depth points.*or leave it out with w=none"),
    "pressure": (refuse_pressure, r"given at pressure 'pres'; convert it to depth"),
    "no units": (
        lambda: changed("vo", units=None),
        r"'vo' has no units attribute; say units=m/s or units=cm/s"),
    "knots": (lambda: changed("uo", units="knots"), r"unknown velocity units 'knots'"),
    "temperature only": (
        lambda: plain(copernicus(), "thetao", "so"),
        r"no variable with standard_name eastward_sea_water_velocity.*it holds so, thetao"),
    "fill": (undeclared_fill, r"speed of 1e\+20 m/s is beyond 10 m/s.*_FillValue"),
    "two": (
        lambda: copernicus().assign(first=copernicus().uo, second=copernicus().uo).drop_vars("uo"),
        r"first, second all have standard_name .*choose one with u=NAME"),
    "calendar": (
        lambda: copernicus().convert_calendar("noleap", use_cftime=True),
        r"calendar 'noleap'; convert it to the standard calendar"),
    "no epoch": (
        lambda: copernicus().assign_coords(time=np.arange(4.0)),
        r"'time' has units '', not e.g. 'hours since 2000-01-01'"),
    "mixed depth": (
        lambda: copernicus().assign_coords(depth=[-5.0, 0.0, 10.0, 50.0, 100.0]),
        r"mixes depths below and heights above the surface"),
    "all missing": (
        lambda: copernicus() * np.nan, r"no variable with standard_name|no water within reach"),
    "repeated time": (
        lambda: copernicus().assign_coords(time=TIMES[[0, 1, 1, 2]]), r"'time' repeats a time"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_teach(name, tmp_path):
    build, message = REFUSED[name]
    path = write(build(), tmp_path)
    with pytest.raises(CurrentError, match=message) as caught:
        Grid(path=path, **START).compile(DURATION)
    assert "current.nc" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("cells", "inside"), [(1.0, True), (1.4, True), (1.6, False), (2.0, False), (5.0, False)]
)
def test_a_start_where_the_longitudes_leave_a_gap_is_outside(tmp_path, cells, inside):
    """A file that goes round the Earth leaves one open cell, where linear interpolation joins its
    two ends. A cell that lacks a meridian is twice as wide, and no longer one of the grid's."""
    cell = 30.0
    end = 180.0 - cells * cell
    longitude = np.append(np.arange(-180.0, end - 0.1, cell), end)
    data = copernicus(longitude=longitude)
    for name in ("uo", "vo"):
        data[name][:] = 0.1
    start = {**START, "longitude_deg": 180.0 - 0.5 * cells * cell}
    grid = Grid(path=write(data, tmp_path), **start)
    if inside:
        np.testing.assert_allclose(grid.velocity(0.0, 0.0, 0.0, 5.0)[:2], 0.1)
    else:
        with pytest.raises(CurrentError, match=r"start longitude .* is outside"):
            grid.compile(3600.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"latitude_deg": 20.0}, r"start latitude 20 is outside 48..50 degree north"),
        ({"longitude_deg": -30.0}, r"start longitude -30 is outside -17..-15 degree east"),
        ({"longitude_deg": 164.0}, r"start longitude 164 is outside -17..-15 degree east"),
        ({"east": "uoo"}, r"unknown variable 'uoo': did you mean 'uo'"),
        ({"units": "furlong"}, r"unknown velocity units 'furlong'"),
    ],
)
def test_settings_that_do_not_fit_the_file(tmp_path, settings, message):
    path = write(copernicus(), tmp_path)
    with pytest.raises(CurrentError, match=message):
        Grid(path=path, **{**START, **settings}).compile(DURATION)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(CurrentError, match=r"no current file .*missing.nc"):
        Grid(path=str(tmp_path / "missing.nc"), **START).compile(DURATION)
    broken = tmp_path / "broken.nc"
    broken.write_bytes(b"not a netCDF file")
    with pytest.raises(
        CurrentError, match=r"cannot read .*broken.nc as CF netCDF or zarr: its content is neither"
    ) as caught:
        Grid(path=str(broken), **START).compile(DURATION)
    assert "\n" not in str(caught.value)
    nothing = tmp_path / "nothing.nc"
    nothing.touch()
    with pytest.raises(CurrentError, match=r"nothing.nc is empty \(0 bytes\): copy or download"):
        Grid(path=str(nothing), **START).compile(DURATION)
    empty = tmp_path / "empty.zarr"
    empty.mkdir()
    with pytest.raises(CurrentError, match=r"empty.zarr"):
        Grid(path=str(empty), **START).compile(DURATION)
    shutil.rmtree(empty)


def test_a_box_too_large_for_memory_is_refused_before_reading(tmp_path, monkeypatch):
    monkeypatch.setattr("twin.water.current.box.LARGEST_BOX", 1000)
    with pytest.raises(CurrentError, match=r"set reach=METRES"):
        Grid(path=write(copernicus(), tmp_path), **START).compile(DURATION)


def edited(tmp_path, name: str, attribute: str, value) -> str:
    """A sound file but for one attribute."""
    path = write(copernicus(), tmp_path, encoding={"uo": {"_FillValue": None}})
    with netCDF4.Dataset(path, "a") as file:
        file[name].setncattr(attribute, value)
    return path


@pytest.mark.parametrize("attribute", ["scale_factor", "add_offset"])
@pytest.mark.parametrize("value", ["evil", ""])
def test_a_packing_that_is_no_number_is_named(attribute, value, tmp_path):
    path = edited(tmp_path, "uo", attribute, value)
    with pytest.raises(CurrentError, match=f"attribute {attribute} of 'uo' is .* not a number"):
        parse_current(f"grid:{path}").load(DURATION, Origin(**START))


def test_an_attribute_of_another_kind_is_a_line(tmp_path):
    path = edited(tmp_path, "uo", "standard_name", [1.0, 2.0])
    with pytest.raises(CurrentError, match=r"current\.nc is damaged") as raised:
        parse_current(f"grid:{path}").load(DURATION, Origin(**START))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("name", ["uo", "thetao"])
def test_damage_that_shows_when_values_are_read_is_a_line(name, tmp_path):
    data = copernicus()
    for offset, other, standard in (
        (10.0, "thetao", "sea_water_potential_temperature"),
        (30.0, "so", "sea_water_practical_salinity"),
    ):
        data[other] = data["uo"] + offset
        data[other].attrs = {"standard_name": standard}
    path = write(data, tmp_path, encoding={name: {"fletcher32": True}})
    whole, values = Path(path).read_bytes(), data[name].values.tobytes()
    assert whole.count(values) == 1
    place = whole.index(values)
    Path(path).write_bytes(whole[:place] + b"\xff" + whole[place + 1 :])
    grid, origin, rest = parse_current(f"grid:{path}"), Origin(**START), np.zeros((4, 2))
    read = {
        "uo": lambda: grid.load(DURATION, origin),
        "thetao": lambda: along_track(grid, *rest, origin),
    }
    with pytest.raises(CurrentError, match=r"current\.nc is damaged, its values cannot") as raised:
        read[name]()
    assert "\n" not in str(raised.value)
