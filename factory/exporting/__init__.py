"""Exporting: stores in the formats that others read."""

from factory.exporting.base import Exporter, ExportOptions
from factory.exporting.registry import EXPORTERS, register

__all__ = ["EXPORTERS", "ExportOptions", "Exporter", "register"]
