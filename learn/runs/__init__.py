"""Runs: the folder that one training leaves behind."""
