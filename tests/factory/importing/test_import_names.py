"""Import: what becomes of each name in a file, the pump that is taken, and payloads by name."""

import numpy as np
import pytest
from logs import refused, slocum

from factory.importing import import_logs
from factory.samples import Flight
from factory.samples.gliders import slocum_columns, write_slocum
from twin.records.schema import VARIABLES, Variable, declare, declare_stored

FLIGHT = Flight(depth=100.0, surface=600.0)


@pytest.mark.parametrize("column", sorted(set(slocum_columns(FLIGHT)) - {"time"}))
def test_a_name_that_is_read_makes_a_difference(column, tmp_path):
    """What the report calls read is in the store: without it something is missing or otherwise."""
    dataset, report = slocum(tmp_path, FLIGHT)
    assert column in report.names["flight table"]["read"]
    without, _ = slocum(tmp_path, FLIGHT, **{column: None})
    same = all(
        name in without and np.array_equal(dataset[name], without[name], equal_nan=True)
        for name in report.channels
    )
    assert not same or column == "m_depth"  # it only tells the unit of the pressure


def test_what_is_known_and_not_used_is_left_out_and_what_is_empty_is_missing(tmp_path):
    count = len(FLIGHT.time)
    _, report = slocum(
        tmp_path,
        FLIGHT,
        m_de_oil_vol=np.zeros(count),  # of a pump that this vehicle has not
        c_battpos=np.full(count, np.nan),
        sci_bird_count=np.ones(count),
    )
    names = report.names["flight table"]
    assert names["left out"] == ("m_de_oil_vol",)
    assert names["missing"] == ("c_battpos",)
    assert names["not read"] == ("sci_bird_count",)
    table = {(row["what"], row["of"]): row["why"] for row in report.table()}
    assert "another pump" in str(table[("left out", "m_de_oil_vol")])
    assert "c_battpos" in str(table[("missing", "flight table")])


@pytest.mark.parametrize("rows", ["one", "every"])
def test_of_two_pumps_the_one_that_moves_is_taken(rows, tmp_path):
    """A deep Slocum writes a 0 of the ballast pump that it has not, and its oil bladder."""
    columns = slocum_columns(FLIGHT)
    oil = columns["m_ballast_pumped"] + 60.0
    ballast = np.zeros(len(oil))
    if rows == "one":
        ballast[1:] = np.nan
    dataset, report = slocum(tmp_path, FLIGHT, m_ballast_pumped=ballast, m_de_oil_vol=oil)
    pump = dataset["measured_pump"].values
    assert np.nanmin(pump) == pytest.approx(-170.0)
    assert np.nanmax(pump) == pytest.approx(290.0)
    notes = [e.detail for e in report.entries if e.subject == "measured_pump"]
    assert len(notes) == 1
    assert "from m_de_oil_vol" in notes[0]
    assert "not m_ballast_pumped" in notes[0]


def test_a_log_without_any_pump_says_that_it_is_missing(tmp_path):
    dataset, report = slocum(tmp_path, FLIGHT, m_ballast_pumped=None)
    assert "measured_pump" not in dataset
    assert report.count("missing", "measured_pump") == 1


