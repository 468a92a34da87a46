"""The summary of a mission."""

from __future__ import annotations

import math

import numpy as np

import twin
from twin.mission.segments import SawTooth, Surface
from twin.records.mission_dataset import summarise


def test_the_angle_of_attack_is_that_of_the_flight_not_of_the_surface() -> None:
    mission = twin.Mission(
        name="dive and stay",
        segments=[SawTooth(max_depth_m=20.0, yos=1), Surface(duration_s=200.0)],
    )
    run = twin.simulate(mission=mission)
    v_rel = run.v_rel
    every = np.abs(np.rad2deg(np.arctan2(v_rel[:, 2], v_rel[:, 0])))
    assert np.percentile(every, 98) > 60.0  # it lies at the surface
    assert 1.0 < summarise(run)["angle_of_attack_p98_deg"] < 30.0


def test_a_vehicle_that_never_dives_has_no_angle_of_attack() -> None:
    mission = twin.Mission(name="stay", segments=[Surface(duration_s=20.0)])
    assert math.isnan(summarise(twin.simulate(mission=mission))["angle_of_attack_p98_deg"])
