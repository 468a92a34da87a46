"""What a pilot changes, what drove a vehicle and alarms that end are told for what they are."""

import math

import numpy as np
import pytest

import twin
from glider_twin_ops.health.assessment import judged, remarks_of, rings
from glider_twin_ops.health.channels import CHANNELS, NAMES
from glider_twin_ops.health.deployment_dives import changes_of
from glider_twin_ops.health.dive_channels import channels_of, flight_model
from glider_twin_ops.health.dive_signals import DiveSignals
from glider_twin_ops.health.judgement import STEP, follow
from glider_twin_ops.health.signatures import signatures_of, usual_dive

NOISE = np.array([channel.noise for channel in CHANNELS])
DIVES = 20


def dive(depth=100.0, pitch=26.0, pump=200.0, **more):
    """A saw tooth without noise."""
    z = np.concatenate([np.linspace(0.0, depth, 200), np.linspace(depth, 0.0, 200)])
    down = np.arange(400) < 200
    signals = {
        "measured_depth": z,
        "measured_pitch": np.where(down, -pitch, pitch),
        "measured_pump": np.where(down, -pump, pump),
        "measured_vacuum": np.where(z < 5.0, 3e4, 2.5e4),
    }
    return DiveSignals(period=4.0, signals=signals, **more)


def of_kind(kind, vehicle, shape):
    return next(h for h in signatures_of(vehicle, shape).hypotheses if h.kind == kind)


def values(seed=1, count=DIVES):
    return NOISE * np.random.default_rng(seed).standard_normal((count, len(NAMES)))


def test_a_change_of_the_dive_counts_by_depth_pitch_and_volume():
    found = changes_of(
        [dive(), dive(102.0), dive(300.0), dive(300.0, 32.0), dive(300.0, 32.0, 150)]
    )
    assert found[0] == 0.0
    assert found[1] < 1.0 < min(found[2:])


def test_a_level_may_step_where_the_dive_was_changed_and_nowhere_else():
    seen = values()
    seen[10:] += 3.0 * NOISE
    changes = np.zeros(DIVES)
    changes[10] = 4.0
    same, changed = follow(seen), follow(seen, changes)
    assert np.array_equal(same.innovation[1:10], changed.innovation[1:10])
    ratio = np.sqrt(changed.expected[10] / same.expected[10])
    assert ratio == pytest.approx(np.full(len(NAMES), 3.0 * STEP), rel=0.5)
    assert np.abs(changed.innovation[10:]).mean() < 0.6 * np.abs(same.innovation[10:]).mean()


def test_a_thruster_hides_the_glide_but_not_the_hull():
    calibration = flight_model(twin.load_vehicle("slocum-200"))
    told = channels_of(dive(), calibration)
    driven = channels_of(dive(powered=True), calibration)
    assert np.isfinite(told[NAMES.index("rate_dive")])
    assert np.isnan(driven[[NAMES.index(n) for n in ("rate_dive", "trim_climb", "hotel")]]).all()
    assert driven[NAMES.index("air")] == told[NAMES.index("air")]
    # the bladder of the surface is no leak
    assert told[NAMES.index("air")] == pytest.approx(math.log((101_325.0 - 2.5e4) / 283.15))


def test_an_alarm_stands_until_no_fault_is_as_likely():
    odds = np.array([-5.0, 4.0, 2.0, 4.0, 3.5, 1.0, -0.5, 2.0, -0.5, -0.5, 3.5, 3.5])
    assert rings(odds, 3.0) == [(4, 8), (11, 11)]
    assert rings(np.array([-math.inf, 1.0]), 3.0) == []
    # a level below even odds does not make it flap
    assert rings(np.array([-1.0, -1.0, -1.5, -2.0, -2.5, -2.5]), -1.2) == [(1, 4)]


@pytest.fixture(scope="module")
def attached():
    vehicle = twin.load_vehicle("slocum-200")
    shape = usual_dive(vehicle)
    return (
        vehicle,
        shape,
        next(h for h in signatures_of(vehicle, shape).hypotheses if h.kind == "attached"),
    )


def judgement(attached, begun, ended=DIVES):
    vehicle, shape, fault = attached
    seen = values()
    seen[begun:ended] += np.nan_to_num(fault.signature) * fault.scale
    return judged(
        name="one", numbers=range(1, DIVES + 1), values=seen, time=10_800.0 * np.arange(DIVES),
        ways=np.full((DIVES, 2), math.nan), dive=shape, vehicle=vehicle, threshold=3.0,
    )  # fmt: skip


def test_a_fault_that_stays_is_an_alarm_that_stands(attached):
    one = judgement(attached, 12)
    assert one.alarm
    assert one.kind == "attached"
    assert one.since_dive in (13, 14)
    assert one.rang == ((one.noticed_dive, DIVES),)
    assert one.since_dive <= one.noticed_dive <= one.since_dive + 2
    assert one.describe()["rang"] == [[one.noticed_dive, DIVES]]
    assert all(kind.kind not in kind.also for kind in one.kinds)
    assert one.describe()["also"] == list(one.kinds[0].also)


