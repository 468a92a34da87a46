"""Exporting: stores in the formats that others read."""

from factory.exporting.base import EXPORTERS, Exporter, ExportOptions, register

__all__ = ["EXPORTERS", "ExportOptions", "Exporter", "register"]
