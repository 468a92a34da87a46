"""Turning: what turns and rolls a glider, fitted to the turns of a log."""