def test_a_sound_deployment_is_said_to_have_nothing_wrong(attached):
    one = judgement(attached, DIVES)
    assert not one.alarm
    assert one.verdict().startswith(f"one: nothing wrong in {DIVES} dives")


def test_what_the_log_cannot_show_is_not_weighed(attached):
    vehicle, shape, _ = attached
    seen = values()
    seen[:, NAMES.index("lock")] = math.nan  # it has no Doppler log
    kinds = [
        {kind.kind for kind in judged(
            name="one", numbers=range(1, DIVES + 1), values=told, time=10_800.0 * np.arange(DIVES),
            ways=np.full((DIVES, 2), math.nan), dive=shape, vehicle=vehicle, threshold=3.0,
        ).kinds}
        for told in (values(), seen)
    ]  # fmt: skip
    assert kinds[0] - kinds[1] == {"dvl_beam"}
    # and a compass shows by fixes alone
    assert "compass_iron" not in kinds[1]


def test_a_log_lacks_what_it_tells_neither_so_nor_otherwise(attached):
    vehicle, shape, _ = attached
    lacking = []
    for names in (("temperature_lag",), ("temperature_lag", "cell_lag"), ("cell_lag",)):
        seen = values()
        seen[:, [NAMES.index(name) for name in names]] = math.nan
        lacking.append(judged(
            name="one", numbers=range(1, DIVES + 1), values=seen, time=10_800.0 * np.arange(DIVES),
            ways=np.full((DIVES, 2), 0.2), dive=shape, vehicle=vehicle, threshold=3.0,
        ).lacking)  # fmt: skip
    assert lacking == [(), ("temperature_lag", "cell_lag"), ("cell_lag",)]


def test_nothing_rings_on_a_sound_vehicle(attached):
    one = judgement(attached, DIVES)
    assert (one.alarm, one.kind, one.rang, one.noticed_dive) == (False, "none", (), None)


def test_what_shows_in_a_loud_channel_comes_first(attached):
    vehicle, shape, _ = attached
    quiet = values()
    loud = quiet.copy()
    loud[-1, NAMES.index("air")] += 0.5  # a hundred times its noise, in the last dive alone
    one, before = (
        judged(
            name="one", numbers=range(1, DIVES + 1), values=told, time=10_800.0 * np.arange(DIVES),
            ways=np.full((DIVES, 2), math.nan), dive=shape, vehicle=vehicle, threshold=30.0,
        )
        for told in (loud, quiet)
    )  # fmt: skip
    assert not one.alarm
    air = NAMES.index("air")
    tell = {
        h.kind
        for h in signatures_of(vehicle, shape).hypotheses
        if np.nan_to_num(np.abs(np.atleast_2d(h.signature)[:, air])).max() * h.scale
        > CHANNELS[air].noise
    }
    shows = [kind.kind in tell for kind in one.kinds]
    assert 0 < sum(shows) < len(shows)
    assert shows == sorted(shows, reverse=True)
    for part in (True, False):  # each part the likeliest first
        told = [k.probability for k in one.kinds if (k.kind in tell) == part]
        assert told == sorted(told, reverse=True)
    assert [k.probability for k in before.kinds] == sorted(
        (k.probability for k in before.kinds), reverse=True
    )


def test_remarks_name_thruster_rudder_and_the_pilots_changes():
    seen = values()
    seen[:, NAMES.index("turn_dive")], seen[:, NAMES.index("turn_climb")] = -14.0, -11.0
    changes = np.zeros(DIVES)
    changes[[3, 4, 9]] = 2.0
    powered = [d >= 18 for d in range(DIVES)]
    vehicle = twin.load_vehicle("slocum-200")
    thruster, leaning, changed = remarks_of(range(DIVES), seen, changes, powered, vehicle)
    assert "thruster drove dives 18 to 19" in thruster
    assert "rudder at -14 degrees in dives and -11 in climbs" in leaning
    assert "dives 3 to 4, 9:" in changed
    assert remarks_of(range(DIVES), values(), np.zeros(DIVES), [], vehicle) == ()


def test_signatures_are_of_the_water_that_the_vehicle_is_ballasted_for():
    ocean = twin.load_vehicle("slocum-200")
    brackish = ocean.replace(reference_density=1005.0)
    shape = usual_dive(ocean, depth=40.0)
    place = NAMES.index("rate_climb")
    one, other = (
        next(h for h in signatures_of(v, shape).hypotheses if h.kind == "attached")
        for v in (ocean, brackish)
    )
    assert one.signature[place] < -0.1
    assert other.signature[place] == pytest.approx(one.signature[place], rel=0.1)
