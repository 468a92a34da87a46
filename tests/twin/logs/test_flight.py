"""`twin flight` on logs whose truth is known: speeds, water, currents, tracks, file, command."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from examples import needs_docs, own_type
from logs import SHARED, stored
from simulated_logs import simulated_flight

import twin
from factory.samples import Flight
from glider_twin_protocols.auv_samples import write_mat
from twin.__main__ import PROGRAM
from twin.errors import InputError, StoreError, UnknownName
from twin.geodesy import from_tangent_plane
from twin.identify.speed import motion_of
from twin.logs import estimate_flight, flight_dataset, write_flight
from twin.logs.flight_estimator import ESTIMATORS, FlightEstimator
from twin.logs.flight_summary import summarise
from twin.records.logged import CELLS
from twin.records.store import write_store
from twin.records.tracks import read_tracks
from twin.show.flight_figures import FLIGHT_FIGURES, write_flight_figures

CURRENT = (0.07, -0.04, -0.01)
"""[m/s] north, east, down: the water rises"""


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A flight with ideal sensors and the density that a CTD would have measured."""
    folder = tmp_path_factory.mktemp("flight")
    flown = simulated_flight(
        folder, "glider", sensors="ideal", current="uniform:" + ",".join(map(str, CURRENT))
    )
    data = xr.open_zarr(flown).load()
    data["measured_density"] = data["true_density"].copy()
    over = data["true_velocity_north"] + 1j * data["true_velocity_east"]
    turn = np.exp(-1j * np.radians(data["true_heading"]))
    past = ((over - complex(*CURRENT[:2])) * turn).expand_dims(cell=3, axis=2)
    data.update(zip(CELLS, (past.real, past.imag, 0.0 * past.real + [4.0, 8.0, 12.0]), strict=True))
    return write_store(data, folder / "store.zarr")


@pytest.fixture(scope="module")
def flight(store):
    return estimate_flight(store, profiles=True)


def truth(store: Path, name: str) -> np.ndarray:
    return xr.open_zarr(store)[f"true_{name}"].values[0].astype(float)


def test_the_velocities_are_the_true_ones(store, flight):
    dataset = flight_dataset(flight)
    for name, most in (("surge", 0.01), ("sway", 0.005), ("heave", 0.01)):
        error = dataset[name].values[0] - truth(store, name)
        deep = truth(store, "depth") > 5.0
        assert np.sqrt(np.mean(error[deep] ** 2)) < most, name
    alpha = np.degrees(np.arctan2(truth(store, "heave"), truth(store, "surge")))
    steady = np.abs(truth(store, "pitch")) > 15.0
    found = dataset["angle_of_attack"].values[0]
    assert np.nanmedian(np.abs(found - alpha)[steady]) < 0.3


def test_angles_say_by_how_much_the_velocities_correct_them(flight):
    turned = dataclasses.replace(
        flight.calibration,
        pitch_offset=np.radians(2.7),
        heading_cycles=(0.0, np.radians(-1.5), 0, 0),
    )
    dataset = flight_dataset(dataclasses.replace(flight, calibration=turned))
    assert "1 pitch +2.700 degree" in dataset["pitch"].attrs["comment"]
    assert "h +0.000 -1.500 sin(h) degree" in dataset["heading"].attrs["comment"]


def test_rising_water_is_found_in_dives_and_climbs(flight):
    summary = flight.summary()
    assert summary.w_mean_dive == pytest.approx(0.01, abs=0.002)
    assert summary.w_mean_climb == pytest.approx(0.01, abs=0.002)
    assert summary.w_deviation < 0.01
    assert summary.depth_rate_rmse >= summary.w_deviation
    assert set(summary.describe()) == {
        "w_mean_dive_m_s", "w_mean_climb_m_s", "w_sd_m_s", "depth_rate_rmse_m_s",
        "w_profile_difference_m_s",
    }  # fmt: skip


