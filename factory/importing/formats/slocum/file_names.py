"""Endings of a Slocum's own files."""

BINARY = frozenset(f".{a}{b}d" for a in "dmsent" for b in "bc")
"""Logs: flight d, m, s; science e, n, t; plain b, compressed c."""
CACHES = frozenset({".cac", ".ccc"})
"""Lists of sensors that the logs refer to, plain and compressed."""
