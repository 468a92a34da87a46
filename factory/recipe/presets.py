"""Presets: which column of the table of parameters, which sensors, which missions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Preset:
    """What a preset name stands for."""

    spread: str
    """column of the table of parameters"""
    sensors: str
    """sensor suite of gliders"""
    survey_sensors: str
    """that of vehicles with a propeller"""
    fixed_missions: bool = False
    """its missions are given, not drawn"""


PRESETS: Mapping[str, Preset] = {
    "paper": Preset("paper", "ideal", "survey"),
    "field": Preset("field", "field", "survey-field"),
    "paper-test": Preset("paper", "ideal", "survey", fixed_missions=True),
}
"""`paper`: a glider noise-free, in one constant current per mission; a propelled vehicle in still
water with the instruments of the paper's tables. `field`: the paper's list of further work:
sensor errors, GPS fixes, a current with vertical structure, and a vehicle that is not as its file
says. `paper-test`: the paper's test trajectory in three currents."""
