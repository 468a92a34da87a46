"""A fault is called since its first dive by its own signature, and drift is not."""

import math

import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.faults import FAULTS
from twin.health.channels import CHANNELS, NAMES
from twin.health.judgement import follow, judge
from twin.health.signatures import confusable, hypotheses_of, in_dives, usual_dive
from twin.health.thresholds import threshold_of

DIVES, BEGUN = 40, 20
NOISE = np.array([channel.noise for channel in CHANNELS])
WALK = np.array([channel.walk for channel in CHANNELS])


@pytest.fixture(scope="module")
def hypotheses():
    vehicle = twin.load_vehicle("slocum-200")
    return in_dives(hypotheses_of(vehicle, usual_dive(vehicle)), np.full((DIVES, 2), 0.2))


def sound(seed):
    """Channels of a sound vehicle: levels that walk, and noise."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(WALK * rng.standard_normal((DIVES, len(NAMES))), axis=0)
    return walk + NOISE * rng.standard_normal((DIVES, len(NAMES)))


def days():
    return np.arange(DIVES) / 8.0


def test_a_sound_vehicle_rings_seldom(hypotheses):
    highest = [judge(follow(sound(seed)), days(), hypotheses).evidence.max() for seed in range(12)]
    assert np.mean(np.array(highest) > threshold_of(30.0)) < 0.25


@pytest.mark.parametrize(
    "kind", ["wing_lost", "attached", "pump_weak", "pitch_slips", "hotel_raised", "turn_slips"]
)
def test_a_fault_is_called_by_its_name_since_its_first_dive(hypotheses, kind):
    one = next(h for h in hypotheses if h.kind == kind)
    values = sound(3)
    values[BEGUN:] += np.nan_to_num(one.signature) * one.scale
    verdict = judge(follow(values), days(), hypotheses)
    place = verdict.kinds.index(kind)
    assert verdict.probability[place] > 0.9
    assert abs(verdict.since[place] - BEGUN) <= 1
    assert verdict.size[place] == pytest.approx(one.scale, rel=0.35)
    over = np.flatnonzero(verdict.evidence > threshold_of(30.0))
    assert BEGUN <= over[0] <= BEGUN + 3


def test_a_channel_that_the_log_lacks_is_left_out(hypotheses):
    values = sound(4)
    values[:, NAMES.index("roll_climb")] = math.nan
    levels = follow(values)
    assert np.isnan(levels.innovation[:, NAMES.index("roll_climb")]).all()
    assert np.isfinite(judge(levels, days(), hypotheses).evidence[3:]).all()


def test_every_kind_of_the_vehicle_is_weighed(hypotheses):
    vehicle = twin.load_vehicle("slocum-200")
    assert {h.kind for h in hypotheses} == {
        name for name, kind in FAULTS.items() if not kind.unfit(vehicle)
    }
    assert confusable(hypotheses, NOISE)["wing_lost"] == {"wing_lost"}


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
    assert threshold_of(300.0) > threshold_of(30.0) > threshold_of(1.0)
    with pytest.raises(InputError, match="must be within"):
        threshold_of(1e4)
