"""Import of tables by a mapping: units, axes, rows, refusals, and every column accounted for."""

import datetime
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from logs import SENTINEL, example, part, refused, sailfish_columns

from factory.importing import import_logs
from factory.importing.formats.csv.mapping_file import load_mapping, parse_mapping, shipped_names
from factory.importing.units import in_unit
from factory.samples import START, Flight, write_csv
from factory.samples.archives import table_columns
from factory.soundness import verify_logs
from twin.records.logged import LogStore
from twin.records.store import write_store

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "howto" / "import_tables.md").read_text()
TORPEDO = ROOT / "tests" / "vehicles" / "torpedo.xml"
FLIGHT = Flight(depth=100.0, surface=600.0)


def mine(**changes):
    """The page's mapping with other top-level keys; None removes one."""
    data = {**tomllib.loads(example(PAGE, "mine.toml")), **changes}
    return {key: value for key, value in data.items() if value is not None}


def with_signals(**signals):
    """The page's mapping with other signals; None removes one."""
    kept = {**mine()["signals"], **signals}
    return mine(signals={name: entry for name, entry in kept.items() if entry is not None})


def text_of(data):
    """A mapping as TOML, by JSON, of which its values are a part."""
    lines = [f"{key} = {_value(value)}" for key, value in data.items() if key != "corrections"]
    for one in data.get("corrections", []):
        lines.append("[[corrections]]")
        lines += [f"{key} = {json.dumps(value)}" for key, value in one.items()]
    return "\n".join(lines)


def _value(value):
    if isinstance(value, dict):
        inside = ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items())
        return "{ " + inside + " }"
    if isinstance(value, datetime.datetime):
        return value.isoformat()
    return json.dumps(value)


@pytest.fixture
def folder(tmp_path):
    write_csv(tmp_path / "log.csv", table_columns(FLIGHT))
    return tmp_path


def bring(folder, data, *files, **options):
    (folder / "mapping.toml").write_text(text_of(data))
    paths = [folder / name for name in files or ("log.csv",)]
    return import_logs("csv", paths, mapping=folder / "mapping.toml", **options)


# --- what comes in ------------------------------------------------------------------------------


def test_units_axes_and_headings_become_those_of_the_store(folder):
    dataset, report = bring(folder, mine())
    assert report.rows == report.rows_with_fixes == FLIGHT.dives
    assert dataset.attrs["platform"] == "my AUV"
    n = int(dataset["n_samples"][1])
    truth = FLIGHT.state(float(dataset["start_time"][1]) + dataset["time"].values[:n])
    steady = (truth["depth"] > 5.0) & (truth["depth"] < 95.0)

    def row(name):
        return np.asarray(dataset[name].values[1, :n][steady], float)

    assert np.allclose(row("measured_pitch"), truth["pitch"][steady], atol=1e-3)
    assert np.allclose(row("measured_heading"), FLIGHT.heading, atol=1e-3)
    assert np.allclose(row("measured_pump"), truth["pump"][steady], atol=1e-3)
    # an eastward-up rate of -0.5 degree/s about the axis up is one to starboard
    assert np.allclose(row("measured_yaw_rate"), np.radians(0.5), atol=1e-6)
    surge = row("measured_dvl_surge")
    assert np.allclose(surge[np.isfinite(surge)], FLIGHT.speed, atol=1e-5)


def test_every_column_is_read_left_out_or_named(folder):
    _, report = bring(folder, mine())
    rows = len(FLIGHT.time)
    under = int(FLIGHT.state(FLIGHT.time)["under"].sum())
    became = {}
    for entry in report.entries:
        for column in table_columns(FLIGHT):
            named = column in entry.detail.split(", ") if entry.action == "not read" else False
            if (entry.action in ("read", "left out") and entry.subject == column) or named:
                became[column] = entry.action
    assert set(became) == set(table_columns(FLIGHT))
    (told,) = report.names.values()
    assert set().union(*told.values()) == set(table_columns(FLIGHT))
    assert told["left out"] == ("ax",)
    assert told["not read"] == ("comment",)
    assert became["ax"] == "left out"
    assert became["comment"] == "not read"
    assert report.count("read", "theta") == rows
    assert report.count("removed", "vx") == rows - under
    assert report.count("read", "lat") == rows - under


