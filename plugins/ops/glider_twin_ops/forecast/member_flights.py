"""Member flights: members flown side by side on all cores, each with track and surfacings.

A `Surfacing` has place, time, energy and ellipses of all members' n-th surfacing.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
import os
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.request import Request
from twin import Mission, Origin, Scenario, Trajectory, scenario_of
from twin.checks import state_at
from twin.errors import InaccurateStep, SimulationUnstable
from twin.fossen import LANES
from twin.geodesy import from_tangent_plane, wrap_longitude
from twin.mission import SURFACED_MARGIN_M
from twin.navigation import Ellipse, chi_squared, outline
from twin.numbers import Array
from twin.physics import Fleet, file_timestep, fly_in_lanes, quiet_mujoco, stiffness_of
from twin.vehicle import ENERGY

SAMPLE_PERIOD = 10.0
"""[s] Sample period of a member: the error of a surfacing is 3 m at 0.3 m/s"""
STEPS, SETTLED = 2.0, 0.75
"""STEPS: [1] members' physics step over the file's, whose explicit part limits it: in six hours the
end moves by less than 5 m, in lanes by about 1 m (`python -m benchmarks.forecast_speed`). SETTLED:
the file's step is flown if this step times the vehicle's fastest rate is larger. Rates of members
differ by a fifth, and at 1 they would be unstable."""
PER_CORE = {"mujoco": 12, "lanes": 4 * LANES[0]}
"""Members per core in a fleet: enough to keep a core busy, few enough to show progress"""
UNDER = 3.0
"""[1] Depth that counts as dived, over the depth that counts as surfaced"""
FLOATS = 300.0
"""[s] Time afloat, beyond the mission's own surface interval, after which a mission is over"""
THINNED = 30
"""Number of samples for each point of a track that is kept"""
HALF, NINETY = 0.5, 0.9
"""[1] Probabilities that the two ellipses hold the surfacing"""
FIX_DEVIATION = 5.0
"""[m] Standard deviation of the GPS fix after the dive, north and east each"""
TAILS = np.array([0.05, 0.95])
"""[1] Fractions of the members that have surfaced at the two bounds of a time"""
LEAST = 0.99
"""[1] A surfacing is reported if at least this fraction of the members has it: place, time and
ellipse without late members would describe the early members"""
ELLIPSE_POINTS = 64
KILO = 1e3


@dataclasses.dataclass(frozen=True, kw_only=True)
class MemberFlight:
    """Flight of one member."""

    time: Array
    """[s] Time from the start to each surfacing, (surfacing,)"""
    place: Array
    """North, east [m] of each surfacing, (surfacing, 2)"""
    energy: Array
    """[J] Energy used from the start to each surfacing, (surfacing,)"""
    track: Array
    """North, east [m] of the thinned track, (point, 2)"""
    times: Array
    """[s] Time from the start to each point of the track, (point,)"""
    duration: float
    """[s] Duration of the flight"""
    taken: float
    """[J] Energy used by the flight"""
    end: Array
    """North, east, depth [m] and velocity over ground, NED [m/s], at the end, (6,)"""
    over: bool = False
    """True if the mission ended with the last surfacing: the member floats from then on"""

    def delayed(self, stays: Array, late: float, drift: Array) -> MemberFlight:
        """Add surface intervals [s] before the dives, with drift [m/s], and lengthen each dive by
        the fraction `late` along its displacement; energy is as flown."""
        longer = late * np.append(0.0, self.time)
        farther = late * np.vstack([np.zeros((1, 2)), self.place.reshape(-1, 2)])
        stayed = np.cumsum(stays)
        ended = np.searchsorted(self.time, self.times)  # dives before each point
        surfaced = np.arange(len(self.time))
        track = self.track + stayed[ended, None] * drift + farther[ended]
        return dataclasses.replace(
            self,
            time=self.time + stayed[surfaced] + longer[1:],
            place=self.place + stayed[surfaced, None] * drift + farther[1:],
            times=np.append(0.0, self.times + stayed[ended] + longer[ended]),
            track=np.vstack([self.track[:1], track]),
        )

    def not_before(self, earliest: float) -> MemberFlight:
        """Lengthen the first dive along its displacement, so that the first surfacing is not before
        a time [s]; energy is as flown."""
        if not len(self.time) or self.time[0] >= earliest:
            return self
        first = float(self.time[0])
        later = earliest - first
        farther = later / first * self.place[0]
        dived = np.clip(self.times / first, 0.0, 1.0)  # fraction of the first dive
        return dataclasses.replace(
            self,
            time=self.time + later,
            place=self.place + farther,
            times=self.times + dived * later,
            track=self.track + dived[: len(self.track), None] * farther,
        )

    def rates(self) -> tuple[float, float]:
        """Mean power [W] and speed over ground [m/s] to the last surfacing, else to the end."""
        end, energy = self.duration, self.taken
        if len(self.time):
            end, energy = float(self.time[-1]), float(self.energy[-1])
        before = self.track[self.times <= end]
        return energy / end, float(np.hypot(*np.diff(before, axis=0).T).sum()) / end


