"""Evaluation: velocities and tracks judged against the truth."""
