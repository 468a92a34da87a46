"""CTD, altimeter and GPS: figures of their sheets, geometry, lags, limits, noise."""

import dataclasses

import gsw
import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.records.schema import variable
from twin.sensors import Altimeter, Ctd, Gps, SensorSuite, Surroundings
from twin.sensors.kernels import thermal_kernel
from twin.water.density import DensityProfile
from twin.water.floor import FlatFloor, GridFloor

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


@pytest.mark.parametrize(("lag", "shown"), [(0.0, 12.0), (0.5, 12.0 - 2.0 / np.e)])
def test_the_bead_follows_within_its_lag_and_the_wall_of_the_cell_warms_slowly(lag, shown):
    """A step of 2 K: the wall, still cold, cools the water in the cell by 0.1 of the step, which
    dies out in 10 s."""
    water = np.where(np.arange(60) < 2, 10.0, 12.0)
    bead, cell, start = np.empty(60), np.empty(60), np.full(3, np.nan)
    thermal_kernel(water, DT, lag, 0.1, 10.0, start, bead, cell)
    assert bead[:3] == pytest.approx([10.0, 10.0, shown])
    assert cell[2] == pytest.approx(12.0 - 0.2, abs=0.01)
    assert cell[22] == pytest.approx(12.0 - 0.2 / np.e, abs=0.01)
    assert (np.diff(cell[2:]) > 0.0).all()


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


# --- altimeter ------------------------------------------------------------------------------------


N = 4000
QUIET = Altimeter(scale=0.0, noise=0.0, lost_share=0.0, ping_period=0.0)
AXIS = np.array([-1e4, 1e4])
SLOPE = 0.2
HILL = GridFloor(
    north_m=AXIS, east_m=AXIS, depth_m=100.0 - SLOPE * np.tile(AXIS[:, None], (1, 2))
).compile(0.0)  # rises to the north


def flight(altitude=60.0, pitch=-26.0, roll=0.0, heading=0.0, depth=40.0, n=N):
    """Truth and measured attitude of level flight at an attitude [deg]."""
    values = {"altitude": altitude, "north": 0.0, "east": 0.0, "depth": depth, "roll": roll,
              "pitch": pitch, "heading": heading}  # fmt: skip
    truth = {f"true_{name}": np.full(n, float(value)) for name, value in values.items()}
    measured = {f"measured_{n}": truth[f"true_{n}"] for n in ("roll", "pitch")}
    return {**truth, **measured}


def heights(sensor, signals, floor=None, drawn=None, seed=3):
    from twin.sensors import Surroundings

    return sensor.measure(
        signals,
        dt=DT,
        drawn={"altimeter_scale": 0.0} if drawn is None else drawn,
        rng=np.random.default_rng(seed),
        surroundings=Surroundings(floor=floor),
    )["measured_altitude"]


@pytest.mark.parametrize("floor", [None, FlatFloor(depth_m=100.0).compile(0.0)])
@pytest.mark.parametrize("pitch", [-26.0, -40.0, 0.0, 5.0])
def test_over_a_level_floor_the_height_is_true_at_any_attitude(floor, pitch):
    found = heights(QUIET, flight(pitch=pitch, roll=10.0), floor)
    np.testing.assert_allclose(found, 60.0, atol=2e-4)


def test_over_a_slope_the_beam_measures_where_it_looks():
    """Level flight to the north, uphill: the beam, 26 deg ahead, meets the floor sooner."""
    found = heights(QUIET, flight(pitch=0.0), HILL)
    tangent = np.tan(np.deg2rad(26.0))
    np.testing.assert_allclose(found, 60.0 / (1.0 + SLOPE * tangent), atol=2e-4)
    away = heights(QUIET, flight(pitch=0.0, heading=180.0), HILL)
    np.testing.assert_allclose(away, 60.0 / (1.0 - SLOPE * tangent), atol=2e-4)
    plumb = heights(QUIET, flight(pitch=-26.0), HILL)
    np.testing.assert_allclose(plumb, 60.0, atol=2e-4)


def test_no_echo_out_of_range_or_from_a_climb():
    assert np.isnan(heights(QUIET, flight(altitude=101.0))).all()
    assert np.isnan(heights(QUIET, flight(altitude=0.4))).all()
    assert np.isfinite(heights(QUIET, flight(altitude=99.0))).all()
    assert np.isnan(heights(QUIET, flight(pitch=25.0))).all()  # the beam is 51 deg off
    assert np.isnan(heights(Altimeter(fitted=False), flight())).all()


def test_pings_noise_scale_and_losses_are_as_set():
    sensor = Altimeter(ping_period=2.0, noise=0.2, lost_share=0.25)
    found = heights(sensor, flight(n=40_000), drawn={"altimeter_scale": 0.01})
    pings = np.isfinite(found)
    assert not pings[np.arange(found.size) % 4 != 0].any()
    assert pings[::4].mean() == pytest.approx(0.75, abs=0.02)
    assert np.nanmean(found) == pytest.approx(60.6, abs=0.01)
    assert np.nanstd(found) == pytest.approx(0.2, rel=0.05)
    draws = [Altimeter().draw(np.random.default_rng(s))["altimeter_scale"] for s in range(2000)]
    assert np.std(draws) == pytest.approx(0.005, rel=0.05)