@pytest.mark.parametrize(
    ("unit", "seconds"), [("us", 1e-6), ("min", 60.0), ("h", 3600.0), ("days", 86400.0)]
)
def test_a_clock_of_another_unit_tells_the_same_times(folder, unit, seconds):
    columns = table_columns(FLIGHT)
    stamp = 1e-3 * columns["stamp"] / seconds  # the page's are milliseconds
    write_csv(folder / "log.csv", {**columns, "stamp": stamp})
    dataset, _ = bring(folder, mine(time={**mine()["time"], "unit": unit}))
    assert dataset["dive_duration"].values == pytest.approx(2.0 * FLIGHT.leg, abs=10.0)
    began = [FLIGHT.dive_times(dive)[0] for dive in range(FLIGHT.dives)]
    assert dataset["start_time"].values.astype(float) == pytest.approx(began, abs=10.0)


def test_a_mapped_column_without_a_value_is_missing(folder):
    nothing = np.full(len(FLIGHT.time), np.nan)
    write_csv(folder / "log.csv", {**table_columns(FLIGHT), "r": nothing})
    dataset, report = bring(folder, mine())
    assert report.names["csv table"]["missing"] == ("r",)
    assert "measured_yaw_rate" not in dataset


def test_rows_out_of_order_and_written_twice_are_counted(folder):
    columns = table_columns(FLIGHT)
    order = np.arange(len(FLIGHT.time))
    order[[100, 101]] = order[[101, 100]]
    order = np.insert(order, 300, order[300])
    write_csv(folder / "log.csv", part(columns, order))
    dataset, report = bring(folder, mine())
    assert report.count("sorted") == 1
    assert report.count("repeated") == 1
    straight = bring(folder, mine())[0]
    assert dataset.equals(straight)


def test_a_correction_turns_a_column_of_some_files(folder):
    columns = table_columns(FLIGHT)
    write_csv(folder / "2023-12-01.csv", columns)
    turned, report = bring(folder, mine(), "2023-12-01.csv")
    assert float(np.nanmedian(turned["measured_yaw_rate"])) == pytest.approx(-np.radians(0.5))
    (note,) = [e for e in report.entries if e.subject == "measured_yaw_rate"]
    assert note.action == "note"
    assert "2023-12-01.csv: the gyroscope was mounted upside down" in note.detail


def test_magnetic_headings_need_a_variation(folder):
    heading = {**mine()["signals"]["measured_heading"], "north": "magnetic"}
    nowhere = with_signals(measured_heading=heading, gps_latitude=None, gps_longitude=None)
    refused("from magnetic north, and the log has neither a varia", folder, nowhere, by=bring)
    data = with_signals(measured_heading=heading)
    dataset, _ = bring(folder, data, variation_deg=10.0)
    assert float(np.nanmedian(dataset["measured_heading"])) == pytest.approx(FLIGHT.heading + 10.0)


@pytest.mark.parametrize("places", [("gps_latitude", "gps_longitude"), ("latitude", "longitude")])
def test_a_place_gives_the_variation(folder, places):
    """The field at the flight's place and date, whether a fix or the vehicle's own track tells."""
    signals = mine()["signals"]
    heading = {**signals["measured_heading"], "north": "magnetic"}
    moved = dict.fromkeys(("gps_latitude", "gps_longitude"))
    moved |= {name: signals[f"gps_{name.split('_')[-1]}"] for name in places}
    dataset, _ = bring(folder, with_signals(measured_heading=heading, **moved))
    variation = float(dataset["magnetic_variation"][0])
    assert variation == pytest.approx(-18.05, abs=0.1)
    assert float(np.nanmedian(dataset["measured_heading"])) == pytest.approx(
        FLIGHT.heading + variation, abs=1e-3
    )


