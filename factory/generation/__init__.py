"""Generation: many missions into one store, on all cores, resumable."""
