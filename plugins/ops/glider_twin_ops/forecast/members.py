"""Members: the scenarios that a forecast flies, each with its own vehicle, water and compass.

Flights: members flown side by side on all cores, each told as its track and its surfacings.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
import os
import warnings
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.draws import (
    INTERVAL,
    WaterDraws,
    calibration_deviation,
    draw_field_error,
    draw_models,
    draw_water,
    draw_ways,
    scaled_speed,
)
from glider_twin_ops.forecast.known import Known
from glider_twin_ops.forecast.request import Request, believing, longest_dive
from glider_twin_ops.forecast.surfacing_schedule import SHORTEST, Delays
from glider_twin_ops.forecast.way_pool import GUIDED, WayPool
from twin import Scenario, Trajectory, Vehicle, scenario_of
from twin.checks import state_at
from twin.errors import InaccurateStep, SimulationUnstable
from twin.fossen import LANES
from twin.identify import SPEED, draw_vehicles, known_compass
from twin.mission import SURFACED_MARGIN_M, Mission, Waypoint
from twin.navigation import chi_squared
from twin.navigation.current import CurrentParameters
from twin.numbers import Array
from twin.physics import Fleet, file_timestep, fly_in_lanes, quiet_mujoco, stiffness_of
from twin.records.coordinates import unix_seconds
from twin.vehicle import ENERGY
from twin.water.current import Current, Series, sample_track

SAMPLE_PERIOD = 10.0
"""[s] between two samples of a member: a surfacing is known to 3 m at 0.3 m/s"""
OBEYS = 0.2
"""Weight of the way to its waypoints below which these hardly count"""
STEPS, SETTLED = 2.0, 0.75
"""Times the vehicle file's physics step: in six hours the end moves by less than 5 m, in lanes by
about 1 m (`python -m benchmarks.forecast_speed`). Where such a step times the vehicle's fastest
rate is above `SETTLED` the file's own is flown: members differ by a fifth, and at 1 they would be
unstable"""
STRAIGHT = 5e5
"""[m] farther than a glider goes in a forecast"""
FASTEST = 3.0
"""[m/s] at which a drawn current is cut off: faster ones are no draws of a sea's current"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Members:
    """What is flown, and from what it was drawn; the first is the mean of what is known."""

    scenarios: tuple[Scenario, ...]
    spread: dict[str, str]
    """What was drawn, in words."""
    delays: Delays | None = None
    """By what they come up later than they fly; None where no log tells it."""
    drift: Array | None = None
    """[m/s] north and east of each at the surface, (member, 2)."""
    earliest: float = 0.0
    """[s] after the start: the log has the vehicle under water until then."""

    def delayed(self, number: int, flight: MemberFlight) -> MemberFlight:
        """The flight of a member, as late as was drawn for it, and as its log has it."""
        if self.delays is not None and self.drift is not None:
            stays, late = self.delays.stays[number], float(self.delays.late[number])
            flight = flight.delayed(stays, late, self.drift[number])
        return flight.not_before(self.earliest)


def members_of(request: Request, known: Known) -> Members:
    """Draw the members.

    Raises:
      CurrentError, MissionError, VehicleError: the field, the mission or the vehicle does not do.
    """
    rng = np.random.default_rng(request.seed)
    duration, count = request.flown, request.members
    water = draw_water(known.filter_, duration, count, rng, longest_dive(request.mission))
    water, deviation = draw_models(water, known.pool, rng)
    spread = {"current": f"{known.source}: known to {deviation:.2f} m/s each way"}
    if request.field is not None:
        water, spread["current"] = _with_field(request, known, water, rng)
    told = known.by_model and known.legs > 0
    vehicles, drawn = draw_vehicles(request.vehicle, count, rng, speed=not told)
    spread["vehicle"] = f"identified: {', '.join(drawn)}" if drawn else "not identified"
    scale, source = water.speed_scale, "by the fixes"
    deviation, _ = calibration_deviation(known.filter_)
    if not told:
        deviation = CurrentParameters.speed_scale
        scale, source = _normal(rng, count, deviation), "assumed"
        if known.ways is not None and (slower := _beside_log(request, known.ways)) is not None:
            scale, source = scale + slower, "as recent dives"
    if told or not set(drawn) & set(SPEED):
        vehicles = [
            scaled_speed(one, float(part)) for one, part in zip(vehicles, scale, strict=True)
        ]
        spread["speed"] = f"{100.0 * scale[0]:+.1f} %, +-{100.0 * deviation:.1f} %, {source}"
    compass, deviation, source = _compass(request, known, water, rng)
    spread["compass"] = (
        f"{math.degrees(compass[0]):+.1f} degree, +-{math.degrees(deviation):.1f} degree, {source}"
    )
    mission = believing(request.mission, known.last_current)
    nominal = _scenario(request, mission)
    if known.ways is not None and isinstance(mission.segments[0], Waypoint):
        off, spread["way"] = _ways(request, mission, known.ways, rng)
        course = water.current + off[:, None, :]
        wider = math.sqrt(known.reach / chi_squared(0.9))
        water = dataclasses.replace(water, current=course[:1] + wider * (course - course[:1]))
        spread["spread"] = (
            f"way and current {wider:.2f} times as wide, as surfacings so far were off"
        )
    scenarios = tuple(
        dataclasses.replace(
            nominal,
            vehicle=vehicle,
            believed=request.vehicle,
            compass_offset=-float(offset),
            current=_current(request.field, course),
        )
        for vehicle, offset, course in zip(vehicles, compass, water.current, strict=True)
    )
    delays = None
    if known.rhythm is not None and known.time is not None:
        dives = math.ceil(duration / SHORTEST) + 1
        waited = unix_seconds(str(request.place.time)) - known.time
        delays = known.rhythm.draw(count, dives, waited, rng)
        spread["times"] = known.rhythm.words
    earliest = 0.0
    if known.last_seen is not None:
        begin = unix_seconds(str(request.place.time))
        earliest = max(known.last_seen.time + known.last_seen.rise - begin, 0.0)
        if earliest > 0.0:
            spread["under water"] = known.last_seen.words
    return Members(
        scenarios=scenarios, spread=spread, delays=delays, drift=water.current[:, 0],
        earliest=earliest,
    )  # fmt: skip