def test_a_vehicle_that_does_not_fit_is_suspect():
    depth = np.tile(np.arange(0.0, 100.0, 0.1), 2)
    down = np.arange(2000) < 1000
    for climbing, suspect in ((-0.03, True), (-0.004, False)):
        water = np.where(down, 0.0, climbing) * (depth > 50.0)
        dive = SimpleNamespace(water_up=water, descending=down, ascending=~down, depth=depth)
        found = summarise([dive])
        assert found.suspect is suspect
        # the means hide half of what the lower bins show
        assert found.w_profile_difference == pytest.approx(-climbing, rel=0.01)
        assert found.w_mean_climb == pytest.approx(climbing / 2.0, rel=0.01)
    large = dataclasses.replace(found, w_mean_dive=0.02, w_mean_climb=0.02)
    assert large.suspect


def test_the_current_of_each_dive_is_the_water_s(flight):
    assert flight.currents
    for one in flight.currents:
        assert abs(one.north - CURRENT[0]) < 3.0 * one.deviation
        assert abs(one.east - CURRENT[1]) < 3.0 * one.deviation
        assert one.deviation < 0.05


def test_the_current_of_each_depth_is_the_water_s(flight):
    data = flight_dataset(flight)
    for name, true in zip(("north", "east"), CURRENT, strict=False):
        assert (abs(data[f"profile_{name}"] - true) < 3.0 * data[f"profile_{name}_sd"]).all()
        assert float(data[f"profile_{name}_sd"].median()) < 0.03


def test_the_track_is_where_the_vehicle_was(store, flight):
    (one,) = flight.missions
    assert np.abs(one.position[one.fixes.sample] - one.fixes.position).max() < 1e-6
    true = np.stack([truth(store, "north"), truth(store, "east")], axis=1)
    error = np.hypot(*(one.position - true).T)
    assert error.max() < 30.0
    assert (error < 4.0 * one.deviation + 1.0).all()
    dataset = flight_dataset(flight)
    latitude, longitude = from_tangent_plane(*one.position.T, 49.0, -16.0)
    np.testing.assert_allclose(dataset["latitude"].values[0], latitude, atol=1e-9)
    np.testing.assert_allclose(dataset["longitude"].values[0], longitude, atol=1e-9)


def test_a_log_that_begins_under_way_has_no_phantom_water(store, flight, tmp_path):
    """Its first sample is of a vehicle in full flight, not of one at rest."""
    whole = xr.open_zarr(store).load()
    depth = whole["measured_depth"].values[0]
    first = int(np.argmax(depth > 20.0))
    cut = whole.isel(time=slice(first, None)).assign_coords(time=whole["time"][: -first or None])
    cut["n_samples"] = whole["n_samples"] - first
    found = estimate_flight(write_store(cut, tmp_path / "cut.zarr"))
    (one,) = found.missions
    known = np.isfinite(one.dive.water_up)
    assert known[30] or known[60]
    assert np.abs(one.dive.water_up[known][:40] - 0.01).max() < 0.02
    surge = one.dive.motion.surge[0]
    assert surge == pytest.approx(truth(store, "surge")[first], abs=0.05)


@pytest.mark.parametrize(("lost", "tells"), [(0.03, True), (0.4, False)])
def test_a_dive_that_has_no_attitude_for_long_tells_no_current(
    store, flight, tmp_path, lost, tells
):
    """What is not known of the way through the water would count as current."""
    whole = xr.open_zarr(store).load()
    count = int(whole["n_samples"][0])
    hole = slice(int((0.5 - 0.5 * lost) * count), int((0.5 + 0.5 * lost) * count))
    for name in ("pitch", "roll", "heading"):
        whole[f"measured_{name}"][0, hole] = np.nan
    cut = write_store(whole, tmp_path / "cut.zarr")
    found = estimate_flight(cut)
    assert found.missions[0].dive.tells_current is tells
    assert len(found.currents) == (len(flight.currents) if tells else 0)
    assert len(flight.currents) > 0


