"""Exporting: stores written in formats that other programs read."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory.exporting.base import EXPORTERS as EXPORTERS
    from factory.exporting.base import Advance as Advance
    from factory.exporting.base import Exporter as Exporter
    from factory.exporting.base import ExportOptions as ExportOptions
    from factory.exporting.base import no_progress as no_progress
    from factory.exporting.base import register as register
    from factory.exporting.flat_table import FlatTable as FlatTable
    from factory.exporting.metadata import Metadata as Metadata
    from factory.exporting.metadata import metadata_for as metadata_for

__getattr__, __dir__ = attach(__name__, places(__name__))
