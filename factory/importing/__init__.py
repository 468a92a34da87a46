"""Importing: logs of real vehicles in the schema of the missions that the factory flies."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory.importing.deployment_log import EMPTY as EMPTY
    from factory.importing.deployment_log import OF_THE_MACHINE as OF_THE_MACHINE
    from factory.importing.deployment_log import OTHER_KIND as OTHER_KIND
    from factory.importing.deployment_log import TRUNCATED as TRUNCATED
    from factory.importing.deployment_log import UNREADABLE as UNREADABLE
    from factory.importing.deployment_log import Channel as Channel
    from factory.importing.deployment_log import DeploymentLog as DeploymentLog
    from factory.importing.deployment_log import LoggedFixes as LoggedFixes
    from factory.importing.dives.dive_store import build as dives_dataset  # noqa: F401
    from factory.importing.formats.base import IMPORTERS as IMPORTERS
    from factory.importing.formats.base import TABLES as TABLES
    from factory.importing.formats.base import Importer as Importer
    from factory.importing.formats.base import ReadOptions as ReadOptions
    from factory.importing.formats.base import WrongFormat as WrongFormat
    from factory.importing.formats.base import register as register
    from factory.importing.formats.base import sniff as sniff
    from factory.importing.import_run import METADATA as METADATA
    from factory.importing.import_run import import_logs as import_logs
    from factory.importing.plausibility import DiveRules as DiveRules
    from factory.importing.tally import Tally as Tally

__getattr__, __dir__ = attach(__name__, places(__name__))
