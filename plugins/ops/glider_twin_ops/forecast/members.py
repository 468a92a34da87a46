"""Members: the scenarios that a forecast flies, each with its own vehicle, water and compass.

Time series of the current and errors of speed and compass are sampled from what is known.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from glider_twin_ops.forecast.expected_dive import (
    BOTH,
    GUIDED,
    SHORTEST,
    STEADY,
    Delays,
    GroundPool,
    WayPool,
)
from glider_twin_ops.forecast.member_flights import MemberFlight, fly_nominal, nominal_scenario
from glider_twin_ops.forecast.pool import FILTER, CurrentPool, Mixture
from glider_twin_ops.forecast.request import Known, Request, longest_dive
from twin import Mission, Scenario, Series, Vehicle, Waypoint
from twin.errors import SimulationUnstable
from twin.identify import SPEED, draw_vehicles, known_compass, normal_draws
from twin.navigation import chi_squared
from twin.navigation.current import (
    CALIBRATION,
    DIVE,
    MODES,
    CurrentFilter,
    CurrentParameters,
    Leg,
    passage,
)
from twin.numbers import Array
from twin.records import unix_seconds
from twin.water.current import Current, sample_track

LARGEST_SCALE, OBEYS = 0.5, 0.2
"""[1] LARGEST_SCALE: limit of a sampled speed's relative error. OBEYS: smallest weight of the model
"to its waypoints"; with less, the forecast warns that the vehicle hardly follows them."""
INTERVAL = 1800.0
"""[s] Interval of a sampled time series: 1/28 of an inertial period at 60 degree"""
FIELD_TIME, STRAIGHT = 86400.0, 5e5
"""FIELD_TIME: [s] correlation time of a forecast field's error, as of weather. STRAIGHT: [m]
distance that no glider covers within a forecast"""
FASTEST = 3.0
"""[m/s] Limit of each component of a sampled current; no sea is faster"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Members:
    """Scenarios of all members with their timing errors; the first member has all mean values."""

    scenarios: tuple[Scenario, ...]
    spread: dict[str, str]
    """Sampled quantities and their standard deviations, in words."""
    delays: Delays | None
    """Surface intervals and changes of duration; None without logs that hold enough of them."""
    drift: Array
    """North, east [m/s] of the drift at the surface, (member, 2)."""
    earliest: float
    """[s] Time after the start until which the log shows the vehicle under water."""

    def delayed(self, number: int, flight: MemberFlight) -> MemberFlight:
        """Flight of a member with its sampled timing errors, not before `earliest`."""
        if self.delays is not None:
            stays, late = self.delays.stays[number], float(self.delays.late[number])
            flight = flight.delayed(stays, late, self.drift[number])
        return flight.not_before(self.earliest)


