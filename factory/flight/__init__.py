"""Flight: one mission from its parameters to its signals."""