def _beside_log(request: Request, ways: WayPool) -> float | None:
    """[1] level speed of recent dives over the vehicle's, less 1; None where it makes no way."""
    first = request.mission.segments[0]
    if ways.speed is None or not isinstance(first, Waypoint):
        return None
    straight = dataclasses.replace(
        first, targets=({"north_m": STRAIGHT, "east_m": 0.0},), surface_at_target=False
    )
    (flight,) = fly_nominal(request, [dataclasses.replace(request.mission, segments=(straight,))])
    if isinstance(flight, SimulationUnstable) or not len(flight.time):
        return None
    nominal = float(np.hypot(*flight.place[0])) / float(flight.time[0])
    return ways.speed / nominal - 1.0 if nominal > 0.0 else None


def _ways(
    request: Request, mission: Mission, ways: WayPool, rng: np.random.Generator
) -> tuple[Array, str]:
    """Draws of how the vehicle will not go as it is sent, (member, 2) [m/s], and in words."""
    place = request.place
    first = mission.placed(place.latitude_deg, place.longitude_deg).segments[0]
    assert isinstance(first, Waypoint)
    targets = [(one["north_m"], one["east_m"]) for one in first.targets]
    steered = (first.current_north_m_s or 0.0, first.current_east_m_s or 0.0)
    ahead = ways.toward(targets, steered, longest_dive(mission))
    off = draw_ways(ahead, ways.pool.freedom, request.members, rng)
    deviation = math.sqrt(0.5 * float(np.trace(ahead.covariance)))
    said = f"as dives so far went beside how they were sent: {deviation:.2f} m/s each way"
    obeys = float(ahead.weights[ahead.names.index(GUIDED)]) if GUIDED in ahead.names else 0.0
    if obeys < OBEYS:
        most = ahead.names[int(np.argmax(ahead.weights))]
        said += (
            f". Dives so far did not go to the waypoints that they had, but {most} "
            f"({100.0 * float(ahead.weights.max()):.0f} %): the places of this plan hardly move "
            "the forecast. Where it is steered otherwise from now on, forecast without --logs, "
            "with --vehicle and --current"
        )
    return off, said


def _normal(rng: np.random.Generator, count: int, deviation: float) -> Array:
    """Draws about 0, (count,), the first of them 0."""
    draws = deviation * rng.standard_normal(count)
    draws[0] = 0.0
    return draws


def _compass(
    request: Request, known: Known, water: WaterDraws, rng: np.random.Generator
) -> tuple[Array, float, str]:
    """True heading less the compass's [rad], (member,), its deviation, and who says so."""
    identified, deviation = known_compass(request.vehicle)
    _, filtered = calibration_deviation(known.filter_)
    if known.legs:
        # by a flight model, whose compass was corrected: the filter's error is what remained of it
        return (identified if known.by_model else 0.0) + water.compass, filtered, "by the fixes"
    if deviation is not None:
        drawn = _normal(rng, request.members, deviation)
        return identified + drawn, deviation, "identified"
    return water.compass, filtered, "assumed"