def test_an_error_of_attitude_becomes_one_of_height():
    signals = flight(pitch=0.0)
    signals["measured_pitch"] = signals["measured_pitch"] + 3.0
    found = heights(QUIET, signals)
    expected = 60.0 * np.cos(np.deg2rad(29.0)) / np.cos(np.deg2rad(26.0))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_mission_without_a_floor_has_no_altimeter_channel():
    suite = SensorSuite()
    assert "measured_altitude" not in {entry.name for entry in suite.writes(("true_depth",))}
    there = {entry.name for entry in suite.writes(("true_depth", "true_altitude"))}
    assert "measured_altitude" in there


def test_impossible_altimeters_are_refused():
    for settings, told in (
        ({"min_range": 200.0}, "the longest must exceed"),
        ({"lost_share": 1.5}, "at most 1"),
        ({"tilt_deg": 95.0}, "0 to below 90"),
        ({"noise": -1.0}, "at least 0"),
    ):
        with pytest.raises(InputError, match=told):
            Altimeter(**settings)


# --- GPS ------------------------------------------------------------------------------------------


SIGMA = {"gps_sigma": 4.0}


def float_and_dive(*stays, n=8000):
    """Truth with the hull breaking the surface in the given [start, stop) seconds."""
    immersion, depth = np.ones(n), np.full(n, 20.0)
    for start, stop in stays:
        piece = slice(round(start / DT), round(stop / DT))
        immersion[piece], depth[piece] = 0.992, 0.1
    return {
        "true_immersion": immersion, "true_depth": depth, "true_roll": np.zeros(n),
        "true_pitch": np.zeros(n), "true_north": np.linspace(0.0, 900.0, n),
        "true_east": np.linspace(0.0, -500.0, n),
    }  # fmt: skip


def fixes(gps, truth, seed=0, drawn=SIGMA):
    out = gps.measure(truth, dt=DT, drawn=drawn, rng=np.random.default_rng(seed))
    north, east = out["measured_gps_north"], out["measured_gps_east"]
    assert np.array_equal(np.isnan(north), np.isnan(east))
    return north, east


def test_fixes_come_only_at_the_surface_and_after_the_time_to_first_fix():
    truth = float_and_dive((1000.0, 1500.0), (3000.0, 3020.0))
    waits = []
    for seed in range(300):
        north, _ = fixes(Gps(), truth, seed)
        at = np.flatnonzero(np.isfinite(north)) * DT
        assert at.max() < 1500.0  # the second stay is shorter than any time to first fix
        waits.append(at.min() - 1000.0)
        assert np.allclose(np.diff(at), 1.0)
    assert min(waits) >= 30.0
    assert max(waits) <= 120.5
    assert np.mean(waits) == pytest.approx(75.0, abs=5.0)


def test_a_mission_that_starts_at_the_surface_has_its_fix():
    truth = float_and_dive((0.0, 60.0))
    assert np.isfinite(fixes(Gps(), truth)[0][0])
    waiting = Gps(tracking_at_start=False, first_fix_min=40.0, first_fix_max=40.0)
    at = np.flatnonzero(np.isfinite(fixes(waiting, truth)[0]))
    assert at[0] == round(40.0 / DT)


def test_short_dips_do_not_restart_the_search():
    truth = float_and_dive((1000.0, 1130.0), (1133.0, 1200.0), (1300.0, 1325.0))
    north, _ = fixes(Gps(fix_interval=0.0), truth)
    at = np.flatnonzero(np.isfinite(north)) * DT
    assert np.isnan(north[round(1130.0 / DT) : round(1133.0 / DT)]).all()
    assert np.isfinite(north[round(1133.0 / DT) : round(1200.0 / DT)]).all()
    assert at.max() < 1200.0


def test_error_has_the_drawn_sigma_and_is_correlated():
    n = 400_000
    truth = float_and_dive((0.0, n * DT), n=n)
    north, east = fixes(Gps(fix_interval=0.0), truth)
    error = north - truth["true_north"]
    assert error.std() == pytest.approx(4.0, rel=0.08)
    assert (east - truth["true_east"]).std() == pytest.approx(4.0, rel=0.08)
    lag = round(120.0 / DT)
    assert np.corrcoef(error[:-lag], error[lag:])[0, 1] == pytest.approx(np.exp(-1), abs=0.08)
    sigmas = [Gps().draw(np.random.default_rng(s))["gps_sigma"] for s in range(500)]
    assert 3.0 <= min(sigmas) < 3.1
    assert 4.9 < max(sigmas) <= 5.0


def test_ideal_is_exact_at_once_and_still_blind_below():
    truth = float_and_dive((1000.0, 1500.0))
    north, east = fixes(Gps.ideal(), truth, drawn={"gps_sigma": 0.0})
    wet = truth["true_immersion"] == 1.0
    assert np.isnan(north[wet]).all()
    assert np.array_equal(north[~wet], truth["true_north"][~wet])
    assert np.array_equal(east[~wet], truth["true_east"][~wet])


def test_a_tail_antenna_needs_the_nose_down():
    truth = float_and_dive((0.0, 4000.0))
    tail = Gps(antenna_position=(-1.45, 0.0, -0.03))
    assert not tail.at_surface(truth).any()  # level: 0.03 m above the axis, which is 0.1 m deep
    truth["true_pitch"][:] = -30.0
    assert tail.at_surface(truth).all()
    truth["true_pitch"][:] = 30.0
    assert not tail.at_surface(truth).any()


def test_wrong_settings_of_gps_are_explained():
    with pytest.raises(InputError, match="above first_fix_max 120: swap them"):
        Gps(first_fix_min=200.0)
    with pytest.raises(InputError, match=r"antenna_position is nan"):
        Gps(antenna_position=(0.0, 0.0, np.nan))
