"""Checks: the twin against the Fossen model, published figures, and its own cost."""
