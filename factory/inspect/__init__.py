"""Inspect: what a store holds, whether it is sound, and whether it can be flown again."""
