"""Features: the inputs of a network by name, computed from measured and commanded signals.

No feature reads a `true_*` channel. Absolute heading is not a feature: the water does not depend
on it, and a network with the heading learns the headings of its training missions. Absolute depth
is the feature `depth`, but no default: with few missions it identifies the mission. Where net
buoyancy changes with depth (hull compressibility, stratification), `glide_speed` is the better
input, since it needs no knowledge of buoyancy.

A feature is computed over a whole mission (`Feature.compute`) or sample by sample
(`FeatureSteps`), to the same values.
"""

from twin.navigation.features.base import FEATURES as FEATURES
from twin.navigation.features.base import GLIDER_PARTS as GLIDER_PARTS
from twin.navigation.features.base import SLOW_S as SLOW_S
from twin.navigation.features.base import Channels as Channels
from twin.navigation.features.base import Feature as Feature
from twin.navigation.features.base import FeatureSteps as FeatureSteps
from twin.navigation.features.base import Term as Term
from twin.navigation.features.base import channels_of as channels_of
from twin.navigation.features.base import feature as feature
from twin.navigation.features.base import is_known as is_known
from twin.navigation.features.base import is_part_channel as is_part_channel
from twin.navigation.features.base import register as register
from twin.navigation.features.base import trailing_mean as trailing_mean
from twin.navigation.features.base import trailing_slope as trailing_slope
from twin.navigation.features.selection import DEFAULT_GROUPS as DEFAULT_GROUPS
from twin.navigation.features.selection import FLIGHT as FLIGHT
from twin.navigation.features.selection import INPUT_SETS as INPUT_SETS
from twin.navigation.features.selection import SENSORS as SENSORS
from twin.navigation.features.selection import feature_matrix as feature_matrix
from twin.navigation.features.selection import features_for as features_for
from twin.navigation.features.selection import features_of as features_of
from twin.navigation.features.selection import groups as groups
from twin.navigation.features.selection import leave_out as leave_out
from twin.navigation.features.selection import mirror_signs as mirror_signs
from twin.navigation.features.selection import select_features as select_features
from twin.navigation.features.selection import without_image as without_image
from twin.numbers import Array as Array
