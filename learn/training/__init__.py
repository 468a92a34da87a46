"""Training: networks fitted to missions, side by side."""