@pytest.mark.parametrize("ending", [".nc", ".zarr"])
def test_the_file_says_what_it_holds(flight, tmp_path, ending):
    dataset = flight_dataset(flight)
    for name, standard in (
        ("w_water", "upward_sea_water_velocity"),
        ("speed_through_water", "platform_speed_wrt_sea_water"),
        ("speed_through_water_sd", "platform_speed_wrt_sea_water standard_error"),
        ("latitude", "latitude"),
        ("dac_north", "northward_sea_water_velocity"),
    ):
        assert dataset[name].attrs["standard_name"] == standard
    for variable in dataset.data_vars.values():
        assert variable.attrs["long_name"]
    for name in ("speed_through_water", "angle_of_attack"):
        assert dataset[name].attrs["ancillary_variables"] == f"{name}_sd"
        assert "unidentified" in dataset[f"{name}_sd"].attrs["comment"]
        assert np.isfinite(dataset[name]).equals(np.isfinite(dataset[f"{name}_sd"]))
    assert dataset["dac_sd"].dims == ("dac",)
    assert dataset["datetime"].dims == ("mission", "time")
    middle = 0.5 * (dataset["dac_start"].values + dataset["dac_end"].values)
    # all in the one mission of the store
    since = dataset["dac_time"].values - dataset["start_time"].values[0]
    np.testing.assert_allclose(since, middle, atol=1e-3)
    for name in ("latitude", "longitude"):
        track = dataset[name].values
        assert np.nanmin(track) <= dataset[f"dac_{name}"].values.min()
        assert dataset[f"dac_{name}"].values.max() <= np.nanmax(track)
        assert dataset[f"dac_{name}"].attrs["standard_name"] == name
    path = tmp_path / f"flight{ending}"
    write_flight(flight, path)
    with xr.open_dataset(path, engine="zarr" if ending == ".zarr" else None) as read:
        np.testing.assert_allclose(read["w_water"].values, dataset["w_water"].values)
        assert np.issubdtype(read["start_time"].dtype, np.datetime64)
    (track,) = read_tracks(path, 0)  # to be drawn beside others
    position = flight.missions[0].position
    assert track.title == "corrected"
    assert track.time[-1] == pytest.approx(flight.store.period * (len(position) - 1))
    np.testing.assert_allclose(np.stack([track.north, track.east], axis=1), position, atol=0.01)


def test_all_figures_have_data(flight, tmp_path):
    for draw in FLIGHT_FIGURES.values():
        drawn = draw(flight_dataset(flight))
        assert all(axes.has_data() for axes in drawn.axes if axes.axison)
    written, missing = write_flight_figures(flight, tmp_path / "plots")
    assert [path.stem for path in written] == list(FLIGHT_FIGURES)
    assert missing == []


def test_the_command(store, tmp_path, capsys):
    out = tmp_path / "flight.nc"
    arguments = ["flight", str(store), "--out", str(out), "--json", "--currents"]
    assert PROGRAM.main(arguments) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["w_mean_dive_m_s"] == pytest.approx(0.01, abs=0.002)
    assert answer["flown"] == answer["profiles"] == 1
    assert out.is_file()
    assert PROGRAM.main(arguments) == 2
    assert "already exists; use --overwrite" in capsys.readouterr().err
    assert PROGRAM.main([*arguments[:3], str(tmp_path / "flight.csv")]) == 2
    assert "must end in .nc" in capsys.readouterr().err


def test_what_cannot_be_flown_is_told(store, tmp_path):
    with pytest.raises(UnknownName, match="did you mean 'steady'"):
        estimate_flight(store, estimator="stedy")
    with pytest.raises(InputError, match="takes no argument, not '3'"):
        estimate_flight(store, estimator="flight:3")
    with pytest.raises(StoreError, match="no mission 7"):
        estimate_flight(store, missions=[7])


