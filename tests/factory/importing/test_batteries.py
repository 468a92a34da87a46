"""Charge, voltage, current, powers and vacuum: from every kind of log that has them."""

import csv

import netCDF4
import numpy as np
import pytest
from logs import slocum

from factory.importing import import_logs
from factory.samples import Flight, add_variables, write_netcdf
from factory.samples.archives import write_ngdac
from factory.samples.gliders import (
    slocum_columns,
    write_basestation,
    write_seaexplorer,
    write_slocum,
)
from glider_twin_protocols.auv_samples import write_mat

FLIGHT = Flight()
DEEP = Flight(depth=150.0, variation=15.0)


def values(dataset, name, row=0):
    found = dataset[name].values[row].astype(float)
    return found[np.isfinite(found)]


def test_a_slocums_counter_is_kept_at_its_own_samples(tmp_path):
    time = slocum_columns(FLIGHT)["time"]
    count = len(time)
    charge = 200.0 + 1e-4 * np.arange(count)
    charge[np.arange(count) % 10 != 0] = np.nan  # every 40 s
    files = write_slocum(
        tmp_path, FLIGHT, m_coulomb_amphr_total=charge, m_battery=np.full(count, 15.5),
        m_coulomb_current=np.full(count, 0.2), m_vacuum=np.full(count, 7.0),
        m_coulomb_amphr=np.full(count, 1.0),
    )  # fmt: skip
    dataset, report = import_logs("slocum", files)
    kept = values(dataset, "measured_charge")
    assert len(kept) < 0.1 * int(dataset["n_samples"][0])
    assert set(np.round(kept, 4)) <= set(np.round(charge[np.isfinite(charge)], 4))
    assert values(dataset, "measured_voltage") == pytest.approx(15.5)
    assert values(dataset, "measured_battery_current") == pytest.approx(0.2)
    assert values(dataset, "measured_vacuum") == pytest.approx(7.0 * 3386.389)
    assert "measured_thruster_power" not in dataset
    assert "m_coulomb_amphr" in report.names["flight table"]["left out"]


def test_a_thruster_takes_its_current_at_the_batteries_voltage(tmp_path):
    count = len(slocum_columns(FLIGHT)["time"])
    on = FLIGHT.state(FLIGHT.time)["under"]
    common = {"m_battery": np.full(count, 16.0), "m_thruster_power": 4.0 * on}
    dataset, _ = slocum(tmp_path, FLIGHT, **common)
    assert values(dataset, "measured_thruster_power").max() == pytest.approx(4.0)
    files = write_slocum(tmp_path, FLIGHT, **common, m_thruster_current=0.5 * on)
    dataset, _ = import_logs("slocum", files)
    assert values(dataset, "measured_thruster_power").max() == pytest.approx(8.0)
    assert values(dataset, "measured_thruster_power").min() == 0.0


def with_numbers(paths, **numbers):
    for path in paths:
        write_netcdf(path, {f"log_{name}": ((), value) for name, value in numbers.items()}, "a")


def with_words(paths, **words):
    for path in paths:
        write_netcdf(path, {f"log_{n}": ((f"of_{n}",), text) for n, text in words.items()}, "a")


def test_a_seagliders_gauges_count_both_batteries_at_both_ends_of_a_dive(tmp_path):
    paths = write_basestation(tmp_path, DEEP)
    with_numbers(
        paths, FG_AHR_10V=10.0, FG_AHR_24V=20.0, FG_AHR_10Vo=10.1, FG_AHR_24Vo=20.3,
        INTERNAL_PRESSURE=9.0,
    )  # fmt: skip
    with_words(paths, **{"24V_AH": "14.0,21.5", "10V_AH": "15.0,11.0"})
    dataset, _ = import_logs("seaglider", paths)
    assert values(dataset, "measured_charge") == pytest.approx([30.0, 30.4])
    assert values(dataset, "measured_voltage") == pytest.approx([14.5])
    assert values(dataset, "measured_vacuum") == pytest.approx([101325.0 - 9.0 * 6894.757])


