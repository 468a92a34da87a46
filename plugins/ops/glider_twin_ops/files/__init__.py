"""Files that a Seaglider is sent: targets, commands, and when its instruments sample."""

from glider_twin_ops.files.seaglider_commands import commanded as commanded
from glider_twin_ops.files.seaglider_commands import commands_of as commands_of
from glider_twin_ops.files.seaglider_commands import commands_text as commands_text
from glider_twin_ops.files.seaglider_commands import read_commands as read_commands
from glider_twin_ops.files.seaglider_science import ScienceLayer as ScienceLayer
from glider_twin_ops.files.seaglider_science import read_science as read_science
from glider_twin_ops.files.seaglider_science import science_text as science_text
from glider_twin_ops.files.seaglider_science import sparser as sparser
from glider_twin_ops.files.seaglider_targets import SeagliderTarget as SeagliderTarget
from glider_twin_ops.files.seaglider_targets import read_targets as read_targets
from glider_twin_ops.files.seaglider_targets import targets_of as targets_of
from glider_twin_ops.files.seaglider_targets import targets_text as targets_text
