"""Slocum mission files (.mi with their .ma) read as missions; what is not flown is listed."""

from twin.mission.slocum.mission_reader import SlocumReading, read_slocum

__all__ = ["SlocumReading", "read_slocum"]
