"""Exporting: stores in the formats that others read."""
