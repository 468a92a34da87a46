"""Kills: processes of `factory generate` ended, frozen and doubled; the store is always the same."""
