"""The CTD: Sea-Bird's figures, the lag of its cell, and where there is none."""

import dataclasses

import gsw
import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.records.schema import variable
from twin.sensors import Ctd, SensorSuite, Surroundings
from twin.water.density import DensityProfile

DT = 0.5
STILL = dict.fromkeys(Ctd.draws, 0.0)
CAST = DensityProfile.thermocline()


def dive(n=4000, rate=0.1, profile=CAST):
    """Straight down through a profile."""
    depth = 1.0 + rate * DT * np.arange(n)
    temperature, salinity = profile.temperature_salinity(depth)
    return {
        "true_depth": depth,
        "true_density": profile.density(depth),
        "true_temperature": temperature,
        "true_salinity": salinity,
        "measured_pressure": profile.pressure(depth, latitude=36.8),
    }


def measure(ctd, truth, *, drawn=STILL, profile=CAST):
    return ctd.measure(
        truth, dt=DT, drawn=drawn, rng=np.random.default_rng(0),
        surroundings=Surroundings(density=profile),
    )  # fmt: skip


def test_the_default_is_the_glider_payload_ctd_of_its_sheet():
    ctd = Ctd()
    # +-0.002 degC and +-0.0003 S/m, both as two sigma; resolutions as printed
    assert (2 * ctd.temperature_offset, 2 * ctd.conductivity_offset) == (0.002, 0.0003)
    assert (ctd.temperature_resolution, ctd.conductivity_resolution) == (0.001, 1e-5)
    # SBE-41CP: Johnson, Toole and Larson (2007)
    assert (ctd.thermal_amplitude, ctd.thermal_time) == (0.141, 6.89)


def test_without_errors_it_shows_the_water():
    truth = dive()
    out = measure(Ctd.ideal(), truth)
    assert out["measured_temperature"] == pytest.approx(truth["true_temperature"], abs=1e-12)
    assert out["measured_salinity"] == pytest.approx(truth["true_salinity"], abs=1e-9)
    # the profile's density is for the pressure of standard ocean, half a dbar off at 300 m
    assert out["measured_density"] == pytest.approx(truth["true_density"], abs=5e-3)


def test_zero_errors_reach_salinity_through_conductivity():
    """dS/dC is about 9.6 psu per S/m, dS/dT at constant C about -1 psu per degree, at 15 degC."""
    truth = {name: values[:200] for name, values in dive().items()}  # the mixed layer
    clean = measure(Ctd.ideal(), truth)
    ctd = Ctd.ideal()
    by_cell = measure(ctd, truth, drawn=STILL | {"ctd_conductivity_offset": 0.001})
    by_bead = measure(ctd, truth, drawn=STILL | {"ctd_temperature_offset": 0.01})
    change = [
        x["measured_salinity"][-1] - clean["measured_salinity"][-1] for x in (by_cell, by_bead)
    ]
    assert change[0] == pytest.approx(0.0091, rel=0.1)
    assert change[1] == pytest.approx(-0.0091, rel=0.1)
    shift = by_bead["measured_temperature"] - clean["measured_temperature"]
    assert shift == pytest.approx(0.01, abs=1e-12)


def test_the_thermistor_trails_by_its_lag():
    truth = dive(rate=0.2)
    ctd = dataclasses.replace(Ctd.ideal(), temperature_lag=2.0)
    late = measure(ctd, truth)["measured_temperature"] - truth["true_temperature"]
    gradient = np.gradient(truth["true_temperature"], DT)
    steady = slice(1200, 3900)
    # a first-order lag trails a ramp by lag, less what exact steps of 0.5 s leave
    kept = np.exp(-DT / 2.0)
    assert late[steady] == pytest.approx(-gradient[steady] * DT * kept / (1 - kept), rel=0.02)


def test_the_cells_warmth_makes_a_step_spike_that_decays():
    """After a step of -5 degC the wall is warm: by alpha times the step, for about tau."""
    n = 200
    truth = {
        "true_depth": np.full(n, 50.0), "true_density": np.full(n, 1025.0),
        "true_temperature": np.where(np.arange(n) < 50, 15.0, 10.0),
        "true_salinity": np.full(n, 35.0),
        "measured_pressure": CAST.pressure(np.full(n, 50.0), latitude=36.8),
    }  # fmt: skip
    ctd = dataclasses.replace(Ctd.ideal(), thermal_amplitude=0.141, thermal_time=6.89)
    salinity = measure(ctd, truth)["measured_salinity"]
    warm = gsw.C_from_SP(35.0, 10.0 + 0.141 * 5.0, 50.3) - gsw.C_from_SP(35.0, 10.0, 50.3)
    spike = warm / (gsw.C_from_SP(35.1, 10.0, 50.3) - gsw.C_from_SP(35.0, 10.0, 50.3)) * 0.1
    assert salinity[:50] == pytest.approx(35.0, abs=1e-9)
    assert salinity[50] - 35.0 == pytest.approx(spike, rel=0.05)
    later = 50 + round(6.89 / DT)
    assert (salinity[later] - 35.0) / (salinity[50] - 35.0) == pytest.approx(np.exp(-1), rel=0.05)


def test_readings_are_multiples_of_the_resolution():
    out = measure(Ctd(), dive())
    steps = out["measured_temperature"] / 0.001
    assert steps == pytest.approx(np.round(steps), abs=1e-6)


def test_there_is_none_where_the_water_has_only_density():
    truth = dive()
    bare = {name: truth[name] for name in ("true_depth", "true_density", "measured_pressure")}
    assert Ctd().channels(bare) == ()
    assert measure(Ctd(), bare) == {}
    names = [entry.name for entry in SensorSuite().writes(truth)]
    made = ("temperature", "salinity", "density", "conductivity")
    assert names[-4:] == [f"measured_{name}" for name in made]
    only_density = DensityProfile(depth=[0.0, 100.0], values=[1024.0, 1026.0])
    assert only_density.temperature_salinity(50.0) is None
    again = DensityProfile(**CAST.describe()).temperature_salinity(50.0)
    assert np.array_equal(again, CAST.temperature_salinity(50.0))
    with pytest.raises(InputError, match="both temperature and salinity, or neither"):
        DensityProfile(depth=[0.0], values=[1025.0], temperature=[10.0])


def test_wrong_settings_are_explained():
    with pytest.raises(InputError, match=r"Ctd\.temperature_lag is -1"):
        Ctd(temperature_lag=-1.0)


@pytest.mark.parametrize("ctd", [Ctd(), Ctd.ideal()])
def test_salinity_is_that_of_its_conductivity(ctd):
    truth = dive()
    out = measure(ctd, truth)
    again = gsw.SP_from_C(
        10.0 * out["measured_conductivity"], out["measured_temperature"], truth["measured_pressure"]
    )
    np.testing.assert_allclose(out["measured_salinity"], again, rtol=0, atol=1e-9)


def test_an_ideal_suite_measures_conductivity_beside_the_truth():
    truth = dive()
    made = measure(Ctd.ideal(), truth)
    assert set(made) == {entry.name for entry in Ctd.writes}
    expected = gsw.C_from_SP(
        truth["true_salinity"], truth["true_temperature"], truth["measured_pressure"]
    )
    np.testing.assert_allclose(10.0 * made["measured_conductivity"], expected, rtol=1e-12)
    run = twin.simulate(duration=20.0, density="thermocline", sensors="ideal")
    assert np.array_equal(run["measured_salinity"], run["true_salinity"])
    assert run["measured_conductivity"].min() > 3.0
    assert variable("measured_conductivity").standard_name == "sea_water_electrical_conductivity"