def members_of(request: Request, known: Known) -> Members:
    """Sample the members of a forecast.

    Raises:
      CurrentError, MissionError, VehicleError: the field, mission or vehicle cannot be used.
    """
    rng = np.random.default_rng(request.seed)
    duration, count = request.flown, request.members
    water = draw_water(known.filter_, duration, count, rng, longest_dive(request.mission))
    water, deviation = draw_models(water, known.pool, rng)
    spread = {"current": f"{known.source}: known to {deviation:.2f} m/s each way"}
    if request.field is not None:
        field = _mean_field(request, request.field)
        error, fixed = request.field_error, known.legs > 0
        water = draw_field_error(water, known.filter_, field, error, rng, told=fixed)
        spread["current"] = f"field, error {error:g} m/s" + f", from {known.source}" * fixed
    told = known.by_model and known.legs > 0
    vehicles, drawn = draw_vehicles(request.vehicle, count, rng, speed=not told)
    spread["vehicle"] = f"identified: {', '.join(drawn)}" if drawn else "not identified"
    scale, source = water.speed_scale, "by the fixes"
    deviation = _calibration(known.filter_)[0]
    if not told:
        deviation = CurrentParameters.speed_scale
        scale, source = deviation * _scattered(rng, count, 1)[:, 0], "assumed"
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
    mission = request.mission
    if known.last_current is not None:
        north, east = known.last_current
        segments = tuple(
            dataclasses.replace(segment, current_north_m_s=north, current_east_m_s=east)
            if isinstance(segment, Waypoint)
            and segment.current == "estimated"
            and segment.current_north_m_s is None
            else segment
            for segment in mission.segments
        )
        mission = dataclasses.replace(mission, segments=segments)
    nominal = nominal_scenario(request, mission)
    if known.ways is not None and isinstance(mission.segments[0], Waypoint):
        ahead, spread["way"] = _ways(request, mission, known.ways)
        off = draw_ways(ahead, known.ways.pool.freedom, request.members, rng)
        course = water.current + off[:, None, :]
        if known.ground is not None:
            course, part = draw_ground(course, ahead.means[0], known.ground, rng)
            spread["ground"] = f"{100.0 * part:.0f} % of the members go {STEADY}"
        wider = math.sqrt(known.reach / chi_squared(0.9))
        water = dataclasses.replace(water, current=course[:1] + wider * (course - course[:1]))
        spread["spread"] = (
            f"way and current {wider:.2f} times as wide, as surfacings so far were off"
        )
    courses = (
        Series(interval=INTERVAL, north=tuple(north), east=tuple(east))
        for north, east in np.clip(water.current, -FASTEST, FASTEST).swapaxes(1, 2)
    )
    scenarios = tuple(
        dataclasses.replace(
            nominal,
            vehicle=vehicle,
            believed=request.vehicle,
            compass_offset=-float(offset),
            current=series if request.field is None else request.field + series,
        )
        for vehicle, offset, series in zip(vehicles, compass, courses, strict=True)
    )
    begin = unix_seconds(str(request.place.time))
    delays, earliest = None, 0.0
    if known.rhythm is not None and known.time is not None:
        dives = math.ceil(duration / SHORTEST) + 1
        delays = known.rhythm.draw(count, dives, begin - known.time, rng)
        spread["times"] = known.rhythm.words
    if known.last_seen is not None:
        earliest = max(known.last_seen.time + known.last_seen.rise - begin, 0.0)
        if earliest > 0.0:
            spread["under water"] = known.last_seen.words
    return Members(
        scenarios=scenarios,
        spread=spread,
        delays=delays,
        drift=water.current[:, 0],
        earliest=earliest,
    )


def _beside_log(request: Request, ways: WayPool) -> float | None:
    """[1] Horizontal speed of recent dives over the flown vehicle's, minus 1; None: unknown."""
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


def _ways(request: Request, mission: Mission, ways: WayPool) -> tuple[Mixture, str]:
    """Forecast of the velocity through the water [m/s] on a mission, and its law in words."""
    place = request.place
    first = mission.placed(place.latitude_deg, place.longitude_deg).segments[0]
    assert isinstance(first, Waypoint)
    targets = [(one["north_m"], one["east_m"]) for one in first.targets]
    steered = (first.current_north_m_s or 0.0, first.current_east_m_s or 0.0)
    ahead = ways.toward(targets, steered, longest_dive(mission))
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
    return ahead, said


def _compass(
    request: Request, known: Known, water: WaterDraws, rng: np.random.Generator
) -> tuple[Array, float, str]:
    """Compass error [rad] (true less measured), (member,), standard deviation, and source."""
    identified, deviation = known_compass(request.vehicle)
    filtered = float(_calibration(known.filter_)[1])
    if known.legs:
        # by a flight model, whose compass was corrected: the filter's error is what remained of it
        return (identified if known.by_model else 0.0) + water.compass, filtered, "by the fixes"
    if deviation is not None:
        drawn = deviation * _scattered(rng, request.members, 1)[:, 0]
        return identified + drawn, deviation, "identified"
    return water.compass, filtered, "assumed"


def _mean_field(request: Request, field: Current) -> tuple[float, float]:
    """North, east [m/s] of a field at the start, mean over the depths of the mission."""
    depths = np.linspace(0.0, max(request.deepest, 1.0), 21)
    rest = np.zeros_like(depths)
    program = field.compile(request.flown, request.place)
    north, east = sample_track(program, rest, rest, rest, depths, rest, rest, rest)[:, :2].T
    return float(north.mean()), float(east.mean())


