"""Navigation: what a vehicle on board can know of where it is, and how it is found afterwards."""
