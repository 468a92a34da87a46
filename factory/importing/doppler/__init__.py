"""Doppler logs: their own files, and the velocity of a hull through the water that they show."""
