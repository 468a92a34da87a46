"""What a pilot is told of a run beside its figures."""

from __future__ import annotations

import numpy as np
import pytest

from twin.mission import Hold, Mission, SawTooth, Waypoint
from twin.physics.ballast import out_of_trim, weighed
from twin.physics.remarks import remarks
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.profile import Uniform
from twin.water.density import DensityProfile
from twin.water.floor import FlatFloor, GridFloor

DIVES = Mission(segments=(SawTooth(max_depth_m=20, pitch_deg=30, heading_deg=0, yos=1),))
AWAY = Waypoint(targets=({"north_m": 2000.0, "east_m": 0.0},), max_depth_m=30)


def told(**fields) -> list[str]:
    scenario = Scenario(**fields)
    return remarks(scenario, Simulation(scenario).run())


def test_nothing_is_said_of_a_mission_that_was_flown():
    assert told(mission=DIVES) == []


def test_a_run_that_ends_before_its_target_says_how_far():
    (text,) = told(mission=Mission(segments=(AWAY,)), duration=300.0)
    assert text.startswith("the run ended 1.8")
    assert text.endswith(" km short of target 1 of 1, at 300 s")


def test_a_current_beyond_the_vehicle_comes_before_the_target_that_it_costs():
    stronger, short = told(
        mission=Mission(segments=(AWAY,)), duration=300.0, current=Uniform(north=-2.0)
    )
    assert stronger.startswith("the current of 2.00 m/s is stronger than the vehicle")
    assert "km short of target 1 of 1" in short


def test_a_dive_beyond_the_largest_depth_is_aborted():
    sinks = Hold(shift_m=0.02, rotation_deg=0, net_mass_kg=0.3, duration_s=600)
    (text,) = told(mission=Mission(segments=(sinks,), max_depth_m=15.0))
    assert text == (
        "the mission was not flown to its end: it went deeper than max_depth_m and climbed to the "
        "surface"
    )


def test_ground_that_is_touched_is_said_with_the_way_out():
    unfinished, text = told(mission=DIVES, floor=FlatFloor(depth_m=12.0))
    assert unfinished.startswith("the mission was not flown to its end: its segments took more")
    assert text.startswith("the vehicle touched the sea floor or an obstacle at ")
    assert "min_altitude_m" in text


def test_a_track_beyond_the_bathymetry_says_when():
    small = GridFloor(north_m=[-5.0, 5.0], east_m=[-5.0, 5.0], depth_m=np.full((2, 2), 200.0))
    (text,) = told(mission=DIVES, floor=small)
    assert text.startswith("the vehicle left the bathymetry's area at ")
    assert text.endswith(" s; from there on the depth at its edge was used")


@pytest.mark.parametrize(
    ("more", "water", "said"),
    [
        (0.1, None, ""),
        (2.0, None, "is 2.00 kg heavy at the surface of this water, and its pump carries 0.25 kg"),
        (-2.0, None, "is 2.00 kg light"),
        (0.0, None, ""),
        (0.0, 1040.0, "is 0.79 kg light"),
    ],
)
def test_a_vehicle_beyond_its_pump_is_told_before_it_flies(more, water, said):
    vehicle = load_vehicle("slocum-200")
    heavy, ballast = weighed(vehicle, mass=vehicle.mass + more)
    column = None
    if water is not None:
        column = DensityProfile(depth=np.array([0.0, 1e3]), values=np.full(2, water))
    told = out_of_trim(heavy, ballast, column)
    assert said in told
    assert bool(told) == bool(said)
    neutral, ballast = weighed(vehicle, mass=vehicle.mass + more, ballast_at=0.0)
    assert out_of_trim(neutral, ballast, column) == ""