def scaled_speed(vehicle: Vehicle, scale: float) -> Vehicle:
    """Scale a vehicle's speed by 1 + scale at equal weight: water forces over (1 + scale)^2."""
    factor = 1.0 / (1.0 + min(max(scale, -LARGEST_SCALE), LARGEST_SCALE)) ** 2
    factors = {
        one.name: factor
        for one in vehicle.law.uncertainties()
        if one.unit == "1" and one.certain == 1.0
    }
    return vehicle.replace(law=vehicle.law.scaled(factors))


@dataclasses.dataclass(frozen=True, kw_only=True)
class WaterDraws:
    """Samples of the water by member; the first member has all mean values."""

    current: Array
    """North, east [m/s], (member, time, 2), `INTERVAL` apart"""
    speed_scale: Array
    """[1] Real speed over the model's speed, minus 1, (member,)"""
    compass: Array
    """[rad] True heading minus compass reading, (member,)"""


def draw_water(
    filter_: CurrentFilter, duration: float, count: int, rng: np.random.Generator, dive: float
) -> WaterDraws:
    """Sample time series of the current, and errors of speed and compass, from a filter.

    Args:
      filter_: current filter at the start. duration: [s]. count: members, the mean included.
      dive: [s] interval at which the part of the current that belongs to a dive is sampled anew.
    """
    mean, covariance = _state(filter_)
    states = mean + np.vstack([np.zeros_like(mean), normal_draws(covariance, count - 1, rng)])
    times = np.arange(math.ceil(duration / INTERVAL) + 2)
    modes = states[:, MODES::2] + 1j * states[:, MODES + 1 :: 2]
    gone = passage(filter_.modes, INTERVAL)
    deviation = np.sqrt(filter_.inflation * gone.noise)
    course = np.empty((count, len(times), 2))
    added = states[:, DIVE]
    per_dive = max(1, round(dive / INTERVAL))
    for k in times:
        if k and k % per_dive == 0:
            added = filter_.parameters.dive * _scattered(rng, count, 2)
        total = modes.sum(axis=1)
        course[:, k, 0], course[:, k, 1] = total.real + added[:, 0], total.imag + added[:, 1]
        noise = _scattered(rng, count, 2 * len(deviation))
        modes = gone.kept * modes + deviation * (noise[:, ::2] + 1j * noise[:, 1::2])
    scale, compass = states[:, CALIBRATION].T
    return WaterDraws(current=course, speed_scale=scale, compass=compass)


def draw_models(
    drawn: WaterDraws, pool: CurrentPool, rng: np.random.Generator
) -> tuple[WaterDraws, float]:
    """Assign each member one of a pool's models, sampled by weight.

    Members of the filter keep their sampled currents. Members of another model take its time series
    plus a constant error, Student's t of the model's scale. The first member is the mean of all.

    Args:
      pool: pool that has learned from the dives; its filter is at the start.

    Returns:
      Samples, and standard deviation [m/s] of the current at the start, mean of north and east.
    """
    count, steps, _ = drawn.current.shape
    filter_ = pool.filters[FILTER]
    begins = filter_.time + INTERVAL * np.arange(steps) - 0.5 * INTERVAL
    points = [
        Leg(start=begin, duration=INTERVAL, over_ground=(0.0, 0.0), through_water=None)
        for begin in begins.tolist()
    ]
    courses = {
        name: drawn.current[0]
        if name == FILTER
        else np.array([pool.alone(name, point)[0] for point in points])
        for name in pool.pool.names
    }
    known = [name for name, course in courses.items() if np.isfinite(course).all()]
    part = np.array([pool.pool.weights[name] for name in known])
    part /= part.sum()
    taken = rng.choice(len(known), size=count, p=part)
    freedom = pool.pool.freedom
    heavy = np.sqrt(freedom / rng.chisquare(freedom, count))
    error = heavy[:, None] * rng.standard_normal((count, 2))
    course, variance = drawn.current.copy(), np.empty(len(known))
    for k, name in enumerate(known):
        if name == FILTER:
            _, covariance = _state(filter_)
            total = np.zeros((2, len(covariance)))
            for axis in range(2):
                total[axis, MODES + axis :: 2] = 1.0
                total[axis, DIVE.start + axis] = 1.0
            variance[k] = 0.5 * float(np.trace(total @ covariance @ total.T))
            continue
        scale, mine = pool.pool.scales[name], taken == k
        variance[k] = scale**2 * freedom / (freedom - 2.0)
        course[mine] = courses[name] + scale * error[mine][:, None, :]
    course[0] = np.einsum("m,mtk->tk", part, np.array([courses[name] for name in known]))
    apart = np.array([courses[name][0] for name in known]) - course[0, 0]
    deviation = math.sqrt(float(part @ (variance + 0.5 * (apart**2).sum(axis=1))))
    return dataclasses.replace(drawn, current=course), deviation


