"""Water: its density over depth, the currents in it, and the sea floor below it."""
