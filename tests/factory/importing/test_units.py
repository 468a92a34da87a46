"""Units of logs: a declaration converts, contradictions are told, and guesses come last."""

import dataclasses
from datetime import UTC, datetime

import gsw
import netCDF4
import numpy as np
import pytest
from logs import details, refused

from factory import samples
from factory.importing import import_logs
from factory.importing.angles import LoggedAngle, attitude_degrees
from factory.importing.cleaning import positions, within_limits
from factory.importing.deployment_log import EMPTY, NO_FIXES, Channel, DeploymentLog, LoggedFixes
from factory.importing.formats.csv.mapping import Signal
from factory.importing.formats.slocum.choices import slocum_pump
from factory.importing.formats.slocum.native_sensors import in_native_units
from factory.importing.messages import MessageTable, valued
from factory.importing.payload import parse_payload, payload_channels
from factory.importing.plausibility import sinks_in_radian
from factory.importing.pressures import to_dbar, without_air
from factory.importing.tally import Tally
from factory.importing.units import declared, in_unit, known_units
from factory.samples import Flight, add_variables, write_csv
from factory.samples.archives import write_ngdac, write_og1, write_pyglider, write_spray
from factory.samples.gliders import write_basestation, write_seaexplorer
from glider_twin_protocols.auv_samples import write_dorado_product, write_mat, write_nc4
from glider_twin_protocols.message_samples import Dataflash
from twin.physics.true_signals import declare_parts
from twin.vehicle.vehicle import load_vehicle

FLIGHT = Flight()
SLOW = Flight(depth=90.0, speed=0.36)
KNOT, FOOT, PSI = 1852.0 / 3600.0, 0.3048, 0.689475729


def rewritten(paths, name, unit, change):
    """Files whose variable holds other numbers and declares another unit; None: declares none."""
    for path in paths:
        with netCDF4.Dataset(path, "a") as file:
            variable = file[name]
            variable[...] = change(np.asarray(variable[...], float))
            if unit is not None:
                variable.units = unit
            elif "units" in variable.ncattrs():
                variable.delncattr("units")
    return list(paths)


def og1(folder, *, flight=FLIGHT, **more):
    """An OG1.0 file with further variables, each of values and its unit, instead of its own."""
    path = write_og1(folder / "a.nc", flight)
    with netCDF4.Dataset(path, "a") as file:
        for name, (values, unit) in more.items():
            if name not in file.variables:
                file.createVariable(name, "f8", ("N_MEASUREMENTS",))
            file[name][:] = values
            file[name].units = unit
    return [path]


def doubted(report):
    """What is suspect, but for the heading: the vehicle of these files never turns."""
    return {k: v for k, v in details(report, "suspect").items() if k != "measured_heading"}


def largest(dataset, name):
    return float(np.nanmax(dataset[name]))


@pytest.mark.parametrize(
    ("name", "unit", "change", "signal", "value", "tolerance"),
    [
        ("u", "cm s-1", lambda v: v * 100.0, "vehicle_dac_east", FLIGHT.east, 1e-6),
        ("u", "knots", lambda v: v / KNOT, "vehicle_dac_east", FLIGHT.east, 1e-6),
        ("v", "mm/s", lambda v: v * 1e3, "vehicle_dac_north", FLIGHT.north, 1e-6),
        ("depth", "feet", lambda v: v / FOOT, "measured_depth", 60.0, 0.6),
        ("depth", "cm", lambda v: v * 100.0, "measured_depth", 60.0, 0.6),
        ("temperature", "K", lambda v: v + 273.15, "measured_temperature", 8.0, 1e-4),
        ("temperature", "degF", lambda v: v * 1.8 + 32.0, "measured_temperature", 8.0, 1e-4),
        ("salinity", "kg/kg", lambda v: v / 1e3, "measured_salinity", 34.0, 1e-3),
        ("salinity", "1e-3", lambda v: v, "measured_salinity", 34.0, 1e-3),
        ("salinity", "PSU", lambda v: v, "measured_salinity", 34.0, 1e-3),
        ("pitch", "rad", np.radians, "measured_pitch", 26.0, 0.1),
        ("pitch", "degrees (nose up)", lambda v: v, "measured_pitch", 26.0, 0.1),
    ],
)
def test_what_a_profile_declares_is_converted(
    tmp_path, name, unit, change, signal, value, tolerance
):
    paths = rewritten(write_ngdac(tmp_path, FLIGHT), name, unit, change)
    if name == "depth":
        rewritten(paths, "pressure", "dbar", lambda v: v * np.nan)
    dataset, report = import_logs("ngdac", paths)
    found = float(np.nanmax(dataset[signal])) if value > 0.0 else float(np.nanmin(dataset[signal]))
    assert found == pytest.approx(value, abs=tolerance)
    assert not doubted(report)


