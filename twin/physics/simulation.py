"""Simulation: one mission or many flown in native code, and their trajectories."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, SimulationUnstable, TwinError
from twin.frames import flip_quaternion, flip_vector, quaternion_to_euler
from twin.mission.controller import Command, Controller, Observation, misread
from twin.mission.guidance import new_state
from twin.mission.mission_file import DONE
from twin.mission.segments.base import surfaced_depth
from twin.numbers import Array
from twin.physics import outcome
from twin.physics.condition import (
    apply_real_vehicle,
    become,
    conditions_of,
    healthy,
    set_start,
    stagger,
)
from twin.physics.model_block import (
    Tables,
    check_integration,
    has_contacts,
    header,
    state,
    table,
    tables_of,
)
from twin.physics.mujoco_model import compile_model, quiet_mujoco, with_hydrodynamics
from twin.physics.native import block as b
from twin.physics.scenario import Scenario
from twin.physics.stiffness import stiffness_in
from twin.records.trajectory import INNOVATIONS, Trajectory
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from twin.physics.navigated import OnBoard


STEPS_PER_CALL = 20_000
"""Steps between returns to Python: enough to cost nothing, few enough to interrupt a run."""
END_CHECK_PERIOD = 30.0
"""[s] Time between checks for the end of a mission that has no duration."""
_WHOLE = mujoco.mjtState.mjSTATE_INTEGRATION
"""Signature of all that MuJoCo's next step depends on, including our words in userdata."""


@dataclasses.dataclass(frozen=True)
class Saved:
    """State and log of a simulation at one time."""

    state: Array
    """MuJoCo's state of the signature mjSTATE_INTEGRATION; the first number is the time [s]."""
    rows: NDArray[Any]
    """Samples up to this time."""
    became: int
    """Number of conditions that the vehicle has taken on."""


