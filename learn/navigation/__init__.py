"""Navigation: dead reckoning, and the methods that it is compared with."""
