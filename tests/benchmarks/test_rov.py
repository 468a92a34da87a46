"""The rivals of an ROV's networks know its equations."""

import numpy as np
import pytest

from benchmarks.rov import Hulls, padded
from twin.vehicle.vehicle import load_vehicle

AHEAD, ASIDE = (1, 1, -1, -1, 0, 0, 0, 0), (-1, 1, -1, 1, 0, 0, 0, 0)
"""Signs of the thrusters' commands"""


@pytest.mark.parametrize(("axis", "signs"), [(0, AHEAD), (1, ASIDE)])
@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2:wu"])
def test_thrust_and_drag_balance_where_the_equations_and_the_parts_do(vehicle, axis, signs):
    rov, command, length = load_vehicle(vehicle), 0.4 * np.array(signs, float), 15.0
    hulls = Hulls([rov])
    speed = hulls.balance(command[None, None], np.array([[[length]]]))[0, 0]
    assert speed[axis] > 0.3
    assert speed == pytest.approx(speed[axis] * np.eye(3)[axis], abs=1e-12)
    change = hulls.change(speed[None, None], np.zeros((1, 3)), command[None], np.array([[length]]))
    np.testing.assert_allclose(change, 0.0, atol=1e-9)
    law, nu = dict(rov.law.derivatives), np.concatenate([speed, np.zeros(3)])
    given = zip(rov.parts, [*command, length], strict=True)
    force = sum(part.wrench(c, nu, 1000.0, 10.0)[axis] for part, c in given)
    name, u = ("Xu", "Yv")[axis], speed[axis]
    assert force == pytest.approx(-law[name] * u - law[name + name[1]] * u * abs(u))


def test_missions_are_padded_with_their_last_sample():
    found = padded([np.array([[1.0], [2.0]]), np.array([[3.0]])])
    np.testing.assert_array_equal(found[..., 0], [[1.0, 2.0], [3.0, 3.0]])
