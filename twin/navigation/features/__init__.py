"""Features: the inputs of a network by name, computed from what a vehicle measures or commands.

No feature reads a `true_*` channel. Absolute heading is not a feature: the water does not know
where north is, and a network that sees the heading learns the headings of its training missions.
Absolute depth is one, `depth`, but no default: on few missions it works as a mission's signature.
Where net buoyancy changes with depth (hull compressibility, stratification), `glide_speed` is the
better way to tell the network, since it needs no knowledge of buoyancy.

A feature is computed over a whole mission (`Feature.compute`) or sample by sample
(`FeatureSteps`), to the same values.
"""

from twin.navigation.features.base import (
    FEATURES,
    GLIDER_PARTS,
    SLOW_S,
    Array,
    Channels,
    Feature,
    Term,
    channels_of,
    feature,
    is_known,
    is_part_channel,
    register,
    trailing_mean,
    trailing_slope,
)
from twin.navigation.features.selection import (
    DEFAULT_GROUPS,
    FLIGHT,
    INPUT_SETS,
    SENSORS,
    feature_matrix,
    features_for,
    features_of,
    groups,
    leave_out,
    mirror_signs,
    select_features,
)
from twin.navigation.features.steps import FeatureSteps

__all__ = [
    "DEFAULT_GROUPS",
    "FEATURES",
    "FLIGHT",
    "GLIDER_PARTS",
    "INPUT_SETS",
    "SENSORS",
    "SLOW_S",
    "Array",
    "Channels",
    "Feature",
    "FeatureSteps",
    "Term",
    "channels_of",
    "feature",
    "feature_matrix",
    "features_for",
    "features_of",
    "groups",
    "is_known",
    "is_part_channel",
    "leave_out",
    "mirror_signs",
    "register",
    "select_features",
    "trailing_mean",
    "trailing_slope",
]
