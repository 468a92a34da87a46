"""The table of limits: every variable has a row, and truth none that is wider than a sensor's."""

import pytest

from twin.records.schema import HYDROGRAPHY, LOGGED_ONLY, SIMULATED, VARIABLES, WITH_FLOOR, Variable
from twin.records.schema.limits import TABLE, quantity, recorded_limits, simulated_limits


@pytest.mark.parametrize("name", VARIABLES)
def test_every_variable_has_limits(name):
    low, high = recorded_limits(name)
    assert low < high
    closer_low, closer_high = simulated_limits(name)
    assert low <= closer_low < closer_high <= high


def test_every_row_is_used():
    named = (*SIMULATED, *HYDROGRAPHY, *LOGGED_ONLY, *WITH_FLOOR)
    assert {quantity(name) for name in named} == set(TABLE)


def test_sensors_may_say_more_than_a_simulation_does():
    assert simulated_limits("true_surge") == (-5.0, 5.0)
    assert simulated_limits("measured_dvl_surge") == (-10.0, 10.0)
    assert simulated_limits("commanded_heading") == (0.0, 360.0)
    assert recorded_limits("true_heading") == (-180.0, 360.0)


def test_a_unit_without_limits_says_where_they_belong(monkeypatch):
    monkeypatch.setitem(VARIABLES, "true_light", Variable("true_light", "lx", "light"))
    with pytest.raises(LookupError, match=r"'true_light': add limits for the unit 'lx' to .*TABLE"):
        recorded_limits("true_light")
    with pytest.raises(KeyError, match="true_depth"):
        recorded_limits("true_dept")