@pytest.mark.parametrize(("unit", "size"), [("bar", 10.0), ("psi", PSI), ("kPa", 0.1)])
@pytest.mark.parametrize("beside", [True, False])
def test_a_declared_pressure_is_converted(tmp_path, unit, size, beside):
    paths = rewritten(write_ngdac(tmp_path, FLIGHT), "pressure", unit, lambda v: v / size)
    if not beside:
        rewritten(paths, "depth", "m", lambda v: v * np.nan)
    dataset, report = import_logs("ngdac", paths)
    assert largest(dataset, "measured_pressure") == pytest.approx(60.39, abs=0.6)
    assert "pressure" not in details(report, "repaired")


@pytest.mark.parametrize("depth", [25.0, 90.0, 900.0])
def test_the_air_in_a_pressure_is_no_other_unit(tmp_path, depth):
    """An absolute pressure is one atmosphere more, and the depth of the file stands."""
    flight = dataclasses.replace(FLIGHT, depth=depth, step=10.0)
    paths = rewritten(write_ngdac(tmp_path, flight), "pressure", "dbar", lambda v: v + 10.1325)
    dataset, report = import_logs("ngdac", paths)
    assert report.rows == flight.dives
    assert largest(dataset, "measured_depth") == pytest.approx(depth, abs=0.5 + 0.006 * depth)
    assert "air's pressure" in details(report, "repaired")["pressure"]


@pytest.mark.parametrize(("unit", "size"), [("dbar", 1.0), ("bar", 10.0), ("Pa", 1e-4)])
def test_the_air_is_as_much_in_every_unit(unit, size):
    depth = np.linspace(0.0, 100.0, 50)
    below = gsw.p_from_z(-depth, 45.0)
    found = to_dbar((below + 10.1325) / size, depth, "pressure", Tally(), native=unit)
    np.testing.assert_allclose(found, below, atol=1e-6)


def test_a_pressure_that_contradicts_its_unit_and_its_depth(tmp_path):
    """Bar that are called dbar can only be bar; a third of the depth can be nothing."""
    (tmp_path / "a").mkdir()
    paths = rewritten(write_ngdac(tmp_path / "a", FLIGHT), "pressure", "dbar", lambda v: v / 10.0)
    dataset, report = import_logs("ngdac", paths)
    assert largest(dataset, "measured_depth") == pytest.approx(60.0, abs=0.6)
    assert "was in bar where dbar is declared" in details(report, "repaired")["pressure"]
    (tmp_path / "b").mkdir()
    paths = rewritten(write_ngdac(tmp_path / "b", FLIGHT), "pressure", "dbar", lambda v: v / 3.0)
    _, report = import_logs("ngdac", paths)
    assert "do not belong together" in details(report, "suspect")["pressure"]


def test_words_that_are_no_unit_of_the_variable(tmp_path):
    """Another quantity is left out by name, a word that nobody knows makes the log suspect."""
    paths = rewritten(write_ngdac(tmp_path, FLIGHT), "temperature", "m s-1", lambda v: v)
    rewritten(paths, "depth", "smoot", lambda v: v)
    dataset, report = import_logs("ngdac", paths)
    assert "measured_temperature" not in dataset
    assert "it is one of m s-1" in details(report, "left out")["temperature"]
    assert "'smoot' is not known: taken as m" in details(report, "suspect")["depth"]


@pytest.mark.parametrize("speed", [3.5, 10.0, 1e30])
def test_no_sea_has_a_current_of_more_than_3_metres_per_second(tmp_path, speed):
    paths = rewritten(write_ngdac(tmp_path, FLIGHT), "u", "m s-1", lambda v: v * 0.0 + speed)
    dataset, report = import_logs("ngdac", paths)
    assert "no sea has it" in details(report, "suspect")["dac_north and dac_east"]
    if "vehicle_dac_east" in dataset:
        assert not np.isfinite(dataset["vehicle_dac_east"]).any()


def test_kelvin_that_are_called_celsius_are_told(tmp_path):
    paths = rewritten(
        write_ngdac(tmp_path, FLIGHT), "temperature", "Celsius",
        lambda v: 283.15 - 0.05 * np.arange(v.size),
    )  # fmt: skip
    dataset, report = import_logs("ngdac", paths)
    assert 0.0 < largest(dataset, "measured_temperature") <= 10.0 + 1e-4
    assert "was in K" in details(report, "repaired")["temperature"]


