"""Clocks that stand for a whole profile, the layouts that public tables have, and each profile's
current."""

import netCDF4
import numpy as np
import pytest
from logs import refused

from factory.importing import import_logs, sniff
from factory.importing.columns import tidy
from factory.importing.sample_clock import NoClock, sample_clock, standing
from factory.importing.tally import Tally
from factory.samples import add_variables, write_csv
from twin.errors import InputError

SINCE = "seconds since 1970-01-01T00:00:00Z"
START, STEP, EACH, PROFILES = 1.7e9, 10.0, 60, 6
LENGTH = 700.0
"""[s] of a profile, from its first sample to the next one's"""
DEEPEST = 90.0
CURRENTS = (0.1, 0.1, 0.2, 0.2, 0.3, 0.3)
"""[m/s] eastward, of the segment of each profile"""


def profiles():
    """Samples of three dives, (profile, sample) each; `profile_*` of a profile, (profile,)."""
    number = np.arange(PROFILES)
    time = START + LENGTH * number[:, None] + STEP * np.arange(EACH)
    down = np.linspace(1.0, DEEPEST, EACH)
    return {
        "time": time,
        "depth": np.stack([down[::-1] if k % 2 else down for k in number]),
        "north": 40.0 + 1e-6 * (time - START),
        "profile_time": time.mean(axis=1),
        "profile_north": (40.0 + 1e-6 * (time - START)).mean(axis=1),
        "number": number + 1.0,
        "u": np.array(CURRENTS),
        "time_uv": START + LENGTH * (2 * (number // 2) + 1.0),
    }


def put(file, name, values, units, dims):
    values = values.astype("i4" if units == "count" else "f8")
    add_variables(file, {name: (dims, values, units)})


SAMPLES = {"precise_time": "time", "precise_lat": "north", "depth": "depth"}
"""Variables that a table has at the samples, and `profiles` of them"""
OF_PROFILE = {
    "time": ("profile_time", SINCE), "latitude": ("profile_north", "degrees_north"),
    "profile_id": ("number", "1"), "u": ("u", "m s-1"), "v": ("u", "m s-1"),
    "time_uv": ("time_uv", SINCE),
}  # fmt: skip
"""Variables that it has of a profile, and their units"""


def at_samples(file, dims, shape):
    known = profiles()
    for name, source in SAMPLES.items():
        units = {"time": SINCE, "depth": "m", "north": "degrees_north"}[source]
        put(file, name, shape(known[source]), units, dims)
    put(file, "precise_lon", shape(-70.0 + 0.0 * known["depth"]), "degrees_east", dims)
    put(file, "temperature", shape(15.0 - 0.05 * known["depth"]), "degree_C", dims)
    put(file, "salinity", shape(34.0 + 0.005 * known["depth"]), "1", dims)


def flat(file, dimension):
    """A row a sample, in which what is the profile's is repeated."""
    file.createDimension("trajectory_strlen", 4)
    at_samples(file, (dimension,), np.ravel)
    for name, (source, units) in OF_PROFILE.items():
        put(file, name, np.repeat(profiles()[source], EACH), units, (dimension,))
    put(file, "longitude", np.full(PROFILES * EACH, -70.0), "degrees_east", (dimension,))
    file.createVariable("trajectory", "S1", (dimension, "trajectory_strlen"))[:] = list("ru00")


def row(file):
    flat(file, "row")


def obs(file):
    flat(file, "obs")


def of_profiles(file):
    for name, (source, units) in OF_PROFILE.items():
        put(file, name, profiles()[source], units, ("profile",))
    put(file, "longitude", np.full(PROFILES, -70.0), "degrees_east", ("profile",))


def counted(file):
    """Contiguous ragged arrays, as ERDDAP's .ncCF has them."""
    of_profiles(file)
    file.createDimension("trajectory", 1)
    at_samples(file, ("obs",), np.ravel)
    put(file, "rowSize", np.full(PROFILES, EACH), "count", ("profile",))
    file["rowSize"].sample_dimension = "obs"
    put(file, "trajectoryIndex", np.zeros(PROFILES), "count", ("profile",))
    file["trajectoryIndex"].instance_dimension = "trajectory"
    file.createVariable("trajectory", str, ("trajectory",))[:] = np.array(["ru00"], object)


def counted_by_name(file):
    of_profiles(file)
    at_samples(file, ("obs",), np.ravel)
    put(file, "row_size", np.full(PROFILES, EACH), "count", ("profile",))
    file.id = "ru00"


def indexed(file):
    of_profiles(file)
    at_samples(file, ("obs",), np.ravel)
    put(file, "parent", np.repeat(np.arange(PROFILES), EACH), "count", ("obs",))
    file["parent"].instance_dimension = "profile"
    file.id = "ru00"


def padded(file):
    """Arrays of profiles by samples with a missing end, as ERDDAP's .ncCFMA has them."""
    of_profiles(file)
    end = np.full((PROFILES, 5), np.nan)
    at_samples(file, ("profile", "obs"), lambda values: np.hstack([values, end]))
    file.id = "ru00"


def samples_first(file):
    of_profiles(file)
    at_samples(file, ("obs", "profile"), np.transpose)
    file.id = "ru00"


LAYOUTS = (row, obs, counted, counted_by_name, indexed, padded, samples_first)


def table(path, layout):
    with netCDF4.Dataset(path, "w") as file:
        layout(file)
    return path


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda one: one.__name__)
def test_a_profile_s_time_gives_way_to_the_sample_s(layout, tmp_path):
    path = table(tmp_path / "ru00.nc", layout)
    assert sniff(path) == "ngdac"
    dataset, report = import_logs("ngdac", [path])
    assert report.deployments == ("ru00",)
    assert report.rows == 3
    assert report.count("suspect") == report.count("removed") == 0
    assert any(e.subject == "precise_time" and e.action == "note" for e in report.entries)
    for dive in range(3):
        lone = dataset.isel(mission=dive)
        length = 2 * LENGTH - (LENGTH - STEP * (EACH - 1))
        assert float(lone["dive_duration"]) == pytest.approx(length, abs=1e-6)
        depth = lone["measured_depth"].values
        assert np.nanmax(depth) == pytest.approx(DEEPEST, abs=1.0)
        at = np.argmin(np.abs(lone["time"].values - 200.0))  # 21 samples down of 60
        assert depth[at] == pytest.approx(1.0 + 20.0 * (DEEPEST - 1.0) / (EACH - 1), abs=0.2)
        warm = lone["measured_temperature"].values[at]
        assert warm == pytest.approx(15.0 - 0.05 * depth[at], abs=0.02)
    assert dataset["vehicle_dac_east"].values == pytest.approx([0.1, 0.2, 0.3])


def test_a_time_that_is_flagged_bad_is_none(tmp_path):
    path = table(tmp_path / "ru00.nc", row)
    with netCDF4.Dataset(path, "a") as file:
        file["precise_time"][100] = START + 1e6
        flags = file.createVariable("precise_time_qc", "i1", ("row",))
        flags[:] = 1
        flags[100] = 4
    _, report = import_logs("ngdac", [path])
    assert report.count("removed", "precise_time") == 1
    assert report.hours < 1.5


def test_a_profile_s_place_is_one_of_its_track(tmp_path):
    """Without places of the samples a track goes on between those of the profiles."""

    def without(file):
        row(file)
        for name in ("precise_lat", "precise_lon"):
            file.renameVariable(name, f"other_{name}")

    dataset, _ = import_logs("ngdac", [table(tmp_path / "ru00.nc", without)])
    north = dataset["measured_onboard_north"].isel(mission=1).values
    steps = np.diff(north[np.isfinite(north)])
    # 1e-6 degree a second are 0.56 m in 5 s; a place that is repeated stands, and then jumps
    inside = steps[steps > 0.0]
    assert inside.max() < 1.2
    assert len(inside) > 100


def test_variables_are_known_by_their_standard_names(tmp_path):
    """As other servers of tables have them: a height, positive up, and no number of a profile."""
    known = profiles()
    path = tmp_path / "cp_340.nc"
    with netCDF4.Dataset(path, "w") as file:
        for name, values, units, standard in (
            ("time", known["time"], SINCE, "time"),
            ("z", -known["depth"], "m", "depth"),
            ("sea_water_temperature", 15.0 - 0.05 * known["depth"], "degree_C", ""),
            ("practical", 34.0 + 0.0 * known["depth"], "1", "sea_water_practical_salinity"),
            ("y", known["north"], "degrees_north", "latitude"),
            ("x", -70.0 + 0.0 * known["depth"], "degrees_east", "longitude"),
        ):
            put(file, name, values.ravel(), units, ("row",))
            if standard:
                file[name].standard_name = standard
    assert sniff(path) == "ngdac"
    dataset, report = import_logs("ngdac", [path])
    assert report.rows == 3
    assert "not read" not in report.names["NGDAC file"]
    depth, warm = dataset["measured_depth"].values, dataset["measured_temperature"].values
    assert np.nanmax(depth) == pytest.approx(DEEPEST, abs=1.0)
    both = np.isfinite(depth) & np.isfinite(warm)
    np.testing.assert_allclose(warm[both], 15.0 - 0.05 * depth[both], atol=0.05)
    north = dataset["measured_onboard_north"].isel(mission=0).values
    # 1e-6 degree a second over the dive
    assert np.nanmax(north) - np.nanmin(north) == pytest.approx(111e3 * 1e-6 * 1290.0, abs=3.0)


def test_a_table_of_two_deployments_makes_two_logs(tmp_path):
    def two(file):
        row(file)
        file["trajectory"][4 * EACH :] = list("ru99")

    _, report = import_logs("ngdac", [table(tmp_path / "both.nc", two)])
    assert report.deployments == ("ru00", "ru99")
    assert report.rows == 3


def test_counts_that_do_not_fit_are_damage(tmp_path):
    path = table(tmp_path / "ru00.nc", counted)
    with netCDF4.Dataset(path, "a") as file:
        file["rowSize"][2] = 10**9
    refused(r"ru00\.nc is damaged: rowSize counts \d+ samples", "ngdac", [path])


def test_no_clock_of_the_samples_is_refused_with_the_cause(tmp_path):
    def alone(file):
        row(file)
        file.renameVariable("precise_time", "other")
        del file["other"].units  # numbers that nobody calls a time

    path = table(tmp_path / "ru00.nc", alone)
    refused(r"'time' gives 360 of 360 samples no time of their own", "ngdac", [path])


def test_a_time_of_too_few_digits_is_refused(tmp_path):
    """Unix time as float32 has steps of 128 s."""

    def coarse(file):
        row(file)
        file["time"][:] = profiles()["time"].ravel().astype(np.float32)
        file["precise_time"][:] = profiles()["time"].ravel().astype(np.float32)

    path = table(tmp_path / "ru00.nc", coarse)
    refused(r"without enough digits", "ngdac", [path])


MAPPING = """vehicle = "Table"
rows = "dives"
deployment = { name = "table" }
[time]
column = "CLOCK"
unit = "s"
[signals]
measured_depth = { column = "depth", unit = "m" }
measured_temperature = { column = "temperature", unit = "degC" }
"""


def test_a_table_s_column_of_time_that_stands_names_the_other(tmp_path):
    known = profiles()
    path = write_csv(
        tmp_path / "table.csv",
        {
            "time": np.repeat(known["profile_time"], EACH), "precise_time": known["time"].ravel(),
            "depth": known["depth"].ravel(), "temperature": 15.0 - 0.05 * known["depth"].ravel(),
        },
    )  # fmt: skip
    mapping = tmp_path / "mine.toml"
    mapping.write_text(MAPPING.replace("CLOCK", "time"))
    refused(r"'time' gives 360 of 360 .* precise_time\?", "csv", [path], mapping=mapping)
    mapping.write_text(MAPPING.replace("CLOCK", "precise_time"))
    _, report = import_logs("csv", [path], mapping=mapping)
    assert report.rows == 3


def test_a_clock_that_stands_for_a_while_makes_its_rows_suspect():
    time = START + np.arange(100.0) * 5.0
    time[40:60] = time[40]
    tally = Tally()
    tidy(time, {"depth": np.arange(100.0)}, "log", tally)
    (doubt,) = tally.doubts
    assert (doubt.start, doubt.end) == (time[39], time[60])


def test_a_clock_that_stood_before_it_was_set_makes_no_later_row_suspect():
    time = START + np.arange(100.0) * 5.0
    time[:20] = START - 20.0 * 365.0 * 86400.0
    tally = Tally()
    tidy(time, {"depth": np.arange(100.0)}, "log", tally)
    (doubt,) = tally.doubts
    assert doubt.end < START


def test_a_clock_of_whole_seconds_goes_on():
    time = START + np.floor(np.arange(200) / 10.0)
    assert not standing(time, {"depth": np.arange(200.0)}).any()
    twice = START + 5.0 * np.floor(np.arange(200) / 2.0)
    assert not standing(twice, {"depth": np.arange(200.0)}).any()
    hanging = np.repeat(START + 60.0 * np.arange(20), 10)  # all values repeated as well
    assert not standing(hanging, {"depth": np.repeat(np.arange(20.0), 10)}).any()
    assert standing(hanging, {"depth": np.arange(200.0)}).all()


def test_the_usual_clock_stays_where_another_has_few_times():
    depth = {"depth": np.arange(100.0)}
    usual = START + np.arange(100.0)
    gps = np.where(np.arange(100) % 20 == 0, usual + 0.5, np.nan)
    tally = Tally()
    assert sample_clock({"time": usual, "time_gps": gps}, depth, "log", tally) == "time"
    assert not tally.entries()
    still = np.repeat(START + 100.0 * np.arange(4), 25)
    with pytest.raises(NoClock):
        sample_clock({"time": still, "time_gps": gps}, depth, "log", tally)
    assert sample_clock({"time": still, "precise": usual}, depth, "log", tally) == "precise"


def test_each_dive_has_its_own_segment_s_current(tmp_path):
    """Segments of 20 min, 4 h and 20 min: the middle of a long one is far from its ends."""
    start, number, paths = START, 0, []
    for seconds, east in ((1200.0, 0.11), (14400.0, 0.22), (1200.0, 0.33)):
        for up in (0, 1):
            number += 1
            count = int(seconds / 20.0)
            deep = np.linspace(1.0, 90.0 if seconds < 3000.0 else 900.0, count)
            path = tmp_path / f"p{number}.nc"
            with netCDF4.Dataset(path, "w") as file:
                file.id = "xx00"
                begin = start + up * (0.5 * seconds + 20.0)
                put(file, "time", begin + 10.0 * np.arange(count), SINCE, ("time",))
                put(file, "depth", deep[::-1] if up else deep, "m", ("time",))
                put(file, "profile_id", np.array(number), "1", ())
                for name, value, units in (
                    ("time_uv", start + 0.5 * seconds, SINCE),
                    ("u", east, "m s-1"),
                    ("v", -east, "m s-1"),
                ):
                    put(file, name, np.array(value), units, ())
            paths.append(path)
        start += seconds + 427.0
    dataset, _ = import_logs("ngdac", paths)
    assert dataset["vehicle_dac_east"].values == pytest.approx([0.11, 0.22, 0.33])
    assert dataset["vehicle_dac_north"].values == pytest.approx([-0.11, -0.22, -0.33])


def test_a_kind_is_named_only_if_its_reader_takes_the_file(tmp_path):
    """Names of one kind do not make a file one: advice would go in a circle."""
    known = profiles()
    path = tmp_path / "profile.nc"
    with netCDF4.Dataset(path, "w") as file:
        put(file, "time", known["time"][0], SINCE, ("time",))
        put(file, "depth", known["depth"][0], "m", ("time",))
        put(file, "profile_num", np.ones(EACH), "1", ("time",))
    refused("looks like ngdac: use `factory import ngdac`", "og1", [path])
    _, report = import_logs("ngdac", [path])
    assert report.rows == 1
    with netCDF4.Dataset(path, "a") as file:
        file.renameVariable("depth", "level")
        put(file, "profile_index", np.ones(EACH), "1", ("time",))
    for kind in ("og1", "ngdac", "seaglider", "spray"):
        with pytest.raises(InputError, match="is not a log of the kind") as caught:
            import_logs(kind, [path])
        assert "looks like" not in str(caught.value)
    refused("depth or pressure at the same samples", "ngdac", [path])
    assert sniff(path) is None


def og1(path, clock):
    """OG1.0 whose TIME is the profile's, beside another time; currents without numbers of dives."""
    known = profiles()
    with netCDF4.Dataset(path, "w") as file:
        dims = ("N_MEASUREMENTS",)
        put(file, "TIME", np.repeat(known["profile_time"], EACH), SINCE, dims)
        put(file, clock, known["time"].ravel(), SINCE, dims)
        put(file, "DEPTH", known["depth"].ravel(), "m", dims)
        put(file, "LATITUDE", known["north"].ravel(), "degrees_north", dims)
        put(file, "LONGITUDE", np.full(PROFILES * EACH, -70.0), "degrees_east", dims)
        for axis, sign in (("EAST", 1.0), ("NORTH", -1.0)):
            values = np.repeat(sign * known["u"], EACH)
            put(file, f"DAVG_CURR_{axis}", values, "m s-1", dims)
    return path


def test_og1_takes_the_clock_that_goes_and_each_dive_its_current(tmp_path):
    path = og1(tmp_path / "a.nc", "TIME_CTD")
    dataset, report = import_logs("og1", [path])
    assert report.rows == 3
    assert report.count("suspect") == report.count("removed") == 0
    assert dataset["dive_duration"].values == pytest.approx(LENGTH + STEP * (EACH - 1), abs=1e-6)
    assert dataset["vehicle_dac_east"].values == pytest.approx([0.1, 0.2, 0.3])
    assert dataset["vehicle_dac_north"].values == pytest.approx([-0.1, -0.2, -0.3])
    with netCDF4.Dataset(path, "a") as file:
        del file["TIME_CTD"].units
    refused(r"'TIME' gives 360 of 360 .* take a file with the time", "og1", [path])


@pytest.mark.parametrize("kind", ["lrauv", "dorado"])
def test_other_readers_refuse_a_clock_that_stands(kind, tmp_path):
    known = profiles()
    path = tmp_path / "navigation.nc"
    with netCDF4.Dataset(path, "w") as file:
        put(file, "time", np.repeat(known["profile_time"], EACH), SINCE, ("time",))
        put(file, "platform_pitch_angle", known["depth"].ravel() / 100.0, "degree", ("time",))
        put(file, "mTheta", known["depth"].ravel() / 100.0, "rad", ("time",))
        for name in ("depth", "mDepth"):
            put(file, name, known["depth"].ravel(), "m", ("time",))
    refused(r"'time of \w+' gives 360 of 360 samples", kind, [path])
