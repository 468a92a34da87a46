"""Report: one self-contained page per run, its figures as PNG, and the model card."""