def test_a_position_that_repeats_is_one_fix_and_the_first_an_old_one(folder):
    columns = table_columns(FLIGHT)
    under = np.isnan(columns["lat"])
    last = np.maximum.accumulate(np.where(under, 0, np.arange(len(under))))
    first = int(np.argmax(under))
    for name in ("lat", "lon"):
        columns[name] = columns[name][last]
        columns[name][:first] = columns[name][first - 1]  # an old fix until the first dive
    write_csv(folder / "log.csv", columns)
    _, report = bring(folder, mine())
    assert report.rows == FLIGHT.dives
    assert report.rows_with_fixes == FLIGHT.dives - 1
    repeated = [e.count for e in report.entries if "repeat the position" in e.detail]
    assert repeated == [first + int(under.sum())]


def test_deployments_by_column_or_by_one_name(folder):
    columns = table_columns(FLIGHT)
    run = np.where(FLIGHT.state(FLIGHT.time)["dive"] < 1, 1.0, 2.0)
    write_csv(folder / "log.csv", {**columns, "run": run})
    _, report = bring(folder, mine(deployment={"column": "run"}))
    assert report.deployments == ("1", "2")
    half = len(FLIGHT.time) // 2
    for name, rows in (("b.csv", slice(half, None)), ("a.csv", slice(0, half))):
        write_csv(folder / name, part(columns, rows))
    _, report = bring(folder, mine(deployment={"name": "lake"}), "b.csv", "a.csv")
    assert report.deployments == ("lake",)
    assert report.rows == FLIGHT.dives
    refused(
        r"unknown column 'rum'.*did you mean 'run'",
        folder,
        mine(deployment={"column": "rum"}),
        by=bring,
    )


# --- logs without depth, fixes or controls ------------------------------------------------------


def flat(**changes):
    """A mapping of attitude and yaw rate alone."""
    kept = ("measured_pitch", "measured_heading", "measured_yaw_rate")
    signals = {name: entry for name, entry in mine()["signals"].items() if name in kept}
    return mine(signals=signals, rows="file", **changes)


def test_a_log_without_depth_fixes_or_controls_is_a_log(folder, tmp_path):
    dataset, report = bring(folder, flat())
    assert report.rows == 1
    assert not {"measured_depth", "measured_phase", "measured_gps_north"} & set(report.channels)
    assert dataset["dive_duration"].values[0] == pytest.approx(np.ptp(FLIGHT.time))
    write_store(dataset, tmp_path / "flat.zarr")
    with LogStore(tmp_path / "flat.zarr") as logs:
        assert verify_logs(logs).ok


def test_rows_are_minutes_or_end_at_gaps(folder):
    columns = table_columns(FLIGHT)
    whole = float(np.ptp(FLIGHT.time))
    _, report = bring(folder, flat() | {"rows": 5})
    assert report.rows == round(whole / 300.0)
    keep = np.ones(len(FLIGHT.time), bool)
    keep[200:260] = False  # 4 minutes
    write_csv(folder / "log.csv", part(columns, keep))
    dataset, report = bring(folder, flat() | {"rows": "gaps"})
    assert report.rows == 2
    lengths = dataset["dive_duration"].values
    assert lengths.sum() == pytest.approx(whole - 61 * FLIGHT.step)
    assert dataset["start_time"].values[1] == pytest.approx(START + 260 * FLIGHT.step)
    refused("no row of 60 s or longer", folder, flat() | {"rows": "gaps", "gap_s": 1}, by=bring)


def test_runs_are_divided_among_the_parts_of_a_store(folder):
    for k in range(3):
        write_csv(folder / f"{k}.csv", table_columns(FLIGHT))
    dataset, _ = bring(folder, flat(), "0.csv", "1.csv", "2.csv")
    assert sorted(dataset["split"].values.tolist()) == [0, 1, 2]


