"""Formats: one folder for each kind of log, a base class, and the registry of all of them."""
