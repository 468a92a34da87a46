"""Plan: a mission's segments in order, its start, its end and its limits."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twin.bounded import read_toml
from twin.errors import MissionError, unknown_name
from twin.mission import mission_file as check
from twin.mission import mission_file as g
from twin.mission.segments import SEGMENTS, Profile, Segment, Surface
from twin.mission.stationing import thruster_gains
from twin.numbers import Array
from twin.vehicle.parts import BatteryHinge, BatterySlide
from twin.vehicle.vehicle import Vehicle

AT_END = ("surface", "hold")
OVERSHOOT_MARGIN_M = 3.0
"""[m] Margin below a dive's lower depth; dives overshoot by up to 2.7 m, which must not abort."""
DEPTHS = ("max_depth_m", "depth_m", "until_depth_m")
"""Fields of segments that name a depth to go to"""
DEEPEST = 1500.0
"""[m] Rated depth for a file without one: the deepest shipped vehicle's"""
TOO_DEEP = 1.2
"""[1] Largest allowed ratio of a mission's depth to the rated depth"""


def built_for(vehicle: Vehicle) -> float:
    """[m] Depth that a vehicle is built for."""
    return vehicle.rated_depth or DEEPEST


def check_depth(depth: float, vehicle: Vehicle) -> None:
    """Raise MissionError for a depth [m] far below the one that the vehicle is built for."""
    rated = built_for(vehicle)
    if depth > TOO_DEEP * rated:
        raise MissionError(
            f"the mission dives to {depth:g} m, and {vehicle.name} is built for {rated:g} m: the "
            f"limit is {TOO_DEEP:g} times that, {TOO_DEEP * rated:g} m; give a lesser depth, or a "
            "vehicle whose file has a larger rated_depth"
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mission:
    """Plan of segments that one vehicle flies in order."""

    segments: tuple[Segment, ...]
    """Segments in the order in which they are flown."""
    name: str = "mission"
    """Name of the mission in summaries and stores."""
    duration_s: float | None = None
    """Time at which the simulation ends [s]; None: the end of the last segment."""
    start_depth_m: float = 0.0
    """Depth of the start [m], positive down."""
    start_heading_deg: float = 0.0
    """Heading at the start [deg true]."""
    max_depth_m: float | None = None
    """Depth below which the mission is aborted to the surface [m]; None: no such limit."""
    at_end: str = "surface"
    """Action after the last segment: climb to the "surface", or "hold": continue the last one."""
    ascent_pitch_deg: float = 35.0
    """Magnitude of pitch [deg] in the final or aborted climb to the surface."""

    def __post_init__(self) -> None:
        if isinstance(self.segments, list):
            object.__setattr__(self, "segments", tuple(self.segments))
        if not (isinstance(self.name, str) and self.name.strip()):
            check.fail("mission", "name", self.name, "a text that is not empty")
        label = f"mission {self.name!r}"
        if not isinstance(self.segments, tuple) or not self.segments:
            raise MissionError(f"{label}: segments must hold at least one segment")
        for index, segment in enumerate(self.segments):
            if not isinstance(segment, tuple(SEGMENTS.values())):
                raise MissionError(
                    f"{label}: segments[{index}] is {segment!r}; give one of "
                    f"{', '.join(kind.__name__ for kind in SEGMENTS.values())}"
                )
        check.fields(self, label)
        if self.at_end not in AT_END:
            raise MissionError(f"{label}: {unknown_name('at_end', str(self.at_end), AT_END)}")
        if self.max_depth_m is not None and self.start_depth_m > self.max_depth_m:
            rule = f"at most max_depth_m = {self.max_depth_m:g} m"
            check.fail(label, "start_depth_m", self.start_depth_m, rule)
        self._check_segments()

    def _check_segments(self) -> None:
        last = len(self.segments) - 1
        for index, segment in enumerate(self.segments):
            label = self._label(index)
            if not segment.limited and (index < last or self.duration_s is None):
                limits = ("yos", "turns", "length_m", "duration_s", "until_depth_m")
                allowed = [name for name in limits if hasattr(segment, name)]
                raise MissionError(
                    f"{label} never ends: give one of {', '.join(allowed)} (only the last segment "
                    "of a mission with a duration_s may do without)"
                )
            field = "max_depth_m" if isinstance(segment, Profile) else "depth_m"
            deepest, most = getattr(segment, field, None), self.max_depth_m
            if deepest is not None and most is not None and deepest > most - OVERSHOOT_MARGIN_M:
                rule = (
                    f"{OVERSHOOT_MARGIN_M:g} m less than the mission's max_depth_m = "
                    f"{self.max_depth_m:g} m, for the overshoot"
                )
                check.fail(label, field, deepest, rule)

    def _label(self, index: int) -> str:
        return f"mission {self.name!r}: segments[{index}] {self.segments[index].kind}"

    @classmethod
    def from_toml(cls, path: str | Path) -> Mission:
        """Read a mission file; see docs/reference/missions.md for its keys.

        Raises:
          MissionError: unreadable file, invalid TOML, unknown key or impossible value.
        """
        path = Path(path)
        hint = (
            "; a mission is not a table of columns but [[segments]] with NAME = VALUE lines, see "
            "docs/reference/missions.md"
        )
        data = read_toml(path, "mission file", MissionError, hint=hint)
        data.setdefault("name", path.stem)
        try:
            return cls.from_dict(data)
        except MissionError as error:
            raise MissionError(f"{path.name}: {error}") from None

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Mission:
        """Make a mission from `to_dict`; raises MissionError for unknown keys or wrong values."""
        check.known_keys("mission", cls, data)
        tables = data.get("segments")
        if not isinstance(tables, list | tuple) or not tables:
            raise MissionError("mission: give at least one [[segments]] table")
        segments = tuple(_segment(index, table) for index, table in enumerate(tables))
        return cls(**{**data, "segments": segments})

    def to_dict(self) -> dict[str, Any]:
        """Convert to plain values for TOML, JSON or a store, without the fields that are None."""
        data = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        data["segments"] = [{"kind": s.kind, **dataclasses.asdict(s)} for s in self.segments]
        plain: dict[str, Any] = _plain(data)
        return plain

    @property
    def needs_floor(self) -> str:
        """Name of the first field in use that needs a sea floor; empty if no field does."""
        for name in ("altitude_m", "min_altitude_m"):
            if any(getattr(segment, name, None) is not None for segment in self.segments):
                return name
        return ""

    @property
    def deepest(self) -> float:
        """[m] Largest depth of start and segments; 0 for one that follows the sea floor."""
        named = (getattr(one, name, None) for one in self.segments for name in DEPTHS)
        return max(self.start_depth_m, *(depth or 0.0 for depth in named))

    @property
    def needs_place(self) -> bool:
        """True if a target has a latitude and longitude, so that the start must have them too."""
        return any(getattr(segment, "geographic", False) for segment in self.segments)

    def placed(self, latitude: float, longitude: float) -> Mission:
        """Copy of the mission with every target in metres from an origin [degree]."""
        if not self.needs_place:
            return self
        segments = tuple(segment.placed(latitude, longitude) for segment in self.segments)
        return dataclasses.replace(self, segments=segments)

    def check(self, vehicle: Vehicle) -> None:
        """Raise MissionError if `vehicle` cannot fly the mission: pump, rotation, pitch, trim."""
        self._rows(vehicle)

    def compile(self, vehicle: Vehicle) -> tuple[Array, Array]:
        """Table (rows + 1, SEGMENT_COLUMNS + 3 * len(parts)) and gains (GAINS,) for guidance.

        A segment has one row; a type made of several segments, such as a lawn-mower, has several.

        Raises:
          MissionError: a segment exceeds the vehicle's abilities, or a target is in degrees.
        """
        if self.needs_place:
            raise MissionError(
                f"mission {self.name!r} goes to places on the Earth, but its start is missing: "
                'give --start LAT,LON or start={"latitude": 49.0, "longitude": -16.0}; '
                "without a scenario, compile Mission.placed(latitude, longitude)"
            )
        self._warn_of_idle_parts(vehicle)
        table = np.array(self._rows(vehicle))
        if self.max_depth_m is not None:
            table[:, g.ABORT_DEPTH] = self.max_depth_m
        return table, _gains(vehicle)

    def _warn_of_idle_parts(self, vehicle: Vehicle) -> None:
        """Warn of parts that neither guidance nor a segment of this mission moves."""
        named = {
            name for segment in self.segments for name in getattr(segment, "parts", None) or ()
        }
        idle = {part: other for part, other in vehicle.idle.items() if part not in named}
        if idle:
            what = ", ".join(f"{part} (beside {other})" for part, other in idle.items())
            warnings.warn(
                f"vehicle {vehicle.name!r}: guidance leaves {what} at rest: say which part is to "
                "steer by <text name='steer.CONTROL' data='PART'/> in its file, or command the "
                "others by 'parts' of a hold or from Python",
                RuntimeWarning,
                stacklevel=3,
            )

    def _rows(self, vehicle: Vehicle) -> list[Array]:
        """Rows of the table; the last row is flown after the segments."""
        rows = [
            part.row(vehicle, self._label(index))
            for index, segment in enumerate(self.segments)
            for part in segment.flown_as()
        ]
        last = self._ascent().row(vehicle, f"mission {self.name!r}: ascent_")
        last[g.KIND] = g.END_AT_SURFACE if self.at_end == "surface" else g.END_HOLDING
        last[g.DURATION] = np.nan
        return [*rows, last]

    def _ascent(self) -> Surface:
        return Surface(pitch_deg=self.ascent_pitch_deg)

    def time_limit_s(self, vehicle: Vehicle) -> float:
        """Longest time [s] to simulate: `duration_s`, or else a generous estimate.

        The estimate adds the time limits of the segments, or their depth ranges at steady vertical
        speeds times TIME_MARGIN, and the final climb to the surface.
        """
        if self.duration_s is not None:
            return float(self.duration_s)
        depth, total, place = self.start_depth_m, 0.0, (0.0, 0.0)
        for index, segment in enumerate(self.segments):
            begun = segment.begun_at(place)
            time, depth = begun.expected(vehicle, depth, self._label(index))
            total, place = total + time, segment.ends_at(place)
        if self.at_end == "surface":
            total += self._ascent().expected(vehicle, depth, f"mission {self.name!r}")[0]
        return math.ceil(total)


def _segment(index: int, table: object) -> Segment:
    label = f"segments[{index}]"
    if not isinstance(table, Mapping):
        raise MissionError(f"{label} is {table!r}; give a table with a kind")
    kind = table.get("kind")
    if kind is None:
        raise MissionError(f"{label}: kind is missing (allowed: {', '.join(sorted(SEGMENTS))})")
    if not isinstance(kind, str) or kind not in SEGMENTS:
        raise MissionError(f"{label}: {unknown_name('kind', str(kind), SEGMENTS)}")
    cls = SEGMENTS[kind]
    check.known_keys(f"{label} {kind}", cls, table, also=("kind",))
    check.required_keys(f"{label} {kind}", cls, table)
    try:
        return cls(**{key: value for key, value in table.items() if key != "kind"})
    except MissionError as error:
        raise MissionError(f"{label} {error}") from None


def _plain(value: Any) -> Any:
    """Convert to plain values without None and empty tables, with numbers as Python floats."""
    if isinstance(value, Mapping):
        plain = {key: _plain(item) for key, item in value.items() if item is not None}
        return {key: item for key, item in plain.items() if item != {}}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, str | bool) else float(value)


