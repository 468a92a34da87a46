"""Temperature and salinity of a gridded current's file, along a track and as a column."""

from pathlib import Path

import gsw
import numpy as np
import pytest
import xarray as xr

import twin
from twin.errors import CurrentError, InputError
from twin.water.current import parse_current
from twin.water.current.axes import Origin
from twin.water.current.hydrography import along_track, column

PLACE = Origin(latitude_deg=49.0, longitude_deg=-16.0)
DEPTH = np.array([0.0, 50.0, 200.0])
LATITUDE, LONGITUDE = np.array([48.8, 49.0, 49.2]), np.array([-16.2, -16.0, -15.8])


def file(
    folder: Path, *, temperature="sea_water_potential_temperature", salinity="sea_water_salinity",
    factor=1.0,
) -> str:  # fmt: skip
    """Water 1 degree warmer per degree north, an hour apart in time by 2 degrees."""
    shape = (2, 3, 3, 3)
    t, z, n, e = np.meshgrid([0.0, 1.0], DEPTH, LATITUDE, LONGITUDE, indexing="ij")
    warm = 12.0 - 0.02 * z + (n - 49.0) + 2.0 * t
    salt = 35.0 + 0.001 * z + 0.1 * (e + 16.0)
    dimensions = ("time", "depth", "latitude", "longitude")
    speed = {"units": "m s-1"}
    data = {
        "uo": (dimensions, np.full(shape, 0.1), speed),
        "vo": (dimensions, np.zeros(shape), speed),
    }
    if temperature:
        data["thetao"] = (dimensions, factor * warm, {"standard_name": temperature})
        data["so"] = (dimensions, salt, {"standard_name": salinity})
    axes = {
        "time": ("time", [0.0, 3600.0], {"units": "seconds since 2000-01-01"}),
        "depth": ("depth", DEPTH, {"units": "m", "positive": "down"}),
        "latitude": ("latitude", LATITUDE, {"units": "degrees_north"}),
        "longitude": ("longitude", LONGITUDE, {"units": "degrees_east"}),
    }
    path = folder / "water.nc"
    xr.Dataset(data, axes).to_netcdf(path)
    return f"grid:{path},lat=49,lon=-16"


def test_along_a_track_it_is_the_file_in_place_and_time(tmp_path):
    current = parse_current(file(tmp_path) + "+uniform:0.1,0")
    time, depth = np.array([0.0, 1800.0, 3600.0]), np.array([0.0, 25.0, 100.0])
    north, east = 1000.0 * np.arange(3.0), np.zeros(3)
    temperature, salinity = along_track(current, time, north, east, depth, PLACE)
    latitude = 49.0 + np.degrees(north / PLACE.meridian_radius)
    potential = 12.0 - 0.02 * depth + (latitude - 49.0) + 2.0 * time / 3600.0
    pressure = gsw.p_from_z(-depth, 49.0)
    absolute = gsw.SA_from_SP(35.0 + 0.001 * depth, pressure, -16.0, 49.0)
    in_situ = gsw.pt_from_t(absolute, temperature, pressure, 0.0)  # back to what the file holds
    assert in_situ == pytest.approx(potential, abs=1e-6)
    assert salinity == pytest.approx(35.0 + 0.001 * depth, abs=1e-9)


def test_what_the_file_calls_its_water_is_heeded(tmp_path):
    still = np.zeros(1)
    deep = np.array([200.0])
    kinds = {}
    for name in ("sea_water_temperature", "sea_water_conservative_temperature"):
        current = parse_current(file(tmp_path, temperature=name))
        kinds[name] = along_track(current, still, still, still, deep, PLACE)[0][0]
    assert kinds["sea_water_temperature"] == pytest.approx(8.0)
    assert abs(kinds["sea_water_conservative_temperature"] - 8.0) > 1e-3
    absolute = parse_current(file(tmp_path, salinity="sea_water_absolute_salinity"))
    salinity = along_track(absolute, still, still, still, deep, PLACE)[1][0]
    assert salinity == pytest.approx(35.2 - 0.169, abs=0.01)  # 35.165 g/kg is 35 of PSS-78


def test_a_file_of_velocity_alone_has_none(tmp_path):
    bare = parse_current(file(tmp_path, temperature=""))
    assert column(bare, PLACE) is None
    assert along_track(parse_current("uniform:0.1,0"), *np.zeros((4, 2)), PLACE) is None
    assert column(None, PLACE) is None


def test_kelvin_is_refused(tmp_path):
    hot = parse_current(file(tmp_path, factor=30.0))
    with pytest.raises(CurrentError, match=r"a temperature or salinity of .* is beyond 60"):
        column(hot, PLACE)


def test_a_mission_measures_the_water_of_its_current(tmp_path):
    text = file(tmp_path)
    start = {"latitude": 49.0, "longitude": -16.0, "time": "2000-01-01"}
    current = text.split(",")[0]
    run = twin.simulate(current=current, start=start, duration=600.0, sensors="ideal")
    depth, seconds = run["true_depth"], run.time
    potential = 12.0 - 0.02 * depth + 2.0 * seconds / 3600.0
    assert run["measured_temperature"] == pytest.approx(potential, abs=0.05)
    assert (run["true_density"] == 1025.0).all()  # what it flies in is what --density says
    own = twin.simulate(
        current=current, start=start, duration=600.0, density="grid", sensors="ideal"
    )
    assert own["true_density"][0] == pytest.approx(gsw.rho_t_exact(35.165, 12.0, 0.0), abs=0.02)
    assert own["measured_density"] == pytest.approx(own["true_density"])
    with pytest.raises(InputError, match="made of a current's file"):
        twin.parse_density("grid")
    with pytest.raises(InputError, match="density 'grid' is that of the current's file"):
        twin.simulate(density="grid", duration=60.0)
