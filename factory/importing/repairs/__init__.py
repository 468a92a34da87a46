"""Repairs: impossible values, wrong units and offsets of logs, each counted."""
