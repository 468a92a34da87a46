"""Names and colours of the methods, the same in every table and figure."""

from __future__ import annotations

from twin.plot.style import ESTIMATE, GUIDE, PALETTE, TRUTH

TITLES = {
    "network": "networks",
    "floor": "floor: true surge and sway",
    "pitch_plus_alpha": "w / tan(pitch + alpha)",
    "steady_flight": "steady flight model",
    "onboard": "on-board track",
    "ekf": "EKF on the dynamic model",
    "dvl": "DVL-aided",
}
"""What people read."""

COLOURS = {
    "truth": TRUTH,
    "network": ESTIMATE,
    "floor": GUIDE,
    "pitch_plus_alpha": PALETTE["orange"],
    "steady_flight": PALETTE["green"],
    "onboard": PALETTE["purple"],
    "ekf": PALETTE["sky"],
    "dvl": PALETTE["black"],
}

KNOWLEDGE_TITLES = {
    "none": "no current",
    "previous": "previous dive's current",
    "corrected": "corrected afterwards",
}


def title_of(method: str) -> str:
    """The method in words."""
    return TITLES.get(method, method.replace("_", " "))


def colour_of(method: str) -> str:
    """Its colour."""
    return COLOURS.get(method, GUIDE)
