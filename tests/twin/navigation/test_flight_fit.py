"""The fit of a hull to its first dives: by depth rates, and by a Doppler log that is off itself."""

import dataclasses

import numpy as np
import pytest
from glides import LEG, PERIOD, changed, glides

from twin.errors import InputError
from twin.navigation.flight_filter import FlightFilter, FlightSpread, FlightStart
from twin.navigation.flight_filter_kernels import CONSTANTS, OUTPUTS
from twin.navigation.flight_fit import adapt_flight, steady_glides
from twin.vehicle.vehicle import load_vehicle

PITCHES = (-20.0, 24.0, -38.0, 34.0, -28.0, 18.0, -32.0, 27.0)
DIVE = round(2 * LEG / PERIOD)
SPANS = [slice(k * DIVE, (k + 1) * DIVE) for k in range(len(PITCHES) // 2)]
STIFF = {"hull_compressibility": 1e-16}


def nominal():
    return dataclasses.replace(load_vehicle(), **STIFF)


def flown(drag, lift, *, scale=0.0, angle=0.0, shear=0.0):
    """Signals of dives on two headings, their surge, and where they are settled."""
    vehicle = dataclasses.replace(changed(drag=drag, lift=lift), **STIFF)
    signals, surge, settled = glides(vehicle, pitches=PITCHES)
    pitch = np.deg2rad(signals["measured_pitch"])
    sink = np.gradient(signals["measured_depth"], PERIOD)
    heave = (sink + surge * np.sin(pitch)) / np.cos(pitch)
    heading = np.where(np.arange(len(surge)) // DIVE % 2, 200.0, 40.0)
    slip = shear * np.cos(np.deg2rad(heading))  # of the log's cells, which go north
    u, w = surge + slip * np.cos(pitch), heave + slip * np.sin(pitch)
    u, w = (1.0 + scale) * (u - angle * w), (1.0 + scale) * (w + angle * u)
    rng = np.random.default_rng(1)
    signals |= {
        "measured_heading": heading,
        "measured_dvl_surge": u + 2e-3 * rng.standard_normal(len(u)),
        "measured_dvl_sway": np.zeros(len(u)),
        "measured_dvl_heave": w + 2e-3 * rng.standard_normal(len(u)),
        "measured_dvl_mode": np.full(len(u), 2.0),
    }
    return signals, surge, settled


def fit(signals, *, log, dives=4):
    flight = FlightFilter(nominal(), PERIOD)
    return adapt_flight(flight, steady_glides(flight, signals, SPANS[:dives], log=log), log=log)


def error(start, signals, surge, settled):
    found = FlightFilter(nominal(), PERIOD, start=start).run(signals)
    steady = settled & (found[:, OUTPUTS.index("steady")] > 0.0)
    assert steady.mean() > 0.5
    return np.sqrt(np.mean((found[steady, 0] - surge[steady]) ** 2))


def test_a_fouled_hull_is_found_by_its_depth_rate():
    signals, surge, settled = flown(1.4, 1.0)
    found = fit(signals, log=False)
    assert found.start is not None
    value, sd = found.factors["drag"]
    assert value == pytest.approx(np.log(1.4), abs=0.02)
    assert sd < 0.03
    assert found.left_over < 0.5
    assert error(found.start, signals, surge, settled) < 0.5 * error(None, signals, surge, settled)


def test_a_log_that_is_off_itself_tells_the_lift_slope():
    """Scale, angle and shear of the log are found beside it and do not go into the hull."""
    signals, surge, settled = flown(1.4, 0.92, scale=0.02, angle=0.012, shear=0.03)
    without, by_log = (fit(signals, log=log) for log in (False, True))
    wanted = np.log(0.92)
    value, sd = by_log.factors["lift_slope"]
    assert abs(value - wanted) < 2.5 * sd
    assert sd < 0.7 * FlightSpread().coefficient
    assert abs(without.factors["lift_slope"][0] - wanted) > 0.06  # depth rates alone cannot
    both = [error(one.start, signals, surge, settled) for one in (without, by_log)]
    assert both[1] < 0.6 * both[0]


def test_what_steady_flight_does_not_explain_widens_the_deviations():
    signals, _, _ = flown(1.4, 1.0)
    calm = fit(signals, log=False)
    time = PERIOD * np.arange(len(signals["measured_depth"]))
    signals["measured_depth"] = signals["measured_depth"] + 1.5 * np.sin(time / 97.0)
    wavy = fit(signals, log=False)
    assert calm.widened < 1.2
    assert wavy.widened > 2.5
    assert wavy.factors["drag"][1] > 2.0 * calm.factors["drag"][1]


def test_a_hull_as_its_file_says_is_left_near_it():
    signals, surge, settled = flown(1.0, 1.0)
    found = fit(signals, log=False)
    assert all(abs(found.factors[n][0]) < 0.03 for n in ("drag", "lift_slope", "induced"))
    assert error(found.start, signals, surge, settled) < 2e-3


def test_one_dive_is_held_back_by_quarters():
    signals, _, _ = flown(1.4, 1.0)
    found = fit(signals, log=False, dives=1)
    assert found.start is not None
    assert found.factors["drag"][0] == pytest.approx(np.log(1.4), abs=0.1)


def test_a_filter_goes_on_from_what_was_found():
    signals, _, _ = flown(1.4, 1.0)
    start = fit(signals, log=False).start
    flight = FlightFilter(nominal(), PERIOD, start=start)
    assert [value for value, _ in flight.constants.values()] == list(start.constants)
    flight.run(signals)
    before, after = flight.begins[0], [value for value, _ in flight.constants.values()]
    moved = np.abs(np.array(after) - before) / np.sqrt(np.diag(flight.begins[1]))
    assert 0.0 < moved.max() < 2.0
    flight.reset()
    assert flight.constants["drag"][0] == start.constants[0]


def test_what_does_not_suffice_is_refused():
    signals, _, _ = flown(1.0, 1.0)
    short = [slice(0, 400)]
    flight = FlightFilter(nominal(), PERIOD)
    few = steady_glides(flight, signals, short, log=False)
    with pytest.raises(InputError, match="steady glides, and a fit needs 20"):
        adapt_flight(flight, few, log=False)
    signals["measured_dvl_mode"][:] = 1.0
    bottom = steady_glides(flight, signals, SPANS, log=True)
    with pytest.raises(InputError, match="no water lock in a steady glide"):
        adapt_flight(flight, bottom, log=True)
    unit = tuple(map(tuple, np.eye(len(CONSTANTS))))
    zeros = (0.0,) * len(CONSTANTS)
    for bad in (
        {"constants": zeros[1:]},
        {"constants": (np.nan, *zeros[1:])},
        {"correlation": tuple(map(tuple, -np.eye(len(CONSTANTS))))},
        {"deviations": zeros},
        {"depth_rate": 0.0},
    ):
        right = {
            "constants": zeros, "deviations": (1.0,) * len(zeros), "correlation": unit,
            "depth_rate": 1e-2,
        }  # fmt: skip
        FlightStart(**right)
        with pytest.raises(InputError, match=r"flight filter begins|depth_rate"):
            FlightStart(**right | bad)