def test_an_estimator_of_one_s_own(store, flight):
    class Slow(FlightEstimator):
        kind = "half"
        summary = "half the surge, for a test; heave is left to the depth rate"

        def motion(self, store, log, calibration, start):
            found = motion_of(log, calibration, start=start)
            nothing = np.full(len(found.surge), np.nan)
            return type(found)(surge=0.5 * found.surge, sway=found.sway, heave=nothing)

    class HalfThere(FlightEstimator):
        kind = "half-there"
        summary = "nothing"

    with pytest.raises(InputError, match="it lacks the method `motion`"):
        ESTIMATORS.add(HalfThere)
    ESTIMATORS.add(Slow)
    try:
        slow = twin.estimate_flight(store, estimator="half")
    finally:
        ESTIMATORS.unregister("half")
    assert "speed_through_water_sd" not in flight_dataset(slow)  # its errors are not known
    one, two = slow.missions[0].dive, flight.missions[0].dive
    np.testing.assert_allclose(one.motion.surge, 0.5 * two.motion.surge)
    assert np.isfinite(one.motion.heave).all()
    np.testing.assert_array_equal(one.water_up, two.water_up)  # of the flight model, always


@pytest.mark.parametrize("name", ["flight", "steady"])
def test_the_shipped_estimators_agree_in_steady_flight(name, flight, store):
    other = estimate_flight(store, estimator=name).missions[0].dive.motion
    own = flight.missions[0].dive.motion
    deep = truth(store, "depth") > 10.0
    assert np.median(np.abs(other.speed - own.speed)[deep]) < 0.01
    assert ESTIMATORS[name].summary


@needs_docs
def test_an_estimator_of_ones_own_runs(store, flight):
    with own_type("two_thirds"):
        import two_thirds

        try:
            found = estimate_flight(store, estimator="two-thirds")
        finally:
            ESTIMATORS.unregister(two_thirds.TwoThirds.kind)
    whole = flight.missions[0].dive.motion
    np.testing.assert_allclose(found.missions[0].dive.motion.surge, whole.surge * 2.0 / 3.0)


UNIT334 = SHARED / "slocum_unit334_2023"


@pytest.mark.skipif(not UNIT334.is_dir(), reason=f"no public logs at {UNIT334}")
def test_the_water_over_a_slocum_rises_as_often_as_it_sinks(tmp_path):
    """Identified on the same log without options: the pitch sensor's offset is found."""
    from twin.identify import identify, load_calibration, load_logs
    from twin.identify.logged_missions import start_vehicle

    pytest.importorskip("pyarrow")
    path = stored(tmp_path / "unit334.zarr", "slocum", [UNIT334])
    found = identify(load_logs(path), load_calibration(start_vehicle(path)))
    assert "pitch_offset" in found.determined
    summary = estimate_flight(path, found.calibration).summary()
    assert abs(summary.w_mean_dive - summary.w_mean_climb) < 0.003
    assert summary.w_deviation < 0.01


# --- logs that no flight model can read -----------------------------------------------------------


@pytest.fixture(scope="module")
def lrauv(tmp_path_factory):
    """Of a propelled vehicle: depth and positions, no attitude, no pump."""
    folder = tmp_path_factory.mktemp("lrauv")
    return stored(folder / "lrauv.zarr", "lrauv", [write_mat(folder / "shore.mat", Flight())])


@pytest.mark.parametrize(
    "words",
    [["flight"], ["flight", "--vehicle", "tethys"], ["flight", "--vehicle", "slocum-200"],
     ["identify"]],
)  # fmt: skip
def test_what_the_log_lacks_is_said_whatever_vehicle_is_given(words, lrauv, tmp_path, capsys):
    command, *options = words
    out = tmp_path / ("mine.xml" if command == "identify" else "flight.nc")
    assert PROGRAM.main([command, str(lrauv), "--out", str(out), *options]) == 2
    told = capsys.readouterr().err
    assert "has no channel measured_pitch (nor " in told
    assert "as buoyancy-driven gliders log them, whatever --vehicle is given" in told
    assert "give --vehicle" not in told


def test_its_overview_is_what_was_measured(lrauv, tmp_path, capsys):
    out = tmp_path / "overview.png"
    assert PROGRAM.main(["plot", str(lrauv), "--out", str(out)]) == 0
    assert out.stat().st_size > 10_000
    assert "without a flight model" in capsys.readouterr().err