def _gains(vehicle: Vehicle) -> Array:
    """Gains and parts of all loops, shape (GAINS,), for `guidance_step`."""
    gains = np.zeros(g.GAINS)
    for first, pid in (
        (g.PITCH_KP, vehicle.pitch_pid),
        (g.HEADING_KP, vehicle.heading_pid),
        (g.DEPTH_KP, vehicle.depth_pid),
        (g.TRIM_KP, vehicle.trim_pid),
        (g.BUOYANCY_KP, vehicle.buoyancy_pid),
    ):
        gains[first : first + 3] = pid or (0.0, 0.0, 0.0)
    gains[g.PERIOD] = vehicle.control_period
    for control, place, sense, low in (
        ("pitch", g.PITCH_PART, g.PITCH_SENSE, None),
        ("heading", g.TURN_PART, None, None),
        ("trim", g.TRIM_PART, g.TRIM_SENSE, g.TRIM_LOW),
        ("buoyancy", g.BUOYANCY_PART, None, g.BUOYANCY_LOW),
    ):
        part, index = vehicle.steered(control), vehicle.steered_index(control)
        gains[place] = -1.0 if index is None else index
        if sense is not None:
            gains[sense] = 1.0 if part is None else part.sense("pitch")
        if low is not None and part is not None:
            gains[low], gains[low + 1] = part.low, part.high
    gains[g.FOLLOWERS] = len(vehicle.followers)
    names = vehicle.part_names
    for k, follower in enumerate(vehicle.followers):
        part, lead = vehicle.part(follower.part), vehicle.part(follower.lead)
        first = g.FOLLOWER + g.FOLLOWER_COLUMNS * k
        gains[first : first + g.FOLLOWER_COLUMNS] = (
            *(names.index(lead.name), names.index(part.name), follower.weight),
            *(lead.rest, part.low, part.high),
        )
    thruster_gains(vehicle, gains)
    gains[g.PITCHES_AT_REST] = float(isinstance(vehicle.steered("pitch"), BatterySlide))
    gains[g.TURNS_BY_ROLL] = float(isinstance(vehicle.steered("heading"), BatteryHinge))
    return gains
