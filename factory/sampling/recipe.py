"""Recipe: all settings that decide the bytes of a store, and the comparison of recipes."""

from __future__ import annotations

import hashlib
import json
import math
import platform
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numba
import numpy as np

from factory.sampling import presets
from factory.sampling.distribution import Distribution, Fixed
from factory.sampling.draw import Parameters, Plan, draw_parameters, plan_missions, samples_in
from factory.sampling.mission_kinds import propelled
from factory.sampling.parameters import FLOOR_DEPTH, Table, override, parameter_table
from factory.sampling.presets import PRESETS
from twin.errors import InputError, MissionError, StoreError, TwinError, unknown_name
from twin.mission import check_depth
from twin.physics.mujoco_model import INTEGRATORS, compile_model
from twin.physics.true_signals import ENGINES, SAMPLE_PERIOD, declare_parts, simulated_signals
from twin.plugins import installation
from twin.records import attributes
from twin.records.schema import HYDROGRAPHY, SCHEMA_VERSION, WITH_FLOOR
from twin.sensors import SENSORS, SUITE_PRESETS, SensorSuite
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle
from twin.version import __version__

if TYPE_CHECKING:
    from factory.sampling.fly import GivenCurrent
    from twin.physics import Lane

VERSIONS = "versions"
"""Entry of a recipe's description: versions of all software that can change a bit of a result"""
DEFAULT_HOURS = 10.0
"""[h] Default time of all missions together, as in the paper's training set"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recipe:
    """Settings of a store; equal recipes give equal arrays."""

    preset: str = "paper"
    """Name of the preset, a key of PRESETS"""
    hours: float | None = None
    """[h] Time of all missions; None: DEFAULT_HOURS, or the duration of the preset's missions"""
    seed: int = 0
    """Root of every random draw"""
    changes: Mapping[str, str | float]
    """Replaced distributions, by parameter name"""
    vehicle: Vehicle
    """Vehicle with the values of its file"""
    sensors: str | SensorSuite | None = None
    """Sensor suite, or its name such as field+turbidity; None: the preset's"""
    current: str | Mapping[str, Any] | None = None
    """Current of all missions: the text of `twin simulate --current`, or the description in a
    store; None samples a current for each mission."""
    engine: str = ENGINES[0]
    """Physics engine, one of ENGINES"""

    def __post_init__(self) -> None:
        if self.engine not in ENGINES:
            raise InputError(unknown_name("engine", str(self.engine), ENGINES))
        if self.preset not in PRESETS:
            raise InputError(unknown_name("preset", self.preset, PRESETS))
        if self.seed < 0:
            raise InputError(f"--seed {self.seed} must be at least 0")
        if PRESETS[self.preset].fixed_missions:
            if self.hours is not None:
                raise InputError(
                    f"preset {self.preset!r} has missions of its own: leave --hours out"
                )
            presets.check_paper_test(self.vehicle)
        declare_parts(self.vehicle)
        # computed here so that errors appear before a store is begun
        _ = self.suite, self.distributions, self.plan, self.physics, self.given_current

    @property
    def sensor_preset(self) -> str:
        """Name of the sensor suite; `custom` for an object that equals no named suite."""
        if isinstance(self.sensors, SensorSuite):
            named = (name for name, suite in SUITE_PRESETS.items() if suite == self.sensors)
            return next(named, "custom")
        preset = PRESETS[self.preset]
        own = preset.survey_sensors if propelled(self.vehicle) else preset.sensors
        return self.sensors or own

    @cached_property
    def suite(self) -> SensorSuite:
        """Sensor suite."""
        if isinstance(self.sensors, SensorSuite):
            return self.sensors
        return SensorSuite.preset(self.sensor_preset)

    @cached_property
    def physics(self) -> dict[str, Any]:
        """Time step [s] and integrator; compiling the model shows errors of the vehicle at once."""
        if self.engine == "lanes":
            from twin.physics.lanes import INTEGRATOR

            return {"timestep_s": self._lane.timestep, "integrator": INTEGRATOR}
        option = compile_model(self.vehicle, lean=True).opt
        names = {int(number): name for name, number in INTEGRATORS.items()}
        return {"timestep_s": option.timestep, "integrator": names[int(option.integrator)]}

    @property
    def _lane(self) -> Lane:
        """The vehicle in the batched engine; raises an error if the engine cannot fly it."""
        from twin.physics.lanes import Lane
        from twin.physics.scenario import Scenario

        return Lane(Scenario(vehicle=self.vehicle, engine=self.engine, duration=SAMPLE_PERIOD))

    @property
    def abreast(self) -> int:
        """Number of missions in a batch of the engine."""
        if self.engine == ENGINES[0]:
            return 1
        from twin.fossen.lane_block import LANES

        return LANES[-1]

    def warm(self) -> None:
        """Compile the engine once, before the fork of workers that would each compile it."""
        if self.engine == "lanes":
            from twin.physics.lanes import flown_abreast

            for _ in flown_abreast([self._lane] * (self.abreast + 1)):  # full batch and one more
                pass

    @cached_property
    def table(self) -> Table:
        """Parameters of the vehicle's missions by name."""
        return parameter_table(self.vehicle)

    @cached_property
    def distributions(self) -> dict[str, Distribution]:
        """Distribution of every parameter."""
        distributions = override(PRESETS[self.preset].distributions(self.table), self.changes)
        if self.current is not None:
            for name in self._currents():
                if name in self.changes:
                    raise InputError(f"--current replaces every drawn current: do not set {name}")
                distributions[name] = Fixed(math.nan)
        return distributions

    def _currents(self) -> list[str]:
        return [name for name in self.table if name.startswith("current.")]

    @cached_property
    def given_current(self) -> GivenCurrent | None:
        """Current of all missions; None if it is sampled for each mission."""
        if self.current is None:
            return None
        from factory.sampling.fly import given_current

        return given_current(self.current, max(self.plan.durations_s))

    @cached_property
    def plan(self) -> Plan:
        """Durations and splits of all missions."""
        if PRESETS[self.preset].fixed_missions:
            return presets.paper_test_plan()
        hours = DEFAULT_HOURS if self.hours is None else self.hours
        return plan_missions(self.distributions["mission.duration_h"], hours=hours, seed=self.seed)

    @property
    def float32_bytes(self) -> int:
        """[byte] Size of the missions' signals as plain float32, without padding."""
        simulated = set(simulated_signals(self.vehicle))
        if self.distributions["water.stratified"] != Fixed(0.0):
            simulated |= {name for name in HYDROGRAPHY if name.startswith("true_")}
        if FLOOR_DEPTH in self.table:
            simulated |= {name for name in WITH_FLOOR if name.startswith("true_")}
        measured = {entry.name for entry in self.suite.writes(simulated)}
        samples = sum(samples_in(duration) for duration in self.plan.durations_s)
        return 4 * len(measured | simulated) * samples

    def parameters(self, mission: int, attempt: int) -> Parameters:
        """Sample the parameters of one attempt at one mission; raises MissionError."""
        if PRESETS[self.preset].fixed_missions:
            settled = [*self.changes, *(self._currents() if self.current is not None else ())]
            return presets.paper_test_parameters(
                mission, self.table, self.distributions, settled, seed=self.seed, attempt=attempt
            )
        key = {"seed": self.seed, "mission": mission, "attempt": attempt}
        duration, vehicle = self.plan.durations_s[mission], self.vehicle
        return draw_parameters(
            self.table, self.distributions, duration_s=duration, vehicle=vehicle, **key
        )

    def describe(self) -> dict[str, Any]:
        """Return all settings that decide the bytes, in types of JSON."""
        description = {
            attributes.VERSION: SCHEMA_VERSION,
            "preset": self.preset,
            "hours": self.plan.hours,
            "seed": self.seed,
            "vehicle": self.vehicle.name,
            attributes.VEHICLE_SHA256: sha256(self.vehicle.xml),
            **({} if self.engine == ENGINES[0] else {"engine": self.engine}),
            "hydrodynamics": "coefficients",
            **self.physics,
            attributes.SAMPLE_PERIOD: SAMPLE_PERIOD,
            "distributions": {name: d.text() for name, d in self.distributions.items()},
            "sensors": self.suite.settings(),
            "current": None if self.given_current is None else self.given_current.describe(),
            VERSIONS: versions(self.vehicle),
        }
        # tuples become lists, as in a description that is read from a store
        plain: dict[str, Any] = json.loads(json.dumps(description))
        return plain

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all settings that decide the bytes."""
        return sha256(json.dumps(self.describe(), sort_keys=True, separators=(",", ":")))

    def document(self) -> dict[str, Any]:
        """Return the recipe in types of JSON, for `read_recipe`."""
        return {
            attributes.SETTINGS: self.describe(),
            attributes.CHANGES: dict(self.changes),
            attributes.VEHICLE_MJCF: self.vehicle.xml,
        }


def read_recipe(document: Mapping[str, Any], *, any_versions: bool = False) -> Recipe:
    """Build a recipe from a `document` of `Recipe.document`.

    Args:
      any_versions: whether libraries here may have other versions, which may change last bits.

    Raises:
      StoreError: the document is damaged, or would make another store here.
      InputError: the recipe needs a sensor, a vehicle part or a file that is missing here.
    """
    try:
        settings, text = document[attributes.SETTINGS], document[attributes.VEHICLE_MJCF]
        preset = settings["preset"]
        recipe = Recipe(
            preset=preset,
            hours=None if PRESETS[preset].fixed_missions else settings["hours"],
            seed=settings["seed"],
            changes=document[attributes.CHANGES],
            vehicle=parse_vehicle(text, Path(f"{settings['vehicle']}.xml")),
            sensors=SensorSuite.from_settings(settings["sensors"]),
            current=settings["current"],
            engine=settings.get("engine", ENGINES[0]),
        )
    except (KeyError, TypeError, AttributeError) as error:
        if isinstance(error, TwinError):
            raise
        raise StoreError(
            f"the recipe cannot be read ({type(error).__name__}: {error}): it is damaged"
        ) from error
    here = recipe.describe()
    if any_versions:
        settings = {**settings, VERSIONS: here[VERSIONS]}
    changed = differences(settings, here)
    if changed:
        raise StoreError(
            f"this program would make another store of that recipe: {'; '.join(changed[:5])}"
        )
    return recipe


def make_recipe(
    *, vehicle: str = "glider", changes: Mapping[str, str | float] | None = None,
    labels: str = "truth", **settings: Any,
) -> Recipe:  # fmt: skip
    """Make a recipe from names.

    Args:
      vehicle: shipped name, or the path of an MJCF file.
      changes: replaced distributions, by parameter name.
      labels: `truth`, or the sensor whose velocities are kept beside it, `camera`.
      settings: other fields of `Recipe`, such as preset and hours.

    Raises:
      InputError: unknown preset, parameter, vehicle, sensor suite or engine; impossible value.
      MissionError: a replaced distribution dives too deep for the vehicle; a preset's own warns.
    """
    recipe = Recipe(vehicle=load_vehicle(vehicle), changes=dict(changes or {}), **settings)
    if labels != "truth":
        if labels not in SENSORS:
            raise InputError(
                f"labels {labels!r} come with a plugin that is not installed: "
                f"{installation('plugins/vision')}"
            )
        recipe = replace(recipe, sensors=f"{recipe.sensor_preset}+{labels}")
    _check_depths(recipe)
    return recipe


def _check_depths(recipe: Recipe) -> None:
    """Refuse given depths far below the one that the vehicle is built for; warn of a preset's."""
    if PRESETS[recipe.preset].fixed_missions:
        check_depth(recipe.parameters(0, 0).deepest_m, recipe.vehicle)
        return
    for name in ("mission.start_depth_m", "mission.max_depth_m", "mission.depth_m"):
        drawn = recipe.distributions.get(name, Fixed(0.0))
        try:
            check_depth(drawn.highest, recipe.vehicle)
        except MissionError as error:
            text = f"{name} = {drawn.text()}: {error}"
            if name in recipe.changes:
                raise MissionError(text) from None
            warnings.warn(f"preset {recipe.preset!r}: {text}", stacklevel=3)


def sha256(text: str) -> str:
    """Return the SHA-256 of a text, hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def versions(vehicle: Vehicle) -> dict[str, str]:
    """Return the versions of all software that can change a bit of the vehicle's results."""
    return {
        "glider-twin": __version__,
        "physics": str(vehicle.physics_version),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "mujoco": mujoco.__version__,
        "numba": numba.__version__,
        "numpy": np.__version__,
    }


def differences(old: Mapping[str, Any], new: Mapping[str, Any], prefix: str = "") -> list[str]:
    """List the entries in which two descriptions differ, as `name: old -> new`."""
    lines: list[str] = []
    for name in sorted(old.keys() | new.keys()):
        a, b = old.get(name), new.get(name)
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            lines += differences(a, b, f"{prefix}{name}.")
        elif a != b:
            lines.append(f"{prefix}{name}: {a} -> {b}")
    return lines
