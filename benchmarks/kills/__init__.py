"""Kills: processes of `factory generate` ended, frozen, doubled; the store stays the same."""
