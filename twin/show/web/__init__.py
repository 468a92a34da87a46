"""Replay: a mission in three dimensions as one HTML file that any browser opens offline."""