def test_payload_comes_by_known_names_and_by_those_that_the_user_maps(tmp_path):
    depth = slocum_columns(FLIGHT)["m_depth"]
    oxygen, nitrate = 200.0 + depth, 3.0 + 0.1 * depth
    oxygen[::2] = np.nan  # every 8 s
    oxygen[(FLIGHT.time > FLIGHT.dive_times(1)[0] + 100.0) & (depth > 30.0)] = np.nan
    oxygen[5] = -9999.0
    paths = write_slocum(tmp_path, FLIGHT, sci_oxy4_oxygen=oxygen, sci_suna_no3=nitrate)
    dataset, report = import_logs("slocum", paths, payload=["nitrate=sci_suna_no3[umol L-1]"])
    assert dataset["measured_oxygen"].attrs["units"] == "umol L-1"
    assert dataset["measured_nitrate"].attrs["units"] == "umol L-1"
    truth = dataset["measured_depth"].values
    # the tips of the saw-tooth lie between samples
    off = np.abs(dataset["measured_oxygen"].values - 200.0 - truth)
    assert np.nanmax(off) < 1.5
    assert np.nanmedian(off) < 0.1
    assert np.isnan(dataset["measured_oxygen"].values[2]).mean() > 0.2  # no value where it was off
    assert np.nanmax(np.abs(dataset["measured_nitrate"].values - 3.0 - 0.1 * truth)) < 0.2
    assert report.count("removed", "sci_oxy4_oxygen") == 1
    assert {"sci_oxy4_oxygen", "sci_suna_no3"} <= set(report.names["flight table"]["read"])


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("nitrate", "write NAME=COLUMN"),
        ("Nitrate=sci_suna_no3", "small letters"),
        ("pitch=sci_suna_no3", "measured_pitch is a signal of every store"),
        ("nitrate=sci_suna_no", r"no file has the column 'sci_suna_no'; is it sci_suna_no3"),
    ],
)
def test_a_wrong_mapping_is_refused(word, message, tmp_path):
    paths = write_slocum(tmp_path, FLIGHT, sci_suna_no3=np.ones(len(FLIGHT.time)))
    refused(message, "slocum", paths, payload=[word])


def test_what_a_store_says_of_a_name_does_not_stop_an_import(tmp_path):
    """A store with a sensor of one's own was opened before in this process."""
    VARIABLES.pop("measured_turbidity", None)
    declare_stored("measured_turbidity", {"units": "NTU", "long_name": "turbidity"})
    paths = write_slocum(tmp_path, FLIGHT, sci_flntu_turb_units=np.ones(len(FLIGHT.time)))
    dataset, _ = import_logs("slocum", paths)
    assert dataset["measured_turbidity"].attrs["units"] == "1"


def test_a_sensor_s_own_meaning_of_a_name_is_kept_and_said(tmp_path):
    VARIABLES.pop("measured_turbidity", None)
    declare(Variable("measured_turbidity", "m", "of another kind"))
    paths = write_slocum(tmp_path, FLIGHT, sci_flntu_turb_units=np.ones(len(FLIGHT.time)))
    dataset, report = import_logs("slocum", paths)
    assert "measured_turbidity" not in dataset
    assert any("another meaning" in entry.detail for entry in report.entries)
    refused("exists already", "slocum", paths, payload=["turbidity=sci_flntu_turb_units"])


def test_folders_below_are_named_and_searched_on_request(tmp_path):
    folders = [tmp_path / "parent" / name for name in ("2016", "2017")]
    for number, folder in enumerate(folders):
        folder.mkdir(parents=True)
        write_slocum(folder, Flight(), name=f"unit{number}")
    refused(r"; 2 below it do: give --recursive, or name .*2016, ", "slocum", [tmp_path / "parent"])
    _, report = import_logs("slocum", [tmp_path / "parent"], recursive=True)
    assert report.deployments == ("unit0", "unit1")
    (tmp_path / "empty" / "below").mkdir(parents=True)
    refused("nor do the folders below it", "slocum", [tmp_path / "empty"])


def test_what_a_log_holds_from_before_its_clock_was_set_goes(tmp_path):
    """Hours on the deck in 1990: no fix, no dive; another deployment's dives stay."""
    right, _ = slocum(tmp_path, Flight())
    table = slocum_columns(Flight())
    early = {name: values[:50].copy() for name, values in table.items()}
    early["time"] = 646_000_000.0 + np.arange(50.0)
    early["m_depth"], early["m_pressure"] = np.zeros(50), np.zeros(50)
    both = {name: np.concatenate([early[name], table[name]]) for name in table}
    dataset, report = slocum(tmp_path, Flight(), **both)
    assert report.count("removed", "unit1") == 50
    assert not [e for e in report.entries if "silent for" in e.detail]
    assert np.array_equal(dataset["measured_depth"], right["measured_depth"], equal_nan=True)
    early["m_depth"], early["m_pressure"] = np.full(50, 60.0), np.full(50, 6.0)
    both = {name: np.concatenate([early[name], table[name]]) for name in table}
    _, report = slocum(tmp_path, Flight(), **both)
    assert report.count("removed", "unit1") == 0