def _scenario(request: Request, mission: Mission) -> Scenario:
    """The nominal one; its current is put in later."""
    duration = request.flown
    flown = dataclasses.replace(mission, duration_s=duration)
    place = request.place
    return scenario_of(
        vehicle=request.vehicle,
        mission=flown,
        duration=duration,
        start={
            "latitude": place.latitude_deg,
            "longitude": place.longitude_deg,
            "time": place.time,
            "heading": _first_heading(flown, request),
        },
        current=request.field,
        engine=request.engine,
        timestep=_step(request.vehicle),
        sample_period=SAMPLE_PERIOD,
        density=request.density,
    )


def _step(vehicle: Vehicle) -> float:
    """[s] of the physics, which is explicit in what is not rotary damping."""
    own, stiff = file_timestep(vehicle), stiffness_of(vehicle)
    return own if stiff is not None and STEPS * own * stiff.rest > SETTLED else STEPS * own


def _first_heading(mission: Mission, request: Request) -> float:
    """[rad] toward the first target, so that no turn at the start takes time."""
    placed = mission.placed(request.place.latitude_deg, request.place.longitude_deg)
    targets = getattr(placed.segments[0], "targets", None)
    if not targets:
        return math.radians(mission.start_heading_deg)
    return math.atan2(targets[0]["east_m"], targets[0]["north_m"]) % (2.0 * math.pi)


def _with_field(
    request: Request, known: Known, water: WaterDraws, rng: np.random.Generator
) -> tuple[WaterDraws, str]:
    """The draws of the field's error, and what they are in words."""
    field = _mean_field(request)
    drawn = draw_field_error(
        water, known.filter_, field, request.field_error, rng, told=known.legs > 0
    )
    words = f"field, error {request.field_error:g} m/s"
    return drawn, words + (f", from {known.source}" if known.legs else "")


def _mean_field(request: Request) -> tuple[float, float]:
    """North, east [m/s] at the start, mean over the depths of the first dives."""
    assert request.field is not None
    depths = np.linspace(0.0, max(request.deepest, 1.0), 21)
    rest = np.zeros_like(depths)
    program = request.field.compile(request.flown, request.place)
    north, east = sample_track(program, rest, rest, rest, depths, rest, rest, rest)[:, :2].T
    return float(north.mean()), float(east.mean())


def _current(field: Current | None, course: Array) -> Current:
    cut = np.clip(course, -FASTEST, FASTEST)
    series = Series(interval=INTERVAL, north=tuple(cut[:, 0]), east=tuple(cut[:, 1]))
    return series if field is None else field + series


PER_CORE = {"mujoco": 12, "lanes": 4 * LANES[0]}
"""Members for each core between two looks: enough to keep it busy, few enough to show progress"""
UNDER = 3.0
"""Times the depth that counts as surfaced, beyond which the vehicle has dived"""
FLOATS = 300.0
"""[s] beyond a mission's own stay at the surface, after which it is over"""
THINNED = 30
"""Samples of a track for one point that is kept"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MemberFlight:
    """One member."""

    time: Array
    """[s] since the start of each surfacing, (surfacing,)"""
    place: Array
    """North, east [m] there, (surfacing, 2)"""
    energy: Array
    """[J] taken until then, (surfacing,)"""
    track: Array
    """North, east [m], thinned, (point, 2)"""
    times: Array
    """[s] since the start of its points, (point,)"""
    duration: float
    """[s] of the flight"""
    taken: float
    """[J] in all"""
    end: Array
    """North, east, depth [m] and velocity over ground, NED [m/s], at its end, (6,)"""
    over: bool = False
    """Whether its mission was over with its last surfacing: it floats from then on"""

    def delayed(self, stays: Array, late: float, drift: Array) -> MemberFlight:
        """The same with stays at the surface [s] before its dives, in which it drifts [m/s], and
        with dives that last longer by a part, along their own way; energy is as flown."""
        longer = late * np.append(0.0, self.time)
        farther = late * np.vstack([np.zeros((1, 2)), self.place.reshape(-1, 2)])
        stayed = np.cumsum(stays)
        ended = np.searchsorted(self.time, self.times)  # dives, before a point of the track
        surfaced = np.arange(len(self.time))
        return dataclasses.replace(
            self,
            time=self.time + stayed[surfaced] + longer[1:],
            place=self.place + stayed[surfaced, None] * drift + farther[1:],
            times=np.append(0.0, self.times + stayed[ended] + longer[ended]),
            track=np.vstack(
                [self.track[:1], self.track + stayed[ended, None] * drift + farther[ended]]
            ),
        )

    def not_before(self, earliest: float) -> MemberFlight:
        """The same with its first surfacing no earlier than a time [s]: its first dive lasts so
        much longer, along its own way; energy is as flown."""
        if not len(self.time) or self.time[0] >= earliest:
            return self
        first = float(self.time[0])
        later = earliest - first
        farther = later / first * self.place[0]
        dived = np.clip(self.times / first, 0.0, 1.0)  # how much of the first dive is over
        return dataclasses.replace(
            self,
            time=self.time + later,
            place=self.place + farther,
            times=self.times + dived * later,
            track=self.track + dived[: len(self.track), None] * farther,
        )

    def rates(self) -> tuple[float, float]:
        """[W] and [m/s] over ground until its last surfacing; of the whole flight without one."""
        end, energy = self.duration, self.taken
        if len(self.time):
            end, energy = float(self.time[-1]), float(self.energy[-1])
        before = self.track[self.times <= end]
        return energy / end, float(np.hypot(*np.diff(before, axis=0).T).sum()) / end


def fly(
    scenarios: Sequence[Scenario], *, threads: int = 0
) -> Iterator[list[MemberFlight | SimulationUnstable]]:
    """Fly the first member, then the others in fleets; yields what each fleet found.

    In lanes the first ones fly together, which takes no longer, and are told one after the other.

    Args:
      threads: of a fleet; 0 takes every core.
    """
    cores = threads or os.cpu_count() or 1
    engine = scenarios[0].engine
    first = LANES[0] if engine == "lanes" else 1
    rest = max(len(scenarios) - first, 0)
    fleets = math.ceil(rest / (PER_CORE[engine] * cores))
    ends = [0, *(first + rest * k // fleets for k in range(fleets)), len(scenarios)]
    for a, b in itertools.pairwise(ends):
        found = _flown(scenarios[a:b], threads)
        if a == 0:  # the mean of what is known, at once
            yield found[:1]
            found = found[1:]
        if found:
            yield found


@contextlib.contextmanager
def coarse_steps() -> Iterator[None]:
    """Let steps be inaccurate: a millimetre per second is little beside an unknown current.

    Filters of warnings belong to the process: who flies in several threads enters it before the
    first of them starts and leaves it after the last has ended.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InaccurateStep)
        yield


