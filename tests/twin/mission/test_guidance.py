"""Guidance: its step on its own, and flying the Sea-Wing with the gains of its file."""

import itertools
import math

import numpy as np
import pytest

from twin.errors import InputError
from twin.mission import Hold, Mission, SawTooth, Spiral, Surface, load_mission, steady_glide
from twin.mission import mission_file as g
from twin.mission.controller import Command, MissionController, Observation
from twin.mission.guidance import guidance_step, new_state
from twin.mission.shipped_missions import load_mission_for
from twin.physics.simulation import Scenario, simulate
from twin.physics.start import Start
from twin.vehicle.vehicle import load_vehicle

KP, KI, KD = 2.0, 0.01, 30.0
TICK = 0.5
VEHICLE = load_vehicle("glider").replace(
    pitch_pid=(0.1, 0.01, 0.5), heading_pid=(KP, KI, KD), control_period=TICK
)
PARTS = VEHICLE.part_names


class Scripted:
    """Feeds guidance a vehicle whose state the test sets by hand."""

    def __init__(self, *segments, **mission):
        plan = Mission(segments=segments, **mission)
        self.table, self.gains = plan.compile(VEHICLE)
        self.table[:, [g.DIVE_TURN, g.CLIMB_TURN]] = 1.0  # as if it turned alike in all ways
        self.state = new_state()
        self.command = np.zeros(3)
        self.time = 0.0

    def tick(self, depth=50.0, roll=0.0, pitch=0.0, heading=0.0, rates=(0.0, 0.0, 0.0)):
        """One tick; returns shift, rotation, pump."""
        guidance_step(
            self.table, self.gains, self.state, self.time, depth, roll, pitch, heading, *rates,
            self.command,
        )  # fmt: skip
        self.time += TICK
        return self.command.copy()

    def trim(self, which, segment=0):
        """One of a row's three commands: shift, rotation, pump."""
        return self.table[segment, g.SEGMENT_COLUMNS :].reshape(3, 3)[which]

    def glide(self, *depths):
        """Ticks at each depth; returns the phases."""
        phases = []
        for depth in depths:
            self.tick(depth)
            phases.append(self.state[g.PHASE])
        return phases

    def __getitem__(self, slot):
        return self.state[slot]


def test_saw_tooth_turns_at_its_depths_and_counts_yos():
    run = Scripted(
        SawTooth(max_depth_m=100, min_depth_m=10, yos=2), Hold(duration_s=100), at_end="hold"
    )
    assert run.glide(0, 5, 99.9, 100) == [g.DIVE, g.DIVE, g.DIVE, g.CLIMB]
    assert run[g.YO_COUNT] == 0.5
    assert run.glide(101, 60, 10.1, 10) == [g.CLIMB, g.CLIMB, g.CLIMB, g.DIVE]
    assert run[g.YO_COUNT] == 1.0
    assert run.glide(8, 100) == [g.DIVE, g.CLIMB]
    assert run[g.SEGMENT] == 0
    assert run.glide(10) == [g.HOLDING]
    assert run[g.SEGMENT] == 1


def test_pump_and_setpoint_follow_the_phase():
    run = Scripted(
        SawTooth(max_depth_m=100, pitch_deg=25, climb_pitch_deg=40, climb_net_mass_kg=0.41, yos=1)
    )
    assert run.tick(20)[2] == pytest.approx(-0.3 / 1025e-6)
    assert run[g.PITCH_SETPOINT] == pytest.approx(math.radians(-25))
    assert run.tick(100)[2] == pytest.approx(400)
    assert run[g.PITCH_SETPOINT] == pytest.approx(math.radians(40))


def test_next_segment_goes_on_in_the_same_direction():
    run = Scripted(
        SawTooth(max_depth_m=100, min_depth_m=5, duration_s=2.0),
        Spiral(max_depth_m=80, min_depth_m=20, rotation_deg=30, yos=1),
        at_end="hold",
    )
    assert run.glide(50, 100, 90) == [g.DIVE, g.CLIMB, g.CLIMB]
    assert run.glide(79, 70) == [g.CLIMB, g.CLIMB]
    assert run[g.SEGMENT] == 1
    assert run[g.YO_COUNT] == -0.5
    assert run.glide(20) == [g.DIVE]
    assert run[g.YO_COUNT] == 0.0
    run.glide(80, 20)
    assert run[g.YO_COUNT] == 1.0
    assert run[g.DONE] == 1.0


