"""Sampling: what decides the bytes of a store, and one mission flown from its parameters."""
