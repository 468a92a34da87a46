"""A sheared sea, a tide and a wrong speed are no faults."""

import numpy as np
import pytest

import twin
from glider_twin_ops.health.channels import (
    DIFFERENCE,
    NAMES,
    NOISE,
    PLACE,
    TIDES,
    new_legs,
    standing,
    steps_in_shear,
)
from glider_twin_ops.health.dive_channels import DiveSignals, channels_of, strokes_of
from glider_twin_ops.health.judgement import follow, judge
from glider_twin_ops.health.signatures import signatures_of, usual_dive
from twin.identify import load_calibration
from twin.vehicle import Consumption

DIVES = 24
TURNS = [PLACE["turn_dive"], PLACE["turn_climb"]]
DAYS = np.arange(DIVES) / 8.0


def ways_on(headings):
    """0.3 m/s through the water on each heading [degree]."""
    angle = np.deg2rad(headings)
    return 0.3 * np.column_stack([np.cos(angle), np.sin(angle)])


TURNED = ways_on(np.where(np.arange(DIVES) < 12, 20.0, 140.0))


def signatures(name):
    vehicle = twin.load_vehicle(name)
    return signatures_of(vehicle, usual_dive(vehicle, depth=100.0))


@pytest.fixture(scope="module")
def glider():
    return signatures("glider")


def test_a_rolled_battery_leans_against_shear_and_a_rudder_hardly(glider):
    # 0.9 degree and more for 3e-4 1/s: what the usual current of a draw has over 100 m
    assert (np.abs(glider.sheared[TURNS]) > 3000.0).all()
    assert (np.abs(signatures("slocum-200").sheared[TURNS]) < 1500.0).all()


def test_levels_may_step_where_a_vehicle_turns_in_shear():
    response = np.zeros(len(NAMES))
    response[TURNS] = 1e4
    steps = steps_in_shear(response, TURNED, DAYS, 100.0)[:, TURNS[0]]
    assert steps[0] == 0.0
    assert steps[12] > 1.5 * steps[11]
    assert steps[12] < 1e4 * 2.0 * DIFFERENCE / 100.0
    # unknown headings may be any
    unknown = steps_in_shear(response, np.full((DIVES, 2), np.nan), DAYS, 100.0)[5, TURNS[0]]
    assert steps[5] < unknown < steps[12] + 1e-9


def test_what_turns_it_rests_elsewhere_on_another_leg_and_is_not_stuck(glider, noise):
    """Where the heading stands in its dead band a drive may hardly move for a leg."""
    moves = [PLACE["turn_moves"], PLACE["heading_error"]]
    steps = steps_in_shear(np.zeros(len(NAMES)), TURNED, DAYS, 100.0)[:, moves]
    assert (steps[12] > 1.0).all()
    assert not np.delete(steps, 12, axis=0).any()
    sound = noise(11, DIVES)
    sound[12:, moves] += [-1.8, 0.6]
    assert odds(glider, sound, TURNED)[0].evidence.max() < -2.0
    stuck = next(h for h in glider.in_dives(TURNED) if h.kind == "turn_stuck").signature
    sound[16:] += stuck[16:]
    found, probability = odds(glider, sound, TURNED)
    assert found.evidence[18] > 3.0
    assert probability["turn_stuck"] > 0.9


def test_the_turn_onto_a_new_leg_is_no_error_of_the_heading():
    calibration = load_calibration("slocum-200")
    depth = np.concatenate([np.linspace(0.0, 100.0, 200), np.linspace(100.0, 0.0, 200)])
    errors = []
    for turned in (0.0, 120.0):
        heading = 40.0 + 2.0 * np.sin(np.arange(400) / 9.0) + turned * np.exp(-np.arange(400) / 15)
        signals = {
            "measured_depth": depth, "measured_heading": heading,
            "commanded_heading": np.full(400, 40.0),
        }  # fmt: skip
        found = channels_of(DiveSignals(period=4.0, signals=signals), calibration)
        errors.append(found[PLACE["heading_error"]])
    assert errors[1] == pytest.approx(errors[0], abs=0.3)  # its noise


def odds(glider, values, ways):
    changes = steps_in_shear(glider.sheared, ways, DAYS, 100.0)
    levels = follow(values, changes)
    found = judge(levels, DAYS, glider.in_dives(ways), standing(ways, DAYS))
    return found, dict(zip(found.kinds, found.probability, strict=True))


def test_a_turn_into_shear_is_no_slipped_drive_and_a_slip_is_one(glider, noise):
    sound = noise(3, DIVES)
    sound[12:] += np.nan_to_num(glider.sheared) * 2.0 * DIFFERENCE / 100.0
    stepped = sound[12:, TURNS].mean(axis=0) - sound[:12, TURNS].mean(axis=0)
    assert (np.abs(stepped) > 3.0 * NOISE[TURNS]).all()
    assert odds(glider, sound, TURNED)[0].evidence.max() < -2.0
    slip = next(h for h in glider.hypotheses if h.kind == "turn_slips")
    faulty = sound.copy()
    faulty[16:] += 6.0 * np.nan_to_num(slip.signature)
    found, probability = odds(glider, faulty, TURNED)
    assert found.evidence[18] > 3.0
    assert probability["turn_slips"] > 0.9