def test_a_segment_entered_below_its_depth_climbs_first():
    run = Scripted(Hold(duration_s=0.5), SawTooth(max_depth_m=80, yos=1))
    assert run.glide(120, 120) == [g.HOLDING, g.CLIMB]


@pytest.mark.parametrize(
    ("before", "inside", "past"), [(20.0, 59.9, 60.0), (90.0, 60.1, 60.0)], ids=["down", "up"]
)
def test_until_depth_is_a_limit_from_either_side(before, inside, past):
    run = Scripted(Hold(until_depth_m=60), Hold(duration_s=9), duration_s=100)
    run.glide(before, inside)
    assert run[g.SEGMENT] == 0
    run.glide(past)
    assert run[g.SEGMENT] == 1


def test_time_limit_counts_from_the_segments_own_start():
    run = Scripted(Hold(duration_s=2), Hold(duration_s=3, shift_m=0.01))
    segments = [run.tick()[0] for _ in range(10)]
    assert segments == [0.0] * 4 + [0.01] * 6


def test_hold_commands_exactly_its_positions():
    run = Scripted(Hold(shift_m=-0.02, rotation_deg=30, net_mass_kg=0.205, duration_s=10))
    for pitch in (0.0, 0.5, -0.9):
        command = run.tick(pitch=pitch, rates=(0.1, 0.2, 0.3))
        np.testing.assert_allclose(command, [-0.02, math.pi / 6, -200])
    assert math.isnan(run[g.PITCH_SETPOINT])
    assert math.isnan(run[g.HEADING_SETPOINT])


def test_surface_interval_counts_from_the_arrival():
    run = Scripted(Surface(duration_s=2), SawTooth(max_depth_m=50, yos=1))
    assert run.glide(30, 20, 10, 1.6) == [g.SURFACING] * 4
    assert run.command[2] == pytest.approx(VEHICLE.actuator_max[2])
    assert run.glide(1.4, 0.3, 0.3, 1.8) == [g.AT_SURFACE] * 4  # washed over: still counting
    assert run.command[0] == VEHICLE.actuator_max[0]
    assert run.command[1] == 0.0
    assert run.glide(0.3) == [g.DIVE]


def test_end_at_the_surface_is_done_on_arrival():
    run = Scripted(Hold(duration_s=1))
    assert run.glide(40, 40, 40) == [g.HOLDING, g.HOLDING, g.SURFACING]
    assert run[g.SEGMENT] == 1
    assert run[g.DONE] == 0.0
    assert run.glide(5, 1) == [g.SURFACING, g.AT_SURFACE]
    assert run[g.DONE] == 1.0
    run.time += 1e6
    assert run.glide(0.5) == [g.AT_SURFACE]


def test_end_holding_flies_the_last_segment_on():
    run = Scripted(SawTooth(max_depth_m=50, yos=0.5), at_end="hold")
    assert run.glide(30, 50) == [g.DIVE, g.CLIMB]
    assert run[g.DONE] == 1.0
    assert run.glide(5, 50, 5) == [g.DIVE, g.CLIMB, g.DIVE]
    assert run[g.SEGMENT] == 0


@pytest.mark.parametrize("at_end", ["surface", "hold"])
def test_too_deep_aborts_to_the_surface_for_good(at_end):
    run = Scripted(
        Hold(net_mass_kg=0.5, duration_s=1e4), SawTooth(max_depth_m=50, yos=1),
        max_depth_m=60, at_end=at_end,
    )  # fmt: skip
    assert run.glide(59, 60) == [g.HOLDING, g.HOLDING]
    assert run.glide(60.1, 61, 40, 20) == [g.SURFACING] * 4
    assert run.command[2] == pytest.approx(VEHICLE.actuator_max[2])
    assert run[g.ABORTED] == 1.0
    assert run[g.SEGMENT] == 2
    assert run.glide(1) == [g.AT_SURFACE]
    assert run[g.DONE] == 1.0


