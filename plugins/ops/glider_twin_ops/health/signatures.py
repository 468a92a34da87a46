"""Signatures: what each fault adds to the channels of a dive, by flights of the twin with it.

The same dive is flown sound and with each fault that the vehicle can have, in lanes, and each
flight's channels are taken as from a log; the difference over the size is the signature. A kind of
one's own so needs no line here.
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
"""[d] after which the signature of what grows is taken; [s] for each metre of depth: a vehicle
without a wing is slow"""
FLOOR_BELOW, DEEP = 20.0, 250.0
"""[m] of the floor below the dive, so that an altimeter hears it; and that is dived at least, in
as many yos as that takes"""
OCEAN, PER_SALINITY = 1025.0, 0.77
"""[kg/m3] that the shipped gliders are ballasted for, and by which a unit of salinity is denser"""
HEADING, SHEAR, SETTLED = 30.0, 3e-4, 300.0
"""[degree] of the flights; [1/s] of the sheared one: 6 cm/s over 200 m; [s] of a flight after which
a fault begins that began at once"""
FLATTER = 1.0
"""[degree] by which a second sound dive is flatter: what already that changes, as where a weak turn
settles, is no part of a signature"""
ASTRAY = 10.0
"""[degree], median of its heading's error, from which on a sound vehicle's turns, and what a fault
makes of them, are not told: what turns it is at its end"""
TURNING = ("roll_dive", "roll_climb", "turn_dive", "turn_climb")
"""Channels of what holds the heading"""
STEEPER, STEEPEST, DEEPER, TRIES = 6.0, 40.0, 40.0, 5
"""[degree] by which a dive is steeper where a vehicle stalls from the surface on, as real ones
begin theirs steeply, and the most; [m] by which it is deeper, where turns take most of it; dives"""
RATES = [PLACE[name] for name in ("rate_dive", "rate_climb")]
LIKE = 0.97
"""Cosine between two signatures, over their noise, from which no channel tells them apart"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TypicalDive:
    """The dive that a vehicle usually makes, its pitches in [degree]; faults are flown in it."""

    depth: float
    """[m] of the lower turn"""
    pitch: float
    climb_pitch: float
    net_mass: float
    """[kg] heavy in dives"""
    climb_net_mass: float
    """[kg] light in climbs"""
    period: float
    """[s] between samples"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """A fault of size 1, in one of the ways that a vehicle can have it."""

    fault: Fault
    signature: Array
    """added to each channel, (channels,), or in each dive, (dives, channels); for what grows, a day
    after its begin; NaN where the twin does not tell"""
    scale: float
    """Size that it usually has"""

    @property
    def kind(self) -> str:
        """Of the fault."""
        return self.fault.kind


def usual_dive(vehicle: Vehicle, period: float = 4.0, depth: float = 150.0) -> TypicalDive:
    """Dive of a vehicle's file: its usual glide."""
    pitch, _ = vehicle.usual_glide
    lightest, heaviest = vehicle.net_mass_range
    return TypicalDive(
        depth=depth, pitch=math.degrees(pitch), climb_pitch=math.degrees(pitch),
        net_mass=0.5 * heaviest, climb_net_mass=-0.5 * lightest, period=period,
    )  # fmt: skip


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Signatures:
    """What faults and a sheared sea add to the channels of a vehicle's dive."""

    hypotheses: tuple[Hypothesis, ...]
    """of every fault that it can have"""
    sheared: Array
    """Response of each channel to a current across the heading that changes by 1 m/s in a metre of
    depth, (channels,); NaN where the twin does not tell"""

    def in_dives(self, way: Array) -> list[Hypothesis]:
        """Hypotheses in the dives of a deployment: what a kind itself expects of each dive.

        Args:
          way: mean velocity through the water of each dive by the compass [m/s], (dives, 2); NaN
            where it is not known.
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
    """Signatures of every fault that a vehicle can have in a dive, by flights.

    Where the vehicle does not glide steadily in it, it flies a steeper, deeper one.

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
            # how deep it floats is the affair of a bladder, which no twin has
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
"""A dive, its faults, and the shear across its heading [1/s]"""


def _flown_channels(vehicle: Vehicle, cases: Sequence[Case]) -> list[Array]:
    """Channels of dives with sets of faults, noise-free; NaN where one cannot be flown."""
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
    """A dive with faults, and where it is shallow several, so that it says as much."""
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
    # the water that the vehicle is ballasted for
    fresher = max((OCEAN - vehicle.reference_density) / PER_SALINITY, -5.0)
    water = DensityProfile.thermocline(
        max_depth=dive.depth + 200.0,
        surface_salinity=max(33.4 - fresher, 0.0), deep_salinity=max(34.4 - fresher, 0.0),
    )  # fmt: skip
    return Scenario(
        vehicle=vehicle,
        believed=vehicle,
        mission=mission,
        faults=[  # grown for some days, or begun at once
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
    """A flight as a log without noise."""
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
    """Kinds that no channel with a noise tells from each kind, which is among them.

    Args:
      noise: of each channel, (channels,); infinite where a log lacks it.
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
