"""Import: what sensors do wrong, and what the import makes of it. Small written files."""

import gzip

import gsw
import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logs import details, part, refused, slocum

from factory.importing import import_logs
from factory.importing.angles import in_degrees
from factory.importing.cleaning import counts_upward
from factory.importing.columns import column_names, read_table, tidy
from factory.importing.deployment_log import EMPTY, NO_FIXES, Channel, DeploymentLog, LoggedFixes
from factory.importing.plausibility import unreachable
from factory.importing.pressures import pressure_of, with_depth
from factory.importing.tally import Tally
from factory.samples import Flight, write_csv, write_netcdf
from factory.samples.archives import write_og1
from factory.samples.gliders import slocum_columns, write_basestation, write_seaglider, write_slocum
from glider_twin_protocols.auv_samples import write_mat
from glider_twin_protocols.message_samples import write_bag
from twin.errors import InputError

FLIGHT = Flight()


def with_sentinels(columns, share):
    """Pitch, depth and pressure as a Slocum writes them where a sensor was silent."""
    bad = np.random.default_rng(5).random(len(columns["time"])) < share
    changed = {name: columns[name].copy() for name in ("m_pitch", "m_depth", "m_pressure")}
    for name, sentinel in (("m_pitch", -999.0), ("m_depth", 9999.0), ("m_pressure", 999.0)):
        changed[name][bad] = sentinel
    return changed


@pytest.mark.parametrize("factor", [1.0, 180.0 / np.pi])
def test_sentinels_neither_turn_the_unit_nor_leave_depth_behind(tmp_path, factor):
    right, whole = slocum(tmp_path, FLIGHT)
    changed = with_sentinels(slocum_columns(FLIGHT), 0.05)
    changed["m_pitch"] = np.where(changed["m_pitch"] == -999.0, -999.0, changed["m_pitch"] * factor)
    dataset, report = slocum(tmp_path, FLIGHT, **changed)
    bad = int((changed["m_pitch"] == -999.0).sum())
    assert bad > 20
    assert report.count("removed", "m_pitch") == report.count("removed", "m_pressure") == bad
    repaired = report.count("repaired", "m_pitch")
    assert repaired == (len(FLIGHT.time) - bad if factor > 1.0 else 0)
    assert report.count("repaired") == repaired
    assert report.rows == whole.rows
    # no fix was taken for one under water
    assert report.count("removed", "GPS fixes") == whole.count("removed", "GPS fixes") == 0
    assert float(np.nanmax(dataset["measured_depth"])) < FLIGHT.depth + 1.0
    apart = np.abs(dataset["measured_pitch"].values - right["measured_pitch"].values)
    assert np.nanpercentile(apart, 90.0) < 0.01


def test_runs_of_impossible_depth_go_and_the_dive_stays(tmp_path):
    columns = slocum_columns(FLIGHT)
    depth, pressure = columns["m_depth"].copy(), columns["m_pressure"].copy()
    run = slice(90, 102)
    pressure[run] = 40.0
    depth[run] = 400.0
    dataset, report = slocum(tmp_path, FLIGHT, m_depth=depth, m_pressure=pressure)
    assert report.count("removed", "m_pressure") == 12
    assert float(np.nanmax(dataset["measured_depth"])) < FLIGHT.depth + 1.0
    assert report.rows == FLIGHT.dives


@given(st.integers(0, 150), st.integers(1, 20), st.floats(60.0, 9000.0))
def test_only_the_run_is_out_of_reach(start, length, value):
    time = 4.0 * np.arange(200.0)
    values = 30.0 + 20.0 * np.sin(time / 100.0)
    assert not unreachable(time, values, rate=2.0, jump=4.0).any()
    # far enough that the run's own length does not make it reachable
    values[start : start + length] = value + 2.0 * 4.0 * (length + 2)
    bad = unreachable(time, values, rate=2.0, jump=4.0)
    assert np.flatnonzero(bad).tolist() == list(range(start, start + length))


def test_a_roll_in_degrees_is_not_taken_for_radian(tmp_path):
    """A few degrees of roll would be half a turn in radian; they are in no other angle's unit."""
    wobble = 3.0 + 2.0 * np.sin(FLIGHT.time / 50.0)
    dataset, report = slocum(tmp_path, FLIGHT, m_roll=wobble)
    assert report.count("repaired", "m_roll") == report.count("repaired") == len(wobble)
    assert np.nanmax(np.abs(dataset["measured_roll"])) == pytest.approx(5.0, abs=0.1)