def test_pitch_loop_is_feedforward_plus_pid():
    run = Scripted(SawTooth(max_depth_m=100, pitch_deg=35, yos=1))
    trim = run.trim(g.DIVE_COMMAND)[0]
    setpoint = math.radians(-35)
    assert run.tick(pitch=setpoint)[0] == pytest.approx(trim)
    # nose 0.02 rad too high: mass forward; nose falling: mass held back
    assert run.tick(pitch=setpoint + 0.02)[0] == pytest.approx(trim + 0.1 * 0.02)
    integral = 0.01 * 0.02 * 0.5
    pitching = run.tick(pitch=setpoint, rates=(0.0, -0.004, 0.0))[0]
    assert pitching == pytest.approx(trim + integral - 0.5 * 0.004)


def test_integral_waits_while_the_battery_is_at_its_end():
    run = Scripted(SawTooth(max_depth_m=100, pitch_deg=35, yos=1))
    for _ in range(400):
        assert run.tick(pitch=math.radians(60))[0] == VEHICLE.actuator_max[0]
    assert run[g.DIVE_INTEGRAL] == 0.0
    assert run.tick(pitch=math.radians(-35))[0] == pytest.approx(run.trim(g.DIVE_COMMAND)[0])


def test_dive_and_climb_keep_their_own_integrals():
    run = Scripted(SawTooth(max_depth_m=100, pitch_deg=35, yos=9))
    for _ in range(20):
        run.tick(pitch=math.radians(-34))
    dive = run[g.DIVE_INTEGRAL]
    assert dive == pytest.approx(-20 * 0.5 * math.radians(1))
    for _ in range(20):
        run.tick(100.0 if run[g.PHASE] == g.DIVE else 60.0, pitch=math.radians(36))
    assert run[g.DIVE_INTEGRAL] == dive
    assert run[g.CLIMB_INTEGRAL] == pytest.approx(-20 * 0.5 * math.radians(1))


@pytest.mark.parametrize("phase_depth", [20.0, 100.0], ids=["dive", "climb"])
@pytest.mark.parametrize(
    ("heading", "setpoint", "error"),
    [(10, 20, 10), (350, 5, 15), (5, 350, -15), (200, 30, -170), (0, 179, 179), (90, 90, 0)],
)
def test_heading_error_takes_the_short_way_in_dive_and_climb(phase_depth, heading, setpoint, error):
    run = Scripted(SawTooth(max_depth_m=100, heading_deg=setpoint, max_rotation_deg=80, yos=1))
    rotation = run.tick(phase_depth, heading=math.radians(heading))[1]
    wanted = min(max(2.0 * math.radians(error), -math.radians(80)), math.radians(80))
    assert rotation == pytest.approx(wanted, abs=1e-12)


def test_heading_is_held_when_none_is_given():
    run = Scripted(SawTooth(max_depth_m=100, yos=1))
    assert run.tick(heading=1.2)[1] == 0.0
    assert run.tick(heading=1.1)[1] == pytest.approx(0.2)
    assert run[g.HEADING_SETPOINT] == 1.2


def test_spiral_rotation_by_phase_and_no_heading_setpoint():
    run = Scripted(Spiral(max_depth_m=100, rotation_deg=40, climb_rotation_deg=-20, yos=1))
    assert run.tick(50, heading=1.0)[1] == pytest.approx(math.radians(40))
    assert math.isnan(run[g.HEADING_SETPOINT])
    assert run.tick(100, heading=2.0)[1] == pytest.approx(math.radians(-20))


def test_same_inputs_give_the_same_bits():
    rng = np.random.default_rng(3)
    script = rng.uniform(-0.3, 0.3, (200, 6)) + np.array([0, 0, 3, 0, 0, 0])
    commands = []
    for _ in range(2):
        run = Scripted(SawTooth(max_depth_m=100, heading_deg=150, yos=3))
        depths = 50 + 55 * np.sin(np.linspace(0, 20, len(script)))
        commands.append(
            [run.tick(d, *row[:3], rates=row[3:]) for d, row in zip(depths, script, strict=True)]
        )
    np.testing.assert_array_equal(commands[0], commands[1])


def observation(**values):
    fields = {**dict.fromkeys(Observation.__slots__, 0.0), "parts": dict.fromkeys(PARTS, 0.0)}
    return Observation(**{**fields, **values})


