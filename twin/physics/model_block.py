"""Model block: the parameters of vehicle and water that a compiled model carries.

The block lies in the model's own custom numbers, so it is copied, pickled and freed with the model.

Tables are the numbers of a scenario that native code reads. They lie in the model, so their sizes
must be known when the model is compiled. A fleet gives all its models room for the largest tables.

`check_integration` refuses unsuitable integrators, steps and sample periods.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np

from twin.errors import FloorError, InputError, VehicleError
from twin.mission.mission_file import COMPASS_OFFSET
from twin.numbers import Array
from twin.physics.native import block as b
from twin.vehicle.laws import LAWS
from twin.vehicle.parts import PARTS, Part
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from twin.physics.scenario import Scenario

_NONE = np.zeros(0)
RUN_TABLES = ("plan", "current", "density", "temperature", "floor")
"""Names of the tables of a run, in the block's order."""
FLOOR_BODY = "glider_twin_floor"
"""Mocap body with the plane that represents the sea floor under the vehicle."""


class Tables(NamedTuple):
    """Tables of one run; an absent table is empty."""

    plan: Array = np.zeros((0, 0))
    """Mission table or schedule, shape (rows, columns)."""
    control: float = b.CONTROL_NONE
    """Type of the plan: one of the block's CONTROL_*."""
    gains: Array | None = None
    """Gains of a mission, shape (GAINS,)."""
    current: Array = _NONE
    """Compiled current, see `Current.compile`."""
    density: Array = _NONE
    """Compiled density profile, see `DensityProfile.compile`."""
    temperature: Array = _NONE
    """Compiled temperature for a hull that expands; see `DensityProfile.compile_temperature`."""
    floor: Array = _NONE
    """Compiled sea floor, see `Floor.compile`."""

    @property
    def words(self) -> int:
        """Count of the numbers in all tables."""
        return sum(int(getattr(self, name).size) for name in RUN_TABLES)


Plans = dict[tuple[int, int, Any], tuple[Array, Array]]
"""Compiled plans and gains, by `id` of mission, `id` of believed vehicle, and place."""


def tables_of(scenario: Scenario, duration: float, plans: Plans | None = None) -> Tables:
    """Compile the tables of a scenario that flies for `duration` [s].

    Args:
      plans: compiled plans of other scenarios that still exist; a shared plan is compiled once.

    Raises:
      MissionError, CurrentError, FloorError: the plan, the current or the sea floor is unsuitable.
    """
    from twin.mission import Mission
    from twin.mission.controller import Schedule

    found: dict[str, Any] = {}
    if scenario.navigate is not None:
        pass  # guidance runs in Python
    elif isinstance(scenario.mission, Mission):
        plans = {} if plans is None else plans
        believed = scenario.believed_vehicle
        key = id(scenario.mission), id(believed), scenario.place
        if key not in plans:
            plans[key] = scenario.mission_in_metres().compile(believed)
        plan, gains = plans[key]
        gains = gains.copy()
        gains[COMPASS_OFFSET] = scenario.compass_offset
        found |= {"plan": plan, "control": b.CONTROL_MISSION, "gains": gains}
    elif isinstance(scenario.mission, Schedule):
        scenario.mission.check(scenario.vehicle)
        found |= {"plan": scenario.mission.table(), "control": b.CONTROL_SCHEDULE}
    if scenario.current is not None:
        found["current"] = scenario.current.compile(duration, scenario.place)
    if scenario.density is not None:
        found["density"] = scenario.density.compile()
        if scenario.vehicle.hull_thermal_expansion:
            found["temperature"] = scenario.density.compile_temperature()
    return Tables(**found, floor=floor_table(scenario, duration))


