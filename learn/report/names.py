"""Names and colours of the methods, the same in every table and figure."""

from __future__ import annotations

from twin.navigation.baselines.registry import BASELINES
from twin.plot.style import ESTIMATE, GUIDE, PALETTE, TRUTH

TITLES = {"network": "networks", "floor": "floor: true velocities"}
"""What people read, of methods that are not baselines."""
COLOURS = {"truth": TRUTH, "network": ESTIMATE, "floor": GUIDE}

KNOWLEDGE_TITLES = {
    "none": "no current",
    "previous": "previous dive's current",
    "corrected": "corrected afterwards",
}


def title_of(method: str) -> str:
    """The method in words; of a baseline that is not registered, its name."""
    if method in BASELINES:
        return str(BASELINES[method].title)
    return TITLES.get(method, method.replace("_", " "))


def colour_of(method: str) -> str:
    """Its colour."""
    if method in BASELINES and (colour := BASELINES[method].colour):
        return PALETTE[colour]
    return COLOURS.get(method, GUIDE)
