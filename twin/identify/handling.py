"""Handling: pitch, turns, actuator travel and control gains, fitted to logs after the speed.

    found = identify(logs, load_calibration("seaglider"))     # trim, drag, hull, sensors
    handling = handle(logs, found)                            # pitch, turns, loops
    handling.identification.calibration, handling.failures

The steps, each with the results of the earlier ones: speed by the flight model, pitch at which the
moments balance at this speed, turns about these glides, control loops for the dynamics.
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

CLEARLY_MOVED = 3.0
"""[standard deviations] Difference from the vehicle file's value; a larger one counts as determined
by the log, even if its standard deviation is large"""
TRAVEL_MARGIN, GUIDANCE_MARGIN = 0.1, 0.03
"""[1] TRAVEL_MARGIN: fraction of a part's travel that is added beyond the log's positions.
GUIDANCE_MARGIN: fraction of the battery's travel left at both ends for guidance in a usual glide"""
LARGEST_ASYMMETRY = math.radians(3.0)
"""[rad] Largest difference of the neutral positions of dives and climbs without a note"""
PITCH_STEP = math.radians(0.5)
"""[rad] Step in the search for the steepest usual glide within the battery's travel"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Handling:
    """Vehicle with fitted pitch, turns and gains, and the tests that it failed in simulation."""

    identification: Identification
    """Identification with the estimates of the flight model, of pitch and of turns"""
    phases: tuple[Phase, ...]
    """Usual dive and climb of the log"""
    pitch_deviation: float | None
    """[rad] RMS residual of the steady pitches; None: not fitted"""
    turn_deviation: float | None
    """[rad/s] RMS residual of yaw rates averaged over up to 90 s; None: not fitted"""
    yaw_bias: float | None
    """[rad] Yaw moment at no roll and no rudder, as the sideslip of an equal Munk moment"""
    roll_offset: float | None
    """[rad] Offset of the measured roll: zero of the sensor, or heel of the vehicle"""
    neutral: float | None
    """[rad] Neutral position of the turning part in the fitted vehicle; None: not known"""
    failures: tuple[str, ...]
    """Failed tests; empty if the vehicle trims, is stable and steers in dives and climbs"""
    notes: tuple[str, ...]
    """Sentences on values that the logs did not determine, and on asymmetry, with the reasons"""


def handle(
    logs: Sequence[Log],
    found: Identification,
    *,
    proof: bool = True,
    progress: Callable[[float], None] = lambda part: None,
) -> Handling:
    """Fit pitch and turns, set the control gains, and test the vehicle in simulation.

    Args:
      found: result of `identify`. proof: fly the vehicle, and report the tests that it fails.
      progress: called with the fraction done, 0 to 1.
    """
    notes: list[str] = []
    logs, _ = gliding(logs)
    calibration = with_travel(logs, found.calibration)
    identification = dataclasses.replace(found, calibration=calibration)
    balance = None
    # a fit by simulated dives has already fitted the pitch
    if not {p.name for p in PITCHING} & {e.name for e in found.estimates}:
        balance = balanced(logs, calibration)
        if balance is None:
            notes.append("pitch: no battery positions in steady dives and climbs of these logs")
        else:
            calibration = balance.calibration
            identification = _with_estimates(identification, balance)
    progress(0.2)
    turns = turned(logs, calibration)
    progress(0.6)
    if turns is None:
        notes.append("turns: too few steady parts in dives and climbs of these logs")
    else:
        calibration = turns.fitted.calibration
        identification = _with_estimates(identification, turns.fitted)
        channel = channel_of(calibration)
        if turns.apart > LARGEST_ASYMMETRY:
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
    """Usual dive and climb: medians over steady parts; a phase without steady parts is left out."""
    windows = windows_of(logs, calibration)
    vehicle, pump = calibration.vehicle, pump_of(calibration)
    # layers of the log can raise the net mass beyond the pump; the test's water has one density
    light, heavy = (vehicle.net_mass_for_pump(end) for end in (pump.high, pump.low))
    found = []
    for climbing in (False, True):
        glides = [w.glide for w in windows if w.climbing == climbing]
        if glides:
            *_, pitch, net_mass = np.median(glides, axis=0)
            found.append(Phase(pitch=float(pitch), net_mass=float(np.clip(net_mass, light, heavy))))
    return tuple(found)


def with_usual_glide(calibration: Calibration, phases: Sequence[Phase]) -> tuple[Calibration, str]:
    """Set the usual glide to the log's; missions that set neither pitch nor pump fly it.

    The net mass is half of the difference between the phases. The pitch is the flatter of the two
    phases', or the steepest flatter one that the battery can hold in dives and in climbs. If the
    pump is far from the centre of buoyancy, equal net masses may need more battery travel than the
    log shows.

    Returns:
      the calibration, and a note with the reason; the note is empty if the log's pitch is kept.
    """
    dive, climb = phases
    pitch = min(abs(dive.pitch), abs(climb.pitch))
    net_mass = 0.5 * (dive.net_mass - climb.net_mass)
    if pitch == 0.0 or net_mass <= 0.0:
        return calibration, ""
    vehicle = calibration.vehicle
    held = pitch
    while held > PITCH_STEP and not _can_hold(vehicle, held, net_mass):
        held -= PITCH_STEP
    if not _can_hold(vehicle, held, net_mass):
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


def _can_hold(vehicle: Vehicle, pitch: float, net_mass: float) -> bool:
    """True if the battery can hold this pitch in dives and climbs, with a margin at both ends."""
    slide = vehicle.steered("pitch")
    assert slide is not None  # a calibration has one moving battery
    room = GUIDANCE_MARGIN * (slide.high - slide.low)
    low, high = slide.low + room, slide.high - room
    try:
        shifts = [steady_glide(vehicle, -s * pitch, s * net_mass).shift for s in (1.0, -1.0)]
    except MissionError:
        return False  # too flat to glide at all
    return all(low <= shift <= high for shift in shifts)


def with_travel(logs: Sequence[Log], calibration: Calibration) -> Calibration:
    """Widen the parts' travel to all positions in the logs: encoders of real vehicles have other
    zeros than the file's, and real pumps other ends."""
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
        if control == "pitch":  # the encoder's zero differs: shift the travel, keep 0 in it
            slack = TRAVEL_MARGIN * (part.high - part.low)
            ends = {"low": min(low - slack, 0.0), "high": max(high + slack, 0.0)}
        changes[part.name] = ends
    return calibration.with_vehicle(**changes)


def _with_estimates(identification: Identification, fitted: Fitted) -> Identification:
    """Return the identification with the estimates of a further fit added."""
    deviation, start = np.sqrt(np.diag(fitted.covariance)), identification.calibration
    estimates = []
    for parameter, moved, off in zip(fitted.parameters, fitted.offsets, deviation, strict=False):
        sure = bool(np.isfinite(off) and (off <= UNDETERMINED or abs(moved) > CLEARLY_MOVED * off))
        note = "" if sure else "with the others only: the log does not determine it"
        estimates.append(
            IdentifiedParameter.of(parameter, start, fitted.calibration, float(off), sure, note)
        )
    return identification.with_estimates(fitted.calibration, estimates, fitted.covariance)
