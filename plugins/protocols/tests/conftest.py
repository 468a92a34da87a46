"""A store that many tests read."""

from stores import field_store

__all__ = ["field_store"]
