"""Handling: pitch, turns, travel of the parts and gains of a vehicle, fitted after its speed.

    found = identify(logs, load_calibration("seaglider"))     # trim, drag, hull, sensors
    handling = handle(logs, found)                            # pitch, turns, loops
    handling.identification.calibration, handling.failures

Each step starts from the one before: speeds of the flight model, pitches at which the moments
balance at these speeds, turns about these glides, and control loops on the resulting dynamics.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from twin.errors import InputError, MissionError, NoSteadyState
from twin.identify.answer import Identification, IdentifiedParameter
from twin.identify.calibration import Calibration
from twin.identify.comparison import Fitted
from twin.identify.fit import UNDETERMINED
from twin.identify.linear_motion import Phase, with_gains
from twin.identify.logged_missions import Log, gliding
from twin.identify.pitch import PITCHING, balanced, pump_of
from twin.identify.proof import failures
from twin.identify.turning_fit import turned
from twin.identify.turning_windows import channel_of, windows_of
from twin.mission.glide_balance import steady_glide
from twin.vehicle.vehicle import Vehicle

FAR = 3.0
"""Distance from the vehicle file's value in standard deviations beyond which a value counts as
determined, whatever its standard deviation"""
SLACK, ROOM = 0.1, 0.03
"""Fraction of a part's travel that is added beyond the log's positions; fraction of the battery's
travel that guidance keeps free beside the usual glide"""
UNEVEN = math.radians(3.0)
"""[rad] Distance between the neutral positions of dives and climbs above which a note says so"""
FLATTER = math.radians(0.5)
"""[rad] Step by which the usual glide is made flatter until the battery holds it"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Handling:
    """A vehicle that pitches, turns and is steered as its log, with the failures of its proof."""

    identification: Identification
    """Identification with the estimates of pitch and turns beside those of the flight model"""
    phases: tuple[Phase, ...]
    """Usual dive and climb of the log"""
    pitch_deviation: float | None
    """[rad] RMS residual of the steady pitches; None: not fitted"""
    turn_deviation: float | None
    """[rad/s] RMS residual of yaw rates averaged over up to 90 s; None: not fitted"""
    yaw_bias: float | None
    """[rad] Asymmetry that turns the vehicle at no roll and no rudder, as a sideslip"""
    roll_offset: float | None
    """[rad] Zero of the roll sensor, or roll of the vehicle's weight"""
    neutral: float | None
    """[rad] Position of the turning part, as flown, at which the vehicle goes straight"""
    failures: tuple[str, ...]
    """Failures of the vehicle; empty when it trims, is stable and steers in both phases"""
    notes: tuple[str, ...]
    """Sentences on values that stay the vehicle file's, with the reasons"""


def handle(
    logs: Sequence[Log],
    found: Identification,
    *,
    proof: bool = True,
    progress: Callable[[float], None] = lambda part: None,
) -> Handling:
    """Fit pitch and turns, place the gains, and prove the vehicle.

    Args:
      found: from `identify`. proof: fly the vehicle, and report its failures.
      progress: called with the fraction done, 0 to 1.
    """
    notes: list[str] = []
    logs, _ = gliding(logs)
    calibration = with_travel(logs, found.calibration)
    identification = dataclasses.replace(found, calibration=calibration)
    balance = None
    # a fit of the twin's rollouts includes the pitch
    if not {p.name for p in PITCHING} & {e.name for e in found.estimates}:
        balance = balanced(logs, calibration)
        if balance is None:
            notes.append("pitch: no battery positions in steady dives and climbs of these logs")
        else:
            calibration = balance.calibration
            identification = _with(identification, balance)
    progress(0.2)
    turns = turned(logs, calibration)
    progress(0.6)
    if turns is None:
        notes.append("turns: too few steady parts in dives and climbs of these logs")
    else:
        calibration = turns.fitted.calibration
        identification = _with(identification, turns.fitted)
        channel = channel_of(calibration)
        if turns.apart > UNEVEN:
            notes.append(
                f"asymmetry: to go straight, dives and climbs of these logs want the {channel} "
                f"{math.degrees(turns.apart):.0f} deg apart; the mean of the two is flown"
            )
        unseen = "roll" not in turns.fitted.deviation and channel is not None
        if unseen and any(group.position is None for group in turns.groups):
            notes.append(f"turns: the logs have no {channel}, so that what it does is not known")
    phases = phases_of(logs, calibration)
    lacking: tuple[str, ...] = ()
    if len(phases) == 2:
        calibration, note = with_usual_glide(calibration, phases)
        notes += [note] if note else []
        try:
            calibration = with_gains(calibration, phases)
        except (MissionError, NoSteadyState, InputError) as error:
            notes.append(f"gains: {error}")
        progress(0.8)
        if proof:
            lacking = failures(calibration, phases)
    else:
        lacking = ("the logs hold no steady dive and climb to try it in",)
    progress(1.0)
    return Handling(
        identification=dataclasses.replace(identification, calibration=calibration),
        phases=phases,
        pitch_deviation=None if balance is None else balance.deviation["pitch"],
        turn_deviation=None if turns is None else turns.fitted.deviation["yaw_rate"],
        yaw_bias=None if turns is None else turns.asymmetry[0],
        roll_offset=None if turns is None else turns.asymmetry[1],
        neutral=None if turns is None else turns.neutral,
        failures=lacking,
        notes=tuple(notes),
    )