def test_values_of_no_unit_are_told(tmp_path):
    paths = rewritten(
        write_ngdac(tmp_path, FLIGHT), "temperature", "Celsius",
        lambda v: 800.0 + np.arange(v.size),
    )  # fmt: skip
    _, report = import_logs("ngdac", paths)
    assert "most of its values are impossible" in details(report, "suspect")["temperature"]


@pytest.mark.parametrize(
    ("name", "values", "unit"),
    [("DAVG_CURR_NORTH", 10.0, "cm/s"), ("DAVG_CURR_NORTH", 0.1 / KNOT, "kt")],
)
def test_currents_of_og1_are_converted(tmp_path, name, values, unit):
    state = FLIGHT.state(FLIGHT.time)
    size = np.full(len(FLIGHT.time), values)
    paths = og1(
        tmp_path, divenum=(state["dive"] + 1.0, "1"), DAVG_CURR_EAST=(2.0 * size, unit),
        **{name: (size, unit)},
    )  # fmt: skip
    dataset, _ = import_logs("og1", paths)
    np.testing.assert_allclose(dataset["vehicle_dac_north"], 0.1, atol=1e-6)
    np.testing.assert_allclose(dataset["vehicle_dac_east"], 0.2, atol=1e-6)


@pytest.mark.parametrize("depth", [True, False])
def test_radian_that_are_called_degrees_are_told_by_the_sinking(tmp_path, depth):
    """Roll and heading are of the same software: they follow the pitch."""
    time, state = SLOW.time, SLOW.state(SLOW.time)
    more = {
        "PITCH": (np.radians(state["pitch"]), "deg"),
        "ROLL": (np.radians(np.full(len(time), -4.0)), "deg"),
        "GLIDER_HEADING": (np.radians(state["heading"]), "deg"),
        "HEADING": (np.full(len(time), np.nan), "deg"),
    }
    if not depth:
        more |= {"PRES": (1.0065 * state["depth"], "dbar")}
        more |= {"DEPTH": (np.full(len(time), np.nan), "m")}
    dataset, report = import_logs("og1", og1(tmp_path, flight=SLOW, **more))
    assert largest(dataset, "measured_pitch") == pytest.approx(26.0, abs=0.1)
    assert float(np.nanmedian(dataset["measured_roll"])) == pytest.approx(-4.0, abs=0.1)
    assert float(np.nanmedian(dataset["measured_heading"])) == pytest.approx(40.0, abs=0.1)
    assert set(details(report, "repaired")) >= {"PITCH", "ROLL", "GLIDER_HEADING"}


def test_a_level_vehicle_is_no_vehicle_in_radian(tmp_path):
    """A pitch that says nothing of the sinking stays what the file calls it, and is suspect."""
    swing = 0.5 * np.sin(np.arange(len(SLOW.time)))
    dataset, report = import_logs("og1", og1(tmp_path, flight=SLOW, PITCH=(swing, "deg")))
    assert largest(dataset, "measured_pitch") == pytest.approx(0.5, abs=0.01)
    assert "below 1.5 degree" in details(report, "suspect")["PITCH"]


def test_degrees_stay_degrees(tmp_path):
    state = SLOW.state(SLOW.time)
    dataset, report = import_logs("og1", og1(tmp_path, flight=SLOW, PITCH=(state["pitch"], "deg")))
    assert largest(dataset, "measured_pitch") == pytest.approx(26.0, abs=0.1)
    assert "PITCH" not in details(report, "repaired")
    assert not doubted(report)


@pytest.mark.parametrize(
    ("empty", "full", "signal", "value"),
    [
        ("PRES", "DEPTH", "measured_depth", 60.0),
        ("PITCH", "GLIDER_PITCH", "measured_pitch", 26.0),
        ("TEMP", "TEMP_ADJUSTED", "measured_temperature", 9.0),
    ],
)
def test_a_variable_without_values_hides_no_other(tmp_path, empty, full, signal, value):
    state = FLIGHT.state(FLIGHT.time)
    nothing = np.full(len(FLIGHT.time), np.nan)
    there = {
        "DEPTH": (state["depth"], "m"),
        "GLIDER_PITCH": (state["pitch"], "degrees"),
        "TEMP_ADJUSTED": (np.full(len(nothing), 9.0), "degC"),
    }
    units = {"PRES": "dbar", "PITCH": "degrees", "TEMP": "degC"}
    paths = og1(tmp_path, **{full: there[full], empty: (nothing, units[empty])})
    dataset, report = import_logs("og1", paths)
    assert report.rows == FLIGHT.dives
    assert largest(dataset, signal) == pytest.approx(value, rel=0.02)


