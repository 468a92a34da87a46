"""Stores of missions and of logs, read back."""