def test_mission_controller_is_the_same_guidance():
    mission = Mission(segments=[SawTooth(max_depth_m=100, heading_deg=40, yos=0.5)])
    controller = MissionController(mission, VEHICLE)
    run = Scripted(SawTooth(max_depth_m=100, heading_deg=40, yos=0.5))
    for tick, depth in enumerate([10.0, 50.0, 100.0, 60.0, 1.0, 1.0]):
        command = controller(observation(time=0.5 * tick, depth=depth, pitch=-0.5, heading=0.3))
        np.testing.assert_array_equal(command.as_array(VEHICLE), run.tick(depth, 0.0, -0.5, 0.3))
    assert controller.done
    assert not controller.aborted
    assert controller.segment == 1


def test_command_refuses_what_is_not_a_number():
    with pytest.raises(InputError, match="command: rotation = nan must be a finite number"):
        Command(rotation=math.nan)
    assert Command(shift=0.01, pump=-3).as_array(VEHICLE).tolist() == [0.01, 0.0, -3.0]


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
    run = Scripted(SawTooth(max_depth_m=100, heading_deg=0, pitch_deg=35, yos=1))
    body = euler_rates_to_body(roll, pitch, **rates)
    return run.tick(roll=roll, pitch=pitch, rates=body)[:2]


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
    run = Scripted(SawTooth(max_depth_m=100, heading_deg=0, max_rotation_deg=80, yos=1))
    command = run.tick(pitch=-math.pi / 2, rates=(0.0, 0.0, 0.004))[1]
    assert command == pytest.approx(-KD * 0.004 / 0.2)


def test_every_segment_begins_with_an_empty_heading_integral():
    leg = {"max_depth_m": 100, "min_depth_m": 5, "pitch_deg": 30}
    run = Scripted(
        SawTooth(heading_deg=10, duration_s=20, **leg), SawTooth(heading_deg=50, yos=1, **leg)
    )
    error = math.radians(1.0)
    for tick in range(40):
        rotation = run.tick(heading=math.radians(9.0))[1]
        assert rotation == pytest.approx(KP * error + KI * error * TICK * tick)
    assert run.tick(heading=math.radians(49.0))[1] == pytest.approx(KP * error)
    assert run[g.SEGMENT] == 1


def test_errors_beyond_two_degrees_are_integrated_as_two():
    run = Scripted(SawTooth(max_depth_m=100, heading_deg=0, yos=1))
    error = math.radians(-5.0)
    for tick in range(20):
        rotation = run.tick(heading=math.radians(5.0))[1]
        assert rotation == pytest.approx(KP * error - KI * math.radians(2.0) * TICK * tick)


def climbing_at(depth, following):
    """Phase of the segment that follows a dive turned at 60 m, entered on the way up."""
    first = SawTooth(max_depth_m=60, min_depth_m=5, pitch_deg=30, duration_s=2.0)
    run = Scripted(first, following)
    for here in (50.0, 60.0, 58.0, 55.0):
        run.tick(here)
    assert run[g.PHASE] == g.CLIMB
    run.tick(depth)
    assert run[g.SEGMENT] == 1
    return run[g.PHASE], run[g.YO_COUNT]


@pytest.mark.parametrize("kind", [SawTooth, Spiral])
def test_a_climb_goes_on_only_below_the_upper_limit_of_the_next_segment(kind):
    turn = {"rotation_deg": 30} if kind is Spiral else {}
    following = kind(max_depth_m=100, min_depth_m=40, yos=1, **turn)
    assert climbing_at(41.0, following) == (g.CLIMB, -0.5)
    assert climbing_at(40.0, following) == (g.DIVE, 0.0)  # at its upper limit: it has to dive
    assert climbing_at(30.0, following) == (g.DIVE, 0.0)


def test_a_dive_stays_a_dive_in_the_next_segment():
    run = Scripted(
        SawTooth(max_depth_m=60, duration_s=2.0), SawTooth(max_depth_m=100, min_depth_m=20, yos=1)
    )
    for here in (10.0, 20.0, 30.0, 40.0, 50.0):
        run.tick(here)
    assert run[g.SEGMENT] == 1
    assert run[g.PHASE] == g.DIVE
    assert run[g.YO_COUNT] == 0.0


