"""Signatures: change of a dive's channels by each fault of size 1, from flights of the twin.

The same dive is flown sound and with each fault that the vehicle can have, by the batched engine.
The difference of the two flights' channels over the fault's size is the signature. A new kind of
fault needs no line here.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np

from glider_twin_ops.health.channels import FLOWN, NAMES, NOISE, PLACE
from glider_twin_ops.health.dive_channels import DiveSignals, channels_of, flight_model
from twin import (
    DensityProfile,
    FlatFloor,
    Mission,
    Profile,
    SawTooth,
    Scenario,
    SensorSuite,
    Surface,
    Trajectory,
    Vehicle,
)
from twin.errors import MissionError, TwinError
from twin.faults import DAY, FAULTS, Fault, faults_of, read_by
from twin.mission import track_to_follow
from twin.numbers import Array
from twin.physics import BODY, Lane, differs, electric_signals, flown_abreast, healthy
from twin.vehicle.parts import Fin

GROWN, PATIENCE = 1.0, 60.0
"""GROWN: [d] age at which the signature of a growing fault is taken. PATIENCE: [s] longest flight
for each metre of depth, since a vehicle without a wing is slow"""
FLOOR_BELOW, DEEP = 20.0, 250.0
"""[m] FLOOR_BELOW: height of the dive's turn above the floor, so that an altimeter hears it. DEEP:
smallest sum of the depths of all yos"""
OCEAN, PER_SALINITY = 1025.0, 0.77
"""[kg/m3] OCEAN: density of the gliders' ballasting. PER_SALINITY: rise per unit of salinity"""
HEADING, SHEAR, SETTLED = 30.0, 3e-4, 300.0
"""HEADING: [degree] of the flights. SHEAR: [1/s] of the sheared flight, 6 cm/s over 200 m. SETTLED:
[s] time in a flight at which a fault begins that does not grow"""
FLATTER = 1.0
"""[degree] Pitch by which a second sound dive is flatter; its changes of channels, as where a weak
turn settles, are subtracted from signatures"""
ASTRAY = 10.0
"""[degree] Median heading error of a sound dive above which signatures of `TURNING` are unknown,
since the steering is at its limit"""
TURNING = ("roll_dive", "roll_climb", "turn_dive", "turn_climb")
"""Channels of roll and steering"""
STEEPER, STEEPEST, DEEPER, TRIES = 6.0, 45.0, 40.0, 5
"""Changes of a dive in which a vehicle stalls. STEEPER: [degree] by which it is steeper, up to
STEEPEST. DEEPER: [m], since turns take most of a shallow dive. TRIES: number of tries"""
FLATTEST, PITCH_STEP, MASS_STEP = 8.0, 5.0, 0.3
"""FLATTEST: [degree] smallest pitch of a dive that replaces another. A change of pitch by
PITCH_STEP [degree] counts as much as one of the net mass' logarithm by MASS_STEP."""
MASSES = (1.0, 0.8, 1.25, 0.6, 1.6, 0.4, 0.25)
"""Factors on the net mass that are tried"""
ASCENT = 35.0
"""[degree] Usual pitch of the ascent to the surface"""
TRIM = ("trim_dive", "trim_climb")
RATES = [PLACE[name] for name in ("rate_dive", "rate_climb")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class TypicalDive:
    """Usual dive of a vehicle, in which faults are flown; pitches in [degree]."""

    depth: float
    """[m] Depth of the lower turn"""
    pitch: float
    climb_pitch: float
    net_mass: float
    """[kg] Net mass in dives, heavy"""
    climb_net_mass: float
    """[kg] Net mass in climbs, light"""
    period: float
    """[s] Sample period"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """Fault of size 1, in one of the variants that a vehicle can have."""

    fault: Fault
    signature: Array
    """Change of each channel, (channels,), or in each dive, (dives, channels); of a growing fault a
    day after its begin; NaN where unknown"""
    scale: float
    """Usual size of the fault"""
    exact: bool = False
    """True where the fault itself states its signature, which no flight predicts"""

    @property
    def kind(self) -> str:
        """Kind of the fault."""
        return self.fault.kind


def usual_dive(vehicle: Vehicle, period: float = 4.0, depth: float = 150.0) -> TypicalDive:
    """Usual glide of a vehicle's file as a dive."""
    pitch, _ = vehicle.usual_glide
    lightest, heaviest = vehicle.net_mass_range
    return TypicalDive(
        depth=depth, pitch=math.degrees(pitch), climb_pitch=math.degrees(pitch),
        net_mass=0.5 * heaviest, climb_net_mass=-0.5 * lightest, period=period,
    )  # fmt: skip


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Signatures:
    """Changes of a dive's channels by faults and by a sheared current."""

    hypotheses: tuple[Hypothesis, ...]
    """All faults that the vehicle can have"""
    dive: TypicalDive | None
    """Dive that was flown; None where the vehicle cannot fly any near the asked one"""
    sheared: Array
    """Change of each channel per 1/s of shear of the current across the heading, (channels,); NaN
    where unknown"""

    def in_dives(self, way: Array) -> list[Hypothesis]:
        """Hypotheses of a deployment, with signatures of each dive where the fault states them.

        Args:
          way: mean velocity through the water of each dive by the compass [m/s], (dives, 2); NaN
            where unknown.
        """
        found = []
        for one in self.hypotheses:
            told = one.fault.expected(np.nan_to_num(way))
            if told is not None:
                signature = np.zeros((len(way), len(NAMES)))
                for name, values in told.items():
                    signature[:, PLACE[name]] = values
                one = dataclasses.replace(one, signature=signature, exact=True)
            found.append(one)
        return found


def held(vehicle: Vehicle, dive: TypicalDive) -> TypicalDive | None:
    """Nearest dive whose pitches and net masses the balance of forces can hold, or None."""
    lightest, heaviest = vehicle.net_mass_range
    found: dict[str, float] = {}
    for way, sign, most in (("", 1.0, heaviest), ("climb_", -1.0, -lightest)):
        pitch, mass = getattr(dive, f"{way}pitch"), getattr(dive, f"{way}net_mass")
        trials = sorted(
            (abs(off) / PITCH_STEP + abs(math.log(factor)) / MASS_STEP, pitch + off, factor)
            for off in range(-30, 31)
            for factor in MASSES
        )
        for _, angle, factor in trials:
            net = min(max(factor * mass, 0.02 * most), most)
            if FLATTEST <= angle <= STEEPEST and _holds(vehicle, sign, angle, net):
                found |= {f"{way}pitch": angle, f"{way}net_mass": net}
                break
        else:
            return None
    return dataclasses.replace(dive, **found)


def _holds(vehicle: Vehicle, sign: float, pitch: float, mass: float) -> bool:
    """True where a steady glide at a pitch [degree], and one a little flatter, exist."""
    try:
        for angle in (pitch, pitch - FLATTER):
            track_to_follow(vehicle, "dive", "pitch_deg", -sign * angle, sign * mass, None)
    except MissionError:
        return False
    return True


@functools.lru_cache(maxsize=64)
def _ascent_pitch(vehicle: Vehicle) -> float:
    """[degree] Pitch nearest to a usual ascent's that the vehicle holds with its pump full."""
    most = -vehicle.net_mass_range[0]
    every = sorted(np.arange(FLATTEST, STEEPEST + 1.0).tolist(), key=lambda p: abs(p - ASCENT))
    return next((pitch for pitch in every if _holds(vehicle, -1.0, pitch, most)), ASCENT)


def signatures_of(vehicle: Vehicle, dive: TypicalDive) -> Signatures:
    """Fly the signatures of all faults that a vehicle can have in a dive.

    A dive that the balance of forces cannot hold gives way to the nearest that it can. A vehicle
    that does not glide steadily in the dive flies a steeper, deeper one.
    """
    faults = [
        type(sample).of_size(math.sqrt(sample.sizes[0] * sample.sizes[1]), **choice)
        for name in faults_of(vehicle)
        for sample in [FAULTS[name]()]
        for choice in sample.choices(vehicle)
    ]
    flown = [fault for fault in faults if fault.expected(np.zeros((0, 2))) is None]
    nothing = np.full(len(NAMES), math.nan)
    best: tuple[TypicalDive | None, list[Array]] = None, [nothing] * (3 + len(flown))
    for more in range(TRIES):
        down, up = (min(p + more * STEEPER, STEEPEST) for p in (dive.pitch, dive.climb_pitch))
        deeper = dive.depth + more * DEEPER
        one = held(vehicle, dataclasses.replace(dive, depth=deeper, pitch=down, climb_pitch=up))
        if one is None:
            continue
        flatter = dataclasses.replace(
            one, pitch=one.pitch - FLATTER, climb_pitch=one.climb_pitch - FLATTER
        )
        cases: list[Case] = [(one, (), 0.0), (flatter, (), 0.0), (one, (), SHEAR)]
        table = _flown_channels(vehicle, cases + [(one, (fault,), 0.0) for fault in flown])
        if table is not None and (best[0] is None or np.isfinite(table[0][RATES]).all()):
            best = one, table
        if table is not None and (
            np.isfinite(table[0][RATES]).all() or flight_model(vehicle) is None
        ):
            break
    asked, (sound, beside, sheared, *table) = best
    leaning = np.where(FLOWN, (sheared - sound) / SHEAR, 0.0)
    found = [] if asked is None else _differences(vehicle, asked, flown, sound, beside, table)
    for fault in (one for one in faults if asked is None or one not in flown):
        found.append(Hypothesis(fault=fault, signature=0.0 * NOISE, scale=abs(fault.size)))
    return Signatures(hypotheses=tuple(found), sheared=leaning, dive=asked)


def _differences(
    vehicle: Vehicle,
    dive: TypicalDive,
    faults: Sequence[Fault],
    sound: Array,
    beside: Array,
    table: Sequence[Array],
) -> list[Hypothesis]:
    """Hypotheses of faults by their flights in a dive and by two sound flights."""
    loose = np.nan_to_num(np.abs(beside - sound))
    off = max(math.exp(each[PLACE["heading_error"]]) for each in (sound, beside))
    found, built = [], healthy(dive_scenario(vehicle, dive))
    for fault, channels in zip(faults, table, strict=True):
        shown = channels - sound
        shown = np.sign(shown) * np.maximum(np.abs(shown) - loose, 0.0)
        signature = shown / (fault.size * (GROWN if fault.grows else 1.0))
        signature[~FLOWN] = 0.0
        if differs(fault, built, BODY):
            # the depth at the surface depends on an air bladder, which the twin lacks
            signature[PLACE["surface_depth"]] = 0.0
        if off > ASTRAY:
            signature[[PLACE[name] for name in TURNING]] = math.nan
        # nobody knows at which side of the axis something hangs
        for share in (1.0, 0.0, -1.0) if fault.kind == "attached" else (1.0,):
            placed = np.where(np.isin(NAMES, TRIM), share * signature, signature)
            found.append(Hypothesis(fault=fault, signature=placed, scale=abs(fault.size)))
    return found


Case = tuple[TypicalDive, tuple[Fault, ...], float]
"""Dive, its faults, and the shear across its heading [1/s]"""


def _flown_channels(vehicle: Vehicle, cases: Sequence[Case]) -> list[Array] | None:
    """Fly dives with their faults; noise-free channels, NaN where one with a fault cannot be flown;
    None where a sound one cannot."""
    calibration = flight_model(vehicle)
    found = [np.full(len(NAMES), math.nan) for _ in cases]
    try:
        scenarios = [dive_scenario(vehicle, *case) for case in cases]
        for k, one in flown_abreast([Lane(one, until_flown=True) for one in scenarios]):
            if isinstance(one, Trajectory):
                found[k] = channels_of(told(scenarios[k], one), calibration)
            elif not cases[k][1]:
                return None
    except TwinError:
        return None
    return found


def dive_scenario(
    vehicle: Vehicle, dive: TypicalDive, faults: Sequence[Fault] = (), shear: float = 0.0
) -> Scenario:
    """Scenario of a dive with faults; several yos where it is shallow."""
    yos = max(math.ceil(DEEP / dive.depth), 1)
    bottom, across = 1.1 * dive.depth + FLOOR_BELOW, math.radians(HEADING + 90.0)
    current = Profile(
        depth=(0.0, bottom),
        north=(0.0, shear * bottom * math.cos(across)),
        east=(0.0, shear * bottom * math.sin(across)),
    )
    ascent = Surface(duration_s=120.0, pitch_deg=_ascent_pitch(vehicle))
    mission = Mission(
        segments=(
            ascent,
            SawTooth(
                heading_deg=HEADING, yos=yos, max_depth_m=dive.depth, min_depth_m=8.0,
                pitch_deg=dive.pitch, climb_pitch_deg=dive.climb_pitch, net_mass_kg=dive.net_mass,
                climb_net_mass_kg=dive.climb_net_mass,
            ),
            ascent,
        ),
        start_heading_deg=HEADING,
        ascent_pitch_deg=_ascent_pitch(vehicle),
        name="signature",
    )  # fmt: skip
    # water of the density that the vehicle is ballasted for
    fresher = max((OCEAN - vehicle.reference_density) / PER_SALINITY, -5.0)
    water = DensityProfile.thermocline(
        max_depth=dive.depth + 200.0,
        surface_salinity=max(33.4 - fresher, 0.0), deep_salinity=max(34.4 - fresher, 0.0),
    )  # fmt: skip
    return Scenario(
        vehicle=vehicle,
        believed=vehicle,
        mission=mission,
        faults=[  # a growing fault is a day old, another begins in flight
            dataclasses.replace(fault, start=-GROWN * DAY if fault.grows else SETTLED)
            for fault in faults
        ],
        density=water,
        current=current if shear else None,
        floor=FlatFloor(depth_m=bottom),
        engine="lanes",
        sample_period=min(dive.period, 4.0),
        duration=PATIENCE * dive.depth * yos,
    )


def told(scenario: Scenario, flown: Trajectory) -> DiveSignals:
    """Log of a flight without noise."""
    floor = scenario.floor
    signals: dict[str, Array] = dict(
        SensorSuite.preset("ideal").measure(
            flown.signals, dt=scenario.sample_period, rng_seed=np.random.SeedSequence(0),
            density=scenario.density,
            bottom_depth=floor.depth_m if isinstance(floor, FlatFloor) else None,
        )
    )  # fmt: skip
    signals |= electric_signals(scenario, flown)
    signals["commanded_heading"] = flown["commanded_heading"]
    signals |= read_by(
        scenario.faults, signals, flown.time, np.random.default_rng(0),
        period=scenario.sample_period,
    )  # fmt: skip
    for part in scenario.vehicle.parts:
        if isinstance(part, Fin):
            signals["measured_fin"] = signals[f"measured_{part.name}"]
    return DiveSignals(period=scenario.sample_period, signals=signals)
