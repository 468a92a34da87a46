"""A fault is called since its first dive by its own signature, and drift is not."""

import math

import gsw
import numpy as np
import pytest

from glider_twin_ops.health.channels import NAMES, NOISE, WALK
from glider_twin_ops.health.deployment_dives import values_of
from glider_twin_ops.health.dive_channels import DiveSignals, channels_of
from glider_twin_ops.health.judgement import follow, judge, rings, threshold_of
from twin.errors import InputError
from twin.faults import FAULTS

DIVES, BEGUN = 40, 20


@pytest.fixture(scope="module")
def hypotheses(slocum):
    return slocum.signatures.in_dives(np.full((DIVES, 2), 0.2))


@pytest.fixture(scope="module")
def fault(hypotheses):
    """A hypothesis by its kind."""
    return lambda kind: next(h for h in hypotheses if h.kind == kind)


def sound(seed):
    """Channels of a sound vehicle: levels that walk, and noise."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(WALK * rng.standard_normal((DIVES, len(NAMES))), axis=0)
    return walk + NOISE * rng.standard_normal((DIVES, len(NAMES)))


DAYS = np.arange(DIVES) / 8.0


def faulty(fault):
    values = sound(3)
    values[BEGUN:] += np.nan_to_num(fault.signature) * fault.scale
    return follow(values)


def test_a_sound_vehicle_rings_seldom(hypotheses):
    highest = [judge(follow(sound(seed)), DAYS, hypotheses).evidence.max() for seed in range(12)]
    assert np.mean(np.array(highest) > threshold_of(30.0)) < 0.25


@pytest.mark.parametrize(
    "kind", ["wing_lost", "attached", "pump_weak", "pitch_slips", "hotel_raised", "turn_slips"]
)
def test_a_fault_is_called_by_its_name_since_its_first_dive(hypotheses, fault, kind):
    verdict = judge(faulty(fault(kind)), DAYS, hypotheses)
    place = verdict.kinds.index(kind)
    assert verdict.probability[place] > 0.9
    assert abs(verdict.since[place] - BEGUN) <= 1
    assert verdict.size[place] == pytest.approx(fault(kind).scale, rel=0.35)
    over = np.flatnonzero(verdict.evidence > threshold_of(30.0))
    assert BEGUN <= over[0] <= BEGUN + 3


@pytest.mark.parametrize(("kind", "after"), [("wing_lost", 1), ("hotel_raised", 2)])
def test_two_dives_make_an_alarm(hypotheses, fault, kind, after):
    level, evidence = threshold_of(30.0), judge(faulty(fault(kind)), DAYS, hypotheses).evidence
    assert evidence[BEGUN - 1] < level
    assert rings(evidence, level) == [(BEGUN + after, DIVES - 1)]
    if kind == "wing_lost":
        assert evidence[BEGUN] > level


def test_a_channel_that_the_log_lacks_is_left_out(hypotheses):
    values = sound(4)
    values[:, NAMES.index("roll_climb")] = math.nan
    levels = follow(values)
    assert np.isnan(levels.innovation[:, NAMES.index("roll_climb")]).all()
    assert not np.isnan(judge(levels, DAYS, hypotheses).evidence).any()


def test_a_long_deployment_whose_log_says_little_does_not_ring(hypotheses):
    """Of satellite logs whose depth at the surface alone is told, those of 160 dives rang."""
    count, rng = 250, np.random.default_rng(5)
    hypotheses = [one for one in hypotheses if one.signature.ndim == 1]
    values = np.full((count, len(NAMES)), math.nan)
    k = NAMES.index("surface_depth")
    values[:, k] = NOISE[k] * rng.standard_normal(count)
    found = judge(follow(values), np.arange(count) / 8.0, hypotheses)
    assert found.evidence.max() < threshold_of(30.0)
    # once it drifts it rings all the same
    values[150:, k] += 0.04 * np.arange(100)
    found = judge(follow(values), np.arange(count) / 8.0, hypotheses)
    assert found.evidence.max() > 5.0
    assert found.kinds[int(np.argmax(found.probability))] == "pressure_drift"


def test_every_kind_of_the_vehicle_is_weighed(hypotheses, slocum):
    possible = {name for name, kind in FAULTS.items() if not kind.unfit(slocum.vehicle)}
    assert {h.kind for h in hypotheses} == possible


def test_a_port_wing_and_a_starboard_one_are_mirrors(hypotheses):
    port, starboard = (
        next(h for h in hypotheses if getattr(h.fault, "side", "") == side).signature
        for side in ("port", "starboard")
    )
    for name in ("roll_dive", "roll_climb", "turn_climb"):
        k = NAMES.index(name)
        assert port[k] == pytest.approx(-starboard[k], rel=0.05, abs=0.05)
    assert abs(port[NAMES.index("roll_climb")]) > 2.0


def test_rates_that_were_not_measured_are_refused():
    assert threshold_of(300.0) > threshold_of(30.0) > threshold_of(3.0)
    with pytest.raises(InputError, match="must be within"):
        threshold_of(1e4)


def dive(zero=0.0, waves=0.0, conductivity_lag=0.0, temperature_lag=0.0):
    """A dive and its climb in a thermocline, from the surface to the surface."""
    period, rng = 4.0, np.random.default_rng(0)
    fall = np.concatenate([[0.0, 0.1, 0.3, 0.7], np.arange(1.0, 120.0, 0.6)])
    depth = np.concatenate([fall, fall[::-1], 0.15 * np.cos(np.arange(12)) * 0.7 ** np.arange(12)])
    rate = np.gradient(depth, period)
    moved = depth + waves * np.sin(np.arange(len(depth)) / 70.0)
    signals = {"measured_depth": depth + zero + 0.01 * rng.standard_normal(len(depth))}
    for name, lag in (("temperature", temperature_lag), ("conductivity", conductivity_lag)):
        signals[f"measured_{name}"] = 10.0 - 5.0 * np.tanh((moved - lag * rate - 60.0) / 25.0)
    return DiveSignals(period=period, signals=signals)


def told(name, signals):
    return channels_of(signals, None)[NAMES.index(name)]


def channel(name, **settings):
    return told(name, dive(**settings))


@pytest.mark.parametrize("zero", [-1.2, 0.0, 0.3, 2.5])
def test_the_depth_at_the_surface_is_told_to_centimetres(zero):
    assert channel("surface_depth", zero=zero) == pytest.approx(zero, abs=0.08)


def test_a_log_that_ends_below_tells_no_depth_at_the_surface():
    """What begins to sink is as slow as what floats, and lies deeper."""
    depth, begin = dive(zero=0.3).signals["measured_depth"], np.linspace(0.5, 0.9, 12)
    risen = np.concatenate([begin, depth[4:]])
    # nor does one moment in which what turns below the surface is slow
    below, up, moment = (
        told("surface_depth", DiveSignals(period=4.0, signals={"measured_depth": one}))
        for one in (np.concatenate([begin, depth[4:150]]), risen, risen[12:-10])
    )
    assert math.isnan(below)
    assert up == pytest.approx(0.3, abs=0.2)
    assert math.isnan(moment)


def test_samples_that_the_importer_interpolated_tell_no_depth_at_the_surface():
    whole = dive(zero=0.3)
    depth = whole.signals["measured_depth"]
    count = len(depth)
    rising = np.arange(count) >= count - 60
    lost = depth.copy()
    lost[-60:] = np.linspace(lost[-61], 0.0, 60)  # ends in a ramp as slow as floating
    lost[-20:] = np.linspace(0.2, 0.0, 20)
    time = 4.0 * np.arange(count)
    nearest = np.where(rising, time[-61], time)
    for stamped, told_depth in ((time, True), (nearest, False)):
        signals = {"measured_depth": lost, "measured_depth_time": stamped}
        found = told("surface_depth", DiveSignals(period=4.0, signals=signals))
        assert math.isfinite(found) == told_depth


def test_a_late_cell_is_told_though_waves_move_the_water():
    calm, rough = (channel("cell_lag", conductivity_lag=20.0, waves=waves) for waves in (0.0, 3.0))
    assert calm == pytest.approx(20.0, rel=0.1)
    assert rough == pytest.approx(calm, abs=1.0)
    assert abs(channel("temperature_lag", waves=3.0)) > 3.0
    assert abs(channel("cell_lag", waves=3.0)) < 0.1
    # a slow thermistor too, where a log has conductivity or the salinity that was made of it
    slow = dive(temperature_lag=15.0, waves=3.0)
    lag = told("cell_lag", slow)
    assert lag == pytest.approx(-15.0, abs=1.0)
    signals = dict(slow.signals)
    signals["measured_salinity"] = gsw.SP_from_C(
        10.0 * signals.pop("measured_conductivity"), signals["measured_temperature"],
        signals["measured_depth"],
    )  # fmt: skip
    salty = DiveSignals(period=slow.period, signals=dict(signals))
    del signals["measured_salinity"]
    warm = DiveSignals(period=slow.period, signals=signals)
    table = values_of([slow, salty, warm], None)
    both = table[:, [NAMES.index("cell_lag"), NAMES.index("temperature_lag")]]
    assert both[:2, 0] == pytest.approx(lag, abs=1e-3)
    # and the thermistor by itself only where nothing is beside it
    assert np.isfinite(both).tolist() == [[True, False], [True, False], [False, True]]


def test_iron_that_was_there_before_the_log_is_no_fault(slocum):
    """Headings that change show old iron as a fault that begins with them would."""
    heading = np.repeat([0.3, 2.0, 4.0, 5.5], DIVES // 4)
    way = 0.25 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    mine = slocum.signatures.in_dives(way)
    iron = next(h for h in mine if h.kind == "compass_iron")
    odds = {}
    for begun in (0, BEGUN + 4):
        values = sound(5)
        values[begun:] += 25.0 * iron.signature[begun:]
        verdict = judge(follow(values), DAYS, mine)
        # two headings are left: nothing tells it from a turn as a whole
        kinds = ("compass_iron", "compass_turned")
        odds[begun] = sum(verdict.probability[verdict.kinds.index(kind)] for kind in kinds)
    assert odds[0] < 0.2
    assert odds[BEGUN + 4] > 0.9