def draw_ways(ahead: Mixture, freedom: float, count: int, rng: np.random.Generator) -> Array:
    """Sample the velocity through the water less that of the flown path, north and east [m/s],
    (member, 2), which is added to the current.

    Each member takes one model of the pool by its weight, plus a constant error. The first member
    has the mean of all.

    Args:
      ahead: forecast of a `WayPool`; members fly the path of its first model.
      freedom: [1] degrees of freedom of the pool's Student's t.
    """
    off = ahead.draw(count, freedom, rng) - ahead.means[0]
    off[0] = ahead.mean - ahead.means[0]
    return off


def draw_ground(
    course: Array, flown: Array, ground: GroundPool, rng: np.random.Generator
) -> tuple[Array, float]:
    """Let some members, sampled by weight, move over ground like the last three dives.

    Args:
      course: north, east [m/s] of the current, (member, time, 2).
      flown: north, east [m/s] of the flown path through the water.
      ground: pool that has learned from the dives.

    Returns:
      The currents, and the fraction of such members; the first member keeps the weighted mean.
    """
    part, count = ground.pool.weights[STEADY], len(course)
    scale, freedom = ground.pool.scales[STEADY], ground.pool.freedom
    wider = ground.pool.scales[BOTH] * math.sqrt(freedom / (freedom - 2.0))  # as the mixture has it
    course = course[:1] + wider * (course - course[:1])
    heavy = np.sqrt(freedom / rng.chisquare(freedom, (count, 1)))
    steady = ground.steady - flown + scale * heavy * rng.standard_normal((count, 2))
    found = np.where(rng.random((count, 1, 1)) < part, steady[:, None, :], course)
    found[0] = (1.0 - part) * course[0] + part * (ground.steady - flown)
    return found, part


def draw_field_error(
    drawn: WaterDraws,
    filter_: CurrentFilter,
    field: tuple[float, float],
    deviation: float,
    rng: np.random.Generator,
    *,
    told: bool,
) -> WaterDraws:
    """Replace the sampled current by samples of a field's error.

    Args:
      field: north, east [m/s] of the field at the start, mean over the dives' depths.
      deviation: [m/s] standard deviation of the field's error, north and east each.
      told: True if fixes have corrected the filter; its current then gives the starting error.
    """
    seen, spread = filter_.current
    prior, gain = deviation**2 * np.eye(2), np.zeros((2, 2))
    if told:
        gain = prior @ np.linalg.inv(prior + filter_.inflation * spread)
    mean = gain @ (seen - np.array(field))
    count, steps, _ = drawn.current.shape
    kept = math.exp(-INTERVAL / FIELD_TIME)
    gained = deviation * math.sqrt(1.0 - kept**2)
    error = mean + np.vstack([np.zeros(2), normal_draws(prior - gain @ prior, count - 1, rng)])
    course = np.empty((count, steps, 2))
    for k in range(steps):
        course[:, k] = error
        error = kept * error + gained * _scattered(rng, count, 2)
    return dataclasses.replace(drawn, current=course)


def _state(filter_: CurrentFilter) -> tuple[Array, Array]:
    """Mean and covariance of a filter's state; the covariance is inflated as in its forecasts."""
    state = filter_.state()
    return state["mean"], filter_.inflation * state["covariance"]


def _calibration(filter_: CurrentFilter) -> Array:
    """Standard deviations of the errors of speed [1] and compass [rad], (2,)."""
    return np.sqrt(np.diag(_state(filter_)[1])[CALIBRATION])


def _scattered(rng: np.random.Generator, count: int, size: int) -> Array:
    """Standard normal samples, (count, size); zero for the first member."""
    draws = rng.standard_normal((count, size))
    draws[0] = 0.0
    return draws