def test_a_slight_roll_follows_the_unit_of_pitch_and_heading(tmp_path):
    """0.1 to 0.5: a roll that could be either."""
    either = 0.3 + 0.2 * np.sin(FLIGHT.time / 50.0)
    assert in_degrees("roll", either) is None
    columns = slocum_columns(FLIGHT)
    dataset, report = slocum(tmp_path, FLIGHT, m_roll=either)
    assert report.count("repaired") == 0
    assert np.nanmax(dataset["measured_roll"]) == pytest.approx(np.degrees(0.5), abs=0.1)
    whole = {n: np.degrees(columns[n]) for n in ("m_pitch", "m_heading")}
    dataset, report = slocum(tmp_path, FLIGHT, m_roll=either, **whole)
    assert report.count("repaired", "m_roll") == len(either)
    assert np.nanmax(dataset["measured_roll"]) == pytest.approx(0.5, abs=0.01)


def test_a_heading_sentinel_is_no_heading(tmp_path):
    heading = slocum_columns(FLIGHT)["m_heading"]
    heading[30:34] = -999.0
    dataset, report = slocum(tmp_path, FLIGHT, m_heading=heading)
    assert report.count("removed", "m_heading") == 4
    assert np.allclose(
        dataset["measured_heading"].values[np.isfinite(dataset["measured_heading"].values)],
        FLIGHT.heading,
        atol=1e-3,
    )


def test_a_roll_of_half_a_turn_is_suspect(tmp_path):
    """Radian by its small values, and yet the vehicle would lie on its side."""
    samples, dives = write_seaglider(tmp_path, Flight(depth=150.0))
    table = read_table(samples)
    columns = {"glider": ["SG999"] * len(table), **table.columns}
    columns["roll_deg"] = 70.0 + np.sin(columns["time"])
    write_csv(samples, columns)
    _, report = import_logs("seaglider", [samples, dives])
    assert "rolls by 70 degree" in details(report, "suspect")["measured_roll"]


@pytest.mark.parametrize(
    ("column", "subject"), [("m_heading", "measured_heading"), ("m_pitch", "measured_pitch")]
)
def test_a_sensor_that_stands_still_for_a_dive_is_suspect(tmp_path, column, subject):
    moving = slocum_columns(FLIGHT)
    for name in ("m_heading", "m_pitch"):
        moving[name] = moving[name] + 1e-3 * np.sin(FLIGHT.time)
    both = {name: moving[name] for name in ("m_heading", "m_pitch")}
    _, report = slocum(tmp_path, FLIGHT, **both)
    assert report.count("suspect") == 0
    start, end = FLIGHT.dive_times(1)
    stuck = (FLIGHT.time > start - 10.0) & (FLIGHT.time < end + 10.0)
    both[column] = np.where(stuck, 0.3, both[column])
    _, report = slocum(tmp_path, FLIGHT, **both)
    assert report.count("suspect", subject) == 1
    assert "same value for a whole dive" in details(report, "suspect")[subject]


def test_a_depth_that_stands_still_while_pitched_is_suspect(tmp_path):
    flight = Flight(depth=120.0)
    depth = slocum_columns(flight)["m_depth"]
    start, _ = flight.dive_times(1)
    stuck = (flight.time > start + 200.0) & (flight.time < start + 550.0)
    depth[stuck] = depth[np.argmax(stuck)]
    _, report = slocum(tmp_path, flight, m_depth=depth, m_pressure=None)
    said = " ".join(e.detail for e in report.entries if e.subject == "measured_depth")
    assert "one depth for more than 300 s" in said


@pytest.mark.parametrize(("factor", "unit"), [(25.4, "mm"), (2.54 * 3.0, "cm"), (0.0254, "metres")])
def test_the_batterys_unit_is_told_by_its_travel(tmp_path, factor, unit):
    """0.8 inch of travel; in cm only with three times as much, since 2 cm could be 2 inches."""
    inches = slocum_columns(FLIGHT)["m_battpos"]
    dataset, report = slocum(tmp_path, FLIGHT, m_battpos=factor * inches, c_battpos=factor * inches)
    assert f"was in {unit}" in details(report, "repaired")["m_battpos"]
    size = 0.4 * 0.0254 * (3.0 if unit == "cm" else 1.0)
    for name in ("measured_shift", "commanded_shift"):
        assert np.nanmax(dataset[name]) == pytest.approx(size, rel=1e-3), name


def test_a_batterys_travel_that_is_no_gliders_is_suspect(tmp_path):
    counts = 4000.0 * slocum_columns(FLIGHT)["m_battpos"]
    _, report = slocum(tmp_path, FLIGHT, m_battpos=counts)
    assert "in no unit" in details(report, "suspect")["measured_shift"]