def test_a_seaglider_without_gauges_reckons_its_charge(tmp_path):
    paths = write_basestation(tmp_path, DEEP)
    for number, path in enumerate(paths):
        words = {"24V_AH": f"24.1,{1.0 + number:.3f}", "10V_AH": f"10.3,{0.5 * number:.3f}"}
        with_words([path], **words)
    dataset, _ = import_logs("seaglider", paths)
    ends = [values(dataset, "measured_charge", row)[-1] for row in range(3)]
    assert ends == pytest.approx([1.0, 2.5, 4.0])
    with netCDF4.Dataset(paths[1], "a") as file:  # a text of another form says nothing
        file["log_24V_AH"][:] = list("no,numbers")[: len(file["log_24V_AH"])]
    dataset, _ = import_logs("seaglider", paths)
    assert [len(values(dataset, "measured_charge", row)) for row in range(3)] == [1, 0, 1]


def test_a_seagliders_pump_takes_power_while_it_runs(tmp_path):
    paths = write_basestation(tmp_path, DEEP)
    for path in paths:
        with netCDF4.Dataset(path, "a") as file:
            columns = {
                "st_secs": file["gc_end_secs"][:] - 60.0, "pitch_secs": [10.0, 20.0],
                "vbd_i": [0.0, 1.5], "vbd_secs": [0.0, 40.0], "vbd_volts": [30.0, 12.0],
            }  # fmt: skip
            add_variables(file, {f"gc_{n}": (("gc_event",), v) for n, v in columns.items()})
    dataset, _ = import_logs("seaglider", paths)
    power = dataset["measured_pump_power"].values[0]
    period = float(dataset.attrs.get("period", 5.0))
    assert np.nanmax(power) == pytest.approx(18.0)
    runs = np.flatnonzero(power == power.max())
    assert len(runs) * period == pytest.approx(40.0, abs=period)
    with netCDF4.Dataset(paths[0]) as file:  # after the pitch, 20 s from the move's start
        begin = float(file["gc_st_secs"][1]) + 20.0
    assert dataset["start_time"].values[0] + runs[0] * period == pytest.approx(begin, abs=period)


def test_a_seaexplorers_voltage_and_pressure_inside(tmp_path):
    path = write_seaexplorer(tmp_path / "sea035_M12_gli.csv", DEEP)
    with path.open() as file:
        rows = list(csv.reader(file))
    added = [[*row, "28.5", "71325"] for row in rows[1:]]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([[*rows[0], "Voltage", "Pa"], *added])
    dataset, _ = import_logs("seaexplorer", [path])
    assert values(dataset, "measured_voltage") == pytest.approx(28.5)
    assert values(dataset, "measured_vacuum") == pytest.approx(30000.0)


def test_an_lrauv_counts_what_is_left(tmp_path):
    path = write_mat(tmp_path / "shore.mat", DEEP)
    time = DEEP.time[::50] / 86400.0 + 719529.0
    with netCDF4.Dataset(path, "a") as file:
        for name, column, unit in (
            ("platform_battery_charge", 236.0 - 0.1 * np.arange(len(time)), "Ah"),
            ("platform_battery_voltage", np.full(len(time), 16000.0), "mV"),
        ):
            columns = {"time": (("n",), time), "value": (("n",), column)}
            columns["units"] = (("u",), np.array([ord(c) for c in unit], np.uint16))
            add_variables(file.createGroup(name), columns)
    dataset, _ = import_logs("lrauv", [path])
    charge = values(dataset, "measured_charge")
    assert charge[0] >= 0.0
    assert np.diff(charge) == pytest.approx(0.1, abs=1e-4)
    assert values(dataset, "measured_voltage") == pytest.approx(16.0)


def test_profiles_that_keep_a_slocums_sensors_have_its_counter(tmp_path):
    paths = write_ngdac(tmp_path, DEEP)
    for path in paths:
        with netCDF4.Dataset(path, "a") as file:
            size = len(file["time"])
            for name, value in (("m_coulomb_amphr_total", 12.5), ("m_battery", 15.0)):
                add_variables(file, {name: (file["time"].dimensions, np.full(size, value))})
    dataset, _ = import_logs("ngdac", paths)
    assert values(dataset, "measured_charge") == pytest.approx(12.5)
    assert values(dataset, "measured_voltage") == pytest.approx(15.0)


def test_impossible_voltages_go(tmp_path):
    count = len(slocum_columns(FLIGHT)["time"])
    volts = np.full(count, 15.0)
    volts[:5] = 0.0
    _, report = slocum(tmp_path, FLIGHT, m_battery=volts)
    assert report.count("removed", "m_battery") == 5
