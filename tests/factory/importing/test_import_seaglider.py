"""Import of Seaglider logs: tables and basestation netCDF, truth by the ADCP, refusals."""

import warnings

import netCDF4
import numpy as np
import pytest
from logs import refused
from scipy.io import netcdf_file

from factory.importing import import_logs
from factory.importing.columns import read_table
from factory.importing.dives.regular_times import to_body
from factory.importing.netcdf import as_array, open_netcdf
from factory.samples import Flight, add_variables, write_csv, write_netcdf
from factory.samples.gliders import write_basestation, write_seaglider
from twin.errors import InputError

FLIGHT = Flight(depth=150.0, variation=15.0)


def write_adcp(path, flight):
    """Velocity through the water every 60 s, up positive, as the inverse solution gives it."""
    time = flight.time[::15]
    state = flight.state(time)
    level = flight.speed * np.cos(np.radians(flight.pitch)) * state["under"]
    climb = flight.speed * np.sin(np.radians(state["pitch"]))
    azimuth = np.radians(flight.heading)
    return write_csv(
        path,
        {
            "glider": ["SG999"] * len(time),
            "time": time,
            "depth_m": state["depth"],
            "u_ttw": level * np.sin(azimuth),
            "v_ttw": level * np.cos(azimuth),
            "w_ttw": climb,
            "u_ocn": np.full(len(time), flight.east),
            "v_ocn": np.full(len(time), flight.north),
        },
    )


def test_dives_run_from_the_second_fix_to_the_last(tmp_path):
    dataset, report = import_logs("seaglider", write_seaglider(tmp_path, FLIGHT))
    assert report.deployments == ("SG999",)
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    assert dataset["dive"].values.tolist() == [1, 2, 3]
    for dive in range(FLIGHT.dives):
        begins, ends = FLIGHT.dive_times(dive)
        moved = FLIGHT.displacement(begins - 40.0, ends + 60.0)
        row = dataset.isel(mission=dive)
        assert float(row["dive_duration"]) == pytest.approx(ends - begins + 100.0)
        assert float(row["displacement_north"]) == pytest.approx(moved[0], abs=0.2)
        assert float(row["displacement_east"]) == pytest.approx(moved[1], abs=0.2)
        assert float(row["vehicle_dac_north"]) == pytest.approx(FLIGHT.north)
    n = int(dataset["n_samples"][0])
    pitch, shift = dataset["measured_pitch"].values[0, :n], dataset["measured_shift"].values[0, :n]
    # the encoder: (1800 - 2000) * 0.003 cm is nose down, which is 6 mm forward
    assert np.allclose(shift[pitch < -20], 0.006, atol=1e-6)
    assert np.allclose(shift[pitch > 20], -0.006, atol=1e-6)
    assert np.allclose(dataset["measured_heading"].values[0, :n], FLIGHT.heading, atol=1e-3)
    assert np.nanmedian(dataset["measured_salinity"]) == pytest.approx(34.0)
    assert np.nanmedian(dataset["measured_density"]) == pytest.approx(1026.9, abs=0.3)
    # the glider is silent between the fix and its first sample: held, and marked
    assert dataset["measured_gap"].values[0, 0] == 1.0
    assert dataset["measured_gap"].values[0, n // 4] == 0.0


def test_adcp_truth_is_turned_into_body_axes_near_its_samples_only(tmp_path):
    paths = [*write_seaglider(tmp_path, FLIGHT), write_adcp(tmp_path / "adcp.csv", FLIGHT)]
    dataset, report = import_logs("seaglider", paths)
    n = int(dataset["n_samples"][1])
    surge = dataset["true_surge"].values[1, :n]
    there = np.isfinite(surge)
    depth = dataset["measured_depth"].values[1, :n]
    steady = there & (depth > 30.0) & (depth < 120.0)
    assert steady.sum() > 50
    # the imaginary glider moves along its nose
    assert np.allclose(surge[steady], FLIGHT.speed, atol=1e-3)
    assert np.allclose(dataset["true_sway"].values[1, :n][steady], 0.0, atol=1e-3)
    assert np.allclose(dataset["true_heave"].values[1, :n][steady], 0.0, atol=1e-3)
    assert np.allclose(dataset["true_speed"].values[1, :n][steady], FLIGHT.speed, atol=1e-3)
    assert np.allclose(dataset["true_current_east"].values[1, :n][steady], FLIGHT.east, atol=1e-6)
    assert not there[depth < 0.5].any()
    shallow = [e for e in report.entries if e.action == "left out" and "ADCP" in e.subject]
    assert shallow[0].count > 0


def test_body_axes_undo_the_rotation():
    rng = np.random.default_rng(3)
    angles = rng.uniform(-1.0, 1.0, (3, 20))
    vectors = rng.normal(size=(3, 20))
    body = to_body(vectors, *angles)
    assert np.allclose(np.linalg.norm(body, axis=0), np.linalg.norm(vectors, axis=0))
    down = np.tile([[0.0], [0.0], [1.0]], 20)
    roll, pitch, _ = angles
    expected = [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)]
    assert np.allclose(to_body(down, *angles), expected)