def test_controls_are_those_of_a_vehicle(folder, tmp_path):
    columns = table_columns(FLIGHT)
    command = np.where(np.arange(len(FLIGHT.time)) % 10 < 5, 5.0, -5.0)
    write_csv(folder / "log.csv", {**columns, "delta": command, "n": np.full(len(command), 300.0)})
    data = flat(model=str(TORPEDO))
    data["signals"] |= {
        "commanded_rudder": {"column": "delta", "unit": "deg"},
        "measured_propeller": {"column": "n", "unit": "rpm"},
    }
    dataset, _ = bring(folder, data)
    assert float(np.nanmedian(dataset["measured_propeller"])) == pytest.approx(31.4159, abs=1e-3)
    # a command keeps its value until the next
    assert set(np.unique(dataset["commanded_rudder"])) == {-5.0, 5.0}
    write_store(dataset, tmp_path / "own.zarr")
    with LogStore(tmp_path / "own.zarr") as logs:
        assert logs.vehicle.part_names == ("propeller", "rudder", "elevator")
    del data["model"], data["signals"]["measured_propeller"]
    data["signals"] = {"commanded_ruder": data["signals"]["commanded_rudder"]}
    refused(r"signal 'commanded_ruder'.*name the vehicle: model", folder, data, by=bring)


# --- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (with_signals(measured_pich={"column": "theta", "unit": "rad"}),
         "unknown signal 'measured_pich': did you mean 'measured_pitch'"),
        (with_signals(measured_phase={"column": "z"}), "the import makes measured_phase itself"),
        (with_signals(measured_pitch={"column": "theta", "unit": "rads"}),
         "unit 'rads' is not one of degree: unknown unit 'rads': did you mean 'rad"),
        (with_signals(measured_depth={"column": "z", "unit": "bar"}),
         "unit 'bar' is not one of m, it is one of dbar"),
        (with_signals(measured_pitch={"column": "theta"}), "unit is missing; take one of deg"),
        (with_signals(measured_pitch={"unit": "rad"}), "column is missing"),
        (with_signals(measured_pitch={"column": "theta", "unit": "rad", "zero": "east"}),
         "zero is for headings"),
        (with_signals(measured_pitch={"column": "theta", "unit": "rad", "sign": 2}),
         "sign must be 1 or -1"),
        (with_signals(measured_pitch={"column": "theta", "unit": "rad", "framed": "FLU"}),
         "unknown key 'framed': did you mean 'frame'"),
        (with_signals(measured_pitch={"column": "theta", "unit": "rad", "possible": [1, 0]}),
         "possible must be"),
        (with_signals(gps_longitude=None), "gps_latitude and gps_longitude belong together"),
        (mine(frame="FLD"), "unknown frame 'FLD'"),
        (mine(vehicle=None), "vehicle is missing"),
        (mine(rows="dive"), 'rows must be "dives"'),
        (with_signals(measured_depth=None), 'rows = "dives" needs measured_depth'),
        (mine(deployment="run"), "deployment must be"),
        (mine(time={"column": "stamp", "unit": "fortnight"}), "unknown unit of time 'fortnight'"),
        (mine(time={"column": "stamp", "start": "yesterday"}), "start must be a time such as"),
        (mine(time={"column": "stamp", "start_from_name": "^2023"}), "one group in brackets"),
        (mine(ignored={"theta": "why"}), "column 'theta' is measured_pitch and ignored"),
        (mine(ignored={"ax": ""}), "ignored.ax needs a reason"),
        (mine(corrections=[{"files": "*", "signal": "measured_roll", "reason": "x", "sign": -1}]),
         "unknown mapped signal 'measured_roll'"),
        (mine(corrections=[{"files": "*", "signal": "measured_pitch", "reason": "x"}]),
         "it changes nothing"),
        (mine(corrections=[{"files": "*", "reason": "x", "sign": -1}]), ": signal is missing"),
        (mine(dvl_lock="floor"), "unknown dvl_lock 'floor'"),
        (mine(gap_s=0), "gap_s must be above 0"),
        (mine(tme={}), "unknown key 'tme': did you mean 'time'"),
    ],
)  # fmt: skip
def test_a_wrong_mapping_is_refused(data, message):
    refused(re.escape(message), data, "mine.toml", by=parse_mapping)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (with_signals(measured_pitch={"column": "teta", "unit": "rad"}),
         "log.csv: measured_pitch: unknown column 'teta': did you mean 'theta'"),
        (mine(time={"column": "stamps"}), "time: unknown column 'stamps': did you mean 'stamp'"),
        (mine(time={"column": "stamp", "unit": "ms"}), "not unix time: give in [time] when"),
        (mine(time={"column": "stamp", "unit": "iso"}), "holds numbers: write unit"),
        (mine(time={"column": "stamp", "unit": "ms", "start_from_name": r"^(\d{8})_"}),
         "its name does not fit start_from_name"),
        (with_signals(measured_dvl_surge={"column": "vx", "unit": "m/s"}),
         "is to be measured_dvl_surge and is -99 m/s in"),
        (with_signals(true_surge={"column": "z", "unit": "m/s"}), "a distance, not a velocity"),
    ],
)  # fmt: skip
def test_a_mapping_that_does_not_fit_the_file(folder, data, message):
    refused(re.escape(message), folder, data, by=bring)


