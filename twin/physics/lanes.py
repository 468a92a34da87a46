"""Lanes: scenarios flown by the batched Fossen engine, with the same log as the MuJoCo twin.

A lane is one scenario's column in a block of numbers, flown at once. Scenarios with one structure,
step and sample period share blocks; results depend on neither the block nor the number of threads.
"""

from __future__ import annotations

import concurrent.futures
import functools
import itertools
import math
import os
from collections.abc import Iterator, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from twin.errors import FloorError, InputError, SimulationUnstable, StepTooLong
from twin.faults.base import Condition
from twin.fossen import lanes as ln
from twin.fossen import terms
from twin.fossen.lane_block import AT, LANES, PART, PARTS_AT, empty_block
from twin.fossen.structure import Structure, structure_of
from twin.mission.controller import FollowedPositions
from twin.mission.mission_file import GAINS, GUIDANCE_STATE
from twin.numbers import Array
from twin.physics.condition import conditions_of, write_instruments
from twin.physics.model_block import Plans, Tables, steps_per_sample, tables_of
from twin.physics.mujoco_model import obstacle_names, with_hydrodynamics
from twin.physics.native import block as b
from twin.physics.outcome import trajectory
from twin.physics.scenario import Scenario
from twin.physics.start import Start
from twin.physics.stiffness import file_timestep, stiffness_in
from twin.physics.true_signals import LEAN
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle
from twin.water.density import density_at

END_CHECK_PERIOD = 30.0
"""[s] Time between checks for the end of a mission that has no duration."""
CHUNK = 64
"""Samples of a block between two copies from its log."""
INTEGRATOR = "adams-bashforth"
"""Name of the integrator of lanes; see `twin.fossen.lanes`."""
LONGEST_STEP = 1.0
"""[s] Limit of the step in lanes."""


class Aground(FloorError):
    """A vehicle reached the sea floor at `time_s`; lanes have no contact forces."""

    def __init__(self, mission: int | None, time_s: float):
        super().__init__(
            f"{'' if mission is None else f'mission {mission}: '}the vehicle came to the sea floor "
            f"at {time_s:.0f} s, which engine='lanes' does not feel; take engine='mujoco', or turn "
            "higher above the floor (min_altitude_m)"
        )
        self.time_s = time_s


LaneResult = Trajectory | SimulationUnstable | Aground
"""Result of one lane."""


class Lane:
    """One scenario, ready to fly in a block.

    Raises:
      InputError, VehicleError, MissionError, CurrentError, FloorError: the scenario cannot fly in
        lanes; the message says why.
    """

    def __init__(
        self,
        scenario: Scenario,
        plans: Plans | None = None,
        *,
        until_flown: bool = False,
        follow: FollowedPositions | None = None,
    ):
        """Prepare the lane; `plans` as in `tables_of`, the other options as in `fly_in_lanes`."""
        self.scenario = scenario
        self.open_ended = until_flown or scenario.open_ended
        self.followed = np.zeros(0) if follow is None else follow.table()
        vehicle = with_hydrodynamics(scenario.vehicle, scenario.hydrodynamics)
        _check(scenario, vehicle)
        self.vehicle = vehicle
        self.duration = scenario.run_time()
        self.tables: Tables = tables_of(scenario, self.duration, plans)
        ballast = scenario.ballast
        volume = None if ballast is None else ballast.neutral_volume(vehicle, scenario.density)
        self.structure, self.numbers = structure_of(
            vehicle, neutral_volume=volume, zeros=scenario.encoder_zeros
        )
        self.conditions = conditions_of(scenario, self.duration)
        self.timestep = step = scenario.timestep or file_timestep(vehicle)
        if scenario.timestep is not None:
            stiff = stiffness_in(scenario, vehicle, self.tables)
            if stiff is not None:
                stiff.check(step)
        if not 0.0 < step <= LONGEST_STEP:
            raise InputError(f"timestep {step:g} s is outside 0 to {LONGEST_STEP:g} s")
        self.per_sample = steps_per_sample(scenario.sample_period, step)
        self.samples = math.floor(self.duration / scenario.sample_period + 1e-9) + 1
        self.joints = _parts_of_joints(vehicle.xml)
        self.row = b.log_row(7 + len(self.joints), 6 + len(self.joints), len(vehicle.parts))

    @property
    def key(self) -> tuple[Any, ...]:
        """Properties that all scenarios of a block share."""
        return self.structure, self.timestep, self.per_sample, self.joints

    def changes(self) -> list[tuple[int, Condition]]:
        """Conditions of the vehicle over the run, each with the step from which it holds."""
        return [(round(time / self.timestep), condition) for time, condition in self.conditions]

    def become(self, rows: Array, gains: Array, condition: Condition) -> None:
        """Write a condition into the vehicle's numbers in a block and into guidance's gains.

        Args:
          rows: column of this lane in the block, shape (structure.size,).
        """
        structure, numbers = structure_of(
            condition.vehicle, neutral_volume=condition.volume, zeros=condition.zeros
        )
        assert structure == self.structure  # a fault changes numbers, never the structure
        rows[structure.numbers_at :] = numbers
        for name, values in _response_rows(condition.vehicle).items():
            at = PARTS_AT + PART.index(name) * structure.parts
            rows[at : at + structure.parts] = values
        write_instruments(gains, condition)

    def column(self) -> Array:
        """Column of this lane in a block, see the function `column`."""
        start, warmth = self.scenario.begin, self.tables.temperature
        return column(self.structure, self.numbers, self.vehicle, start, warmth)


