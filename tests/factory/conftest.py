"""Stores that many tests of the factory read."""

from stores import copied, field_store, paper_store, recipe

__all__ = ["copied", "field_store", "paper_store", "recipe"]