def test_what_a_csv_import_needs(folder):
    refused(r"log\.csv: csv tables need a --mapping.*sailfish", "csv", [folder / "log.csv"])
    refused(
        r"no mapping file salfish: .*did you mean 'sailfish'",
        "csv",
        [folder / "log.csv"],
        mapping="salfish",
    )
    (folder / "broken.toml").write_text("vehicle = ")
    refused(
        r"broken\.toml is not TOML", "csv", [folder / "log.csv"], mapping=folder / "broken.toml"
    )
    columns = {**table_columns(FLIGHT), "theta": ["steep"] * len(FLIGHT.time)}
    write_csv(folder / "log.csv", columns)
    refused("column 'theta' is to be measured_pitch and holds text", folder, mine(), by=bring)


def test_shipped_mappings_are_whole():
    assert "sailfish" in shipped_names()
    for name in shipped_names():
        assert load_mapping(name).signals


@pytest.mark.parametrize(
    ("unit", "wanted", "value"),
    [
        ("rad", "degree", 180.0 / np.pi),
        ("deg/s", "rad s-1", np.pi / 180.0),
        ("rpm", "rad s-1", 2.0 * np.pi / 60.0),
        ("knots", "m s-1", 1852.0 / 3600.0),
        ("cm/s", "m s-1", 0.01),
        ("km/h", "m s-1", 1.0 / 3.6),
        ("bar", "dbar", 10.0),
        ("kPa", "dbar", 0.1),
        ("psi", "dbar", 0.6894757),
        ("L", "cm3", 1000.0),
        ("g", "m s-2", 9.80665),
        ("ft", "m", 0.3048),
        ("mS/cm", "S m-1", 0.1),
        ("K", "degree_Celsius", -272.15),
    ],
)
def test_units(unit, wanted, value):
    assert in_unit(np.ones(1), unit, wanted, "x")[0] == pytest.approx(value)


# --- a propelled vehicle in the layout of the Sailfish's files -----------------------------------


SURGE = "measured_dvl_surge"


def sailfish(folder, name="20220712_0_1.csv", **changes):
    columns = sailfish_columns()
    write_csv(folder / name, {**columns, **changes})
    return import_logs("csv", [folder / name], mapping="sailfish")