def fly(
    scenarios: Sequence[Scenario], *, threads: int = 0
) -> Iterator[list[MemberFlight | SimulationUnstable]]:
    """Fly the first member, then the others in fleets; yield the flights of each fleet.

    In lanes a full batch takes no longer than one member; its first member is yielded alone.

    Args:
      threads: number of threads of a fleet; 0 takes every core.
    """
    cores = threads or os.cpu_count() or 1
    engine = scenarios[0].engine
    first = LANES[0] if engine == "lanes" else 1
    rest = max(len(scenarios) - first, 0)
    fleets = math.ceil(rest / (PER_CORE[engine] * cores))
    ends = [0, *(first + rest * k // fleets for k in range(fleets)), len(scenarios)]
    for a, b in itertools.pairwise(ends):
        found = _flown(scenarios[a:b], threads)
        for some in (found[:1], found[1:]) if a == 0 else (found,):  # the mean member at once
            if some:
                yield some


@contextlib.contextmanager
def coarse_steps() -> Iterator[None]:
    """Ignore warnings of inaccurate steps: errors of mm/s are small beside an unknown current.

    Warning filters belong to the process: enter this context before the first thread starts, and
    leave it after the last has ended.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InaccurateStep)
        yield


def _flown(scenarios: Sequence[Scenario], threads: int) -> list[MemberFlight | SimulationUnstable]:
    """Fly one fleet."""
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
    """Fly missions by the request's vehicle in still water, from the request's place."""
    still = [dataclasses.replace(request, mission=mission, field=None) for mission in missions]
    longest = max(one.flown for one in still)
    scenarios = [nominal_scenario(one, one.mission) for one in still]
    return _flown([dataclasses.replace(one, duration=longest) for one in scenarios], threads=0)


def nominal_scenario(request: Request, mission: Mission) -> Scenario:
    """Scenario of a mission in the request's field, as long as members fly."""
    flown = dataclasses.replace(mission, duration_s=request.flown)
    place = request.place
    targets = getattr(
        flown.placed(place.latitude_deg, place.longitude_deg).segments[0], "targets", None
    )
    heading = math.radians(mission.start_heading_deg)
    if targets:  # toward the first target: no turn at the start
        heading = math.atan2(targets[0]["east_m"], targets[0]["north_m"]) % (2.0 * math.pi)
    own, stiff = file_timestep(request.vehicle), stiffness_of(request.vehicle)
    rough = stiff is None or STEPS * own * stiff.rest <= SETTLED
    return scenario_of(
        vehicle=request.vehicle,
        mission=flown,
        duration=request.flown,
        start={
            "latitude": place.latitude_deg,
            "longitude": place.longitude_deg,
            "time": place.time,
            "heading": heading,
        },
        current=request.field,
        engine=request.engine,
        timestep=STEPS * own if rough else own,
        sample_period=SAMPLE_PERIOD,
        density=request.density,
    )


def told(run: Trajectory, scenario: Scenario) -> MemberFlight:
    """Member flight with the surfacings of a run."""
    depth, afloat = run["true_depth"], 0.5 * scenario.vehicle.hull_length + SURFACED_MARGIN_M
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
    """Indices of the samples at which a vehicle surfaces after a dive.

    Args:
      depth: [m], (time,). afloat: [m] largest depth that counts as surfaced.
    """
    known = np.flatnonzero((depth > UNDER * afloat) | (depth <= afloat))
    up = depth[known] <= afloat
    return known[up & ~np.append(True, up)[:-1]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Surfacing:
    """Statistics of all members' n-th surfacing; times are after the start."""

    number: int
    """n; 1 is the next surfacing"""
    part: float
    """[1] fraction of the members that have this surfacing"""
    north: float
    """[m] mean distance north of the start"""
    east: float
    covariance: Array
    """[m2] covariance of members and fix, (2, 2)"""
    latitude: float
    """[degree] of the mean place"""
    longitude: float
    time_s: float
    """mean time"""
    early_s: float
    """time at which 5 % of the members have surfaced"""
    late_s: float
    """time at which 95 % of the members have surfaced"""
    bound_s: float
    """standard deviation of these two times among samples of members (other seeds)"""
    energy_kj: float
    """mean energy since the start"""
    energy_deviation_kj: float
    members: Array
    """North, east [m] of every member that has this surfacing, (member, 2)"""

    def ellipse(self, holds: float) -> Ellipse:
        """Ellipse that holds the surfacing with a probability such as 0.9.

        With few members the ellipse is wider, since mean and covariance are estimated from them.
        """
        return Ellipse.of(self._shape(holds))

    def _shape(self, holds: float) -> Array:
        """[m2] Matrix of the ellipse in north and east, (2, 2); eigenvalues: squared semi-axes."""
        fix = FIX_DEVIATION**2 * np.eye(2)
        drawn = prediction_quantile(holds, len(self.members))
        return drawn * (self.covariance - fix) + chi_squared(holds) * fix

    def ring(self, holds: float, place: Origin) -> Array:
        """Longitude, latitude [degree] of the ellipse, closed, counterclockwise, (point, 2)."""
        around = outline(self._shape(holds), ELLIPSE_POINTS + 1)
        return degrees(np.array([self.north, self.east]) + around, place)

    def describe(self) -> dict[str, Any]:
        """Numbers as `--json` prints them."""
        same = ("number", "latitude", "longitude", "time_s", "early_s", "late_s", "bound_s")
        return {name: getattr(self, name) for name in same} | {
            "part_of_members": self.part,
            "ellipse_50": dataclasses.asdict(self.ellipse(HALF)),
            "ellipse_90": dataclasses.asdict(self.ellipse(NINETY)),
            "energy_kJ": self.energy_kj,
            "energy_deviation_kJ": self.energy_deviation_kj,
        }


def prediction_quantile(holds: float, count: int) -> float:
    """Squared Mahalanobis radius that holds the next of n + 1 normal samples in a plane.

    Mean and covariance are those of n = `count` samples: (n^2 - 1) p / (n (n - p)) times the
    quantile of F(p, n - p), p = 2 (Hotelling 1931, Ann. Math. Stat. 2). Below three, n is three.
    """
    n = max(count, 3)
    return (n * n - 1.0) / n * ((1.0 - holds) ** (-2.0 / (n - 2)) - 1.0)


def surfacings_of(
    flights: Sequence[MemberFlight], place: Origin, within: float = math.inf
) -> tuple[Surfacing, ...]:
    """Surfacings whose median time is within a horizon, in order, up to the first that fewer than
    `LEAST` of the members have.

    Args:
      flights: of the members so far, flown beyond the horizon; a single one has its fix's ellipses.
      place: of the start. within: [s] the horizon.
    """
    found = []
    for index in range(max((len(one.time) for one in flights), default=0)):
        having = [one for one in flights if len(one.time) > index]
        if not _due(flights, index, within) or len(having) < LEAST * len(flights):
            break
        places = np.array([one.place[index] for one in having])
        times = np.array([one.time[index] for one in having])
        energy = np.array([one.energy[index] for one in having]) / KILO
        centre = places.mean(axis=0)
        spread = FIX_DEVIATION**2 * np.eye(2)
        if len(having) > 1:
            spread = spread + np.cov(places, rowvar=False)
        longitude, latitude = degrees(centre[None], place)[0].tolist()
        early, late = np.quantile(times, TAILS).tolist()
        # the number of members before a bound is binomial: half the distance between the ranks one
        # standard deviation to either side (David and Nagaraja 2003, Order Statistics, 7.1)
        off = np.sqrt(TAILS * (1.0 - TAILS) / len(times))
        below, above = (np.quantile(times, np.clip(TAILS + s * off, 0.0, 1.0)) for s in (-1, 1))
        north, east = centre.tolist()
        found.append(
            Surfacing(
                number=index + 1,
                part=len(having) / len(flights),
                north=north,
                east=east,
                covariance=spread,
                latitude=latitude,
                longitude=float(wrap_longitude(np.array(longitude))),
                time_s=float(times.mean()),
                early_s=early,
                late_s=late,
                bound_s=0.5 * float((above - below).mean()),
                energy_kj=float(energy.mean()),
                energy_deviation_kj=float(energy.std()),
                members=places,
            )
        )
    return tuple(found)


def left_out(flights: Sequence[MemberFlight], told: int, within: float) -> str:
    """Reason why the surfacing after the last reported one is left out; empty if none is due."""
    if not _due(flights, told, within):
        return ""
    part = sum(len(one.time) > told for one in flights) / len(flights)
    return (
        f"surfacing {told + 1} is left out: only {100.0 * part:.0f} % of the members have it, the "
        "others end at their last target or are late; their mean would be that of the early ones"
    )


def over(flights: Sequence[MemberFlight], within: float) -> float | None:
    """[s] Median time at which the mission is over, if half of the members end it within a horizon
    [s]; else None."""
    ends = [float(one.time[-1]) for one in flights if one.over and one.time[-1] < within]
    return float(np.median(ends)) if 2 * len(ends) >= max(len(flights), 1) else None


def _due(flights: Sequence[MemberFlight], index: int, within: float) -> bool:
    """True if half of the members have the surfacing of an index within a time [s]."""
    early = sum(len(one.time) > index and one.time[index] <= within for one in flights)
    return 2 * early >= max(len(flights), 1)


def degrees(points: Array, place: Origin) -> Array:
    """Longitude, latitude [degree] of points north, east [m] of a place, (point, 2).

    Longitudes do not wrap at the date line.
    """
    latitude, longitude = from_tangent_plane(
        points[:, 0], points[:, 1], place.latitude_deg, place.longitude_deg
    )
    return np.stack([longitude, latitude], axis=1)
