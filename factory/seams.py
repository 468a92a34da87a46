"""Extension points of the factory: log formats and export formats.

Each maps the names of its types to the modules that implement them; plugins add types of their own.
"""

from __future__ import annotations

from typing import Any

from twin.registry import Registry

PROTOCOLS = "plugins/protocols"

IMPORTERS: Registry[Any] = Registry(
    "kind of log",
    group="glider_twin.importers",
    folder="factory/importing/formats",
    base="factory.importing.Importer",
    page="howto/import_tables.md#a-type-of-log-of-your-own",
    shipped={
        "slocum": "factory.importing.formats.base:SLOCUM",
        "seaglider": "factory.importing.formats.base:SEAGLIDER",
        "seaexplorer": "factory.importing.formats.base:SEAEXPLORER",
        "og1": "factory.importing.formats.base:OG1",
        "ngdac": "factory.importing.formats.base:NGDAC",
        "spray": "factory.importing.formats.base:SPRAY",
        "pd0": "factory.importing.formats.base:PD0",
        "csv": "factory.importing.formats.base:CSV",
    },
    apart=dict.fromkeys(("lrauv", "mcap", "rosbag2", "ardusub", "dorado", "lsf"), PROTOCOLS),
    objects=True,
)
"""Formats of logs that can be imported"""

EXPORTERS: Registry[Any] = Registry(
    "export format",
    group="glider_twin.exporters",
    folder="factory/exporting",
    base="factory.exporting.Exporter",
    page="reference/factory.md#exports",
    shipped={
        "erddap": "factory.exporting.erddap:ERDDAP",
        "og1": "factory.exporting.og1:OG1",
        "parquet": "factory.exporting.base:PARQUET",
    },
    apart=dict.fromkeys(("huggingface", "lerobot"), "plugins/hubs") | {"mcap": PROTOCOLS},
    objects=True,
)
"""Formats that a store can be exported to"""