def rotation_in_a_climb(turns, *, rising, hand_over=60, by_roll=1.0):
    """Rotation commanded at an error of 10 deg after some seconds of a climb at a depth rate."""
    run = Scripted(SawTooth(max_depth_m=100, min_depth_m=10, heading_deg=0, pitch_deg=30, yos=2))
    run.table[:, g.DIVE_TURN], run.table[:, g.CLIMB_TURN] = turns
    run.gains[g.TURNS_BY_ROLL] = by_roll
    run.tick(depth=101.0)
    for k in range(hand_over):
        depth = 101.0 - rising * k * TICK
        rotation = run.tick(depth, heading=math.radians(-10.0))[1]
    assert run[g.PHASE] == g.CLIMB
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


def test_half_a_turn_stays_on_its_side():
    """An error of 180 deg whose sign a yaw changes does not throw the battery to and fro."""
    run = Scripted(SawTooth(max_depth_m=100, heading_deg=180.0, yos=1))
    headings = np.radians([1.0, 0.5, 359.5, 359.0, 0.2, 358.0])
    rotations = [run.tick(pitch=-0.5, heading=heading)[1] for heading in headings]
    assert len({math.copysign(1.0, rotation) for rotation in rotations}) == 1


# --- in the native plant, with the gains of the file ----------------------------------------------


SEAWING = load_vehicle("glider")


def wrapped(degrees):
    return (np.asarray(degrees) + 180.0) % 360.0 - 180.0


def fly(*segments, start=None, **mission):
    return simulate(
        Scenario(vehicle=SEAWING, mission=Mission(segments=segments, **mission), start=start)
    )


def legs(trajectory):
    """Slices of constant commanded pitch."""
    pitch = trajectory["commanded_pitch"]
    changes = np.flatnonzero(np.diff(pitch) != 0) + 1
    bounds = [0, *changes, len(pitch)]
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]


def gliding(direction, depth):
    """A start on a steady 35 deg glide: direction +1 dives, -1 climbs."""
    pitch = -direction * math.radians(35)
    glide = steady_glide(SEAWING, pitch, 0.3 * direction)
    surge = glide.speed * math.cos(glide.angle_of_attack)
    heave = glide.speed * math.sin(glide.angle_of_attack)
    pump = SEAWING.pump_for_net_mass(0.3 * direction)
    return Start(
        depth=depth, pitch=pitch, v_rel=(surge, 0.0, heave), actuators=(glide.shift, 0.0, pump)
    )


@pytest.fixture(scope="module")
def saw_tooth():
    return fly(
        SawTooth(max_depth_m=100, min_depth_m=10, pitch_deg=35, heading_deg=0, yos=3),
        Surface(duration_s=60),
        name="saw",
        duration_s=2600,
    )


def test_pitch_settles_within_a_minute_and_stays_within_half_a_degree(saw_tooth):
    settle = round(60 / 0.5)
    flown = [leg for leg in legs(saw_tooth) if leg.stop - leg.start > 2 * settle][:6]
    assert len(flown) == 6
    for leg in flown:
        error = (saw_tooth["true_pitch"] - saw_tooth["commanded_pitch"])[leg]
        assert np.abs(error[settle:]).max() < 0.5


def test_saw_tooth_overshoots_its_depths_by_little_and_counts(saw_tooth):
    segment, depth = saw_tooth["commanded_segment"], saw_tooth["true_depth"]
    first = segment == 0
    assert depth.max() < 103
    after_first_dive = np.flatnonzero(depth > 50)[0]
    assert depth[after_first_dive : np.flatnonzero(first)[-1]].min() > 7
    crossings = np.flatnonzero(np.diff((depth[first] > 55).astype(int)) != 0)
    assert len(crossings) == 2 * 3
    assert segment[-1] == 2
    assert depth[-1] < 0.6


@pytest.mark.parametrize("turn_deg", [60, -60])
@pytest.mark.parametrize(("direction", "depth"), [(1, 50.0), (-1, 900.0)], ids=["dive", "climb"])
def test_heading_step_settles_without_a_limit_cycle(direction, depth, turn_deg):
    run = fly(
        SawTooth(max_depth_m=800, min_depth_m=20, heading_deg=turn_deg),
        start=gliding(direction, depth),
        duration_s=1200,
    )
    error = wrapped(run["true_heading"] - turn_deg)
    assert np.abs(error[0]) == pytest.approx(60)
    assert np.abs(error[run.time > 400]).max() < 1.0
    late = run.time > 900
    assert np.ptp(run["commanded_rotation"][late]) < 0.3
    assert np.ptp(run["true_roll"][late]) < 0.3
    pitch_error = (run["true_pitch"] - run["commanded_pitch"])[run.time > 60]
    assert np.abs(pitch_error).max() < 1.0