def floor_table(scenario: Scenario, duration: float) -> Array:
    """Table of the scenario's sea floor; empty without a sea floor.

    Raises:
      FloorError: the floor is unreadable, or the mission starts on land, too deep or too shallow.
    """
    if scenario.floor is None:
        return _NONE
    from twin.water.floor.lookup import floor_depth

    place = scenario.place if scenario.has_place else None
    table = scenario.floor.compile(duration, place)
    start, label = scenario.begin, "the mission starts"
    bottom = float(floor_depth(table, start.north, start.east))
    if bottom <= 0.0:
        other = scenario.floor.other_sense(duration, place)
        way = "depths downward" if other == "positive=down" else "heights upward"
        hint = f" (if the file counts {way}, say {other})" if other else ""
        raise FloorError(f"{label} on land, {-bottom:g} m above the sea: start elsewhere{hint}")
    if start.depth >= bottom:
        raise FloorError(
            f"{label} at a depth of {start.depth:g} m, where the sea floor is at {bottom:g} m: "
            "start higher up or elsewhere"
        )
    for segment in getattr(scenario.mission, "segments", ()):
        above = getattr(segment, "min_altitude_m", None)
        if above is not None and bottom <= segment.min_depth_m + above:
            raise FloorError(
                f"{label} where the sea is {bottom:g} m deep: dives from min_depth_m = "
                f"{segment.min_depth_m:g} m that turn min_altitude_m = {above:g} m above the floor "
                "have no room; start elsewhere, or lower one of the two"
            )
    return table


def header(model: mujoco.MjModel) -> Any:
    """Header of a compiled model's block, live, a record of `block.HEADER`.

    Raises:
      VehicleError: the model carries no block of this program.
    """
    values = model.numeric_data
    if len(values) >= b.HEADER_WORDS:
        found = values[-b.HEADER_WORDS :].view(b.HEADER)[0]
        if found["magic"] == b.MAGIC and found["version"] == b.VERSION:
            return found
    raise VehicleError(
        "this MuJoCo model carries no vehicle's parameters, so it would move in vacuum: build it "
        "with twin.control.physics.Physics.from_vehicle or "
        "twin.physics.mujoco_model.compile_model"
    )


def state(data: mujoco.MjData) -> Any:
    """State that native code keeps in a simulation, live, a record of `block.STATE`."""
    return data.userdata[: b.STATE_WORDS].view(b.STATE)[0]


def _body(model: mujoco.MjModel) -> np.ndarray:
    """Numbers of the block in front of its header, shape (words - HEADER_WORDS,)."""
    words = int(header(model)["words"])
    return model.numeric_data[-words : len(model.numeric_data) - b.HEADER_WORDS]


def table(model: mujoco.MjModel, name: str) -> np.ndarray:
    """One table of the block, live: "parts", "law_values" or one of RUN_TABLES."""
    place = header(model)[name]
    start = int(place["start"])
    return _body(model)[start : start + int(place["size"])]


def part_table(model: mujoco.MjModel) -> np.ndarray:
    """Rows of the parts for native code, live, of dtype `block.PART`, shape (parts,)."""
    return table(model, "parts").view(b.PART)


