"""Optimisers: ways to lower the error of a network, one file a kind."""