def test_a_turn_between_legs_takes_longer_than_one_in_a_long_glide():
    """The inflections disturb it."""
    turn = 60
    first, second = (
        SawTooth(max_depth_m=100, min_depth_m=10, pitch_deg=35, heading_deg=h, yos=3)
        for h in (0, turn)
    )
    run = fly(first, second, name="turn")
    inside = run["commanded_segment"] == 1
    begun = np.flatnonzero(inside)[0]
    time = run.time - run.time[begun]
    off = np.abs(wrapped(run["true_heading"] - turn)) > 1.0
    assert time[inside & ~off].min() < 300
    assert 900 < time[inside & off].max() < 1020
    worst = []
    for leg in legs(run):
        if leg.stop - leg.start > 240 and inside[leg].all():
            error = (run["true_pitch"] - run["commanded_pitch"])[leg]
            worst.append(np.abs(error[120:]).max())
    assert 0.5 < worst[0] < 0.9
    assert max(worst[1:]) < 0.5


@pytest.mark.parametrize("rotation_deg", [35, -35])
def test_spiral_turns_to_the_side_of_its_rotation_both_ways(rotation_deg):
    run = fly(
        Spiral(max_depth_m=150, rotation_deg=rotation_deg), start=gliding(1, 50), duration_s=1000
    )
    heading = np.unwrap(np.radians(run["true_heading"]))
    rate = np.diff(heading) / 0.5
    up = run["commanded_pitch"][1:] > 0
    for way in (up, ~up):
        settled = np.flatnonzero(way)[200:]
        assert len(settled) > 100
        assert (np.sign(rate[settled]) == np.sign(rotation_deg)).all()
    error = (run["true_pitch"] - run["commanded_pitch"])[legs(run)[-1]]
    assert np.abs(error[240:]).max() < 0.5


def test_errors_of_the_vehicle_are_trimmed_away():
    off = SEAWING.replace(
        battery={"neutral_x": SEAWING.battery.neutral_x + 1e-3},
        static_cg=SEAWING.static_cg + np.array([0.0, 2e-4, 0.0]),
    )
    mission = Mission(segments=[SawTooth(max_depth_m=500, heading_deg=20)], duration_s=1100)
    run = simulate(Scenario(vehicle=off, mission=mission))
    late = run.time > 900
    assert np.abs(run["true_pitch"] - run["commanded_pitch"])[late].max() < 0.1
    assert np.abs(wrapped(run["true_heading"] - 20))[late].max() < 0.3


def test_mission_controller_flies_as_the_native_guidance_does():
    mission = Mission(segments=[SawTooth(max_depth_m=40, heading_deg=50)], duration_s=400)
    scenario = Scenario(vehicle=SEAWING, mission=mission)
    native = simulate(scenario)
    python = simulate(
        Scenario(vehicle=SEAWING, duration=400), controller=MissionController(mission, SEAWING)
    )
    for name in ("true_depth", "true_pitch", "true_heading", "true_shift", "true_rotation"):
        np.testing.assert_allclose(python[name], native[name], atol=1e-6, err_msg=name)


def test_shipped_field_mission_surfaces_three_times():
    mission = load_mission("field")
    limit = mission.time_limit_s(SEAWING)
    run = simulate(Scenario(vehicle=SEAWING, mission=mission, duration=limit))
    segment = run["commanded_segment"]
    flown = run.time[np.flatnonzero(segment == len(mission.segments))[0]]
    assert flown < limit
    at_surface = run["true_depth"] < 0.6
    for index, interval in ((0, 180), (2, 300), (4, 300)):
        inside = segment == index
        assert 0.5 * np.count_nonzero(inside & at_surface) == pytest.approx(interval, rel=0.1)
        # lying still, tail up
        end = np.flatnonzero(inside)[-1]
        assert run["true_pitch"][end] < -10
        assert abs(run["true_surge"][end]) < 0.1