@pytest.mark.parametrize("kind", ["ngdac", "seaglider"])
def test_an_empty_pressure_hides_no_depth(tmp_path, kind):
    write = {"ngdac": write_ngdac, "seaglider": write_basestation}[kind]
    paths = rewritten(write(tmp_path, FLIGHT), "pressure", "dbar", lambda v: v * np.nan)
    dataset, report = import_logs(kind, paths)
    assert report.rows == FLIGHT.dives
    assert largest(dataset, "measured_depth") == pytest.approx(60.0, rel=0.02)


def test_an_empty_actuator_hides_no_other_of_its_sensor(tmp_path):
    path = write_pyglider(tmp_path / "a.nc", FLIGHT)
    with netCDF4.Dataset(path, "a") as file:
        file.renameVariable("ballast", "z_ballast")
        file.createVariable("a_ballast", "f8", ("time",))[:] = np.nan
        file["a_ballast"].setncatts({"source": "BallastPos", "units": "cm3"})
    dataset, _ = import_logs("ngdac", [path])
    assert largest(dataset, "measured_pump") == pytest.approx(230.0)


@pytest.mark.parametrize(
    ("kind", "name", "unit", "change", "signal", "value"),
    [
        ("seaglider", "depth_avg_curr_north", "cm/s", lambda v: v * 100.0, "vehicle_dac_north",
         FLIGHT.north),
        ("seaglider", "pressure", "psi", lambda v: v / PSI, "measured_depth", 60.0),
        ("seaglider", "eng_pitchAng", "radians", np.radians, "measured_pitch", 26.0),
        ("seaglider", "temperature", "K", lambda v: v + 273.15, "measured_temperature", 8.0),
        ("spray", "v_depth_mean", "cm s-1", lambda v: v * 100.0, "vehicle_dac_north", FLIGHT.north),
        ("spray", "depth", "feet", lambda v: v / FOOT, "measured_depth", 60.0),
        ("lrauv", "depth", "ft", lambda v: v / FOOT, "measured_depth", 60.0),
        ("lrauv", "platform_pitch_angle", "arcdeg", np.degrees, "measured_pitch", 26.0),
        ("lrauv", "platform_buoyancy_position", "l", lambda v: v * 1e3, "measured_pump", 230.0),
    ],
)  # fmt: skip
def test_every_reader_of_netcdf_converts(tmp_path, kind, name, unit, change, signal, value):
    paths = {
        "seaglider": lambda: write_basestation(tmp_path, FLIGHT),
        "spray": lambda: [write_spray(tmp_path / "a.nc", FLIGHT)],
        "lrauv": lambda: [write_nc4(tmp_path / "a.nc4", FLIGHT)],
    }[kind]()
    right = largest(import_logs(kind, paths)[0], signal)
    assert right == pytest.approx(value, rel=0.06)  # bins and samples miss the turn
    dataset, report = import_logs(kind, rewritten(paths, name, unit, change))
    assert largest(dataset, signal) == pytest.approx(right, rel=1e-3)
    assert not doubted(report)


def test_a_dorado_product_converts(tmp_path):
    paths = write_dorado_product(tmp_path, FLIGHT)
    right, _ = import_logs("dorado", paths)
    paths = rewritten(paths, "depth", "feet", lambda v: v / FOOT)
    dataset, _ = import_logs("dorado", paths)
    np.testing.assert_allclose(dataset["measured_depth"], right["measured_depth"], atol=1e-3)


def test_the_unit_of_a_matlab_log_is_told_where_it_is_none(tmp_path):
    path = write_mat(tmp_path / "log.mat", FLIGHT)
    with netCDF4.Dataset(path, "a") as file:
        file["sea_water_temperature"]["units"][:, 0] = [ord("V")]
    dataset, report = import_logs("lrauv", [path])
    assert report.rows == FLIGHT.dives
    assert "measured_temperature" not in dataset
    assert "it is one of V" in details(report, "left out")["sea_water_temperature"]


# --- a CTD that is off ---------------------------------------------------------------------------