def test_what_is_not_read_is_named_and_what_is_missing_looked_for(tmp_path):
    columns = slocum_columns(FLIGHT)
    renamed = {
        "pitch": columns["m_pitch"],
        "m_tot_num_inflections": columns["m_roll"],
        "m_pitch": None,
    }
    _, report = slocum(tmp_path, FLIGHT, **renamed)
    assert details(report, "not read")["flight table"] == "m_tot_num_inflections, pitch"
    assert report.count("not read", "flight table") == 2
    assert "is it 'pitch', which is not read?" in details(report, "missing")["measured_pitch"]
    # a log without attitude is a log: what cannot be made of it is said, nothing is suspect
    assert "identification and dead reckoning" in details(report, "note")["measured_pitch"]
    assert report.count("suspect", "measured_pitch") == 0
    # a Slocum has no roll mass: nothing to miss
    assert "measured_rotation" not in details(report, "missing")


def test_a_deployment_without_a_dive_does_not_vanish(tmp_path):
    paths = write_slocum(tmp_path, FLIGHT)
    paths += write_slocum(tmp_path, Flight(depth=3.0, speed=0.1, heading=90.0), name="zeta")
    _, report = import_logs("slocum", paths)
    assert report.deployments == ("unit1",)
    assert details(report, "left out")["zeta"].startswith("no dive: deepest ")


def test_samples_outside_rows_are_split_by_where_they_were(tmp_path):
    _, report = slocum(tmp_path, FLIGHT)
    why = [e.detail for e in report.entries if e.subject == "depth samples"]
    assert why == ["at the surface between dives (above 1.5 m)"]


def test_rows_that_repeat_a_time_are_kept_apart_from_those_that_contradict(tmp_path):
    right, _ = slocum(tmp_path, FLIGHT)
    rows = np.concatenate([np.arange(len(FLIGHT.time)), [60, 61, 62, 63]])
    doubled = part(slocum_columns(FLIGHT), rows)
    doubled["m_pitch"][-2:] = 0.9  # the last two say something else
    dataset, report = slocum(tmp_path, FLIGHT, **doubled)
    assert report.count("repeated", "unit1_flight.csv") == 2
    assert report.count("removed", "unit1_flight.csv") == 2
    assert np.allclose(dataset["measured_pitch"], right["measured_pitch"], equal_nan=True)


def test_contradicting_rows_are_not_mixed():
    time = np.array([1e9, 1e9, 1e9 + 1.0])
    columns = {"a": np.array([1.0, 2.0, 3.0]), "b": np.array([np.nan, 5.0, 6.0])}
    _, out = tidy(time, columns, "x", Tally())
    assert out["a"].tolist() == [1.0, 3.0]
    assert np.isnan(out["b"][0])
    columns["a"][1] = 1.0
    _, out = tidy(time, columns, "x", Tally())
    assert out["b"].tolist() == [5.0, 6.0]


def test_the_index_that_pandas_writes_is_no_column(tmp_path):
    right, _ = slocum(tmp_path, FLIGHT)
    paths = write_slocum(tmp_path, FLIGHT)
    lines = paths[0].read_text().splitlines()
    numbered = [f"{k - 1 if k else ''},{line}" for k, line in enumerate(lines)]
    paths[0].write_text("\n".join(numbered) + "\n")
    dataset, _ = import_logs("slocum", paths)
    assert np.allclose(dataset["measured_depth"], right["measured_depth"], equal_nan=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,m_depth\n1,2\n3,4,5\n", "row 2 of the values has more cells than the header"),
        ("time,m_depth\n1,2\n3,4,5,6\n", "not a table of 2 columns.*line 3"),
        ("time,m_depth\n1,2,3,4\n", "not a table of 2 columns"),
        ('time,m_depth\n1,"2\n3,4\n', "not a table of 2 columns"),
        ("1\n2\n", "does not begin with a line of column names"),
    ],
)
def test_tables_that_are_wrong_are_named(tmp_path, text, message):
    path = tmp_path / "a.csv"
    path.write_text(text)
    refused(rf"a\.csv.*{message}", path, by=read_table)


def test_cells_of_every_kind(tmp_path):
    """Separators at the ends of rows, short rows, quotes, words for nothing, and mixed columns."""
    path = tmp_path / "a.csv"
    path.write_text('x,"y",words,z,\n1e-1, 2 ,on,4,\nNaN,N/A,off,bad,\n\n0.30000000000000004\n')
    table = read_table(path)
    assert column_names(path) == ["x", "y", "words", "z"]
    assert list(table.columns) == ["x", "y", "z"]
    assert table.texts["words"].tolist() == ["on", "off", ""]
    np.testing.assert_array_equal(table.columns["x"], [0.1, np.nan, 0.30000000000000004])
    np.testing.assert_array_equal(table.columns["y"], [2.0, np.nan, np.nan])
    np.testing.assert_array_equal(table.columns["z"], [4.0, np.nan, np.nan])