def test_the_sailfish_layout(tmp_path):
    columns = sailfish_columns()
    dataset, report = sailfish(tmp_path)
    assert report.rows == round(400.0 / 120.0)
    lost = int((columns["vf"] == -SENTINEL).sum())
    assert report.count("removed", "vf") == report.count("removed", "vl") == lost
    assert float(np.nanmedian(dataset["measured_pitch"])) == pytest.approx(-np.degrees(0.1))
    assert float(np.nanmedian(dataset["measured_pitch_rate"])) == pytest.approx(-0.01)
    assert float(np.nanmax(dataset["measured_yaw_rate"])) == pytest.approx(0.08)
    assert float(np.nanmin(dataset["measured_dvl_sway"])) == pytest.approx(-0.16)
    assert float(np.nanmax(np.abs(dataset["measured_dvl_surge"]))) == pytest.approx(1.5)
    assert not [name for name in dataset.data_vars if "specific_force" in str(name)]
    assert any("difference of the DVL" in e.detail for e in report.entries if e.subject == "ax")
    lock = dataset["measured_dvl_mode"].values
    assert np.nanmean(lock) == pytest.approx(1.0 - lost / len(columns["vf"]), abs=0.02)
    # the track turns with the heading: clockwise from north
    assert report.count("suspect", "measured_dvl_sway") == 0
    start = str(np.datetime64(int(dataset["start_time"].values[0]), "s"))
    assert start.startswith("2022-07-12T00:00")


def test_a_sentinel_is_shown_as_the_file_has_it_and_goes_by_name_or_by_what_is_possible(folder):
    columns = table_columns(FLIGHT)
    knots = np.where(np.arange(len(FLIGHT.time)) % 5 == 0, 48.66, 2.0)
    knots[1::5] = knots[2::5] = -48.66
    write_csv(folder / "log.csv", {**columns, "vx": -knots})
    entry = {"column": "vx", "unit": "knots", "sign": -1}

    def surge(**more):
        data = flat()
        return bring(folder, data | {"signals": data["signals"] | {SURGE: entry | more}})

    shown = r"'vx' .* is -48\.66 knots in 20 % and 48\.66 knots in 40 % of .*= \[-48\.66, 48\.66\]"
    refused(shown, by=surge)
    refused(r"is 48\.66 knots in 50 % of .*= \[48\.66\]", sentinels=[-48.66], by=surge)
    lost = int((np.abs(knots) > 3.0).sum())
    for cure, removed in (
        ({"sentinels": [-48.66, 48.66]}, "vx"),
        ({"possible": [-3, 3]}, SURGE),
    ):
        dataset, report = surge(**cure)
        assert report.count("removed", removed) == lost
        assert float(np.nanmax(np.abs(dataset[SURGE]))) == pytest.approx(2.0 * 1852.0 / 3600.0)
    write_csv(folder / "log.csv", {**columns, "vx": np.cumsum(np.abs(knots))})
    refused("a distance, not a velocity", possible=[-3, 3], by=surge)


def test_distances_in_the_place_of_velocities_are_refused(tmp_path):
    columns = sailfish_columns()
    run = np.cumsum(np.full(len(columns["time"]), 0.15))
    refused(r"'vf' .* no two alike: a distance, not a velocity", tmp_path, vf=run, by=sailfish)
    refused(
        r"^20220712_0_1\.csv: .* has 0\.15 m/s where the track.*metres per sample",
        tmp_path,
        vf=np.full(len(run), 0.15),
        by=sailfish,
    )
    refused(
        r"0 m/s where the track moves forward .*sensor that was",
        tmp_path,
        vf=np.zeros(len(run)),
        by=sailfish,
    )


def test_a_minute_of_track_is_enough_to_refuse_a_distance(tmp_path):
    columns = sailfish_columns()
    minute = columns["time"] < columns["time"][0] + 70.0
    short = part(columns, minute)
    refused(
        "metres per sample",
        tmp_path,
        **short | {"vf": np.full(int(minute.sum()), 0.15)},
        by=sailfish,
    )