def column(
    structure: Structure, numbers: Array, vehicle: Vehicle, start: Start, temperature: Array
) -> Array:
    """Column of a block for a vehicle at its start, shape (structure.size,).

    Args:
      numbers: parameters of the vehicle, see `structure_of`.
      temperature: compiled profile of the water's temperature, or empty.
    """
    found, parts = np.zeros(structure.size), structure.parts
    found[structure.numbers_at :] = numbers
    warmth = vehicle.hull_reference_temperature
    hull = float(density_at(temperature, start.depth)) if temperature.size else warmth
    attitude = terms.quaternion(float(start.roll), float(start.pitch), float(start.heading))
    state = (start.north, start.east, start.depth, *attitude, *start.v_rel, *start.rates, hull)
    found[AT["state"] : AT["state"] + ln.STATE_WORDS] = state
    found[AT["length"]], found[AT["diameter"]] = vehicle.hull_length, vehicle.hull_diameter
    found[AT["density"]], found[AT["temperature"]] = vehicle.reference_density, warmth
    found[AT["alive"]] = 1.0
    low, high = vehicle.actuator_min, vehicle.actuator_max
    begin = np.clip(start.positions(vehicle.part_names, vehicle.rest), low, high)
    rows: dict[str, Any] = {"now": begin, "command": begin, **_response_rows(vehicle)}
    for name, values in rows.items():
        at = PARTS_AT + PART.index(name) * parts
        found[at : at + parts] = values
    return found


def _response_rows(vehicle: Vehicle) -> dict[str, Any]:
    """Rows of a block with the limits and lags by which parts follow commands."""
    return {
        "low": vehicle.actuator_min,
        "high": vehicle.actuator_max,
        "lag": vehicle.actuator_lag,
        "rate": vehicle.actuator_rate,
        "one_way": [float(part.one_way) for part in vehicle.parts],
    }


def _check(scenario: Scenario, vehicle: Vehicle) -> None:
    """Raise an error that names an option without effect in lanes."""
    for name, there in (
        ("navigate", scenario.navigate is not None),
        ("integrator", scenario.integrator is not None),
        ("centred=False", not scenario.centred),
    ):
        if there:
            raise InputError(
                f"scenario: {name} is not possible with engine='lanes', which has an integrator of "
                "its own and no Python between its steps; leave it out or take engine='mujoco'"
            )
    refuse_obstacles(vehicle)


def refuse_obstacles(vehicle: Vehicle) -> None:
    """Raise InputError if a vehicle's world has obstacles."""
    found = obstacle_names(vehicle.xml)
    if found:
        names = ", ".join(name or "a geom without a name" for name in found)
        raise InputError(
            f"vehicle {vehicle.name!r} has obstacles ({names}), which engine='lanes' would "
            "fly through; take engine='mujoco'"
        )


@functools.lru_cache(maxsize=64)
def _parts_of_joints(xml: str) -> tuple[int, ...]:
    """Index of the part that drives each joint, in the order of MuJoCo's positions."""
    root = ElementTree.fromstring(xml)
    actuators = enumerate(root.findall("actuator/*"))
    by_joint = {actuator.get("joint"): index for index, actuator in actuators}
    names = [joint.get("name") for joint in root.iter("joint") if joint.get("name")]
    return tuple(by_joint[name] for name in names if name in by_joint)


