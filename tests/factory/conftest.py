"""Stores that many tests of the factory read."""

from stores import field_store, paper_store, recipe

__all__ = ["field_store", "paper_store", "recipe"]
