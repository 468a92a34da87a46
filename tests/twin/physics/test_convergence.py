"""Error against the time step: the order of the scheme, and the shipped step."""

from __future__ import annotations

import numpy as np
import pytest

from twin.mission.schedule import Schedule
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")
SHIPPED = 0.1


def fly(timestep: float, *, centred: bool = True, duration: float = 60.0):
    """A turning dive that starts off its steady state, commands constant."""
    actuators = (0.02, 0.5, VEHICLE.pump_for_net_mass(0.3))
    return simulate(
        Scenario(
            vehicle=VEHICLE,
            plan=Schedule(times=[0.0], commands=[actuators]),
            duration=duration,
            start=Start(depth=500.0, pitch=-0.4, v_rel=(0.4, 0.0, 0.01), actuators=actuators),
            timestep=timestep,
            centred=centred,
            sample_period=5.0,
        )
    )


def test_shipped_timestep_is_the_one_tested():
    from twin.physics.mujoco_model import compile_model

    assert compile_model("glider", lean=True).opt.timestep == SHIPPED


@pytest.mark.parametrize(("centred", "order"), [(True, 2.0), (False, 1.0)])
def test_error_falls_at_the_order_of_the_scheme(centred, order):
    """Semi-implicit Euler is first order; time-centred water makes it second."""
    reference = fly(0.005)
    errors = [
        np.abs(fly(timestep, centred=centred).v_rel - reference.v_rel).max()
        for timestep in (0.2, 0.1, 0.05)
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    np.testing.assert_allclose(orders, order, atol=0.4)
    assert errors[1] < (2e-5 if centred else 2e-3)


def test_shipped_step_is_within_a_tenth_of_a_percent_of_the_converged_speed():
    shipped, fine = fly(SHIPPED, duration=120.0), fly(0.0125, duration=120.0)
    speeds = [np.linalg.norm(t.v_rel, axis=1) for t in (shipped, fine)]
    np.testing.assert_allclose(speeds[0], speeds[1], rtol=1e-3)


def test_steady_state_does_not_depend_on_the_step():
    """A fixed point of the motion is one at every step size; only the spin of a spiral is left."""
    ends = [fly(timestep, duration=400.0).v_rel[-1] for timestep in (0.2, 0.1, 0.05)]
    np.testing.assert_allclose(ends[0], ends[2], atol=2e-6)
    np.testing.assert_allclose(ends[1], ends[2], atol=1e-6)