def test_a_log_of_one_sample_says_so(tmp_path):
    one = part(slocum_columns(FLIGHT), slice(60, 61))
    path = write_csv(tmp_path / "unit1_flight.csv", one)
    refused("holds 1 sample", "slocum", [path], variation_deg=0.0)


def test_files_of_no_log_format_are_named(tmp_path):
    write_slocum(tmp_path, FLIGHT)
    (tmp_path / "LICENSE").write_text("free")
    _, report = import_logs("slocum", [tmp_path])
    assert details(report, "left out")["files"] == "no slocum logs: LICENSE"


def test_a_truth_in_centimetres_a_second_is_suspect(tmp_path):
    start, _ = FLIGHT.dive_times(1)
    times = np.arange(start + 20.0, start + 160.0, 1.0)
    paths = write_slocum(tmp_path, FLIGHT)
    truth = {"time": times, "U_dvl_ms": np.full(len(times), 40.0)}
    paths.append(write_csv(tmp_path / "unit1_truth.csv", truth))
    dataset, report = import_logs("slocum", paths)
    assert "cm/s" in details(report, "repaired")["U_dvl_ms"]
    assert np.nanmedian(dataset["true_speed"]) == pytest.approx(0.4)


@pytest.mark.parametrize("suffix", [".csv.gz", ".parquet", ".nc", ".mat"])
def test_cut_files_are_named_in_one_line(tmp_path, suffix):
    whole = tmp_path / f"whole{suffix}"
    kind = "slocum"
    table = write_slocum(tmp_path, FLIGHT)[0]
    if suffix == ".csv.gz":
        whole.write_bytes(gzip.compress(table.read_bytes()))
    elif suffix == ".parquet":
        parquet = pytest.importorskip("pyarrow.parquet")
        arrow = pytest.importorskip("pyarrow")
        parquet.write_table(arrow.table(slocum_columns(FLIGHT)), whole)
    elif suffix == ".mat":
        kind = "lrauv"
        write_mat(whole, FLIGHT)
    else:
        kind, names = "og1", ("TIME", "PITCH", "LATITUDE", "LONGITUDE")
        write_netcdf(whole, dict.fromkeys(names, (("N_MEASUREMENTS",), np.arange(5000.0))))
    cut = tmp_path / f"cut_flight{suffix}"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    with pytest.raises(InputError, match="cut_flight") as caught:
        import_logs(kind, [cut])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "fixes", [NO_FIXES, LoggedFixes(np.zeros(1), np.full(1, 5.0), np.zeros(1))]
)
def test_depth_is_of_the_latitude_where_the_log_was_made(fixes):
    """Gravity grows toward the poles: by its fixes, without any by the track of the vehicle."""
    time, pressure = np.arange(3.0), np.array([0.0, 500.0, 1000.0])
    log = DeploymentLog(
        deployment="north",
        platform="any",
        channels={"measured_pressure": Channel(time, pressure)},
        fixes=fixes,
        magnetic_variation=EMPTY,
        auxiliary={"latitude": Channel(time, np.full(3, 70.0))},
    )
    depth = with_depth(log, Tally()).channel("measured_depth").values
    expected = -gsw.z_from_p(pressure, 5.0 if len(fixes) else 70.0)
    np.testing.assert_allclose(depth, expected, atol=1e-9)
    assert abs(gsw.z_from_p(1000.0, 70.0) - gsw.z_from_p(1000.0, 5.0)) > 1.0


DEPTH_ONLY = """
vehicle = "x"
rows = "dives"
[time]
column = "t"
unit = "s"
[signals]
measured_depth = { column = "z", unit = "m" }
"""


def depth_table(folder, change):
    """Two dives to 100 m in 40 min, a sample every 5 s."""
    time = np.arange(0.0, 2400.0, 5.0)
    depth = 100.0 * (1.0 - np.abs((time / 1200.0) % 1.0 * 2.0 - 1.0))
    (folder / "mine.toml").write_text(DEPTH_ONLY)
    return write_csv(folder / "one.csv", {"t": 1.7e9 + time, "z": change(time, depth)})