def test_a_ctd_that_is_off_has_no_temperature(tmp_path):
    """It writes 0 for all that it measures; none of the zeros is water."""
    state = FLIGHT.state(FLIGHT.time)
    off = state["depth"] > 40.0
    warm = np.where(off, 0.0, 12.0)
    for salt in ("CNDC", "PSAL"):
        folder = tmp_path / salt
        folder.mkdir()
        value = {"CNDC": 3.9, "PSAL": 34.0}[salt]
        more = {
            "TEMP": (warm, "degC"),
            salt: (np.where(off, 0.0, value), {"CNDC": "S m-1", "PSAL": "1"}[salt]),
        }
        dataset, report = import_logs("og1", og1(folder, **more))
        assert float(np.nanmin(dataset["measured_temperature"])) == pytest.approx(12.0, abs=1e-3)
        assert report.count("removed", "temperature") == off.sum()


def test_cold_fresh_water_is_water(tmp_path):
    """A lake has next to no salt, and 0 degC under its ice."""
    state = FLIGHT.state(FLIGHT.time)
    warm = np.where(state["depth"] > 30.0, 4.0, 0.0)
    more = {"TEMP": (warm, "degC"), "CNDC": (np.full(len(warm), 0.008), "S m-1")}
    dataset, report = import_logs("og1", og1(tmp_path, **more))
    assert float(np.nanmin(dataset["measured_temperature"])) == pytest.approx(0.0, abs=1e-6)
    assert report.count("removed", "temperature") == 0
    assert not doubted(report)


# --- pressure with the air -----------------------------------------------------------------------

PASCAL = {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "dbar": 1e4, "bar": 1e5, "psi": 6894.757}


def dived(afloat=0.0):
    """Time [s] and gauge pressure [Pa] of a dive to 20 m at 0.2 m/s, with waves of 2 cm."""
    time = np.arange(0.0, 300.0, 0.5)
    depth = np.clip(np.minimum(0.2 * (time - 20.0), 0.2 * (280.0 - time)), afloat, 20.0)
    return time, 1e4 * (depth + 0.02 * np.sin(time))


@pytest.mark.parametrize("unit", PASCAL)
def test_air_at_the_surface_tells_the_unit_of_an_absolute_pressure(unit):
    time, gauge = dived()
    tally = Tally()
    found = without_air(time, (101_900.0 + gauge) / PASCAL[unit], "Pa", "/pressure", tally)
    np.testing.assert_allclose(found, gauge, atol=700.0)  # weather: 7 cm
    assert [e.action for e in tally.entries()] == ([] if unit == "Pa" else ["repaired"])


def test_a_gauge_is_told_by_its_zero():
    time, gauge = dived()
    tally = Tally()
    np.testing.assert_array_equal(without_air(time, gauge, "Pa", "/pressure", tally), gauge)
    assert [e.action for e in tally.entries()] == ["repaired"]


def test_a_recording_that_begins_under_water_is_left_as_it_is_declared():
    time, gauge = dived(afloat=5.0)
    tally = Tally()
    found = without_air(time, 101_325.0 + gauge, "Pa", "/pressure", tally)
    np.testing.assert_allclose(found, gauge, atol=1e-6)
    assert not tally.entries()


@pytest.mark.parametrize("size", [1e3, 1e4, 37.0])
def test_a_pressure_that_can_be_in_no_unit_or_in_several_is_left_out_and_told(size):
    """Of a gauge of unknown unit nothing says how deep it was: never is it a dive of 2 cm."""
    time, gauge = dived()
    tally = Tally()
    assert not np.isfinite(without_air(time, gauge / size, "Pa", "/pressure", tally)).any()
    (doubt,) = tally.doubts
    assert "another unit" in doubt.why


# --- tables by a mapping -------------------------------------------------------------------------


def test_a_mapped_pressure_with_the_air_in_it_beside_a_depth(tmp_path):
    time, state = FLIGHT.time, FLIGHT.state(FLIGHT.time)
    table = {"t": time, "p": (1.0065 * state["depth"] + 10.1325) / 10.0, "z": state["depth"]}
    path = write_csv(tmp_path / "a.csv", table)
    mapping = tmp_path / "a.toml"
    mapping.write_text(
        'vehicle = "v"\n[time]\ncolumn = "t"\n[signals]\n'
        'measured_pressure = { column = "p", unit = "bar" }\n'
        'measured_depth = { column = "z", unit = "m" }\n'
    )
    dataset, report = import_logs("csv", [path], mapping=mapping)
    assert largest(dataset, "measured_pressure") == pytest.approx(60.4, abs=0.6)
    assert "air's pressure" in details(report, "repaired")["measured_pressure"]


