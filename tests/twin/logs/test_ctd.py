"""The thermal lag of a CTD: found on dives and climbs through a thermocline, and taken off."""

import gsw
import numpy as np
import pytest

from twin.logs.thermal_lag import CtdSeries, ThermalLag, common_lag, ways

PERIOD = 1.0


def water(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Temperature and salinity of a summer's shelf sea."""
    share = 1.0 / (1.0 + np.exp(-(depth - 30.0) / 3.0))
    return 15.0 - 11.0 * share, 31.0 + 1.2 * share


def measured(lag: ThermalLag | None, seed: int = 0) -> tuple[CtdSeries, np.ndarray]:
    """A CTD that dives and climbs twice through it, and the true salinity."""
    rng = np.random.default_rng(seed)
    depth = 5.0 + 70.0 * np.abs((np.arange(1600.0) / 400.0 + 1.0) % 2.0 - 1.0)
    temperature, salinity = water(depth)
    pressure = gsw.p_from_z(-depth, 48.0)
    cell = temperature - (0.0 if lag is None else lag.excess(temperature, PERIOD))
    # its conductivity is that of water at the temperature of the cell
    conductivity = gsw.C_from_SP(salinity, cell, pressure)
    seen = gsw.SP_from_C(conductivity, temperature, pressure)
    ctd = CtdSeries(
        period=PERIOD,
        depth=depth,
        pressure=pressure,
        temperature=temperature,
        salinity=seen + rng.normal(0.0, 0.002, len(seen)),
        latitude=48.0,
        longitude=-58.0,
    )
    return ctd, salinity


def test_the_lag_is_found_and_taken_off():
    lag = ThermalLag(amplitude=0.1, time=12.0)
    dives = [measured(lag, seed) for seed in range(3)]
    found = common_lag([ctd for ctd, _ in dives])
    assert found is not None
    # the product is what profiles show; the two numbers part less well
    assert found.amplitude * found.time == pytest.approx(1.2, rel=0.2)
    ctd, truth = dives[0]
    before = np.abs(ctd.salinity - truth).max()
    after = np.abs(ctd.corrected(found).salinity - truth).max()
    assert before > 0.1
    assert after < 0.25 * before
    np.testing.assert_array_equal(ctd.corrected(found).temperature, ctd.temperature)


def test_a_cell_without_lag_is_left_alone():
    ctds = [measured(None, seed)[0] for seed in range(3)]
    assert common_lag(ctds) is None
    assert ctds[0].corrected(None) is ctds[0]


def test_the_excess_of_a_step_dies_out_in_the_time_of_the_cell():
    lag = ThermalLag(amplitude=0.1, time=12.0)
    step = np.concatenate([np.zeros(5), np.ones(200)])
    excess = lag.excess(step, 0.1)
    assert excess[5] == pytest.approx(0.1, rel=0.01)
    assert excess[5 + 120] == pytest.approx(0.1 / np.e, rel=0.02)
    assert (lag.excess(np.full(20, 14.0), 1.0) == 0.0).all()


def test_holes_stay_holes_and_density_is_of_the_standard_equation():
    ctd, _ = measured(ThermalLag(amplitude=0.1, time=12.0))
    ctd.salinity[100:120] = np.nan
    corrected = ctd.corrected(ThermalLag(amplitude=0.1, time=12.0))
    np.testing.assert_array_equal(np.isnan(corrected.salinity), np.isnan(ctd.salinity))
    absolute = gsw.SA_from_SP(ctd.salinity[0], ctd.pressure[0], -58.0, 48.0)
    conservative = gsw.CT_from_t(absolute, ctd.temperature[0], ctd.pressure[0])
    assert ctd.density[0] == pytest.approx(gsw.rho(absolute, conservative, ctd.pressure[0]))


def test_ways_are_told_from_wiggles():
    depth = np.concatenate(
        [np.linspace(0, 60, 61), np.linspace(59, 20, 40), np.linspace(21, 80, 60), [79.0, 80.0]]
    )
    depth[30] -= 4.0
    found = ways(depth)
    assert [(depth[s][0], depth[s][-1]) for s in found] == [(0.0, 60.0), (60.0, 20.0), (20.0, 80.0)]
