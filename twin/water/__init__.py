"""The water: its density over depth and the currents in it."""
