"""Lines: tracks of the methods through the water and how they look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from learn.data.labels import MODE
from learn.evaluation.evaluation import DVL, FLOOR, NETWORK
from learn.report.names import colour_of, title_of
from learn.report.shown import Shown
from twin.navigation.baselines.registry import BASELINES
from twin.navigation.dead_reckoning import Array
from twin.navigation.dvl_cleaning import BOTTOM
from twin.plot import style

DASHES = ((0, (6, 2)), (0, (1, 1.4)), (0, (6, 2, 1, 2)), (0, (3, 1.5)))
"""Of methods in their order: each tells itself from the others without its colour"""
TRUTH_LINE: dict[str, Any] = {"color": style.TRUTH, "lw": 4.0, "alpha": 0.35, "label": "truth"}
"""Wide and pale, so that what lies on it is seen"""
MARKS = {"start": (0, "o"), "end": (-1, "s")}


def drawn_methods() -> tuple[str, ...]:
    """Those whose tracks are drawn; more would hide each other."""
    return (NETWORK, *(name for name in BASELINES if BASELINES[name].drawn))


def water_lines(shown: Shown, methods: Sequence[str]) -> dict[str, Array]:
    """Tracks through the water [m], (time, 2), of the truth and of methods that have one."""
    lines = {"truth": shown.reference.water_track}
    for name in methods:
        track = shown.water_track(name) if name in shown.estimates else None
        if track is not None and name != FLOOR:
            lines[name] = track
    return lines


BESIDE_DVL = (NETWORK, DVL)
LEAST_BOTTOM_SHARE = 0.5
"""Of the samples of a mission that is drawn beside a Doppler log's track over ground"""


def with_bottom_lock(missions: Sequence[Shown]) -> Shown | None:
    """The longest of the missions in which a Doppler log saw the bottom most of the time."""
    seen = [
        shown
        for shown in missions
        if DVL in shown.estimates
        and shown.estimates[DVL].ground_track is not None
        and np.mean(shown.reference.mission.signals[MODE] == BOTTOM) >= LEAST_BOTTOM_SHARE
    ]
    return max(seen, key=lambda shown: float(shown.reference.path[-1]), default=None)


def ground_lines(shown: Shown, methods: Sequence[str]) -> dict[str, Array]:
    """Tracks over ground [m], (time, 2), of the truth and of methods that have one."""
    lines = {"truth": shown.reference.ground_track}
    for name in methods:
        track = shown.reference.tracks(shown.estimates[name]).get("ground")
        if track is not None:
            lines[name] = track
    return lines


def look(name: str, place: int) -> dict[str, Any]:
    """Line of a method, `place` in the order of those drawn; the truth is the first."""
    if name == "truth":
        return TRUTH_LINE
    dashes = DASHES[(place - 1) % len(DASHES)]
    return {"color": colour_of(name), "lw": 1.4, "ls": dashes, "label": title_of(name)}