def part_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the parts, in their order in the model."""
    return tuple(model.actuator(index).name for index in range(model.nu))


def joint_places(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """(index of the part, index in qpos) of every part that drives a joint."""
    found = []
    for index in range(model.nu):
        if model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT:
            joint = int(model.actuator_trnid[index, 0])
            found.append((index, int(model.jnt_qposadr[joint])))
    return found


def fill_block(model: mujoco.MjModel, vehicle: Vehicle, words: int, *, ring: int) -> None:
    """Write the vehicle into the model's block of `words` numbers."""
    head = model.numeric_data[-b.HEADER_WORDS :].view(b.HEADER)[0]
    hull = model.body("hull").id
    added_mass = vehicle.added_mass
    inertia = vehicle.static_inertia + sum(mass.inertia for mass in vehicle.masses)
    floor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, FLOOR_BODY)

    def acts(part: Part) -> bool:
        """Tell whether a part does more than displace volume at the CB."""
        heavy = part.native_mass is not None or part.native_wrench is not None
        return heavy or (part.native_volume is not None and any(part.position))

    for name, value in {
        "words": words,
        **{n: getattr(model, n) for n in ("nq", "nv", "nu", "na", "nbody", "nuserdata")},
        "hull_body": hull,
        "rigid_mass": model.body_subtreemass[hull],
        "neutral_volume": vehicle.neutral_volume,
        "gravity": vehicle.gravity,
        "reference_density": vehicle.reference_density,
        "compressibility": vehicle.hull_compressibility,
        "thermal_expansion": vehicle.hull_thermal_expansion,
        "thermal_lag": vehicle.hull_thermal_lag,
        "reference_temperature": vehicle.hull_reference_temperature,
        "length": vehicle.hull_length,
        "diameter": vehicle.hull_diameter,
        "added_mass": added_mass,
        "coupling": float(vehicle.added_mass_coupling),
        "rotary_inertia": np.diag(inertia) + np.diag(added_mass)[3:],
        "law": LAWS.code(vehicle.law.kind),
        "law_scaled": float(vehicle.law.density_in_coefficients),
        "acting": float(any(map(acts, vehicle.parts))),
        "control_period": vehicle.control_period,
        "floor_body": -1 if floor < 0 else int(model.body_mocapid[floor]),
        "log_ring": ring,
        "version": b.VERSION,
        "magic": b.MAGIC,
    }.items():
        head[name] = value
    body = _body(model)
    used = 0
    for name, values in (
        ("parts", _part_rows(vehicle, model)),
        ("law_values", vehicle.law.values()),
    ):
        body[used : used + values.size] = values
        head[name]["start"], head[name]["size"] = used, values.size
        used += values.size
    for name in RUN_TABLES:
        head[name]["start"], head[name]["size"] = used, 0


def has_contacts(model: mujoco.MjModel) -> bool:
    """Tell whether contacts are on in a compiled model."""
    return not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT


def _part_rows(vehicle: Vehicle, model: mujoco.MjModel) -> np.ndarray:
    """Rows of the parts as numbers, shape (parts * PART_WORDS,)."""
    rows = np.zeros(len(vehicle.parts), b.PART)
    for index, (row, part) in enumerate(zip(rows, vehicle.parts, strict=True)):
        kind, values = type(part), part.values()
        if len(values) > b.VALUES:
            raise VehicleError(
                f"{label(vehicle)}: part {part.name!r} has {len(values)} values, at most "
                f"{b.VALUES} are possible"
            )
        row["kind"], row["one_way"] = PARTS.code(part.kind), float(part.one_way)
        row["low"], row["high"], row["rate"] = part.low, part.high, part.rate
        row["lag"] = _step_lag(part.lag, model)
        row["place"], row["rest"] = part.position, part.rest
        row["values"][: len(values)] = values
        row["dof"] = -1.0
        if model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT:
            row["dof"] = model.jnt_dofadr[model.actuator_trnid[index, 0]]
            row["servo_damping"] = -model.actuator_biasprm[index, 2]
        for effect in ("volume", "mass", "wrench"):
            row[f"gives_{effect}"] = float(getattr(kind, f"native_{effect}") is not None)
    return rows.view(np.float64).ravel()


def room(model: mujoco.MjModel) -> int:
    """Count of numbers that the tables of a run may have together in this model."""
    return len(_body(model)) - int(header(model)["plan"]["start"])


