"""Deployments with and without a fault: exactly half, the same draw of the same seed."""

import numpy as np
import pytest

from factory.generation.deployments import DeploymentPlan
from factory.sampling.deployment import fault_kinds, faulty_of
from twin.errors import InputError
from twin.vehicle.vehicle import load_vehicle


def test_one_of_each_pair_has_a_fault():
    for seed in range(5):
        faulty = [faulty_of(seed, index) for index in range(40)]
        assert sum(faulty) == 20
        assert all(a != b for a, b in zip(faulty[::2], faulty[1::2], strict=True))


def test_a_draw_follows_from_seed_and_number():
    plan = DeploymentPlan(vehicle=load_vehicle("slocum-200"), seed=5, kinds=("attached",))
    one, again = (plan.draw(3, 0, True) for _ in range(2))
    assert one.fault == again.fault
    assert one.scenario.mission == again.scenario.mission
    assert one.kind == "attached"
    assert 0.0 < one.fault.start < one.scenario.run_time()
    low, high = type(one.fault).sizes
    assert low <= one.fault.size <= high
    healthy = plan.draw(3, 0, False)
    assert healthy.kind == "none"
    assert np.isnan(healthy.onset)


def test_what_a_vehicle_cannot_have_is_refused():
    with pytest.raises(InputError, match="cannot show fault 'blade_lost'"):
        fault_kinds(load_vehicle("slocum-200"), ("blade_lost",))
    with pytest.raises(InputError, match="preset 'field' is none of"):
        DeploymentPlan(vehicle=load_vehicle("slocum-200"), preset="field")
