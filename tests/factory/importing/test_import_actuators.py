"""Actuators that logs hide: an oil pump beside a lone zero, a rotation in counts alone."""

import netCDF4
import numpy as np
import pytest

from factory.importing import import_logs
from factory.importing.deployment_log import EMPTY, NO_FIXES, Channel
from factory.importing.formats.seaglider_log_signals import ROLL_CNV, rotation_from_counts
from factory.importing.formats.slocum.native_sensors import slocum_log
from factory.importing.tally import Tally
from factory.samples import Flight
from factory.samples.gliders import write_basestation


def test_counts_become_a_rotation_about_the_centre_of_each_phase():
    pitch = np.repeat([-25.0, 25.0], 50)
    centre = np.where(pitch < 0.0, 2650.0, 2450.0)
    counts = centre.copy()
    counts[[10, 60]] += 1000.0  # a turn in each phase
    counts[20] = 0.0  # no value
    tally = Tally()
    found = rotation_from_counts(counts, pitch, None, "SG001", tally)
    assert found[10] == found[60] == pytest.approx(-1000.0 * ROLL_CNV)  # to starboard
    assert found[0] == found[99] == 0.0
    assert np.isnan(found[20])
    assert any("C_ROLL" in entry.detail for entry in tally.entries())


def test_a_rotation_that_is_known_stays():
    known = np.full(100, np.nan)
    known[:50] = 12.0
    counts, pitch = np.full(100, 2000.0), np.full(100, -20.0)
    found = rotation_from_counts(counts, pitch, known, "SG001", Tally())
    assert (found[:50] == 12.0).all()
    assert (found[50:] == 0.0).all()


def test_the_oil_pump_is_read_beside_a_lone_zero_of_a_ballast_pump():
    time = np.arange(0.0, 400.0, 4.0)
    volume = np.where(time < 200.0, -200.0, 250.0)
    native = {
        "m_ballast_pumped": Channel(time[:1], np.zeros(1)),
        "m_de_oil_vol": Channel(time, volume),
        "m_depth": Channel(time, np.linspace(5.0, 50.0, len(time))),
    }
    log = slocum_log("unit", native, fixes=NO_FIXES, variation=EMPTY, tally=Tally())
    assert np.ptp(log.channels["measured_pump"].values) == pytest.approx(450.0)


def test_a_dive_file_s_counts_are_a_rotation_about_the_centre_of_dives_and_of_climbs(tmp_path):
    flight, convert = Flight(dives=1), 0.028
    (path,) = write_basestation(tmp_path, flight)
    with netCDF4.Dataset(path, "r+") as file:
        file["log_C_ROLL_DIVE"][...], file["log_C_ROLL_CLIMB"][...] = 1900.0, 2500.0
        file["log_ROLL_CNV"][...] = convert
        file["gc_roll_ad"][:] = [2000.0, 2300.0]  # the first until the bottom
        begin = float(file["time"][0]) - flight.dive_times(0)[0]
        file.createVariable("start_of_climb_time", "f8", ())[...] = flight.leg - begin
    dataset, _ = import_logs("seaglider", [path])
    rotation, depth, pitch = (
        dataset[f"measured_{name}"].values[0] for name in ("rotation", "depth", "pitch")
    )
    deep = (depth > 10.0) & (depth < flight.depth - 5.0)
    # more counts than the centre bring the mass to starboard, which is a negative rotation
    np.testing.assert_allclose(rotation[deep & (pitch < -20.0)], -100.0 * convert, rtol=1e-6)
    np.testing.assert_allclose(rotation[deep & (pitch > 20.0)], 200.0 * convert, rtol=1e-6)
