"""Kinds: the description of this plugin's import format, without its heavy libraries."""

from factory.importing import Importer

MARKERS = Importer(
    name="markers",
    vehicle="any vehicle with markers, filmed by a camera that stands still",
    files="a video .mp4, .avi, .mov or .mkv, with --camera and --log",
    channels="those of the log, and velocities over ground by the camera with their deviations",
    suffixes=frozenset({".mp4", ".avi", ".mov", ".mkv"}),
    marks=frozenset(),
    period=0.2,
    read="glider_twin_vision.markers_reader:read_markers",
    extra="plugins/vision",
    takes_camera=True,
    instrument=True,
)
"""Videos of a vehicle with markers."""
