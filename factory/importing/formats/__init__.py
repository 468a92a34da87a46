"""Formats: one reader for each kind of log file."""
