"""Altimeter: geometry of its beam, its limits, noise and lost pings."""

import numpy as np
import pytest

from twin.errors import InputError
from twin.sensors import Altimeter, SensorSuite
from twin.water.floor import FlatFloor, GridFloor

DT = 0.5
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


def measure(sensor, signals, floor=None, drawn=None, seed=3):
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
    found = measure(QUIET, flight(pitch=pitch, roll=10.0), floor)
    np.testing.assert_allclose(found, 60.0, atol=2e-4)


def test_over_a_slope_the_beam_measures_where_it_looks():
    """Level flight to the north, uphill: the beam, 26 deg ahead, meets the floor sooner."""
    found = measure(QUIET, flight(pitch=0.0), HILL)
    tangent = np.tan(np.deg2rad(26.0))
    np.testing.assert_allclose(found, 60.0 / (1.0 + SLOPE * tangent), atol=2e-4)
    away = measure(QUIET, flight(pitch=0.0, heading=180.0), HILL)
    np.testing.assert_allclose(away, 60.0 / (1.0 - SLOPE * tangent), atol=2e-4)
    plumb = measure(QUIET, flight(pitch=-26.0), HILL)
    np.testing.assert_allclose(plumb, 60.0, atol=2e-4)


def test_no_echo_out_of_range_or_from_a_climb():
    assert np.isnan(measure(QUIET, flight(altitude=101.0))).all()
    assert np.isnan(measure(QUIET, flight(altitude=0.4))).all()
    assert np.isfinite(measure(QUIET, flight(altitude=99.0))).all()
    assert np.isnan(measure(QUIET, flight(pitch=25.0))).all()  # the beam is 51 deg off
    assert np.isnan(measure(Altimeter(fitted=False), flight())).all()


def test_pings_noise_scale_and_losses_are_as_set():
    sensor = Altimeter(ping_period=2.0, noise=0.2, lost_share=0.25)
    found = measure(sensor, flight(n=40_000), drawn={"altimeter_scale": 0.01})
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
    found = measure(QUIET, signals)
    expected = 60.0 * np.cos(np.deg2rad(29.0)) / np.cos(np.deg2rad(26.0))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_mission_without_a_floor_has_no_altimeter_channel():
    suite = SensorSuite()
    assert "measured_altitude" not in {entry.name for entry in suite.writes(("true_depth",))}
    there = {entry.name for entry in suite.writes(("true_depth", "true_altitude"))}
    assert "measured_altitude" in there


def test_impossible_settings_are_refused():
    for settings, told in (
        ({"min_range": 200.0}, "the longest must exceed"),
        ({"lost_share": 1.5}, "at most 1"),
        ({"tilt_deg": 95.0}, "0 to below 90"),
        ({"noise": -1.0}, "at least 0"),
    ):
        with pytest.raises(InputError, match=told):
            Altimeter(**settings)
