"""Neutral positions: a hull that is not quite even is steered straight by a part that is turned."""

import math

import numpy as np
import pytest
from physics import held

from twin.checks.agreement import check_manoeuvres
from twin.fossen import FossenModel
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle

TURNED = {"slocum-200": ("rudder", -0.19), "glider": ("rotation", 0.3)}


def flown(vehicle, part, position):
    named = dict(zip(vehicle.part_names, vehicle.rest.tolist(), strict=True))
    named |= {"pump": vehicle.pump_for_net_mass(0.2), vehicle.steering["pitch"]: 0.015}
    named[part] = position
    command = tuple(named[name] for name in vehicle.part_names)
    start = Start(depth=300.0, pitch=-0.4, v_rel=(0.3, 0.0, 0.01), actuators=command)
    return simulate(held(vehicle, command, 120.0, start=start))


@pytest.mark.parametrize("name", TURNED)
def test_a_part_at_its_neutral_position_steers_as_an_even_vehicles_at_0(name):
    part, neutral = TURNED[name]
    even = load_vehicle(name)
    uneven = even.replace(**{part: {"neutral": neutral}})
    assert uneven.rest[uneven.part_names.index(part)] == neutral
    for turned in (0.0, 0.2):
        mine, theirs = flown(uneven, part, neutral + turned), flown(even, part, turned)
        np.testing.assert_allclose(mine.v_rel, theirs.v_rel, atol=1e-9)
        np.testing.assert_allclose(mine["true_heading"], theirs["true_heading"], atol=1e-6)
    # and by both models: its steady turn at 0 is the even one's the other way
    there = {"pump": even.pump_for_net_mass(0.2), even.steering["pitch"]: 0.015}
    turn = FossenModel(uneven).trim(positions={**there, part: 0.0}).turn_rate_rad_s
    other = FossenModel(even).trim(positions={**there, part: -neutral}).turn_rate_rad_s
    assert turn == pytest.approx(other, rel=1e-9)
    assert abs(math.degrees(turn)) > 0.1


@pytest.mark.parametrize("name", TURNED)
def test_both_models_fly_an_uneven_vehicle_alike(name):
    part, neutral = TURNED[name]
    uneven = load_vehicle(name).replace(**{part: {"neutral": neutral}})
    (found,) = check_manoeuvres(uneven, count=1, duration=300.0)
    assert found.ok, found
