"""Signatures: change of a dive's channels by each fault of size 1, from flights of the twin.

The same dive is flown sound and with each fault that the vehicle can have, by the batched engine.
The difference of the two flights' channels over the fault's size is the signature. A new kind of
fault needs no line here.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from glider_twin_ops.health.channels import FLOWN, NAMES, PLACE
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
from twin.errors import InputError, TwinError
from twin.faults import DAY, FAULTS, Fault, faults_of, read_by
from twin.numbers import Array
from twin.physics import BODY, Lane, differs, electric_signals, flown_abreast, healthy
from twin.vehicle.parts import Fin

GROWN, PATIENCE = 1.0, 60.0
"""[d] Age at which the signature of a growing fault is taken; [s] longest flight for each metre of
depth, since a vehicle without a wing is slow"""
FLOOR_BELOW, DEEP = 20.0, 250.0
"""[m] Height of the dive's turn above the floor, so that an altimeter hears it; [m] least sum of
the depths of all yos"""
OCEAN, PER_SALINITY = 1025.0, 0.77
"""[kg/m3] Density that the shipped gliders are ballasted for, and its rise per unit of salinity"""
HEADING, SHEAR, SETTLED = 30.0, 3e-4, 300.0
"""[degree] Heading of the flights; [1/s] shear of the sheared one, 6 cm/s over 200 m; [s] time of a
flight at which a fault begins that does not grow"""
FLATTER = 1.0
"""[degree] Pitch by which a second sound dive is flatter; its changes of channels, as where a weak
turn settles, are subtracted from signatures"""
ASTRAY = 10.0
"""[degree] Median heading error of a sound dive above which signatures of `TURNING` are unknown,
since the steering is at its limit"""
TURNING = ("roll_dive", "roll_climb", "turn_dive", "turn_climb")
"""Channels of roll and steering"""
STEEPER, STEEPEST, DEEPER, TRIES = 6.0, 40.0, 40.0, 5
"""Changes of a dive in which a vehicle stalls: [degree] steeper, up to the steepest; [m] deeper,
since turns take most of a shallow one; number of tries"""
RATES = [PLACE[name] for name in ("rate_dive", "rate_climb")]
LIKE = 0.97
"""Cosine of two signatures, over their noise, above which no channel tells them apart"""


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
                one = dataclasses.replace(one, signature=signature)
            found.append(one)
        return found


def signatures_of(vehicle: Vehicle, dive: TypicalDive) -> Signatures:
    """Fly the signatures of all faults that a vehicle can have in a dive.

    A vehicle that does not glide steadily in the dive flies a steeper, deeper one.

    Raises:
      InputError: the vehicle's dive cannot be flown.
    """
    faults = [
        type(sample).of_size(math.sqrt(sample.sizes[0] * sample.sizes[1]), **choice)
        for name in faults_of(vehicle)
        for sample in [FAULTS[name]()]
        for choice in sample.choices(vehicle)
    ]
    flown = [fault for fault in faults if fault.expected(np.zeros((0, 2))) is None]
    for more in range(TRIES):
        down, up = (min(p + more * STEEPER, STEEPEST) for p in (dive.pitch, dive.climb_pitch))
        one, flatter = (
            dataclasses.replace(
                dive, depth=dive.depth + more * DEEPER, pitch=down - less, climb_pitch=up - less
            )
            for less in (0.0, FLATTER)
        )
        cases: list[Case] = [(one, (), 0.0), (flatter, (), 0.0), (one, (), SHEAR)]
        cases += [(one, (fault,), 0.0) for fault in flown]
        sound, beside, sheared, *table = _flown_channels(vehicle, cases)
        if np.isfinite(sound[RATES]).all() or flight_model(vehicle) is None:
            break
    else:
        raise InputError(
            f"vehicle {vehicle.name!r} does not glide steadily in the dive that its logs show, nor "
            f"in one to {one.depth:g} m; give the vehicle that made them with --vehicle"
        )
    loose = np.nan_to_num(np.abs(beside - sound))
    off = max(math.exp(each[PLACE["heading_error"]]) for each in (sound, beside))
    found, built = [], healthy(dive_scenario(vehicle, one))
    for fault, channels in zip(flown, table, strict=True):
        shown = channels - sound
        shown = np.sign(shown) * np.maximum(np.abs(shown) - loose, 0.0)
        signature = shown / (fault.size * (GROWN if fault.grows else 1.0))
        signature[~FLOWN] = 0.0
        if differs(fault, built, BODY):
            # the depth at the surface depends on an air bladder, which the twin lacks
            signature[PLACE["surface_depth"]] = 0.0
        if off > ASTRAY:
            signature[[PLACE[name] for name in TURNING]] = math.nan
        found.append(Hypothesis(fault=fault, signature=signature, scale=abs(fault.size)))
    for fault in (one for one in faults if one not in flown):
        nothing = np.zeros(len(NAMES))
        found.append(Hypothesis(fault=fault, signature=nothing, scale=abs(fault.size)))
    leaning = np.where(FLOWN, (sheared - sound) / SHEAR, 0.0)
    return Signatures(hypotheses=tuple(found), sheared=leaning)


Case = tuple[TypicalDive, tuple[Fault, ...], float]
"""Dive, its faults, and the shear across its heading [1/s]"""


def _flown_channels(vehicle: Vehicle, cases: Sequence[Case]) -> list[Array]:
    """Fly dives with their faults; noise-free channels, NaN where one cannot be flown."""
    scenarios = [dive_scenario(vehicle, *case) for case in cases]
    calibration = flight_model(vehicle)
    found = [np.full(len(NAMES), math.nan) for _ in cases]
    try:
        for k, one in flown_abreast([Lane(one, until_flown=True) for one in scenarios]):
            if isinstance(one, Trajectory):
                found[k] = channels_of(told(scenarios[k], one), calibration)
            elif not cases[k][1]:
                raise one
    except TwinError as error:
        raise InputError(
            f"vehicle {vehicle.name!r}: the dive that its logs show cannot be flown ({error}); "
            "give the vehicle that made them with --vehicle"
        ) from error
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
    mission = Mission(
        segments=(
            Surface(duration_s=120.0),
            SawTooth(
                heading_deg=HEADING, yos=yos, max_depth_m=dive.depth, min_depth_m=8.0,
                pitch_deg=dive.pitch, climb_pitch_deg=dive.climb_pitch, net_mass_kg=dive.net_mass,
                climb_net_mass_kg=dive.climb_net_mass,
            ),
            Surface(duration_s=120.0),
        ),
        start_heading_deg=HEADING,
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


def confusable(hypotheses: Sequence[Hypothesis], noise: Array) -> dict[str, set[str]]:
    """Kinds that cannot be told from each kind, itself included.

    Args:
      noise: standard deviation of each channel, (channels,); infinite where a log lacks it.
    """
    units: dict[str, list[Array]] = {}
    for one in hypotheses:
        scaled = np.nan_to_num(np.atleast_2d(one.signature)) * one.scale / noise
        flat = np.clip(scaled, -30.0, 30.0).ravel()
        if scaled.shape[0] == 1 and (size := float(np.linalg.norm(flat))) > 0.5:
            units.setdefault(one.kind, []).append(flat / size)
    found = {one.kind: {one.kind} for one in hypotheses}
    for a, mine in units.items():
        for b, theirs in units.items():
            if any(abs(float(x @ y)) > LIKE for x in mine for y in theirs):
                found[a].add(b)
    return found
