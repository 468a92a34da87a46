"""Formats: a reader for each kind of log, the class `Importer`, and the registry of all kinds."""