@pytest.mark.parametrize("height", [5.5, 8.0, 19.0])
def test_a_sample_above_the_sea_goes_and_the_dives_stay(tmp_path, height):
    path = depth_table(tmp_path, lambda t, z: np.where(t == 1175.0, -height, z))
    dataset, report = import_logs("csv", [path], mapping=tmp_path / "mine.toml")
    assert report.rows == 2
    assert report.count("removed", "measured_depth") == 1
    assert report.count("repaired") == 0
    assert float(dataset["measured_depth"].max()) == pytest.approx(100.0, abs=0.5)
    assert float(dataset["measured_depth"].min()) > -0.1


@pytest.mark.parametrize("noisy", [False, True])
def test_a_column_that_counts_upward_is_turned(tmp_path, noisy):
    """A sentinel in every twentieth row, which counts neither way, does not change that."""
    path = depth_table(tmp_path, lambda t, z: np.where(noisy & (t % 100.0 == 50.0), -9999.0, -z))
    dataset, report = import_logs("csv", [path], mapping=tmp_path / "mine.toml")
    assert report.rows == 2
    assert report.count("repaired", "measured_depth") > 400
    assert float(dataset["measured_depth"].max()) == pytest.approx(100.0, abs=1.0)


def test_an_offset_is_no_column_that_counts_upward(tmp_path):
    """A sensor that shows 8 m above the sea while it floats; no fix tells that it floats."""
    path = depth_table(tmp_path, lambda t, z: np.maximum(z - 20.0, 0.0) - 8.0)
    dataset, report = import_logs("csv", [path], mapping=tmp_path / "mine.toml")
    assert report.count("repaired") == 0
    assert report.count("suspect", "measured_depth") > 50
    (why,) = [e.detail for e in report.entries if e.action == "suspect"]
    assert "above the sea by up to 8.0 m: the sensor has an offset" in why
    assert float(dataset["measured_depth"].max()) == pytest.approx(72.0, abs=0.5)


@pytest.mark.parametrize(
    ("values", "upward"),
    [
        (-np.linspace(0.0, 30.0, 50), True),
        (np.linspace(0.0, 30.0, 50), False),
        (np.linspace(-15.0, 40.0, 50), False),  # an offset
        (np.linspace(-1.5, 0.2, 50), False),  # waves
        (np.append(np.linspace(0.0, 30.0, 20), np.full(200, -999.0)), False),  # a sentinel
        (np.full(50, -12.0), False),
    ],
)
def test_which_way_a_column_counts(values, upward):
    assert counts_upward(values) is upward


def test_the_pressure_above_the_sea_goes_on_as_below(tmp_path):
    depth = np.array([-20.0, -4.0, -2.0, 0.0, 2.0, 1000.0])
    pressure = pressure_of(depth, 45.0)
    np.testing.assert_allclose(pressure[1:], gsw.p_from_z(-depth[1:], 45.0), rtol=1e-12)
    slope = np.diff(pressure[:3]) / np.diff(depth[:3])
    np.testing.assert_allclose(slope, slope[-1], rtol=1e-4)


def write_slocum_depths(folder, change):
    write_slocum(folder, FLIGHT, m_depth=change(slocum_columns(FLIGHT)["m_depth"]), m_pressure=None)
    return "slocum"


def write_og1_depths(folder, change):
    with netCDF4.Dataset(write_og1(folder / "one.nc", FLIGHT), "a") as file:
        file["DEPTH"][:] = change(file["DEPTH"][:])
    return "og1"


def write_dive_pressures(folder, change):
    for path in write_basestation(folder, FLIGHT):
        with netCDF4.Dataset(path, "a") as file:
            for name in ("depth", "pressure"):
                file[name][:] = change(file[name][:])
    return "seaglider"


def write_messages(folder, change):
    pytest.importorskip("rosbags.rosbag2")
    time, state = FLIGHT.with_fixes()
    write_bag(folder / "run", {**state, "depth": change(state["depth"])}, time)
    return "rosbag2"


@pytest.mark.parametrize(
    "write", [write_slocum_depths, write_og1_depths, write_dive_pressures, write_messages]
)
@pytest.mark.parametrize("upward", [False, True])
def test_every_kind_of_log_judges_its_depth_alike(tmp_path, write, upward):
    def change(depth):
        depth = np.array(depth, float)
        if upward:
            return -depth
        depth[40] = -9.0
        return depth

    kind = write(tmp_path, change)
    paths = [tmp_path / "run"] if kind == "rosbag2" else [tmp_path]
    dataset, report = import_logs(kind, paths)
    depth = dataset["measured_depth"].values
    assert np.nanmin(depth) > -0.5
    assert np.nanmax(depth) == pytest.approx(FLIGHT.depth, abs=1.5)
    turned = [e for e in report.entries if e.detail == "was positive up"]
    assert len(turned) == int(upward)