def phases_of(logs: Sequence[Log], calibration: Calibration) -> tuple[Phase, ...]:
    """Usual dive and climb of the logs: medians over steady parts; a phase without any lacks."""
    windows = windows_of(logs, calibration)
    vehicle, pump = calibration.vehicle, pump_of(calibration)
    # in the log's layers the net mass may exceed the pump's; the proof is in water of one density
    light, heavy = (vehicle.net_mass_for_pump(end) for end in (pump.high, pump.low))
    found = []
    for climbing in (False, True):
        glides = [w.glide for w in windows if w.climbing == climbing]
        if glides:
            *_, pitch, net_mass = np.median(glides, axis=0)
            found.append(Phase(pitch=float(pitch), net_mass=float(np.clip(net_mass, light, heavy))))
    return tuple(found)


def with_usual_glide(calibration: Calibration, phases: Sequence[Phase]) -> tuple[Calibration, str]:
    """Set the usual glide, which missions without pitch or pump fly, to the log's.

    Its net mass is half of the difference between the two phases. Its pitch is the flatter of their
    pitches, or the steepest below it that the battery holds in dives and in climbs. With equal net
    masses the battery may have to move further than in the log, where the pump is far from the
    centre of buoyancy.

    Returns:
      the calibration, and a note with the reason; empty where the log's pitch is kept.
    """
    dive, climb = phases
    pitch = min(abs(dive.pitch), abs(climb.pitch))
    net_mass = 0.5 * (dive.net_mass - climb.net_mass)
    if pitch == 0.0 or net_mass <= 0.0:
        return calibration, ""
    vehicle = calibration.vehicle
    held = pitch
    while held > FLATTER and not _holds(vehicle, held, net_mass):
        held -= FLATTER
    if not _holds(vehicle, held, net_mass):
        return calibration, (
            f"usual glide: kept at the vehicle file's: the battery holds no pitch of dives and "
            f"climbs with {net_mass:.2f} kg, the log's usual net mass"
        )
    note = ""
    if held < pitch:
        note = (
            f"usual glide: {math.degrees(held):.1f} deg, where the log has "
            f"{math.degrees(pitch):.1f}: more takes the battery beyond its travel with "
            f"{net_mass:.2f} kg of net mass in dives and in climbs"
        )
    return calibration.with_vehicle(usual_glide=(held, net_mass)), note


def _holds(vehicle: Vehicle, pitch: float, net_mass: float) -> bool:
    """True where the battery holds this glide down and up, with room for guidance at its ends."""
    slide = vehicle.steered("pitch")
    assert slide is not None  # a calibration has one moving battery
    room = ROOM * (slide.high - slide.low)
    low, high = slide.low + room, slide.high - room
    try:
        shifts = [steady_glide(vehicle, -s * pitch, s * net_mass).shift for s in (1.0, -1.0)]
    except MissionError:
        return False  # too flat to glide at all
    return all(low <= shift <= high for shift in shifts)


def with_travel(logs: Sequence[Log], calibration: Calibration) -> Calibration:
    """Widen the travel of the parts to all positions of the log: real encoders have other zeros,
    and real pumps other ends."""
    vehicle = calibration.vehicle
    changes: dict[str, dict[str, float]] = {}
    for control, channel in (
        ("pitch", "shift"), ("heading", channel_of(calibration)), ("buoyancy", "pump"),
    ):  # fmt: skip
        part = vehicle.steered(control)
        if part is None or channel is None:
            continue
        there = [(log, values) for log in logs if (values := getattr(log, channel)) is not None]
        known = np.concatenate([np.zeros(0), *(values[log.use] for log, values in there)])
        if not known.size or (part.low <= known.min() and known.max() <= part.high):
            continue
        low, high = float(known.min()), float(known.max())
        ends = {"low": min(low, part.low), "high": max(high, part.high)}
        if control == "pitch":  # the encoder has another zero: the travel moves; 0 stays inside
            slack = SLACK * (part.high - part.low)
            ends = {"low": min(low - slack, 0.0), "high": max(high + slack, 0.0)}
        changes[part.name] = ends
    return calibration.with_vehicle(**changes)


def _with(identification: Identification, fitted: Fitted) -> Identification:
    """Return the identification with the estimates of a later fit."""
    deviation, start = np.sqrt(np.diag(fitted.covariance)), identification.calibration
    estimates = []
    for parameter, moved, off in zip(fitted.parameters, fitted.offsets, deviation, strict=False):
        sure = bool(np.isfinite(off) and (off <= UNDETERMINED or abs(moved) > FAR * off))
        note = "" if sure else "with the others only: the log does not determine it"
        estimates.append(
            IdentifiedParameter.of(parameter, start, fitted.calibration, float(off), sure, note)
        )
    return identification.with_estimates(fitted.calibration, estimates, fitted.covariance)