class Simulation:
    """One scenario in MuJoCo: its model and its data.

    `model` and `data` are ordinary MuJoCo objects that own everything they need. They outlive the
    Simulation and can be copied and pickled; `mujoco.mj_step(model, data)` runs water, guidance and
    log natively. `data.userdata` holds the last `block.RING` samples of the log. `step` collects
    them in time; a caller that steps MuJoCo itself reads `rows` in time.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        lean: bool = True,
        tables: Tables | None = None,
        reserve: int = 0,
    ):
        """Compile the scenario.

        Args:
          scenario: the scenario to fly.
          lean: leave out what only pictures and sensors need; the dynamics are the same.
          tables: of this scenario, if compiled already.
          reserve: least count of numbers that the model's tables must have room for.
        """
        if scenario.engine != "mujoco":
            raise InputError(
                f"a Simulation steps MuJoCo, and the scenario has engine={scenario.engine!r}: fly "
                "it with twin.simulate or twin.simulate_many, or take engine='mujoco'"
            )
        self.scenario = scenario
        self.duration = scenario.run_time()
        self._samples = math.floor(self.duration / scenario.sample_period + 1e-9) + 1
        self.tables = tables_of(scenario, self.duration) if tables is None else tables
        vehicle = with_hydrodynamics(scenario.vehicle, scenario.hydrodynamics)
        stiff = stiffness_in(scenario, vehicle, self.tables)
        self.model = compile_model(
            scenario.vehicle,
            hydrodynamics=scenario.hydrodynamics,
            timestep=scenario.timestep,
            integrator=scenario.integrator,
            lean=lean,
            tables=self.tables,
            reserve=reserve,
            log=True,
            centred=scenario.centred,
            stiff=stiff,
        )
        if stiff is not None and header(self.model)["centred"]:
            stiff.check(float(self.model.opt.timestep))
        check_integration(self.model, scenario.sample_period, self._samples, self.duration)
        model = self.model
        self._row = b.log_row(model.nq, model.nv, model.nu)
        self._collected = np.zeros(self._samples, self._row)
        self._count = 0
        head = header(model)
        head["log_samples"], head["log_period"] = self._samples, scenario.sample_period
        self._nominal = (model.qpos0.copy(), float(header(model)["neutral_volume"]))
        self.data = mujoco.MjData(model)
        self._conditions = conditions_of(scenario, self.duration)
        self._became = 0
        self.on_board: OnBoard | None = None
        """Sensors and navigator of a navigated run; None otherwise."""
        self.reset()

    @property
    def steps(self) -> int:
        """Steps of the whole run: the last but one logs the last sample, and the last one fills in
        that sample's acceleration."""
        return math.ceil(self.duration / self.model.opt.timestep - 1e-9) + 2

    # --- the log ------------------------------------------------------------------------------

    @property
    def rows(self) -> NDArray[Any]:
        """Samples so far, records of `block.log_row`; the last one may lack its acceleration."""
        self.collect(self.data.userdata)
        return self.collected

    @property
    def collected(self) -> NDArray[Any]:
        """Samples that `collect` has copied from the ring."""
        return self._collected[: self._count]

    @property
    def steps_per_collection(self) -> int:
        """Largest number of steps between two collections at which the ring loses no sample."""
        per_sample = max(1, round(self.scenario.sample_period / self.model.opt.timestep))
        return (b.RING - 1) * per_sample

    def collect(self, userdata: Array) -> None:
        """Copy the samples since the last call from the ring of `userdata`.

        Args:
          userdata: of the simulation that was stepped, shape (model.nuserdata,).

        Raises:
          TwinError: samples are lost because too many steps passed without a collection, or the
            state of native code in `userdata` was overwritten.
        """
        ours = userdata[: b.STATE_WORDS].view(b.STATE)[0]
        if not 0.0 <= ours["logged"] <= len(self._collected):
            raise TwinError(
                f"userdata reports {ours['logged']:g} of at most {len(self._collected)} samples as "
                "logged: it was overwritten; call Simulation.reset"
            )
        logged = int(ours["logged"])
        ring = userdata[b.STATE_WORDS :].view(self._row)
        if logged < self._count:  # the run was reset
            self._count = 0
        # the last collected sample may have lacked its acceleration then
        first = max(self._count - 1, 0)
        if logged - first > len(ring):
            raise TwinError(
                f"{logged - first - len(ring)} samples of this run are lost: it was stepped by "
                f"more than {self.steps_per_collection} steps at once; use Simulation.step, or "
                "read Simulation.rows in between"
            )
        places = np.arange(first, logged)
        self._collected[places] = ring[places % len(ring)]
        self._count = logged

    def step(self, steps: int = 1) -> None:
        """Advance by any number of physics steps and keep the log whole."""
        while steps > 0:
            count = min(steps, self.steps_per_collection, self._change())
            mujoco.mj_step(self.model, self.data, nstep=count)
            self.collect(self.data.userdata)
            steps -= count

    def _change(self) -> int:
        """Apply the conditions that are due; return the steps until the vehicle's next change."""
        period = self.model.opt.timestep
        while self._became < len(self._conditions):
            time, condition = self._conditions[self._became]
            steps = round((time - self.data.time) / period)
            if steps > 0:
                return steps
            become(self.model, self.scenario.vehicle, self._nominal[0], condition)
            self._became += 1
        return STEPS_PER_CALL

    def saved(self) -> Saved:
        """Save everything that later steps depend on, and the log so far."""
        state = np.empty(mujoco.mj_stateSize(self.model, _WHOLE))
        mujoco.mj_getState(self.model, self.data, state, _WHOLE)
        return Saved(state, self.collected.copy(), self._became)

    def restore(self, saved: Saved) -> None:
        """Continue from a state that `saved` returned, of this or an equal Simulation.

        Raises:
          InputError: the state is of a simulation with another vehicle.
        """
        if len(saved.state) != mujoco.mj_stateSize(self.model, _WHOLE):
            raise InputError(
                "the saved state is of a simulation with another vehicle: restore it where it "
                "was saved, or in a Simulation of the same scenario"
            )
        if self._became != saved.became:  # faults change the model as time goes on
            self.reset()
            self.data.time = saved.state[0]
            while self._became < saved.became:
                self._change()
        mujoco.mj_setState(self.model, self.data, saved.state, _WHOLE)
        self._count = len(saved.rows)
        self._collected[: self._count] = saved.rows

    # --- the run ------------------------------------------------------------------------------

    def reset(self) -> None:
        """Return to the start, with an empty log."""
        if self._became:  # the model has a later condition
            become(self.model, self.scenario.vehicle, self._nominal[0], healthy(self.scenario))
            self._became = 0
        # the start is that of the nominal vehicle; its errors act from there on
        self.model.qpos0[:], header(self.model)["neutral_volume"] = self._nominal
        mujoco.mj_resetData(self.model, self.data)
        start, flow = self.scenario.begin, np.zeros(3)
        if self.tables.current.size:
            from twin.water.current.sampler import sample

            place = (start.north, start.east, start.depth)
            flow[:] = sample(self.tables.current, 0.0, *place, 0.0, 0.0, 0.0)[:3]
        set_start(self.model, self.data, start, flow)
        if header(self.model)["centred"]:
            stagger(self.model, self.data)
        scenario = self.scenario
        apply_real_vehicle(
            self.model, scenario.vehicle, ballast=scenario.ballast, density=scenario.density,
            encoder_zeros=scenario.encoder_zeros,
        )  # fmt: skip
        self._count = 0
        self.on_board = None

    def run(
        self, controller: Controller | None = None, *, mission: int | None = None
    ) -> Trajectory:
        """Fly the whole scenario.

        Args:
          controller: Python code that gives the commands each control period instead of a plan.
          mission: index that errors give next to the mission's name; None for a single run.

        Raises:
          SimulationUnstable: the run went unstable; `partial` holds its finite samples.
        """
        if self.scenario.navigate is not None:
            self._run_navigated(controller)
        elif controller is not None:
            if self.scenario.mission is not None:
                raise InputError(
                    "the scenario has a mission and the run a controller: only one of them can "
                    "command the vehicle; leave the mission out of the scenario (its duration "
                    "then ends it), or call run() without a controller"
                )
            self._run_controlled(controller)
        else:
            remaining = self.steps
            per_call = STEPS_PER_CALL
            if self.scenario.open_ended:
                per_call = max(1, round(END_CHECK_PERIOD / self.model.opt.timestep))
            while remaining > 0 and not self.failed and not self.flown:
                count = min(remaining, per_call)
                self.step(count)
                remaining -= count
        return self.trajectory(mission)

    def _run_controlled(self, controller: Controller) -> None:
        vehicle, timestep = self.scenario.vehicle, self.model.opt.timestep
        per_tick = max(1, round(vehicle.control_period / timestep))
        done, memory = 0, new_state()
        while done < self.steps and not self.failed:
            self._change()  # the controller sees a fault that is due now
            seen = observe(self.data, vehicle, self.tables.floor)
            if self._conditions:
                seen = misread(seen, header(self.model)["gains"], memory, surfaced_depth(vehicle))
            command = controller(seen)
            if not isinstance(command, Command):
                raise InputError(f"the controller returned {command!r}; it must return a Command")
            self.data.ctrl[:] = command.as_array(vehicle)
            count = min(per_tick, self.steps - done)
            self.step(count)
            done += count

    def _run_navigated(self, controller: Controller | None) -> None:
        """Run guidance or a controller on navigated positions; see `twin.physics.navigated`."""
        from twin.physics.navigated import OnBoard, guidance_of
        from twin.physics.true_signals import LiveTruth

        scenario, timestep = self.scenario, self.model.opt.timestep
        guidance = guidance_of(scenario)
        if (guidance is None) == (controller is None):
            raise InputError(
                "a navigated run is commanded by the scenario's mission or by a controller: give "
                "one of them"
            )
        truth = LiveTruth(
            scenario.vehicle, self._row, half_step=self.half_step, floor=self.tables.floor
        )
        self.on_board = OnBoard(
            scenario, truth.names, self._samples, floor=self.tables.floor,
            current=self.tables.current,
        )  # fmt: skip
        command = controller or guidance
        assert command is not None
        per_sample = max(1, round(scenario.sample_period / timestep))
        per_tick = max(1, round(scenario.vehicle.control_period / timestep))
        done = 0
        while done < self.steps and not self.failed and not self.flown:
            # a sample is complete one step after its time, and a command is due then
            due = min(-(-done // n) * n + 1 for n in (per_sample, per_tick))
            count = min(max(due - done, 1), self.steps - done)
            self.step(count)
            done += count
            at = done - 1
            if at % per_sample == 0 and at // per_sample < self._samples:
                row = self._collected[at // per_sample]
                change = (self.data.qvel[:6] - row["qvel"][:6]) / timestep
                self.on_board.take(truth.sample(row, change))
            if at % per_tick == 0:
                wanted = command(self.on_board.observe(at * timestep))
                self.data.ctrl[:] = wanted.as_array(scenario.vehicle)
                if guidance is not None:
                    state(self.data)["guidance"][:] = guidance.state

    @property
    def half_step(self) -> float:
        """[s] Time by which the stored velocities are older than their samples."""
        return 0.5 * float(header(self.model)["centred"]) * float(self.model.opt.timestep)

    @property
    def flown(self) -> bool:
        """True when an open-ended mission has been flown to its end."""
        done = state(self.data)["guidance"][DONE]
        return self.scenario.open_ended and bool(done)

    @property
    def failed(self) -> bool:
        """True once the state is no longer finite."""
        return bool(state(self.data)["failed"])

    def trajectory(
        self, mission: int | None = None, *, userdata: Array | None = None
    ) -> Trajectory:
        """Trajectory of the samples so far.

        Args:
          mission: index that errors give. userdata: of the simulation that was stepped; None: that
            of `data`.

        Raises:
          SimulationUnstable: the run went unstable; `partial` holds the finite samples.
        """
        userdata = self.data.userdata if userdata is None else userdata
        self.collect(userdata)
        found = outcome.trajectory(
            self.scenario, self.collected, userdata[: b.STATE_WORDS].view(b.STATE)[0], mission,
            timestep=self.model.opt.timestep, half_step=self.half_step,
            floor=table(self.model, "floor"), contacts=has_contacts(self.model),
        )  # fmt: skip
        if self.on_board is not None:
            found.signals.update(self.on_board.signals())
            found.provenance[INNOVATIONS] = self.on_board.innovations()
        return found


def observe(data: mujoco.MjData, vehicle: Vehicle, floor: Array) -> Observation:
    """Make the observation of a Python controller at this time, in NED and FRD.

    `floor` is the table of the sea floor, empty without a sea floor.
    """
    from twin.water.floor.lookup import floor_depth

    roll, pitch, heading = quaternion_to_euler(flip_quaternion(data.qpos[3:7]))
    altitude = math.inf
    if floor.size:
        altitude = float(floor_depth(floor, data.qpos[0], -data.qpos[1]) + data.qpos[2])
    p, q, r = flip_vector(data.qvel[3:6]).tolist()
    north, east, depth = flip_vector(data.qpos[:3]).tolist()
    return Observation(
        time=float(data.time),
        depth=depth,
        altitude=altitude,
        roll=float(roll),
        pitch=float(pitch),
        heading=float(heading),
        roll_rate=p,
        pitch_rate=q,
        yaw_rate=r,
        north=north,
        east=east,
        parts=dict(zip(vehicle.part_names, data.act.tolist(), strict=True)),
    )


def simulate(scenario: Scenario, controller: Controller | None = None) -> Trajectory:
    """Fly one scenario with its engine; see `Simulation.run`."""
    if scenario.engine == "lanes":
        from twin.physics.lanes import fly_in_lanes

        if controller is not None:
            raise InputError(
                "engine='lanes' runs no Python between its steps: a controller needs "
                "engine='mujoco'"
            )
        found = fly_in_lanes([scenario], threads=1, numbers=[None])[0]
        if isinstance(found, SimulationUnstable):
            raise found
        return found
    with quiet_mujoco():
        return Simulation(scenario).run(controller)


def simulate_many(
    scenarios: Sequence[Scenario], *, threads: int = 1
) -> list[Trajectory | SimulationUnstable]:
    """Fly scenarios side by side on `threads` threads; results do not depend on that number.

    Scenarios with engine "lanes" fly together in blocks, the others in a simulation each.

    Each element is a trajectory, or the `SimulationUnstable` that ended the run; a `StepTooLong`
    if the run could not begin.

    Raises:
      InputError: the scenarios are no list of scenarios, or `threads` is below 1.
    """
    if isinstance(scenarios, Scenario):
        raise InputError("simulate_many takes a list of scenarios; fly a single one with simulate")
    if not isinstance(scenarios, Iterable):
        raise InputError(f"simulate_many takes a list of scenarios, not {_kind(scenarios)}")
    scenarios = list(scenarios)
    for index, scenario in enumerate(scenarios):
        if not isinstance(scenario, Scenario):
            raise InputError(
                f"simulate_many: element {index} is {_kind(scenario)}, not a Scenario; make one "
                "with twin.Scenario(mission=twin.load_mission('default'))"
            )
    if threads < 1:
        raise InputError(f"simulate_many: threads must be at least 1, not {threads}")

    abreast = [index for index, scenario in enumerate(scenarios) if scenario.engine == "lanes"]
    flown: dict[int, Trajectory | SimulationUnstable] = {}
    if abreast:
        from twin.physics.lanes import fly_in_lanes

        lanes = [scenarios[index] for index in abreast]
        found = fly_in_lanes(lanes, threads=threads, numbers=abreast)
        flown = dict(zip(abreast, found, strict=True))

    def fly(item: tuple[int, Scenario]) -> Trajectory | SimulationUnstable:
        index, scenario = item
        if index in flown:
            return flown[index]
        try:
            return Simulation(scenario).run(mission=index)
        except SimulationUnstable as error:
            return error

    with quiet_mujoco():
        if threads == 1:
            return [fly(item) for item in enumerate(scenarios)]
        with concurrent.futures.ThreadPoolExecutor(threads) as pool:
            return list(pool.map(fly, enumerate(scenarios)))


def _kind(value: object) -> str:
    return f"a value of type {type(value).__name__}"
