"""Baselines: what navigators do today, with one interface and the nominal vehicle only."""
