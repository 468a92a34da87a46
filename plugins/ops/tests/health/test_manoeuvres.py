"""Manoeuvres that tell most of a vehicle's parameters."""

import numpy as np
import pytest

from glider_twin_ops.health import most_telling
from glider_twin_ops.health.manoeuvres import LEARNED, NOISE, flown_logs, slopes_of, turned
from glider_twin_ops.health.signatures import usual_dive
from twin.identify import choose, load_calibration

CALIBRATION = load_calibration("slocum-200")
USUAL = usual_dive(CALIBRATION.vehicle, 4.0, 60.0)
CHOSEN = choose(list(LEARNED))


@pytest.fixture(scope="module")
def alone():
    (log,) = flown_logs(CALIBRATION, [USUAL])
    return slopes_of(turned(log, 0.0), CALIBRATION, CHOSEN, NOISE)


def test_the_way_of_a_dive_turns_with_its_course(alone):
    (log,) = flown_logs(CALIBRATION, [USUAL])
    flown = slopes_of(turned(log, 90.0), CALIBRATION, CHOSEN, NOISE)
    # a flight ends with the dive: at the surface no way is made
    assert log.depth[-100:].max() > 5.0
    scale = float(np.abs(flown.way).max())
    np.testing.assert_allclose(alone.turned(90.0).way, flown.way, rtol=1e-6, atol=1e-6 * scale)
    # the drag slows it down, and to starboard nothing goes
    drag = LEARNED.index("drag")
    assert alone.way[0, drag] < 0.0
    assert abs(alone.way[1, drag]) < 0.1 * abs(alone.way[0, drag])


def test_what_is_proposed_tells_more_than_usual_dives(alone):
    information = np.eye(len(CHOSEN)) + 5.0 * alone.depth_rates
    found = most_telling(CALIBRATION, USUAL, information)
    usual, proposed = found.shrinks
    assert proposed < 0.6 < usual < 1.0
    assert len(found.chosen) == 3
    assert all(one.seconds > 600.0 for one in found.chosen)
    # one pitch cannot tell the sensor's zero from drag and lift: others are proposed
    assert len({one.dive.pitch for one in found.chosen}) > 1
    # as many usual dives again: five eighths of the information that depth rates have
    eight = np.linalg.inv(np.eye(len(CHOSEN)) + 8.0 * alone.depth_rates)
    np.testing.assert_allclose(found.ordinary, np.sqrt(np.diag(eight)), rtol=1e-9)
    rows = {str(row["parameter"]): row for row in found.table()}
    assert list(rows) == list(LEARNED)
    assert float(rows["pitch_offset"]["after these"]) < float(rows["pitch_offset"]["deviation now"])
