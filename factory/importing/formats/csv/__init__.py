"""Csv: tables of any vehicle, read by a mapping."""
