"""Surfacing: what the surface behaviors of a Slocum mission ask for, together."""

from __future__ import annotations

import dataclasses
import math

from twin.mission.slocum.behavior import Behavior

# when a behavior starts (Operators Training Guide, beh_args.h)
IMMEDIATELY, STACK_IDLE, PITCH_IDLE, HEADING_IDLE, UPDOWN_IDLE, NEVER = 0, 1, 2, 3, 4, 5
HIT_WAYPOINT, EVERY_SECS, EVERY_SECS_UPDOWN_IDLE, NO_COMMS = 8, 9, 10, 12
QUITS = 0
"""end_action that ends the mission"""
DEFAULT_STAY = 300.0
"""[s] where a surfacing does not say how long it waits for control-C"""
_USED = ("start_when", "when_secs", "keystroke_wait_time", "end_action", "c_use_pitch",
         "c_pitch_value")  # fmt: skip
NO_EFFECT = frozenset(
    [
        "gps_wait_time",
        "gps_postfix_wait_time",
        "printout_cycle_time",
        "report_all",
        "strobe_on",
        "force_iridium_use",
        "when_wpt_dist",
        "min_time_between_gps_fixes",
        "sensor_input_wait_time",
    ]
)
"""Arguments that move nothing: a fix, a call and a printout take the stay"""


@dataclasses.dataclass(kw_only=True)
class Surfacings:
    """When it comes up, and for how long."""

    after_s: float | None = None
    """[s] under water"""
    when_yo_ends: bool = False
    at_target: bool = False
    first: bool = False
    """Before the first dive."""
    stay_s: float = DEFAULT_STAY
    pitch_deg: float | None = None
    """Magnitude in the climb to the surface."""


def surfacings(behaviors: list[Behavior], notes: list[str]) -> Surfacings:
    """The surface behaviors as one; what is left out of each is added to `notes`."""
    found = Surfacings()
    stays: list[float] = []
    for behavior in behaviors:
        arguments = behavior.arguments
        when = arguments.get("start_when")
        if _take(found, behavior, notes):
            stays.append(arguments.get("keystroke_wait_time", DEFAULT_STAY))
        quits = arguments.get("end_action") == QUITS
        if quits and when not in (STACK_IDLE, HEADING_IDLE, NO_COMMS):
            notes.append(f"{behavior.label}: end_action 0 ends the mission there; here it goes on")
        _take_pitch(found, behavior, notes)
        for name in sorted(set(arguments) - set(_USED) - NO_EFFECT):
            notes.append(f"{behavior.label}: {name} = {arguments[name]:g} is left out")
    if stays:
        found.stay_s = stays[0]
        if len(set(stays)) > 1:
            others = ", ".join(f"{stay:g}" for stay in sorted(set(stays) - {stays[0]}))
            notes.append(
                f"surface: all stays last {stays[0]:g} s, the keystroke_wait_time of the first; "
                f"others say {others} s"
            )
    return found


def _take(found: Surfacings, behavior: Behavior, notes: list[str]) -> bool:
    """Add one behavior; whether it brings the glider up during the mission."""
    arguments = behavior.arguments
    when = arguments.get("start_when", math.nan)
    if when in (EVERY_SECS, EVERY_SECS_UPDOWN_IDLE, NO_COMMS):
        seconds = arguments.get("when_secs", math.nan)
        if not seconds > 0.0:
            notes.append(f"{behavior.label}: start_when {when:g} without when_secs: left out")
            return False
        if when == EVERY_SECS_UPDOWN_IDLE:
            notes.append(f"{behavior.label}: start_when 10 is flown as 9: it does not wait for yos")
        found.after_s = min(seconds, math.inf if found.after_s is None else found.after_s)
    elif when in (PITCH_IDLE, UPDOWN_IDLE):
        found.when_yo_ends = True
    elif when == HIT_WAYPOINT:
        found.at_target = True
    elif when == IMMEDIATELY:
        found.first = True
    elif when in (STACK_IDLE, HEADING_IDLE, NEVER):
        return False  # the end of the mission is at the surface anyway
    else:
        said = "is missing" if math.isnan(when) else f"{when:g} is not flown"
        notes.append(f"{behavior.label}: start_when {said}: this surfacing is left out")
        return False
    return True


def _take_pitch(found: Surfacings, behavior: Behavior, notes: list[str]) -> None:
    use, value = (behavior.arguments.get(f"c_{name}") for name in ("use_pitch", "pitch_value"))
    if value is None:
        return
    if use not in (None, 3.0):
        notes.append(
            f"{behavior.label}: c_use_pitch {use:g} is left out: only 3, a servo, is flown"
        )
        return
    pitch = behavior.pitch_deg("c_pitch_value")
    if found.pitch_deg is not None and abs(found.pitch_deg - pitch) > 0.05:
        notes.append(
            f"{behavior.label}: c_pitch_value is {pitch:.1f} degree; the ascent keeps the "
            f"{found.pitch_deg:.1f} of the first surface behavior"
        )
        return
    found.pitch_deg = pitch