# --- the words -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "wanted", "value"),
    [
        ("meter_per_second", "m s-1", 1.0),
        ("ms-1", "m s-1", 1.0),
        ("M/S", "m s-1", 1.0),
        ("DBAR", "dbar", 1.0),
        ("Pascal", "dbar", 1e-4),
        ("degrees_true", "degree", 1.0),
        ("degrees (clockwise from true north)", "degree", 1.0),
        ("deg_C", "degree_Celsius", 1.0),
        ("C", "degree_Celsius", 1.0),
        ("s/m", "S m-1", 1.0),
        ("amp-hrs", "A h", 1.0),
        ("mAh", "A h", 1e-3),
        ("um", "umol L-1", 1.0),
        ("mmol m-3", "umol L-1", 1.0),
        ("cc", "cm3", 1.0),
        ("fathom", "m", 1.8288),
        ("mg m-3", "ug L-1", 1.0),
        ("mho m-1", "S m-1", 1.0),
        ("ml/l", "umol L-1", 1e3 / 22.3916),
        ("mg L-1", "umol L-1", 1e3 / 31.9988),
    ],
)
def test_words_of_vendors_and_of_cf(unit, wanted, value):
    assert in_unit(np.ones(1), unit, wanted, "x")[0] == pytest.approx(value, rel=1e-5)


def test_a_plain_number_is_no_angle():
    """To UDUNITS a radian is a plain number: a `1` shall not turn degrees by 57."""
    refused(
        "unit '1' is not one of degree, it is one of 1",
        np.ones(1),
        "1",
        "degree",
        "a.nc pitch",
        by=in_unit,
    )


@pytest.mark.parametrize("unit", ["x" * 1_000_000, "1e999 m", "m" * 99, "\x1b[2J", "@" * 50])
def test_damaged_words_are_words_that_nobody_knows(unit):
    tally = Tally()
    values = declared(np.ones(3), unit, "m", "depth", tally)
    np.testing.assert_array_equal(values, np.ones(3))
    (entry,) = tally.entries()
    assert entry.action == "suspect"
    assert len(entry.detail) < 200


def test_every_offered_word_can_be_taken():
    for wanted in ("degree", "m", "m s-1", "dbar", "cm3", "S m-1", "degree_Celsius", "psu", "A h"):
        for word in known_units(wanted):
            assert np.isfinite(in_unit(np.ones(1), word, wanted, "x")).all()


# --- sensors and sources -------------------------------------------------------------------------


def test_the_sensor_list_of_a_slocum_converts_and_ends_guesses():
    """A pump that is declared in cc and moves by 2 cc is stuck, not in litres."""
    time = np.arange(200.0)
    small = 1.0 + np.cos(time)
    native = {
        "m_depth": Channel(time, np.full(200, 10.0)),
        "m_battpos": Channel(time, np.linspace(-25.4, 25.4, 200)),
        "m_ballast_pumped": Channel(time, small),
        "m_vacuum": Channel(time, np.full(200, 200.0)),
    }
    units = {"m_depth": "ft", "m_battpos": "mm", "m_ballast_pumped": "cc", "m_vacuum": "nodim"}
    found = in_native_units(native, units, "unit1", Tally())
    assert found["m_depth"].values[0] == pytest.approx(3.048)
    assert found["m_battpos"].values[-1] == pytest.approx(1.0)
    assert found["m_vacuum"].values[0] == 200.0
    tally = Tally()
    pump = slocum_pump(found, tally, units)["measured_pump"]
    np.testing.assert_array_equal(pump.values, small)
    assert not [e for e in tally.entries() if e.action == "repaired"]
    assert slocum_pump(native, tally)["measured_pump"].values[0] == pytest.approx(2000.0)


@pytest.mark.parametrize(("ctd", "value"), [("LEGATO", 39.0), ("GPCTD", 3.9), ("GPCTD", 39.0)])
def test_each_ctd_of_a_seaexplorer_has_its_own_unit(tmp_path, ctd, value):
    """RBR's Legato writes mS/cm and Sea-Bird's GPCTD S/m: 3.9 S/m at 12 degC is a salinity of 34.

    The salinity is that of the practical salinity scale (SP_from_C of TEOS-10).
    """
    time = FLIGHT.time
    stamps = [datetime.fromtimestamp(t, UTC).strftime("%d/%m/%Y %H:%M:%S.%f")[:-3] for t in time]
    right = float(gsw.SP_from_C(39.0, 12.0, 30.0))
    paths = [
        write_seaexplorer(tmp_path / "sea009.3.gli.sub.1.csv", FLIGHT),
        write_csv(
            tmp_path / "sea009.3.pld1.sub.1.csv",
            {
                "PLD_REALTIMECLOCK": stamps,
                f"{ctd}_TEMPERATURE": np.full(len(time), 12.0),
                f"{ctd}_CONDUCTIVITY": np.full(len(time), value),
                f"{ctd}_PRESSURE": np.full(len(time), np.nan),
            },
        ),
    ]
    dataset, _ = import_logs("seaexplorer", paths)
    assert float(np.nanmedian(dataset["measured_salinity"])) == pytest.approx(right, abs=0.05)


