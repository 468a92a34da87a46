"""Deployment: many dives of one simulated vehicle in one sea, with or without a fault.

A deployment is one long mission of preset `field`: hours of yos between surface intervals, to one
depth at one pitch, on legs of several headings. The batched engine flies it, the preset's sensors
measure it. Its log holds what a glider logs: no truth, no gyroscopes.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from factory.sampling import (
    Distribution,
    Impossible,
    Parameters,
    Table,
    ballast_of,
    believed_vehicle,
    build_current,
    build_density,
    check_possible,
    declared,
    draw_values,
    encoder_zeros,
    number,
    origin,
    override,
    parameter_table,
    propelled,
    spread_vehicle,
)
from glider_twin_ops.presets.pilot import LogGaps, Settings, draw_gaps, draw_settings
from twin import FlatFloor, Mission, SawTooth, Scenario, SensorSuite, Surface, Trajectory, Vehicle
from twin.errors import InputError, TwinError
from twin.faults import FAULTS, Fault, faults_of, read_by
from twin.mission import track_to_follow
from twin.numbers import Array
from twin.physics import Lane, electric_signals, flown_abreast
from twin.sensors import Dvl

PERIODS = {"faulty": 4.0, "faulty-satellite": 60.0, "piloted": 4.0, "piloted-satellite": 60.0}
"""[s] Sample period of each preset: of recovered files, and of files sent by satellite; a pilot
changes the settings of `piloted` ones"""
DIVES = (20, 60)
"""Minimum and maximum number of dives of a deployment, each from fix to fix"""
HOURS = (2.0, 3.5)
"""[h] Shortest and longest dive under water, in which shallow vehicles make several yos"""
STAY = 600.0
"""[s] Surface interval between dives"""
LEG = (4, 10)
"""Minimum and maximum number of dives on one heading"""
JITTER = 0.03
"""Standard deviation from dive to dive of a setting, over its value"""
HEALTHY_DIVES = 0.25
"""Smallest fraction of the dives that are healthy, at the beginning"""
ABOVE_FLOOR = (20.0, 50.0)
"""[m] Height of the deepest turn above the floor, so that an altimeter hears it"""
CIRCLING = 3600.0
"""[s] No sound vehicle heads away from its commanded heading for more than half of this time"""
NOT_DRAWN = {"faulty": ("dvl_beam", "compass_turned"), "piloted": ("dvl_beam",)}
"""Faults that deployments do not sample: those of instruments that these vehicles lack, and those
that are younger than the preset"""
_KEY = 0xFA17
"""Key of the random streams of deployments"""

# --- internal waves ---------------------------------------------------------------------------
WAVES = 16
"""Number of sinusoids in the water's vertical velocity"""
WAVE_PERIODS = (480.0, 5400.0)
"""[s] Shortest and longest period, from the buoyancy period to about a dive; the vertical velocity
is nearly white between (Garrett and Munk 1979)"""
WAVE_SPEED = (0.002, 0.012)
"""[m/s] Smallest and largest standard deviation of the vertical water velocity, from public logs
(docs/results/real_logs.md)"""
WAVE_DEPTH = 20.0
"""[m] Depth scale over which a displacement grows from 0 at the surface"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeploymentDraw:
    """Deployment sampled for flight and measurement."""

    number: int
    attempt: int
    """Index of the sample; the first that can be flown is used"""
    scenario: Scenario
    dives: int
    fault: Fault | None
    onset: float
    """Number of the first dive with the fault; NaN without one"""
    sensor_seed: np.random.SeedSequence
    parameters: Parameters
    wave_speed: float
    """[m/s] Standard deviation of the vertical water velocity"""
    gaps: LogGaps = LogGaps()
    """Samples that the log lacks"""

    @property
    def name(self) -> str:
        """Name in stores."""
        return f"{self.scenario.vehicle.name}-{self.number:05d}"

    @property
    def kind(self) -> str:
        """Type of the fault; `none` without one."""
        return "none" if self.fault is None else self.fault.kind


def _stream(seed: int, *key: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(_KEY, *key))


def fault_kinds(
    vehicle: Vehicle, wanted: Sequence[str] = (), preset: str = "faulty"
) -> tuple[str, ...]:
    """Types of faults that a vehicle's deployments sample.

    Args:
      wanted: types to sample; default: all that the vehicle can have.

    Raises:
      InputError: the vehicle cannot have a wanted type.
    """
    without = NOT_DRAWN[preset.removesuffix("-satellite")]
    possible = tuple(name for name in faults_of(vehicle) if name not in without)
    for name in wanted:
        if FAULTS[name].kind not in possible:
            raise InputError(
                f"vehicle {vehicle.name!r} cannot show fault {name!r} in a glider's log; it can "
                f"show {', '.join(possible)}"
            )
    return tuple(wanted) or possible


@dataclasses.dataclass(frozen=True, kw_only=True)
class DeploymentPlan:
    """Settings of simulated deployments; their bytes depend on nothing else."""

    vehicle: Vehicle
    preset: str = "faulty"
    seed: int = 0
    kinds: tuple[str, ...] = ()
    """Types of faults that are sampled; () means all that the vehicle can have"""
    size: float | None = None
    """Size of every fault; None samples it"""

    def __post_init__(self) -> None:
        if self.preset not in PERIODS:
            raise InputError(f"preset {self.preset!r} is none of {', '.join(PERIODS)}")
        if propelled(self.vehicle):
            raise InputError(
                f"preset {self.preset!r} flies dives of a glider, and vehicle "
                f"{self.vehicle.name!r} has a propeller; choose a glider, such as slocum-200, or "
                "fly it with `twin simulate --fault`"
            )
        object.__setattr__(self, "kinds", fault_kinds(self.vehicle, self.kinds, self.preset))

    @property
    def period(self) -> float:
        """[s] Sample period."""
        return PERIODS[self.preset]

    @property
    def piloted(self) -> bool:
        """True where a pilot changes the settings."""
        return self.preset.startswith("piloted")

    @functools.cached_property
    def tables(self) -> tuple[Table, dict[str, Distribution]]:
        """Parameters and their distributions."""
        table = parameter_table(self.vehicle)
        fixed: dict[str, str | float] = {"mission.kind": "saw-tooth"}
        return table, override(declared("field", table), fixed)

    def draw(self, index: int, attempt: int, faulty: bool) -> DeploymentDraw:
        """Sample one deployment, with a fault or without.

        Raises:
          MissionError, NoSteadyState: the vehicle cannot fly it.
        """
        table, distributions = self.tables
        rng = np.random.default_rng(_stream(self.seed, index, attempt))
        values = draw_values(table, distributions, seed=self.seed, mission=index, attempt=attempt)
        segment = {
            name: distributions[name].draw(rng) for name, row in table.items() if row.per_segment
        }
        segment["mission.min_depth_m"] = 8.0
        dives, settings, gaps = 0, None, LogGaps()
        if self.piloted:
            own = np.random.default_rng(_stream(self.seed, index, attempt, 2))
            dives = int(own.integers(DIVES[0], DIVES[1] + 1))
            settings = self._settings(segment, dives, own)
            segment["mission.max_depth_m"] = max(one["max_depth_m"] for one in settings)
        parameters = Parameters(duration_s=3600.0, values=values, segments=(segment,))
        flown = spread_vehicle(self.vehicle, parameters)
        believed = believed_vehicle(self.vehicle, parameters)
        dives = dives or int(rng.integers(DIVES[0], DIVES[1] + 1))
        mission, lengths = _mission(segment, dives, believed, values, rng, settings)
        if settings is not None:
            gaps = draw_gaps(dives, sum(lengths), own)
        fault, onset = _fault(self, dives, lengths, rng) if faulty else (None, math.nan)
        deepest = max(s.max_depth_m for s in mission.segments if isinstance(s, SawTooth))
        scenario = Scenario(
            vehicle=flown,
            believed=believed,
            ballast=ballast_of(self.vehicle, parameters),
            encoder_zeros=encoder_zeros(self.vehicle, parameters),
            mission=mission,
            duration=self.period * math.ceil(sum(lengths) / self.period),
            faults=() if fault is None else (fault,),
            current=build_current(parameters),
            density=build_density(parameters),
            floor=FlatFloor(depth_m=deepest * (1 + 3 * JITTER) + float(rng.uniform(*ABOVE_FLOOR))),
            origin=origin(parameters),
            engine="lanes",
            sample_period=self.period,
        )
        # refused here and not in flight, where its block would wait for another sample
        scenario.mission_in_metres().compile(believed)
        return DeploymentDraw(
            number=index,
            attempt=attempt,
            scenario=scenario,
            dives=dives,
            fault=fault,
            onset=onset,
            sensor_seed=_stream(self.seed, index, attempt, 1),
            parameters=parameters,
            wave_speed=float(rng.uniform(*WAVE_SPEED)),
            gaps=gaps,
        )

    def _settings(
        self, segment: dict[str, Any], dives: int, rng: np.random.Generator
    ) -> list[Settings]:
        """Settings of each dive, by a pilot."""
        first = {name: number(segment, f"mission.{name}") for name in SET}

        def check(settings: Settings) -> None:
            tooth = SawTooth(heading_deg=0.0, yos=1, min_depth_m=8.0, **settings)
            Mission(segments=(tooth,), name="deployment").compile(self.vehicle)

        _, distributions = self.tables
        return draw_settings(first, distributions, self.vehicle.rated_depth, dives, check, rng)


def faulty_of(seed: int, index: int) -> bool:
    """True for deployments with a fault: one of each pair."""
    first = bool(np.random.default_rng(_stream(seed, index // 2, 0xC0)).integers(2))
    return first == (index % 2 == 0)


SET = ("max_depth_m", "pitch_deg", "climb_pitch_deg", "net_mass_kg", "climb_net_mass_kg")
"""Settings of a dive"""


def _mission(
    drawn: dict[str, Any],
    dives: int,
    vehicle: Vehicle,
    values: Any,
    rng: np.random.Generator,
    settings: Sequence[Settings] | None = None,
) -> tuple[Mission, list[float]]:
    """Mission, and the approximate duration [s] of each dive with its surface interval."""
    shallow = number(drawn, "mission.min_depth_m")
    same = {name: number(drawn, f"mission.{name}") for name in SET}
    every = [same] * dives if settings is None else settings
    one_yo = {id(one): _yo_time(vehicle, one, shallow) for one in every}
    under = 3600.0 * float(rng.uniform(*HOURS))
    heading, left = float(values["mission.start_heading_deg"]), 0
    segments: list[Any] = []
    lengths = []
    for dive in every:
        if left == 0:
            heading = (heading + float(rng.uniform(-120.0, 120.0))) % 360.0
            left = int(rng.integers(*LEG))
        left -= 1
        yos = dive.get("yos", max(1, round(under / one_yo[id(dive)])))
        one = {n: dive[n] * (1.0 + JITTER * float(rng.standard_normal())) for n in SET}
        tooth = SawTooth(heading_deg=heading, yos=yos, min_depth_m=shallow, **one)
        segments += [Surface(duration_s=STAY), tooth]
        lengths.append(STAY + yos * one_yo[id(dive)])
    lengths.append(STAY + 300.0)
    mission = Mission(
        segments=(*segments, Surface(duration_s=STAY)),
        start_heading_deg=heading,
        at_end="surface",
        name="deployment",
        duration_s=sum(lengths),
    )
    return mission, lengths


def _yo_time(vehicle: Vehicle, settings: Settings, shallow: float) -> float:
    """[s] Duration of a dive and climb at steady speeds."""
    found = 0.0
    for sign, way in ((1.0, ""), (-1.0, "climb_")):
        pitch, mass = f"{way}pitch_deg", f"{way}net_mass_kg"
        steady = track_to_follow(
            vehicle, "deployment", pitch, -sign * settings[pitch], sign * settings[mass], None,
            within_travel=True,
        )  # fmt: skip
        found += (settings["max_depth_m"] - shallow) / abs(steady.vertical_speed)
    return found


def _fault(
    plan: DeploymentPlan, dives: int, lengths: Sequence[float], rng: np.random.Generator
) -> tuple[Fault, float]:
    """Sample a fault that the vehicle can have, and its first dive."""
    kind = FAULTS[plan.kinds[int(rng.integers(len(plan.kinds)))]]
    least, most = kind.sizes
    size = float(np.exp(rng.uniform(math.log(least), math.log(most)))) if most > least else most
    size = size if plan.size is None else plan.size
    size *= float(rng.choice([-1.0, 1.0])) if kind.signed else 1.0
    choices = kind.of_size(size).choices(plan.vehicle)
    others = dict(choices[int(rng.integers(len(choices)))])
    first = max(math.ceil(HEALTHY_DIVES * dives), 6)
    onset = int(rng.integers(first, max(dives - 6, first + 1)))
    if kind.kind == "compass_iron":
        others["toward"] = float(rng.uniform(0.0, 360.0))
    return kind.of_size(size, sum(lengths[:onset]), **others), float(onset)


# --- flown --------------------------------------------------------------------------------------


def fly_deployments(
    draws: Sequence[DeploymentDraw], suite: SensorSuite
) -> Iterator[tuple[int, dict[str, Array] | TwinError]]:
    """Fly deployments; yield each one's index with its signals, (n,), or the error.

    Deployments come in any order.
    """
    lanes, places = [], []
    for index, draw in enumerate(draws):
        try:
            lanes.append(Lane(draw.scenario))
            places.append(index)
        except TwinError as error:
            yield index, error
    for lane, found in flown_abreast(lanes):
        place = places[lane]
        if isinstance(found, Trajectory):
            try:
                check_possible(found.signals, found.time)
                check_steered(draws[place], found)
            except TwinError as error:
                yield place, error
            else:
                yield place, measured(draws[place], found, lanes[lane], suite)
        else:
            yield place, found


def check_steered(draw: DeploymentDraw, flown: Trajectory) -> None:
    """Raise Impossible where a vehicle circled before its fault, as no pilot would let it."""
    sound = math.inf if draw.fault is None else draw.fault.start
    used = (flown.time < sound) & (flown["true_depth"] > 1.0)
    off = np.deg2rad(flown["true_heading"] - flown["commanded_heading"])[used]
    time, away = flown.time[used], np.cos(off) < 0.0
    for begin in np.arange(0.0, flown.time[-1], CIRCLING):
        some = away[(time >= begin) & (time < begin + CIRCLING)]
        if some.sum() > 0.5 * max(len(some), 1):
            raise Impossible("it circled before it had a fault", time_s=float(begin))


def measured(
    draw: DeploymentDraw, flown: Trajectory, lane: Lane, suite: SensorSuite
) -> dict[str, Array]:
    """Signals that a glider logs of a flight, each (n,)."""
    scenario, period = draw.scenario, draw.scenario.sample_period
    rng = np.random.default_rng(draw.sensor_seed.spawn(1)[0])
    moved = heave_of_waves(flown, draw.wave_speed, rng)
    truth = {**flown.signals, "true_depth": flown["true_depth"] + moved}
    found: dict[str, Any] = dict(
        suite.replace(dvl=Dvl(fitted=False)).measure(
            truth,
            dt=period,
            rng_seed=draw.sensor_seed,
            drawn=suite.draw(draw.sensor_seed),
            bottom_depth=scenario.floor.depth_m if isinstance(scenario.floor, FlatFloor) else None,
            floor=lane.tables.floor,
            latitude=scenario.place.latitude_deg,
            longitude=scenario.place.longitude_deg,
            density=scenario.density,
        )
    )
    found |= electric_signals(scenario, flown, rng)
    found |= {name: flown[name] for name in flown.signals if name.startswith("commanded_")}
    found |= read_by(scenario.faults, found, flown.time, rng, period=period)
    return {name: np.asarray(values, float) for name, values in found.items()} | {
        "time": flown.time
    }


def heave_of_waves(flown: Trajectory, speed: float, rng: np.random.Generator) -> Array:
    """[m] Downward displacement of the water by internal waves at each sample, (n,).

    The vehicle moves with the water; its flight through the water is unchanged.
    """
    low, high = (math.log(1.0 / period) for period in WAVE_PERIODS[::-1])
    rate = 2.0 * math.pi * np.exp(rng.uniform(low, high, WAVES))
    phase = rng.uniform(0.0, 2.0 * math.pi, WAVES)
    size = speed * math.sqrt(2.0 / WAVES) / rate
    moved = np.zeros(len(flown.time))
    for one, at, far in zip(rate, phase, size, strict=True):
        moved += far * np.sin(one * flown.time + at)
    return moved * np.tanh(np.maximum(flown["true_depth"], 0.0) / WAVE_DEPTH)
