"""Formats: a reader for each type of log, the class `Importer`, and the table of all types."""