def test_of_several_topics_the_first_with_values_is_taken():
    """An Imu without an attitude, -1 in its covariance, hides no Odometry."""
    time = np.arange(3.0)
    tables = {
        "/imu": MessageTable(time, {"roll": np.full(3, np.nan)}),
        "/odom": MessageTable(time, {"roll": time}),
    }
    sources = {"measured_roll": [Signal(column="/imu roll"), Signal(column="/odom roll")]}
    tally = Tally()
    assert valued(sources, tables, tally)["measured_roll"].column == "/odom roll"
    assert [(e.action, e.subject) for e in tally.entries()] == [("left out", "/imu")]


def test_oxygen_per_mass_is_not_taken_for_oxygen_per_volume():
    time = np.arange(3.0)
    found = {"AROD_FT_DO": Channel(time, np.full(3, 250.0))}
    tally = Tally()
    made = payload_channels(found, (), tally, units={"AROD_FT_DO": "mmol m-3"})
    np.testing.assert_allclose(made["measured_oxygen"].values, 250.0)
    assert not payload_channels(found, (), tally, units={"AROD_FT_DO": "umol kg-1"})
    given = parse_payload(["oxygen=AROD_FT_DO[umol L-1]"])
    made = payload_channels(found, given, tally, units={"AROD_FT_DO": "umol kg-1"})
    np.testing.assert_allclose(made["measured_oxygen"].values, 250.0)  # the user knows better


@pytest.mark.parametrize(
    ("name", "value"), [("latitude", 49500.0), ("measured_rudder", 1e30), ("onboard_north", 9e301)]
)
def test_no_kind_of_log_keeps_what_no_vehicle_has(name, value):
    """A single value goes; where most are impossible the rest is suspect."""
    declare_parts(load_vehicle("tethys"))
    time = np.arange(10.0)
    good, wrong, off = np.zeros(10), value * (1.0 + 0.1 * time), np.full(10, value)
    one = np.where(time == 3.0, value, 0.0)
    for values, left, doubts in ((good, 10, 0), (one, 9, 0), (wrong, 0, 1), (off, 0, 0)):
        place = "channels" if name.startswith("measured") else "auxiliary"
        log = DeploymentLog(
            deployment="a", platform="b", fixes=NO_FIXES, magnetic_variation=EMPTY,
            **{"channels": {}, place: {name: Channel(time, values)}},
        )  # fmt: skip
        tally = Tally()
        assert len(within_limits(log, tally).channel(name)) == left
        assert len(tally.doubts) == doubts
    fixes = LoggedFixes(time, one, good)
    tally = Tally()
    assert len(within_limits(dataclasses.replace(log, fixes=fixes), tally).fixes) == 9


@pytest.mark.parametrize("unit", ["umol kg-1", "micromoles_per_kilogram", "nmol/kg", "mmol m-3"])
def test_oxygen_of_og1_is_kept_per_volume(tmp_path, unit):
    """250 umol/kg in water of 1027 kg/m3 are 257 umol/L; 250 mmol/m3 are 250."""
    per_mass = unit != "mmol m-3"
    count = len(FLIGHT.time)
    more = {
        "TEMP": (np.full(count, 8.0), "degC"),
        "PSAL": (np.full(count, 35.0), "1"),
        "DOXY": (np.full(count, 250_000.0 if unit.startswith("nmol") else 250.0), unit),
    }
    dataset, _ = import_logs("og1", og1(tmp_path, **more))
    dense = float(gsw.sigma0(gsw.SA_from_SP(35.0, 0.0, -58.0, 49.5), 8.0)) + 1000.0
    right = 250.0 * (dense / 1000.0 if per_mass else 1.0)
    assert float(np.nanmedian(dataset["measured_oxygen"])) == pytest.approx(right, abs=0.05)