def _flown(scenarios: Sequence[Scenario], threads: int) -> list[MemberFlight | SimulationUnstable]:
    """One fleet."""
    results: list[Trajectory | SimulationUnstable]
    with quiet_mujoco(), coarse_steps():
        if scenarios[0].engine == "lanes":
            results = fly_in_lanes(scenarios, threads=threads, lean=True)
        else:
            results = Fleet(scenarios, threads=threads).run()
    return [
        result if isinstance(result, SimulationUnstable) else told(result, scenario)
        for result, scenario in zip(results, scenarios, strict=True)
    ]


def fly_nominal(
    request: Request, missions: Sequence[Mission]
) -> list[MemberFlight | SimulationUnstable]:
    """Missions by the request's vehicle in still water, from its start."""
    still = [dataclasses.replace(request, mission=mission, field=None) for mission in missions]
    longest = max(one.flown for one in still)
    scenarios = [_scenario(one, one.mission) for one in still]
    return _flown([dataclasses.replace(one, duration=longest) for one in scenarios], threads=0)


def told(run: Trajectory, scenario: Scenario) -> MemberFlight:
    """The surfacings of a run."""
    vehicle = scenario.vehicle
    depth, afloat = run["true_depth"], 0.5 * vehicle.hull_length + SURFACED_MARGIN_M
    found = surfacings(depth, afloat)
    stays = [getattr(one, "stay_s", 0.0) for one in getattr(scenario.mission, "segments", ())]
    last = int(found[-1]) if len(found) else len(depth) - 1
    floats = run.time[-1] - run.time[last] > max(stays, default=0.0) + FLOATS
    energy = np.sum([run[name] for name in run if name.startswith(ENERGY)], axis=0)
    return MemberFlight(
        time=run.time[found],
        place=run.position[found, :2],
        energy=energy[found],
        track=run.position[::THINNED, :2],
        times=run.time[::THINNED],
        duration=float(run.time[-1]),
        taken=float(energy[-1]),
        end=state_at(run, -1),
        over=bool(floats and depth[last:].max() <= UNDER * afloat),
    )


def surfacings(depth: Array, afloat: float) -> NDArray[np.int64]:
    """Indices of the samples at which a vehicle has come up from a dive.

    Args:
      depth: [m], (time,). afloat: [m] above which it counts as surfaced.
    """
    found, dived = [], False
    for k, below in enumerate(depth.tolist()):
        if below > UNDER * afloat:
            dived = True
        elif dived and below <= afloat:
            found.append(k)
            dived = False
    return np.array(found, dtype=np.int64)
