"""Learning: networks for surge and sway, and the dead reckoning that uses them."""
