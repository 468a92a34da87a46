"""Registry of the exporters: names for the command line, and writers."""

from __future__ import annotations

from factory.exporting.base import Exporter
from factory.exporting.og1 import OG1
from factory.exporting.parquet import PARQUET
from twin.registry import Registry

EXPORTERS: Registry[Exporter] = Registry("export format", Exporter, group="glider_twin.exporters")
"""Every format that a store can be exported to, by name."""

register = EXPORTERS.register
"""Add an exporter of one's own."""

for _exporter in (OG1, PARQUET):
    register(_exporter)
