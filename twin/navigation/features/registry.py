"""Features by name, and those of a vehicle's own parts."""

from __future__ import annotations

from collections.abc import Iterable

from twin.errors import InputError, unknown_name
from twin.navigation.features.base import Feature, Term, check_feature
from twin.records.schema import SIMULATED, VARIABLES, WITH_FLOOR
from twin.registry import Registry

_SHIPPED = (
    ("attitude", "sin_roll cos_roll sin_pitch cos_pitch sin_roll_slow sin_pitch_slow"),
    ("attitude", "roll_change pitch_change heading_change"),
    ("attitude", "roll_change_slow pitch_change_slow heading_change_slow"),
    ("inertial", "roll_rate pitch_rate yaw_rate"),
    ("inertial", "specific_force_x specific_force_y specific_force_z"),
    ("glide", "depth_rate depth_rate_slow glide_speed glide_speed_slow"),
    ("inertial", "gravity_pitch_sine gravity_glide_speed gravity_glide_speed_slow"),
    ("glide", "depth"),
    ("controls", "shift sin_rotation cos_rotation pump"),
    ("controls", "shift_change rotation_change pump_change"),
    ("controls", "shift_command sin_rotation_command cos_rotation_command pump_command"),
    ("flight", "flight_surge flight_sway flight_attack"),
)
"""File and features, in the order in which networks take them."""

FEATURES: Registry[Feature] = Registry(
    "feature",
    group="glider_twin.features",
    shipped={
        name: f"twin.navigation.features.{file}:{name.upper()}"
        for file, names in _SHIPPED
        for name in names.split()
    },
    check=check_feature,
    check_shipped=False,
)
"""Every feature by name."""

register = FEATURES.add
"""Add a feature of one's own."""

GLIDER_PARTS = ("shift", "rotation", "pump")
"""Parts whose features are in the registry. Those of other parts have the names of their channels:
`measured_rudder` in the group `controls`, `commanded_rudder` in `commands`."""
PART_GROUPS = {"measured": "controls", "commanded": "commands"}
"""Group of the channel of a vehicle's part by the channel's kind."""


def feature(name: str) -> Feature:
    """The feature of that name, of the registry or of a vehicle's part.

    Raises:
      InputError: there is none; the nearest is offered.
    """
    if name in FEATURES:
        return FEATURES[name]
    if not is_part_channel(name):
        raise InputError(unknown_name("feature", name, FEATURES))
    return Feature(
        name=name,
        group=PART_GROUPS[name.partition("_")[0]],
        unit=VARIABLES[name].units if name in VARIABLES else "",
        terms=(Term(channel=name),),
        odd=None,
    )


def is_known(name: str) -> bool:
    """Whether `feature` knows it."""
    return name in FEATURES or is_part_channel(name)


def is_part_channel(name: str) -> bool:
    """Whether it is the reading or the command of a part that the registry does not know."""
    kind, _, part = name.partition("_")
    return kind in PART_GROUPS and bool(part) and name not in (*SIMULATED, *WITH_FLOOR)


def channels_of(features: Iterable[str]) -> tuple[str, ...]:
    """Channels that these features read, each once: of the schema, or estimated ones."""
    return tuple(dict.fromkeys(c for name in features for c in feature(name).channels))