def test_without_dives_there_is_no_variation_and_no_fix(tmp_path):
    samples, dives = write_seaglider(tmp_path, FLIGHT)
    refused("--variation-deg", "seaglider", [samples])
    _, report = import_logs("seaglider", [samples], variation_deg=FLIGHT.variation)
    assert report.rows == FLIGHT.dives
    assert report.rows_with_fixes == 0
    refused("dives of SG999 without its table of samples", "seaglider", [dives])


def test_radian_and_mixed_gliders(tmp_path):
    samples, dives = write_seaglider(tmp_path, FLIGHT)
    table = read_table(samples)
    columns = {"glider": ["SG999"] * len(table), **table.columns}
    columns["pitch_deg"] = np.radians(table.columns["pitch_deg"])
    write_csv(samples, columns)
    other = tmp_path / "other"
    other.mkdir()
    paths = [samples, dives, *write_seaglider(other, Flight(dives=1, heading=250.0), "SG001")]
    dataset, report = import_logs("seaglider", paths)
    assert report.count("repaired", "pitch_deg") == len(table)
    assert np.nanmax(dataset["measured_pitch"]) == pytest.approx(FLIGHT.pitch, abs=1e-3)
    assert sorted(set(dataset["deployment"].values)) == ["SG001", "SG999"]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("p9990001.nc", b"", "is empty"),
        ("p9990001.nc", b"\x89HDF\r\n\x1a\n and no more", "truncated or damaged"),
        ("p9990001.nc", b"not at all", "of another format"),
        ("a.csv", b"m_depth,m_pitch,time\n1,2,3\n", "looks like slocum"),
    ],
)
def test_files_that_are_no_seaglider_log_are_named(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        import_logs("seaglider", [path])
    assert "\n" not in str(caught.value)


def test_a_netcdf_file_of_another_kind_is_named(tmp_path):
    path = tmp_path / "og1.nc"
    names = ("TIME", "PITCH", "LATITUDE", "LONGITUDE")
    write_netcdf(path, dict.fromkeys(names, (("N_MEASUREMENTS",), np.full(2, np.nan))))
    refused("looks like og1", "seaglider", [path])
    refused("looks like og1", "slocum", [path])
    table = write_seaglider(tmp_path, FLIGHT)[0]
    refused("looks like seaglider", "og1", [table])


@pytest.mark.parametrize("without", ["time", "uttw"])
def test_an_adcps_solution_that_lacks_its_times_or_velocities_is_no_truth(tmp_path, without):
    paths = write_basestation(tmp_path, FLIGHT)
    for path in paths:
        with netCDF4.Dataset(path, "a") as file:
            times = file["time"][::6]
            parts = {"time": times, "depth": 50.0, "uttw": 0.1, "vttw": 0.2, "wttw": 0.0}
            for name in parts.keys() - {without}:
                one = (("ad2cp_inv_glider_data_point",), parts[name] + 0.0 * times)
                add_variables(file, {f"ad2cp_inv_glider_{name}": one})
    dataset, report = import_logs("seaglider", paths)
    assert report.rows == FLIGHT.dives
    assert not [name for name in dataset.data_vars if "surge" in str(name)]


def test_base_stations_files_say_where_the_glider_was_sent(tmp_path):
    flight = Flight(depth=150.0)
    dataset, report = import_logs("seaglider", write_basestation(tmp_path, flight))
    north = (49.6 - dataset["start_latitude"].values) * 111_230.0
    waypoint = dataset["commanded_waypoint_north"].values
    for row, count in enumerate(dataset["n_samples"].values):
        known = np.isfinite(waypoint[row, :count])
        assert known.mean() > 0.9
        assert waypoint[row, :count][known] == pytest.approx(north[row], rel=2e-3)
    assert "log_TGT_LATLONG" in report.names["basestation file"]["read"]


def test_a_number_that_older_basestations_write_letter_by_letter_is_one(tmp_path):
    found = {}
    for kind in ("letters", "number", "words"):
        folder = tmp_path / kind
        folder.mkdir()
        paths = write_basestation(folder, FLIGHT)
        for path in paths:
            letters = (("seven",), "7.05105" if kind == "letters" else "unknown")
            one = ((), 7.05105) if kind == "number" else letters
            write_netcdf(path, {"log_INTERNAL_PRESSURE": one}, "a")
        found[kind] = import_logs("seaglider", paths)[0]
    vacuum = found["number"]["measured_vacuum"].values
    assert np.isfinite(vacuum).any()
    np.testing.assert_array_equal(found["letters"]["measured_vacuum"].values, vacuum)
    assert "measured_vacuum" not in found["words"]


def test_limits_that_fit_no_value_are_passed_over_without_a_word(tmp_path):
    """Beyond the variable's own kind: the library's own words name neither file nor variable."""
    path = tmp_path / "a.nc"
    with netcdf_file(path, "w") as file:
        file.createDimension("n", 3)
        one = file.createVariable("one", "h", ("n",))
        one[:] = [1, 2, 3]
        one.valid_min, one.missing_value = np.float64(1e6), np.float64(1e7)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with open_netcdf(path) as file:
            assert as_array(file["one"][:]).tolist() == [1.0, 2.0, 3.0]