class LaneBlock:
    """Block of lanes with equal `key`, at most as many as the widest block holds."""

    def __init__(self, lanes: Sequence[Lane]):
        first = lanes[0]
        self.lanes = lanes
        self.width = next(width for width in LANES if len(lanes) <= width)
        structure: Structure = first.structure
        self.b = empty_block(structure.size * self.width)
        self.rate = structure.rate(self.width)
        rows = self.b.reshape(-1, self.width)
        # copies of the last lane fill the block up and stand still
        filled = [lanes[min(k, len(lanes) - 1)] for k in range(self.width)]
        rows[:, : len(lanes)] = np.array([lane.column() for lane in lanes]).T
        rows[:, len(lanes) :] = rows[:, len(lanes) - 1 : len(lanes)]
        rows[AT["alive"], len(lanes) :] = 0.0
        first_command = PARTS_AT + PART.index("command") * structure.parts
        begin = rows[first_command : first_command + structure.parts].T
        self._tables(filled, begin)

    def _tables(self, filled: Sequence[Lane], begin: Array) -> None:
        """Tables of every lane that guidance and the water read."""
        count = len(filled)
        plans = [lane.tables.plan for lane in filled]
        self.plan_rows = np.array([len(plan) for plan in plans])
        columns = max(plan.shape[1] if len(plan) else 0 for plan in plans)
        self.plans = np.zeros((count, max(self.plan_rows.max(), 1), max(columns, 1)))
        for mine, plan in zip(self.plans, plans, strict=True):
            mine[: len(plan), : plan.shape[1]] = plan
        self.gains = np.zeros((count, GAINS))
        self.guided = np.zeros((count, GUIDANCE_STATE))
        self.wanted = begin.copy()
        self.counts = np.zeros((count, len(ln.COUNTS)))
        self.counts[:, ln.FLOOR_TIME] = np.nan
        control = {b.CONTROL_NONE: ln.NO_CONTROL, b.CONTROL_MISSION: ln.PLAN,
                   b.CONTROL_SCHEDULE: ln.SCHEDULE}  # fmt: skip
        self.periods = np.zeros(count)
        for k, lane in enumerate(filled):
            if lane.tables.gains is not None:
                self.gains[k] = lane.tables.gains
            self.counts[k, ln.CONTROL] = control[lane.tables.control]
            self.counts[k, ln.OPEN_ENDED] = float(lane.open_ended)
            self.counts[k, ln.SAMPLES] = lane.samples
            scheduled = lane.tables.control == b.CONTROL_SCHEDULE
            self.periods[k] = lane.timestep if scheduled else lane.vehicle.control_period
        names = ("current", "density", "temperature", "floor")
        self.water = [joined([getattr(lane.tables, name) for lane in filled]) for name in names]
        self.water.append(joined([lane.followed for lane in filled]))

    def fly(self, lean: bool = False) -> list[tuple[NDArray[Any], Any]]:
        """Fly to the end; return each lane's log rows and its last record of `block.STATE`.

        With `lean` the rows have only the fields `LEAN`.
        """
        first = self.lanes[0]
        joints = np.array(first.joints, dtype=np.int64)
        last = max((lane.samples - 1) * first.per_sample + 1 for lane in self.lanes)
        assert first.row.names is not None
        names = list(LEAN if lean else first.row.names)
        kept = np.dtype([(name, first.row[name]) for name in names])
        fields = [first.row.fields[name][:2] for name in names]  # type: ignore[index]
        # rows are copied as plain numbers: copying field by field takes an eighth of the flight
        words = np.concatenate([np.arange(at // 8, (at + of.itemsize) // 8) for of, at in fields])
        take: Any = words if lean else slice(None)
        # only flown rows are returned
        found = [np.empty((lane.samples, len(words))) for lane in self.lanes]
        size = min(CHUNK, max(lane.samples for lane in self.lanes))
        log = np.zeros((self.width, size, first.row.itemsize // 8))
        look = max(1, round(END_CHECK_PERIOD / first.timestep))
        programs = [array for pair in self.water for array in pair]
        taken = np.zeros(len(self.lanes), int)
        changes = sorted(
            ((step, k, condition) for k, lane in enumerate(self.lanes)
             for step, condition in lane.changes()),
            key=lambda change: change[:2],
        )  # fmt: skip
        for sample in range(0, -(-last // first.per_sample), size):
            begin, end = sample * first.per_sample, (sample + size) * first.per_sample
            end = min(end, last)
            while begin < end:
                while changes and changes[0][0] <= begin:
                    self._become(*changes.pop(0)[1:])
                until = min(end, changes[0][0]) if changes else end
                alive = ln.fly(
                    self.b, self.width, self.b.ctypes.data, self.rate.address,
                    first.structure.parts, joints, first.timestep, begin, until,
                    first.per_sample, look, self.counts, self.plans, self.plan_rows, self.periods,
                    self.gains, self.guided, self.wanted, *programs, log, sample,
                )  # fmt: skip
                begin = until
            for k, rows in enumerate(found):
                logged = int(self.counts[k, ln.LOGGED])
                rows[taken[k] : logged] = log[k][: logged - taken[k], take]
                taken[k] = logged
            if alive == 0:
                break
        ours = np.zeros(len(found), b.STATE)
        for k, one in enumerate(ours):
            one["failed"], one["fail_time"] = self.counts[k, [ln.FAILED, ln.FAIL_TIME]]
            one["guidance"] = self.guided[k]
        return [(rows[: taken[k]].view(kept)[:, 0], ours[k]) for k, rows in enumerate(found)]

    def _become(self, k: int, condition: Condition) -> None:
        """Give the vehicle of lane `k` a new condition from now on."""
        rows = self.b.reshape(-1, self.width)
        column = rows[:, k].copy()
        self.lanes[k].become(column, self.gains[k], condition)
        rows[:, k] = column


def joined(tables: Sequence[Array]) -> tuple[Array, NDArray[np.int64]]:
    """Concatenate tables; also return the index at which each begins and the last ends."""
    places = np.concatenate([[0], np.cumsum([table.size for table in tables])]).astype(np.int64)
    return np.concatenate([*tables, np.zeros(0)]), places


def fly_in_lanes(
    scenarios: Sequence[Scenario],
    *,
    threads: int = 0,
    numbers: Sequence[int | None] = (),
    lean: bool = False,
    until_flown: bool = False,
    follow: Sequence[FollowedPositions] = (),
) -> list[Trajectory | SimulationUnstable]:
    """Fly scenarios in lanes of the batched Fossen engine; `threads` 0 takes every core.

    Each element is a trajectory, the `SimulationUnstable` that ended the run, or a `StepTooLong` if
    the run could not begin.

    Args:
      numbers: index of each scenario in errors, None: no index; by default its place in the list.
      lean: trajectories hold few signals, see `true_signals.from_log`.
      until_flown: end a run when its mission is flown, even if it has a duration.
      follow: for each scenario a part that follows positions instead of guidance; by default none.

    Raises:
      InputError and others as for `Lane`: a scenario cannot fly in lanes.
      Aground: a vehicle reached the sea floor; lanes have no contact forces.
    """
    plans: Plans = {}
    lanes: list[Lane] = []
    places: list[int] = []
    results: list[Trajectory | SimulationUnstable | None] = [None] * len(scenarios)
    for place, (scenario, positions) in enumerate(itertools.zip_longest(scenarios, follow)):
        try:
            lanes.append(Lane(scenario, plans, until_flown=until_flown, follow=positions))
            places.append(place)
        except StepTooLong as error:
            results[place] = error
    named = [numbers[place] if numbers else place for place in places]
    count = threads or os.cpu_count() or 1
    blocks = _blocks(lanes, count)

    def fly(members: list[int]) -> None:
        for index, found in _lane_results(lanes, members, named, lean=lean):
            if isinstance(found, Aground):
                raise found
            results[places[index]] = found

    if count == 1 or len(blocks) == 1:
        for members in blocks:
            fly(members)
    else:
        with concurrent.futures.ThreadPoolExecutor(count) as pool:
            list(pool.map(fly, blocks))
    return [result for result in results if result is not None]


def flown_abreast(lanes: Sequence[Lane]) -> Iterator[tuple[int, LaneResult]]:
    """Fly lanes on this thread; yield the index and the result of each.

    A trajectory is made on request, so that only the logs of one block are in memory.
    """
    for members in _blocks(lanes, 1):
        yield from _lane_results(lanes, members, range(len(lanes)))


def _blocks(lanes: Sequence[Lane], threads: int) -> list[list[int]]:
    """Indices of the lanes of each block."""
    groups: dict[tuple[Any, ...], list[int]] = {}
    for index, lane in enumerate(lanes):
        groups.setdefault(lane.key, []).append(index)
    return [
        list(itertools.islice(rest, size))
        for members in groups.values()
        for rest in [iter(members)]
        for size in _sizes(len(members), threads)
    ]


def _sizes(count: int, threads: int) -> list[int]:
    """Sizes of the blocks of `count` lanes: wide blocks as long as every thread gets work."""
    wide = count // (LANES[-1] * threads) * threads
    narrow = -(-(count - wide * LANES[-1]) // LANES[0])
    return [LANES[-1]] * wide + [LANES[0]] * narrow


def _lane_results(
    lanes: Sequence[Lane],
    members: Sequence[int],
    numbers: Sequence[int | None],
    *,
    lean: bool = False,
) -> Iterator[tuple[int, LaneResult]]:
    """Yield the result of each lane of one block; errors give its number."""
    block = LaneBlock([lanes[index] for index in members])
    logs = block.fly(lean)[::-1]
    for k, index in enumerate(members):
        rows, ours = logs.pop()  # frees each log after its use
        lane, touched = lanes[index], float(block.counts[k, ln.FLOOR_TIME])
        found: LaneResult
        if math.isnan(touched):
            try:
                found = trajectory(
                    lane.scenario, rows, ours, numbers[index], timestep=lane.timestep,
                    half_step=0.0, floor=lane.tables.floor, contacts=False, lean=lean,
                )  # fmt: skip
            except SimulationUnstable as error:
                found = error
        else:
            found = Aground(numbers[index], touched)
        yield index, found
