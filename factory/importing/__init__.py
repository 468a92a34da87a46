"""Importing: logs of real vehicles, in the schema that simulated missions have too."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory.importing import messages as messages
    from factory.importing import netcdf as netcdf
    from factory.importing.cleaning import clean as clean
    from factory.importing.cleaning import counts_upward as counts_upward
    from factory.importing.cleaning import positions as positions
    from factory.importing.columns import read_table as read_table
    from factory.importing.columns import tidy as tidy
    from factory.importing.deployment_log import EMPTY as EMPTY
    from factory.importing.deployment_log import NO_FIXES as NO_FIXES
    from factory.importing.deployment_log import OF_THE_MACHINE as OF_THE_MACHINE
    from factory.importing.deployment_log import OTHER_KIND as OTHER_KIND
    from factory.importing.deployment_log import TRUNCATED as TRUNCATED
    from factory.importing.deployment_log import UNREADABLE as UNREADABLE
    from factory.importing.deployment_log import Channel as Channel
    from factory.importing.deployment_log import DeploymentLog as DeploymentLog
    from factory.importing.deployment_log import LoggedFixes as LoggedFixes
    from factory.importing.deployment_log import each_file as each_file
    from factory.importing.dives.dive_store import build as dives_dataset  # noqa: F401
    from factory.importing.formats.base import IMPORTERS as IMPORTERS
    from factory.importing.formats.base import TABLES as TABLES
    from factory.importing.formats.base import Importer as Importer
    from factory.importing.formats.base import ReadOptions as ReadOptions
    from factory.importing.formats.base import WrongFormat as WrongFormat
    from factory.importing.formats.base import kinds_by_bytes as kinds_by_bytes
    from factory.importing.formats.base import register as register
    from factory.importing.formats.base import sniff as sniff
    from factory.importing.formats.csv.mapping import Mapping as Mapping
    from factory.importing.formats.csv.mapping import Signal as Signal
    from factory.importing.formats.csv.mapping_file import signal_names as signal_names
    from factory.importing.gps_fixes import RECEIVER as RECEIVER
    from factory.importing.gps_fixes import has_fix as has_fix
    from factory.importing.import_run import METADATA as METADATA
    from factory.importing.import_run import import_logs as import_logs
    from factory.importing.import_run import read_logs as read_logs
    from factory.importing.payload import payload_channels as payload_channels
    from factory.importing.payload import payload_names as payload_names
    from factory.importing.plausibility import DiveRules as DiveRules
    from factory.importing.pressures import ctd_channels as ctd_channels
    from factory.importing.pressures import used_of_left as used_of_left
    from factory.importing.pressures import with_dbar_by_depth as with_dbar_by_depth
    from factory.importing.pressures import without_air as without_air
    from factory.importing.sample_clock import expect_going as expect_going
    from factory.importing.sample_clock import parse_stamps as parse_stamps
    from factory.importing.sample_clock import unix_seconds as unix_seconds
    from factory.importing.tally import Tally as Tally
    from factory.importing.tally import note_empty as note_empty
    from factory.importing.tally import note_unread as note_unread
    from factory.importing.units import PRACTICAL as PRACTICAL
    from factory.importing.units import declared as declared
    from factory.importing.units import unit_of as unit_of
    from factory.importing.units import unit_to_take as unit_to_take

__getattr__, __dir__ = attach(__name__, places(__name__))
