"""Guidance in a turn and at the change of a segment: Euler rates, integrals, directions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.mission import Mission, SawTooth, Spiral
from twin.mission import mission_file as g
from twin.mission.guidance import guidance_step, new_state
from twin.mission.shipped_missions import load_mission_for
from twin.vehicle.vehicle import load_vehicle

KP, KI, KD = 2.0, 0.01, 30.0
VEHICLE = load_vehicle("glider").replace(
    pitch_pid=(0.1, 0.01, 0.5), heading_pid=(KP, KI, KD), control_period=0.5
)
TICK = 0.5


class Flight:
    """Guidance flown by hand: the test sets depth, attitude and rates of each tick."""

    def __init__(self, *segments, **mission):
        self.table, self.gains = Mission(segments=segments, **mission).compile(VEHICLE)
        self.table[:, [g.DIVE_TURN, g.CLIMB_TURN]] = 1.0  # as if it turned alike in all ways
        self.state, self.command, self.time = new_state(), np.zeros(3), 0.0

    def tick(self, depth=50.0, *, roll=0.0, pitch=0.0, heading=0.0, rates=(0.0, 0.0, 0.0)):
        """One tick; the command of shift, rotation and pump."""
        guidance_step(
            self.table, self.gains, self.state, self.time, depth, roll, pitch, heading, *rates,
            self.command,
        )  # fmt: skip
        self.time += TICK
        return self.command.copy()


def euler_rates_to_body(roll, pitch, roll_rate, pitch_rate, heading_rate):
    """p, q, r of these rates of the Euler angles (Fossen 2011, equation 2.26)."""
    return (
        roll_rate - math.sin(pitch) * heading_rate,
        math.cos(roll) * pitch_rate + math.sin(roll) * math.cos(pitch) * heading_rate,
        -math.sin(roll) * pitch_rate + math.cos(roll) * math.cos(pitch) * heading_rate,
    )


def commands(roll, pitch, **euler):
    """Shift and rotation of a first tick at these rates of the Euler angles [rad/s]."""
    rates = {"roll_rate": 0.0, "pitch_rate": 0.0, "heading_rate": 0.0, **euler}
    flight = Flight(SawTooth(max_depth_m=100, heading_deg=0, pitch_deg=35, yos=1))
    body = euler_rates_to_body(roll, pitch, **rates)
    return flight.tick(roll=roll, pitch=pitch, rates=body)[:2]


@pytest.mark.parametrize("roll", [0.0, 0.7, -0.7, 1.3])
@pytest.mark.parametrize("pitch", [-0.55, -0.7])
def test_each_loop_brakes_the_rate_of_its_own_angle_only(roll, pitch):
    """On a rolled hull a turn shows in q and r, and so does a change of pitch."""
    still = commands(roll, pitch)
    turning = commands(roll, pitch, heading_rate=0.004)
    pitching = commands(roll, pitch, pitch_rate=0.004)
    rolling = commands(roll, pitch, roll_rate=0.1)
    assert turning - still == pytest.approx([0.0, -KD * 0.004], abs=1e-12)
    assert pitching - still == pytest.approx([0.5 * 0.004, 0.0], abs=1e-12)
    assert rolling == pytest.approx(still, abs=1e-12)


def test_the_heading_rate_stays_finite_where_the_nose_points_down():
    """Below a cosine of 0.2 (78 deg of pitch) the quotient r / cos(pitch) grows no further."""
    flight = Flight(SawTooth(max_depth_m=100, heading_deg=0, max_rotation_deg=80, yos=1))
    command = flight.tick(pitch=-math.pi / 2, rates=(0.0, 0.0, 0.004))[1]
    assert command == pytest.approx(-KD * 0.004 / 0.2)


def test_every_segment_begins_with_an_empty_heading_integral():
    leg = {"max_depth_m": 100, "min_depth_m": 5, "pitch_deg": 30}
    flight = Flight(
        SawTooth(heading_deg=10, duration_s=20, **leg), SawTooth(heading_deg=50, yos=1, **leg)
    )
    error = math.radians(1.0)
    for tick in range(40):
        rotation = flight.tick(heading=math.radians(9.0))[1]
        assert rotation == pytest.approx(KP * error + KI * error * TICK * tick)
    assert flight.tick(heading=math.radians(49.0))[1] == pytest.approx(KP * error)
    assert flight.state[g.SEGMENT] == 1


def test_errors_beyond_two_degrees_are_integrated_as_two():
    flight = Flight(SawTooth(max_depth_m=100, heading_deg=0, yos=1))
    error = math.radians(-5.0)
    for tick in range(20):
        rotation = flight.tick(heading=math.radians(5.0))[1]
        assert rotation == pytest.approx(KP * error - KI * math.radians(2.0) * TICK * tick)


def climbing_at(depth, following):
    """Phase of the segment that follows a dive turned at 60 m, entered on the way up."""
    first = SawTooth(max_depth_m=60, min_depth_m=5, pitch_deg=30, duration_s=2.0)
    flight = Flight(first, following)
    for here in (50.0, 60.0, 58.0, 55.0):
        flight.tick(here)
    assert flight.state[g.PHASE] == g.CLIMB
    flight.tick(depth)
    assert flight.state[g.SEGMENT] == 1
    return flight.state[g.PHASE], flight.state[g.YO_COUNT]


@pytest.mark.parametrize("kind", [SawTooth, Spiral])
def test_a_climb_goes_on_only_below_the_upper_limit_of_the_next_segment(kind):
    turn = {"rotation_deg": 30} if kind is Spiral else {}
    following = kind(max_depth_m=100, min_depth_m=40, yos=1, **turn)
    assert climbing_at(41.0, following) == (g.CLIMB, -0.5)
    assert climbing_at(40.0, following) == (g.DIVE, 0.0)  # at its upper limit: it has to dive
    assert climbing_at(30.0, following) == (g.DIVE, 0.0)


def test_a_dive_stays_a_dive_in_the_next_segment():
    flight = Flight(
        SawTooth(max_depth_m=60, duration_s=2.0), SawTooth(max_depth_m=100, min_depth_m=20, yos=1)
    )
    for here in (10.0, 20.0, 30.0, 40.0, 50.0):
        flight.tick(here)
    assert flight.state[g.SEGMENT] == 1
    assert flight.state[g.PHASE] == g.DIVE
    assert flight.state[g.YO_COUNT] == 0.0


def rotation_in_a_climb(turns, *, rising, hand_over=60, by_roll=1.0):
    """Rotation commanded at an error of 10 deg after some seconds of a climb at a depth rate."""
    flight = Flight(SawTooth(max_depth_m=100, min_depth_m=10, heading_deg=0, pitch_deg=30, yos=2))
    flight.table[:, g.DIVE_TURN], flight.table[:, g.CLIMB_TURN] = turns
    flight.gains[g.TURNS_BY_ROLL] = by_roll
    flight.tick(depth=101.0)
    for k in range(hand_over):
        depth = 101.0 - rising * k * TICK
        rotation = flight.tick(depth, heading=math.radians(-10.0))[1]
    assert flight.state[g.PHASE] == g.CLIMB
    return rotation


def test_a_battery_that_turns_it_otherwise_in_climbs_waits_for_the_climb():
    """A hull that still falls would be turned away from its heading by the climb's roll."""
    assert rotation_in_a_climb((1.0, -1.0), rising=-0.05) == 0.0
    assert rotation_in_a_climb((1.0, -1.0), rising=0.01) == 0.0
    assert rotation_in_a_climb((1.0, -1.0), rising=0.1) < -0.3
    # a rudder turns it alike in both, and one that is in reversed flow waits for nothing
    assert rotation_in_a_climb((1.0, 1.0), rising=-0.05) > 0.3
    assert rotation_in_a_climb((1.0, -1.0), rising=-0.05, by_roll=0.0) < -0.3


def test_a_battery_turns_a_vehicle_by_its_roll_and_a_rudder_does_not():
    for name, by_roll in (
        ("seaglider", 1.0),
        ("glider", 1.0),
        ("slocum-200", 0.0),
        ("tethys", 0.0),
    ):
        _, gains = load_mission_for(load_vehicle(name)).compile(load_vehicle(name))
        assert gains[g.TURNS_BY_ROLL] == by_roll
