"""Data: missions of a store as the sequences that networks learn from."""
