"""Attitude: its sines and cosines, their means, and how fast it turns."""

from twin.navigation.features.base import SLOW_S, Feature, Shape, Term


def _of(name: str, group: str, angle: str, shape: Shape, *, odd: bool = False) -> Feature:
    term = Term(channel=f"measured_{angle}", shape=shape)
    return Feature(name=name, group=group, unit="1", terms=(term,), odd=odd)


def _slow_sine(name: str, angle: str, *, odd: bool = False) -> Feature:
    term = Term(channel=f"measured_{angle}", shape="sine", look="mean", seconds=SLOW_S)
    return Feature(name=name, group="attitude_slow", unit="1", terms=(term,), odd=odd)


def _change(name: str, angle: str, *, slow: bool = False, odd: bool = False) -> Feature:
    seconds = SLOW_S if slow else 0.0
    term = Term(channel=f"measured_{angle}", shape="angle", look="slope", seconds=seconds)
    group = "attitude_rate_slow" if slow else "attitude_rate"
    return Feature(name=name, group=group, unit="rad s-1", terms=(term,), odd=odd)


SIN_ROLL = _of("sin_roll", "attitude", "roll", "sine", odd=True)
COS_ROLL = _of("cos_roll", "attitude", "roll", "cosine")
SIN_PITCH = _of("sin_pitch", "attitude", "pitch", "sine")
COS_PITCH = _of("cos_pitch", "attitude", "pitch", "cosine")
SIN_ROLL_SLOW = _slow_sine("sin_roll_slow", "roll", odd=True)
SIN_PITCH_SLOW = _slow_sine("sin_pitch_slow", "pitch")
ROLL_CHANGE = _change("roll_change", "roll", odd=True)
PITCH_CHANGE = _change("pitch_change", "pitch")
HEADING_CHANGE = _change("heading_change", "heading", odd=True)
ROLL_CHANGE_SLOW = _change("roll_change_slow", "roll", slow=True, odd=True)
PITCH_CHANGE_SLOW = _change("pitch_change_slow", "pitch", slow=True)
HEADING_CHANGE_SLOW = _change("heading_change_slow", "heading", slow=True, odd=True)
