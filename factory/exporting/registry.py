"""Registry of the exporters: names for the command line, and writers."""

from __future__ import annotations

from factory.exporting.base import Exporter
from twin.registry import Registry, instance_of

EXPORTERS: Registry[Exporter] = Registry(
    "export format",
    group="glider_twin.exporters",
    shipped={
        "huggingface": "factory.exporting.huggingface:HUGGINGFACE",
        "lerobot": "factory.exporting.lerobot:LEROBOT",
        "mcap": "factory.exporting.mcap:MCAP",
        "og1": "factory.exporting.og1:OG1",
        "parquet": "factory.exporting.parquet:PARQUET",
    },
    check=instance_of("export format", Exporter),
)
"""Every format that a store can be exported to, by name."""

register = EXPORTERS.add
"""Add an exporter of one's own."""