@pytest.mark.parametrize("cause", ["speed", "tide", "iron"])
def test_a_wrong_speed_and_a_tide_are_no_iron(glider, noise, cause):
    headings = 70.0 * (np.arange(DIVES) // 4)
    ways = ways_on(headings)
    north, east = ways.T
    phase = TIDES[0] * 86400.0 * DAYS
    off = np.deg2rad(22.0) * np.sin(np.deg2rad(headings)) * (np.arange(DIVES) >= 10)
    sound = noise(5, DIVES)
    sound[:, [PLACE["current_north"], PLACE["current_east"]]] += {
        "speed": 0.15 * ways,
        "tide": 0.08 * np.column_stack([np.cos(phase), np.sin(phase)]),
        "iron": np.column_stack([off * east, -off * north]),
    }[cause]
    found, probability = odds(glider, sound, ways)
    if cause == "iron":
        assert probability["compass_iron"] > 0.8
    else:
        assert found.evidence.max() < -1.5


def test_what_the_first_dives_show_is_the_noise_of_a_vehicle(noise):
    late = np.abs(follow(5.0 * noise(7, DIVES)).innovation[10:])
    assert np.nanmean(late) < 1.3


def test_strokes_are_told_with_their_inner_samples():
    volume = np.array([0.0, 0.0, 4.0, 12.0, np.nan, 28.0, 30.0, 30.0, 10.0])
    found = strokes_of(volume, 4.0)
    assert found.out.tolist() == [False, False, True, True, True, True, True, False, False]
    assert found.inner.tolist() == [False, False, False, True, True, True, False, False, False]
    np.testing.assert_allclose(found.rate[found.inner], 2.0)


def pumped(stroke):
    """The pump's rate that a dive with one stroke [cm3/s at each sample] tells."""
    depth = np.concatenate([np.linspace(0.0, 100.0, 60), np.linspace(100.0, 0.0, 60)])
    rate = np.zeros(120)
    rate[60 : 60 + len(stroke)] = stroke
    signals = {"measured_depth": depth, "measured_pump": 4.0 * np.cumsum(rate) - 200.0}
    return channels_of(DiveSignals(period=4.0, signals=signals), None)[PLACE["pump_rate"]]


def test_a_pump_that_is_done_between_two_samples_tells_no_rate():
    even = [3.0, 12.0, 12.0, 11.9, 4.0, 0.5]
    assert np.exp(pumped(even)) == pytest.approx(12.0, rel=0.01)
    # the Sea-Wing's, sampled at two places: the highest would differ by 30 %
    for first in (25.0, 80.0):
        assert np.isnan(pumped(first * np.exp(-np.arange(8.0))))


def test_a_signature_is_of_the_dive_and_not_of_hours_at_the_surface(glider):
    (drift,) = (h for h in glider.hypotheses if h.kind == "pressure_drift")
    shown = drift.signature[PLACE["surface_depth"]]
    # a day after its begin it shows what it has drifted by, in metres of sea water
    assert shown == pytest.approx(0.99, abs=0.05)


def rates(depth, period):
    """Rates' channels of yos to a depth [m] at 0.15 m/s, sampled every `period` [s] of 4 h."""
    time = np.arange(0.0, 4 * 3600.0, period)
    way = 0.15 * time / depth
    rising = way % 2.0 > 1.0
    signals = {
        "measured_depth": depth * np.abs((way + 1.0) % 2.0 - 1.0),
        "measured_pitch": np.where(rising, 24.0, -24.0),
        "measured_pump": np.where(rising, 200.0, -200.0),
    }
    calibration = load_calibration("slocum-200")
    found = channels_of(DiveSignals(period=period, signals=signals), calibration)
    return found[[PLACE["rate_dive"], PLACE["rate_climb"]]]


def test_depth_rates_of_yos_that_satellite_samples_do_not_resolve_are_not_judged():
    assert np.isnan(rates(30.0, 60.0)).all()
    assert np.isfinite(rates(30.0, 4.0)).all()
    moved = np.abs(rates(300.0, 60.0) - rates(300.0, 4.0))
    assert (moved < NOISE[[PLACE["rate_dive"], PLACE["rate_climb"]]]).all()


@pytest.mark.parametrize(("lost", "power"), [(0, 1.5), (40, np.nan)])
def test_a_part_of_the_charge_tells_no_power(lost, power):
    charge = np.linspace(20.0, 20.0 + 1.5 * 100 / 60.0 / 14.0, 101)
    charge[:lost] = np.nan
    signals = {
        "measured_depth": np.linspace(0.0, 300.0, 101), "measured_charge": charge,
        "measured_voltage": np.full(101, 14.0),
    }  # fmt: skip
    found = channels_of(DiveSignals(period=60.0, signals=signals), None)[PLACE["hotel"]]
    assert found == pytest.approx(power, nan_ok=True)


def test_a_leg_begins_where_the_heading_turns_or_is_unknown():
    ways = ways_on(np.array([20.0, 20.0, 110.0, 290.0, 290.0]))
    assert new_legs(ways) == pytest.approx([0.0, 0.0, 1.0, 2.0, 0.0], abs=1e-12)
    ways[4] = np.nan
    assert new_legs(ways)[4] == 1.0


def test_power_by_the_charge_is_without_the_pump_that_deeper_dives_need():
    powers = []
    for depth in (100.0, 800.0):
        down = np.minimum(np.arange(101.0), 100.0 - np.arange(101.0)) / 50.0 * depth
        pump = np.where(np.arange(101) < 50, -200.0, 200.0)
        losses = Consumption.of(twin.load_vehicle("slocum-200"))
        pressure = (1e4 * down[50] + 3e4) / losses.pump_efficiency + losses.pump_loss
        joules = 1.5 * 60.0 * np.arange(101) + (np.arange(101) >= 50) * pressure * 400e-6
        signals = {
            "measured_depth": down, "measured_pump": pump,
            "measured_voltage": np.full(101, 14.0), "measured_charge": joules / 3600.0 / 14.0,
        }  # fmt: skip
        calibration = load_calibration("slocum-200")
        found = channels_of(DiveSignals(period=60.0, signals=signals), calibration)
        powers.append(found[PLACE["hotel"]])
    assert powers == pytest.approx([1.5, 1.5], abs=0.02)
