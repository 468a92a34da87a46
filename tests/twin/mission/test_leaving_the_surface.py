"""A vehicle that an elevator pitches leaves the surface, at low speed and after a stay there."""

from __future__ import annotations

import numpy as np
import pytest

from twin.mission import Mission, SawTooth, Segment, Surface, Transect
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation

SLOW = 0.8


@pytest.mark.parametrize("vehicle", ["tethys", "tethys:gazebo"])
@pytest.mark.parametrize(
    "segment",
    [
        SawTooth(max_depth_m=20.0, min_depth_m=5.0, pitch_deg=10.0, speed_m_s=SLOW, duration_s=300),
        Transect(depth_m=10.0, heading_deg=30.0, speed_m_s=SLOW, duration_s=300.0),
    ],
)
def test_pump_and_battery_take_it_under_water(vehicle: str, segment: Segment) -> None:
    """An elevator alone lifts the tail out of the water, and the hull stays awash."""
    plan = Mission(
        segments=(segment, Surface(duration_s=200.0), segment), duration_s=900.0, at_end="hold"
    )
    run = Simulation(Scenario(vehicle=vehicle, mission=plan)).run()
    for part in (0, 2):
        inside = run["commanded_segment"] == part
        time, depth = run.time[inside], run["true_depth"][inside]
        under = time[np.argmax(depth > 2.0)] - time[0]
        assert depth.max() > 9.0
        assert under < 90.0
    # under way it is neutral again, and the battery where the way has it
    way = (run["commanded_segment"] == 0) & (run.time > 250.0)
    assert run["commanded_pump"][way] == pytest.approx(500.0)
    assert np.abs(run["commanded_shift"][way]).max() < 0.03