def write_tables(model: mujoco.MjModel, tables: Tables) -> None:
    """Write the tables of a run into the model in place of its present ones.

    Raises:
      InputError: the tables exceed the model's room; compile it with a larger `reserve`.
      FloorError: a sea floor is given for a model that was compiled without one.
    """
    if tables.floor.size and header(model)["floor_body"] < 0.0:
        raise FloorError(
            "this model was compiled without a sea floor, so nothing would touch it: compile it "
            "with tables=Tables(floor=...)"
        )
    if tables.words > room(model):
        raise InputError(
            f"the tables of this run have {tables.words} numbers, the model has room for "
            f"{room(model)}; compile it with reserve={tables.words}"
        )
    head, body = header(model), _body(model)
    used = int(head["plan"]["start"])
    for name in RUN_TABLES:
        values = getattr(tables, name).ravel()
        head[name]["size"] = 0  # first, so that no thread reads a half-written table
        head[name]["start"] = used
        body[used : used + values.size] = values
        head[name]["size"] = values.size
        used += values.size
    head["plan_rows"] = len(tables.plan)
    head["control"] = tables.control
    if tables.gains is not None:
        head["gains"] = tables.gains
    elif tables.control == b.CONTROL_SCHEDULE:
        head["control_period"] = model.opt.timestep


def _step_lag(lag: float, model: mujoco.MjModel) -> float:
    """Lag [s] with which one explicit step follows the exponential response exactly.

    MuJoCo advances activations by act + dt * rate, except under RK4, which needs the given lag.
    """
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        return lag
    timestep = model.opt.timestep
    return float(timestep / -np.expm1(-timestep / lag))


def label(vehicle: Vehicle) -> str:
    """Name and file of a vehicle, for error messages."""
    return f"vehicle {vehicle.name!r} ({vehicle.path})"


MOST_SAMPLES = 4_000_000
"""Maximum number of samples of one run: about 1.3 GB of log, 23 days at 2 Hz."""
IMPLICIT_STEP = 0.02
"""[s] Limit of the step with the integrators implicit and implicitfast: servos are stiff."""
_EXPLICIT = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4)


def steps_per_sample(period: float, step: float) -> int:
    """Number of physics steps between samples; raises InputError if it is not whole."""
    steps = period / step
    if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
        nearest = max(1, round(steps)) * step
        raise InputError(
            f"sample period {period:g} s is not a whole number of steps of {step:g} s; the nearest "
            f"is {nearest:g} s"
        )
    return round(steps)


def check_integration(model: mujoco.MjModel, period: float, samples: int, duration: float) -> None:
    """Refuse unsuitable integrators, steps that miss samples, and runs beyond memory.

    Args:
      model: model with the integrator and the step of the run.
      period: [s] between samples.
      samples: number of samples of the whole run of `duration` [s].

    Raises:
      InputError: the run is impossible; the message says why and offers an alternative.
    """
    step, integrator = model.opt.timestep, model.opt.integrator
    if integrator in _EXPLICIT:
        raise InputError(
            "the battery's lead screws are too stiff for integrator euler or rk4 at any useful "
            "step; use discrete (or implicitfast up to a step of "
            f"{IMPLICIT_STEP:g} s)"
        )
    if integrator != mujoco.mjtIntegrator.mjINT_DISCRETE and step > IMPLICIT_STEP:
        raise InputError(
            f"timestep {step:g} s is too long for the stiff servos under this integrator; use "
            f"at most {IMPLICIT_STEP:g} s, or integrator discrete"
        )
    if integrator != mujoco.mjtIntegrator.mjINT_DISCRETE and has_contacts(model):
        raise InputError(
            "a sea floor or an obstacle needs integrator discrete: the implicit ones find the "
            "force of a contact without the battery's stiff servos, which throws the battery "
            "away at the first touch"
        )
    steps_per_sample(period, step)
    if samples < 2:
        raise InputError(
            f"a run of {duration:g} s holds fewer than two samples at a sample period of "
            f"{period:g} s; shorten the period"
        )
    if samples > MOST_SAMPLES:
        raise InputError(
            f"a run of {duration:g} s at a sample period of {period:g} s makes "
            f"{samples:,} samples, more than {MOST_SAMPLES:,}; shorten the mission or "
            "lengthen the period"
        )
