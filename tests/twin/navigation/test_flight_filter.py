"""The flight filter: constants of a vehicle that is not as its file says, and their first fit."""

import dataclasses

import numpy as np
import pytest
from glides import LEG, PERIOD, changed, glides

import twin
from twin.errors import InputError, StoreError
from twin.mission import load_mission
from twin.navigation.flight_filter import FlightFilter, FlightSpread, FlightStart
from twin.navigation.flight_filter_kernels import CARRIED, CHANNELS, CONSTANTS, OUTPUTS, VELOCITY
from twin.navigation.flight_fit import adapt_flight, steady_glides
from twin.navigation.settings import ESTIMATED, can_estimate, estimate, sources
from twin.vehicle.vehicle import load_vehicle


def error(found, surge, settled):
    late = settled & (np.arange(len(surge)) > len(surge) // 2)
    return np.sqrt(np.mean((found[late, 0] - surge[late]) ** 2))


SURE = FlightSpread(coefficient=1e-6, drag=1e-6, pitch=1e-8, ballast=1e-6, compressibility=1e-16)
STIFF = FlightSpread(drag=0.058, compressibility=1e-16, depth_rate=3e-3)
"""of a hull that the test does not compress, in glides that are as the balance has them"""


@pytest.mark.parametrize(
    ("off", "tilt", "ballast"),
    [({"drag": 1.1, "lift": 0.9}, 0.0, 0.0), ({"drag": 0.92}, 0.003, 0.08), ({"lift": 1.1}, 0, 0)],
)
def test_a_vehicle_that_is_not_as_its_file_says_is_learned_on_the_way(off, tilt, ballast):
    signals, surge, settled = glides(changed(**off), tilt=tilt, ballast=ballast)
    nominal = dataclasses.replace(load_vehicle(), hull_compressibility=1e-16)
    learned = FlightFilter(nominal, PERIOD, STIFF)
    after = error(learned.run(signals), surge, settled)
    before = error(FlightFilter(nominal, PERIOD, SURE).run(signals), surge, settled)
    assert after < 0.6 * before
    value, deviation = learned.constants["drag"]
    assert deviation < 0.5 * FlightSpread().coefficient
    assert abs(value - np.log(off.get("drag", 1.0))) < 4.0 * deviation
    assert set(learned.constants) == set(CONSTANTS)


def test_a_vehicle_as_its_file_says_stays_so():
    signals, surge, settled = glides(changed())
    nominal = dataclasses.replace(load_vehicle(), hull_compressibility=1e-16)
    learned = FlightFilter(nominal, PERIOD, STIFF)
    assert error(learned.run(signals), surge, settled) < 1e-3
    assert abs(learned.constants["drag"][0]) < 0.01


def flight(name, *, sensors="ideal", seed=0, duration=None, **segment):
    """True surge and depth of one dive in water of one density, and the filter's outputs for the
    vehicle as its file says."""
    vehicle, mission = load_vehicle(name), load_mission("section")
    one = dataclasses.replace(mission.segments[0], yos=1, **segment)
    limit = {} if duration is None else {"duration_s": duration}
    mission = dataclasses.replace(mission, segments=(one,), **limit)
    run = twin.simulate(
        vehicle=vehicle, mission=mission, sensors=sensors, density="constant", seed=seed
    )
    signals = {name: np.asarray(run[name], float) for name in CHANNELS if name in run}
    surge, depth = np.asarray(run["true_surge"]), np.asarray(run["true_depth"])
    signals["measured_density"] = np.full(len(surge), vehicle.reference_density)
    return surge, depth, FlightFilter(vehicle, PERIOD, SURE).run(signals)


def test_a_hull_that_is_still_heavy_with_its_nose_up_sinks_tail_first():
    """The Seaglider's pump takes minutes at the bottom of a dive."""
    surge, depth, found = flight("seaglider", max_depth_m=50)
    back = (surge < -0.03) & (depth > 5.0)
    assert back.sum() > 60
    assert np.abs(found[back, 0] - surge[back]).mean() < 0.15 * np.abs(surge[back]).mean()
    assert found[back, 3].max() == 0.0


def test_a_hull_that_comes_up_fast_coasts_at_the_surface():
    """Its drag alone brakes it, by the square of its speed: it goes on for metres."""
    surge, depth, found = flight("seaexplorer", max_depth_m=30, net_mass_kg=0.4, duration=1200.0)
    up = np.flatnonzero((depth < 1.0) & (np.arange(len(depth)) > depth.argmax()))[0]
    gone, said = (PERIOD * one[up:].sum() for one in (surge, found[:, 0]))
    assert gone > 6.0
    assert abs(said - gone) < 0.15 * gone


def test_a_hull_that_pitches_over_afloat_goes_as_the_twin_does():
    """The Sea-Wing comes up with its nose up and hangs nose down ten seconds later; noise of the
    depth, as of a sensor, does not row it forward."""
    surge, depth, found = flight("glider", max_depth_m=40, duration=2400.0, sensors="field", seed=3)
    afloat = depth < 1.0
    assert afloat.sum() > 1000
    off = found[afloat, 0] - surge[afloat]
    assert abs(off.mean()) < 1.5e-3
    assert off.std() < 6e-3


def test_a_hull_that_is_only_taken_for_stalled_is_told_by_its_depth_rate():
    """At this pitch a fouled Slocum can sink stalled too, and by the motion alone stays so."""
    vehicle = load_vehicle("slocum-200")
    law = dataclasses.replace(vehicle.flow_frame, drag=(12.8, 752.0))
    vehicle = dataclasses.replace(vehicle, law=law, hull_compressibility=1e-16)
    signals, surge, _ = glides(vehicle, pitches=(-20.0,))
    one = FlightFilter(vehicle, PERIOD, SURE)
    one.run({name: values[:200] for name, values in signals.items()})
    state = one.state()
    state["carried"][VELOCITY : VELOCITY + 3] = 0.05, 0.0, 0.05
    one.restore(state)
    found = one.run({name: values[200:] for name, values in signals.items()})
    stalled = found[:, 2] >= np.deg2rad(17.0)
    assert stalled[:3].all()
    assert not stalled[-600:].any()
    assert np.abs(found[-600:, 0] - surge[-600:]).max() < 0.01


def test_sample_by_sample_it_says_the_same_and_goes_on_from_its_state():
    signals, _, _ = glides(changed(drag=1.05), pitches=(-25.0, 30.0))
    whole = FlightFilter(load_vehicle(), PERIOD).run(signals)
    steps = FlightFilter(load_vehicle(), PERIOD)
    samples = [{name: float(signals[name][k]) for name in CHANNELS} for k in range(len(whole))]
    found = [steps.step(sample) for sample in samples[:700]]
    other = FlightFilter(load_vehicle(), PERIOD)
    other.restore(steps.state())
    found += [other.step(sample) for sample in samples[700:]]
    assert np.array_equal(np.array(found), whole)
    other.reset()
    assert np.array_equal(other.step(samples[0]), whole[0])
    with pytest.raises(InputError, match="not one of a flight filter"):
        other.restore({"carried": np.zeros(CARRIED - 1)})
    with pytest.raises(InputError, match="no channel 'measured_density'"):
        other.step({k: v for k, v in samples[0].items() if k != "measured_density"})
    with pytest.raises(InputError, match="measured_pump of the sample is not finite"):
        other.step({**samples[0], "measured_pump": np.nan})


def test_port_for_starboard_turns_the_sway_round():
    signals, _, _ = glides(changed(), pitches=(-25.0, 30.0))
    for name, value in (("roll", 8.0), ("roll_rate", 1e-3), ("yaw_rate", 0.01)):
        signals[f"measured_{name}"] = np.full_like(signals["measured_roll"], value)
    signals["measured_specific_force_y"] = 0.14 * signals["measured_specific_force_z"]
    odd = ("roll", "roll_rate", "yaw_rate", "specific_force_y")
    image = {k: -v if k.removeprefix("measured_") in odd else v for k, v in signals.items()}
    one, other = (FlightFilter(load_vehicle(), PERIOD).run(s) for s in (signals, image))
    assert np.allclose(other, one * [1.0, -1.0, 1.0, 1.0, 1.0], atol=1e-12)
    assert np.abs(one[:, 1]).max() > 5e-3


def test_it_is_refused_where_there_is_no_glider_or_no_number():
    with pytest.raises(InputError, match="'tethys' has a propeller"):
        FlightFilter(load_vehicle("tethys"), PERIOD)
    assert not can_estimate(load_vehicle("tethys"), CHANNELS)
    assert not can_estimate(load_vehicle(), CHANNELS[:-1])
    assert can_estimate(load_vehicle(), CHANNELS)
    with pytest.raises(InputError, match=r"flight spread ballast is 0\.0"):
        FlightSpread(ballast=0.0)
    signals, _, _ = glides(changed(), pitches=(-25.0,))
    signals["measured_density"][7] = np.nan
    with pytest.raises(StoreError, match=r"measured_density of mission 3 .* first at 3.5 s"):
        estimate(signals, load_vehicle(), PERIOD, mission=3)


def test_estimated_channels_name_what_must_be_measured():
    assert sources(("measured_shift", *ESTIMATED)) == ("measured_shift", *CHANNELS)


# --- the fit to first dives -----------------------------------------------------------------------


PITCHES = (-20.0, 24.0, -38.0, 34.0, -28.0, 18.0, -32.0, 27.0)
DIVE = round(2 * LEG / PERIOD)
SPANS = [slice(k * DIVE, (k + 1) * DIVE) for k in range(len(PITCHES) // 2)]
INCOMPRESSIBLE = {"hull_compressibility": 1e-16}


def nominal():
    return dataclasses.replace(load_vehicle(), **INCOMPRESSIBLE)


def dives_of(drag, lift, *, scale=0.0, angle=0.0, shear=0.0):
    """Signals of dives on two headings, their surge, and where they are settled."""
    vehicle = dataclasses.replace(changed(drag=drag, lift=lift), **INCOMPRESSIBLE)
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


def error_of(start, signals, surge, settled):
    found = FlightFilter(nominal(), PERIOD, start=start).run(signals)
    steady = settled & (found[:, OUTPUTS.index("steady")] > 0.0)
    assert steady.mean() > 0.5
    return np.sqrt(np.mean((found[steady, 0] - surge[steady]) ** 2))


def test_a_fouled_hull_is_found_by_its_depth_rate():
    signals, surge, settled = dives_of(1.4, 1.0)
    found = fit(signals, log=False)
    assert found.start is not None
    value, sd = found.factors["drag"]
    assert value == pytest.approx(np.log(1.4), abs=0.02)
    assert sd < 0.03
    assert found.left_over < 0.5
    assert error_of(found.start, signals, surge, settled) < 0.5 * error_of(
        None, signals, surge, settled
    )


def test_a_log_that_is_off_itself_tells_the_lift_slope():
    """Scale, angle and shear of the log are found beside it and do not go into the hull."""
    signals, surge, settled = dives_of(1.4, 0.92, scale=0.02, angle=0.012, shear=0.03)
    without, by_log = (fit(signals, log=log) for log in (False, True))
    wanted = np.log(0.92)
    value, sd = by_log.factors["lift_slope"]
    assert abs(value - wanted) < 2.5 * sd
    assert sd < 0.7 * FlightSpread().coefficient
    assert abs(without.factors["lift_slope"][0] - wanted) > 0.06  # depth rates alone cannot
    both = [error_of(one.start, signals, surge, settled) for one in (without, by_log)]
    assert both[1] < 0.6 * both[0]


def test_what_steady_flight_does_not_explain_widens_the_deviations():
    signals, _, _ = dives_of(1.4, 1.0)
    calm = fit(signals, log=False)
    time = PERIOD * np.arange(len(signals["measured_depth"]))
    signals["measured_depth"] = signals["measured_depth"] + 1.5 * np.sin(time / 97.0)
    wavy = fit(signals, log=False)
    assert calm.widened < 1.2
    assert wavy.widened > 2.5
    assert wavy.factors["drag"][1] > 2.0 * calm.factors["drag"][1]


def test_a_hull_as_its_file_says_is_left_near_it():
    signals, surge, settled = dives_of(1.0, 1.0)
    found = fit(signals, log=False)
    assert all(abs(found.factors[n][0]) < 0.03 for n in ("drag", "lift_slope", "induced"))
    assert error_of(found.start, signals, surge, settled) < 2e-3


def test_one_dive_is_held_back_by_quarters():
    signals, _, _ = dives_of(1.4, 1.0)
    found = fit(signals, log=False, dives=1)
    assert found.start is not None
    assert found.factors["drag"][0] == pytest.approx(np.log(1.4), abs=0.1)


def test_a_filter_goes_on_from_what_was_found():
    signals, _, _ = dives_of(1.4, 1.0)
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
    signals, _, _ = dives_of(1.0, 1.0)
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