def test_a_strong_current_is_suspect_and_no_other_unit(tmp_path):
    columns = sailfish_columns()
    slow = np.where(columns["vf"] == -SENTINEL, -SENTINEL, 0.4 + 0.02 * np.sin(columns["time"]))
    _, report = sailfish(tmp_path, vf=slow)
    assert report.count("suspect", "measured_dvl_surge")
    refused(
        r"has 4 m/s where .*a distance, or another unit",
        tmp_path,
        vf=np.where(slow == -SENTINEL, -SENTINEL, 10.0 * slow),
        by=sailfish,
    )


def test_a_sway_against_the_track_is_suspect_and_corrected_by_the_mapping(tmp_path):
    turned = sailfish_columns()["vl"]
    turned = np.where(turned == SENTINEL, turned, -turned)
    dataset, report = sailfish(tmp_path, vl=turned)
    assert report.count("suspect", "measured_dvl_sway")
    assert float(np.nanmax(dataset["measured_dvl_sway"])) == pytest.approx(0.16)
    dataset, report = sailfish(tmp_path, "20220719_6_1.csv", vl=turned)
    assert not report.count("suspect", "measured_dvl_sway")
    assert float(np.nanmin(dataset["measured_dvl_sway"])) == pytest.approx(-0.16)


# --- files without a header ---------------------------------------------------------------------


def iver2_rows(count=300):
    """Rows of an Iver2: a dive nose down, and a turn to starboard with the rudder to starboard."""
    rows = []
    for k in range(count):
        pitch = -10.0 if 50 <= k < 100 else 0.0
        row = [0.5 * k, 0.0, 0.0, 2.0 + 0.1 * max(min(k, 100) - 50, 0), 1.0, pitch, 90.0 + 0.1 * k]
        row += [999.0, 999.0, 999.0, -1.2, 0.1, -0.05, 5.0, 5.0, -4.0, -4.0, 50, 2.0, 6000]
        rows.append(" ".join(f"{value:.3f}" for value in [*row, *[0.0] * 15]))
    return rows


def test_an_iver2s_log_has_no_header(tmp_path):
    path = tmp_path / "IverControlData-20220913045149.log"
    path.write_text("\n".join(iver2_rows()) + "\n 150.0 0.0 0.0 7.")  # cut in its last row
    dataset, report = import_logs("csv", [path], mapping="iver2")
    start = datetime.datetime(2022, 9, 13, 4, 51, 49, tzinfo=datetime.UTC).timestamp()
    assert float(dataset["start_time"].values[0]) == pytest.approx(start)
    means = {
        "measured_dvl_surge": 1.2, "measured_dvl_sway": -0.1, "measured_dvl_heave": 0.05,
        "measured_rudder": -5.0, "measured_elevator": 4.0,
        "measured_propeller": 600.0 * 2.0 * np.pi / 60.0, "measured_dvl_mode": 1.0,
    }  # fmt: skip
    for name, value in means.items():
        assert np.nanmean(dataset[name].values) == pytest.approx(value, rel=1e-5), name
    assert "measured_dvl_surge" in report.channels
    assert "commanded_heading" not in report.channels
    assert [e.count for e in report.entries if e.detail == "rows that were cut off"] == [1]


def test_files_without_a_header_fit_their_names_or_are_refused(tmp_path):
    path = tmp_path / "IverControlData-20220913045149.log"
    path.write_text("\n".join(f"{row} 1.0" for row in iver2_rows()))
    refused("has more cells than the header has names", "csv", [path], mapping="iver2")
    path.write_text("\n".join(row[:30] for row in iver2_rows()))
    refused("no row has a time in column 'elapsed'", "csv", [path], mapping="iver2")
    mapping = tmp_path / "own.toml"
    mapping.write_text(text_of(mine(columns=["stamp", "z", "z"])))
    refused("columns names 'z' twice", "csv", [path], mapping=mapping)
    mapping.write_text(text_of(mine(columns=["stamp", "depth"])))
    path.write_text("0 1\n1 2\n2 3\n")
    refused("measured_depth: unknown column 'z'", "csv", [path], mapping=mapping)
