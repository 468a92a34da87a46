"""The vehicle: a hull with its parts, read by name from an MJCF file."""
