"""Faults: every file operation of every writer fails once, and nothing is lost."""
