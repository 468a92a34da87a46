"""Renders: headless pictures and videos of trajectories."""