def test_a_dataflash_log_s_own_table_of_units_is_read(tmp_path):
    pytest.importorskip("pymavlink")
    path, mapping = samples.write("ardusub", tmp_path, FLIGHT)[0], tmp_path / "mine.toml"
    right, _ = import_logs("ardusub", [path], mapping=mapping)
    log = Dataflash()
    for name in ("ATT", "CTUN", "IMU"):  # their numbers in the file
        log.define(name, "Q", "TimeUS")
    before = len(log.data)
    log.define("UNIT", "QbZ", "TimeUS,Id,Label", 0xA0)
    log.define("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", 0xA1)
    log.add("UNIT", 0, ord("m"), b"fathom")
    log.add("FMTU", 0, 0x83, b"-mmm", b"----")
    path.write_bytes(path.read_bytes() + bytes(log.data[before:]))
    dataset, _ = import_logs("ardusub", [path], mapping=mapping)
    deepest = largest(right, "measured_depth")
    assert deepest == pytest.approx(60.0, abs=1.0)
    assert largest(dataset, "measured_depth") == pytest.approx(1.8288 * deepest, rel=1e-3)


@pytest.mark.parametrize(("ways", "sinks"), [(1.0, None), (-1.0, True)])
def test_only_both_ways_tell_radian_by_the_sinking(ways, sinks):
    """A vehicle on its thrusters that only goes down can hang nose down by one degree."""
    time = np.arange(400.0)
    rate = np.where(time < 200.0, 0.2, 0.2 * ways)
    depth = 6.0 + np.concatenate([[0.0], np.cumsum(rate[1:])])
    assert sinks_in_radian(time, depth, -np.sign(rate) * 0.4) is sinks


def test_sentinels_of_a_heading_make_no_heading():
    heading = np.where(np.arange(90) % 9 == 0, -9999.0, 60.0 + np.sin(np.arange(90.0)))
    one = LoggedAngle(values=heading, unit="degree", subject="HEADING")
    tally = Tally()
    found = attitude_degrees({"heading": one}, np.arange(90.0), None, tally)["heading"]
    assert np.isnan(found).sum() == tally.entries()[0].count == 10
    assert np.nanmax(found) < 62.0


@pytest.mark.parametrize("sentinel", [-999.0, 9999.0, 99999.0])
def test_sentinels_of_places_turn_no_degrees_into_minutes(sentinel):
    latitude, longitude = 43.0 + 1e-4 * np.arange(60), 7.5 + 1e-4 * np.arange(60)
    off = np.arange(60) % 3 != 0
    latitude[off], longitude[off] = sentinel, sentinel
    found = positions(latitude, longitude, "fixes", Tally())
    assert np.isfinite(found[0]).sum() == 20
    assert found[0][0] == pytest.approx(43.0)
    assert found[1][0] == pytest.approx(7.5)


def test_longitudes_may_be_counted_on_past_greenwich():
    longitude = 359.995 + 1e-3 * np.arange(16)
    _, found = positions(np.full(16, 43.0), longitude, "fixes", Tally())
    assert found[[0, -1]] == pytest.approx([-0.005, 0.01], abs=1e-9)


def test_a_place_at_the_origin_is_none_yet():
    latitude, longitude = np.array([0.0, 43.0]), np.array([0.0, 7.5])
    tally = Tally()
    assert np.isnan(positions(latitude, longitude, "fixes", tally)[0]).tolist() == [True, False]
    assert tally.entries()[0].detail == "no position yet (0, 0)"


def test_degrees_and_minutes_are_still_told():
    tally = Tally()
    latitude, longitude = (
        np.array([4330.0, 4331.0, 69696969.0]),
        np.array([-730.0, -731.0, 69696969.0]),
    )
    found = positions(latitude, longitude, "fixes", tally)
    assert found[0][:2] == pytest.approx([43.5, 43.0 + 31.0 / 60.0])
    assert found[1][:2] == pytest.approx([-7.5, -(7.0 + 31.0 / 60.0)])


def test_an_og1_temperature_in_kelvin_is_converted_once(tmp_path):
    path = write_og1(tmp_path / "a.nc", FLIGHT)
    with netCDF4.Dataset(path, "a") as file:
        warm = 281.15 + 0.01 * np.sin(np.arange(len(file["TIME"])))
        add_variables(file, {"TEMP": (("N_MEASUREMENTS",), warm, "K")})
    dataset, _ = import_logs("og1", [path], variation_deg=FLIGHT.variation)
    assert float(dataset["measured_temperature"].mean()) == pytest.approx(8.0, abs=0.1)
    assert not any(dataset["suspect"].values)
