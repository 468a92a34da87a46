"""Dives: logs cut into dives and put on a uniform grid."""
