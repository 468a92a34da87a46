"""Member hindcast: each surfacing of a deployment by members flown, as `twin forecast` flies them.

The members of a dive know what the walk knows at its begin: the currents so far, the waypoints of
the dive, and the duration that the schedule expects. Depth and pitch are those of the dive before;
beyond the last waypoint, and where a log has none, the course goes on.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np

from glider_twin_ops.forecast.current_models import CurrentPool
from glider_twin_ops.forecast.known import Known
from glider_twin_ops.forecast.logged_leg import MODEL, LoggedLeg
from glider_twin_ops.forecast.members import MemberFlight, fly, members_of
from glider_twin_ops.forecast.request import Request
from glider_twin_ops.forecast.surfacing import surfacings_of
from glider_twin_ops.forecast.way_pool import WayPool
from twin import Scenario, Vehicle
from twin.checks import EndsApart, ends_apart, flown_in_mujoco
from twin.errors import MissionError
from twin.mission import Mission, Waypoint
from twin.numbers import Array
from twin.records import LogStore

HOUR = 3600.0
AHEAD = 2e5
"""[m] of the course beyond the last waypoint: farther than a dive goes"""
ARRIVAL = 20.0
"""[m] at which a waypoint is reached, as the walk's own ways have it"""
UNDER, FLATTEST, STEEPEST = 5.0, 5.0, 45.0
"""[m] of depth from which on, and [degree] of pitch between which, a sample tells of a glide"""
SHALLOWEST = 10.0
"""[m] of a dive"""


class MemberFlights:
    """Flies members of dive after dive of one deployment."""

    def __init__(
        self,
        logs: LogStore,
        vehicle: Vehicle,
        *,
        members: int,
        engine: str = "lanes",
        seed: int = 0,
        threads: int = 0,
    ):
        """`logs`: open while it is used. `members`, `engine`, `seed`: as `Request` has them."""
        self._logs, self._vehicle = logs, vehicle
        self._members, self._engine = members, engine
        self._seed, self._threads = seed, threads
        self._nominal: tuple[Scenario, MemberFlight] | None = None
        self.unflown: dict[int, str] = {}
        """Dives that members told nothing of, by row, and why"""

    def expect(
        self,
        before: Sequence[LoggedLeg],
        one: LoggedLeg,
        pool: CurrentPool,
        ways: WayPool,
        duration: float,
        reach: tuple[float, float],
    ) -> tuple[Array, Array] | None:
        """Fly the members of a dive.

        Args:
          before: the dives so far, at least one.
          one: of it are read the begin and the waypoints.
          pool, ways: of the current and of ways, after the last of `before`.
          duration: [s] expected.
          reach: [1] squared distances of the ellipses by the dives so far, as `Walked` has them.

        Returns:
          Mean of where they come up, north and east [m] from the begin, (2,), and covariance of
          members and fix [m2], (2, 2); None where they tell nothing (`unflown`).
        """
        place = one.origin
        try:
            request = Request(
                vehicle=self._vehicle,
                mission=self._mission(before[-1], one, duration, ways.steered(one)),
                place=place,
                hours=duration / HOUR,
                members=self._members,
                seed=self._seed,
                engine=self._engine,
            )
        except MissionError as error:
            self.unflown[one.mission] = str(error)
            return None
        members = members_of(request, self._known(before, one, pool, ways, reach[1]))
        found = [
            flight for some in fly(members.scenarios, threads=self._threads) for flight in some
        ]
        flights = [flight for flight in found if isinstance(flight, MemberFlight)]
        told = surfacings_of(flights, place)
        if not told:
            self.unflown[one.mission] = (
                f"{sum(len(flight.time) > 0 for flight in flights)} of {len(found)} members surface"
            )
            return None
        if isinstance(found[0], MemberFlight):
            self._nominal = members.scenarios[0], found[0]
        return np.array([told[0].north, told[0].east]), told[0].covariance

    def beside_mujoco(self) -> EndsApart | None:
        """The first member of the last dive, by MuJoCo too; None where none was flown in lanes."""
        if self._nominal is None or self._engine != "lanes":
            return None
        scenario, flight = self._nominal
        return ends_apart(flight.duration, flight.end, flown_in_mujoco(scenario))

    def _known(
        self,
        before: Sequence[LoggedLeg],
        one: LoggedLeg,
        pool: CurrentPool,
        ways: WayPool,
        reach: float,
    ) -> Known:
        last = before[-1].leg
        return Known(
            pool=copy.deepcopy(pool),
            place=one.begin,
            time=last.end,
            last_current=(float(last.current[0]), float(last.current[1])),
            source=f"{len(before)} dives",
            legs=len(before),
            ways=ways,
            reach=reach,
            by_model=all(each.method == MODEL for each in before),
        ).at(one.leg.start)

    def _mission(
        self, last: LoggedLeg, one: LoggedLeg, duration: float, steered: tuple[float, float]
    ) -> Mission:
        depth, pitch = self._flown(last)
        points = [np.zeros(2), *(np.array(target) for target in one.targets)]
        course = next(
            (b - a for a, b in zip(points[-2::-1], points[:0:-1], strict=True) if (b != a).any()),
            np.array(last.leg.through_water),
        )
        points.append(points[-1] + AHEAD * course / max(float(np.hypot(*course)), 1e-9))
        segment = Waypoint(
            targets=tuple({"north_m": float(n), "east_m": float(e)} for n, e in points[1:]),
            max_depth_m=depth,
            pitch_deg=pitch,
            surface_after_s=duration,
            surface_at_target=False,
            arrival_radius_m=ARRIVAL,
            current_north_m_s=steered[0],
            current_east_m_s=steered[1],
        )
        mission = Mission(name="hindcast", segments=(segment,))
        mission.check(self._vehicle)
        return mission

    def _flown(self, last: LoggedLeg) -> tuple[float, float]:
        """Depth [m] and pitch [degree] of a dive that was flown; unknown: the usual pitch."""
        depth = self._logs.signal("measured_depth", last.mission).astype(float)
        deepest = float(np.nanmax(depth, initial=SHALLOWEST))
        usual = math.degrees(self._vehicle.usual_glide[0])
        if "measured_pitch" not in self._logs:
            return deepest, usual
        pitch = np.abs(self._logs.signal("measured_pitch", last.mission).astype(float))
        glides = pitch[(depth > UNDER) & (pitch > FLATTEST) & (pitch < STEEPEST)]
        return deepest, float(np.median(glides)) if glides.size else usual
