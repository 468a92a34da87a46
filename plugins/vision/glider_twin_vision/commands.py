"""Commands `twin markers` and `twin observe`: sheets to print, and videos of simulated missions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.cli import Console, JsonOption


@dataclass(frozen=True, kw_only=True)
class Markers(JsonOption):
    """Write the five marker sheets of a vehicle, one A4 page each at 300 dpi.

    Example:

        twin markers --out sheets
    """

    out: Path = Path("markers")
    """folder of the pages"""
    side: float = 0.15
    """side of the black square [m]"""

    def run(self, console: Console) -> int:
        """Write the pages."""
        from glider_twin_vision.markers import Board, write_sheets

        found = write_sheets(self.out, Board(side=self.side))
        console.answer(sheets=found)
        console.pairs(
            {path.name: "print at 100 %" for path in found}, title=f"sheets in {self.out}"
        )
        return 0


@dataclass(frozen=True, kw_only=True)
class Observe(JsonOption):
    """Film a stored mission with a camera that sees markers on the vehicle; writes the calibration
    beside the video. Water, motion blur, noise, hidden markers and lost pictures are in it.

    Example:

        twin observe square.zarr --out square.mp4 --visibility 8
    """

    store: Annotated[Path, tyro.conf.Positional]
    """store of the mission"""
    out: Path
    """video, .mp4"""
    mission: int = 0
    """number of the mission in the store"""
    observer: str = "frame"
    """frame on the floor, vehicle or diver that follow"""
    distance: float = 4.0
    """distance of the camera [m]; of a frame, from the middle of the path"""
    visibility: float = 10.0
    """visibility of the water [m]"""
    rate: float = 10.0
    """pictures a second"""
    side: float = 0.15
    """side of the markers' black squares [m]"""
    seconds: float | None = None
    """length of the video from the mission's start [default: all]"""
    seed: int = 0
    """seed of motion, noise and losses"""
    overwrite: bool = False
    """replace an existing video"""

    def run(self, console: Console) -> int:
        """Draw, write and report."""
        from glider_twin_vision.film import film
        from twin.errors import InputError

        for name, low, high in (
            ("distance", 0.5, 20.0),
            ("visibility", 0.5, 100.0),
            ("rate", 1.0, 60.0),
        ):
            if not low <= getattr(self, name) <= high:
                raise InputError(f"--{name} is {getattr(self, name):g}: {low:g} to {high:g}")
        if self.out.suffix.lower() != ".mp4":
            raise InputError(f"video {self.out.name}: the ending must be .mp4")
        if self.out.exists() and not self.overwrite:
            raise InputError(f"{self.out} exists: use --overwrite or another --out")
        made = film(
            self.store, self.out, mission=self.mission, observer=self.observer, rate=self.rate,
            distance=self.distance, visibility=self.visibility, side=self.side,
            seconds=self.seconds, seed=self.seed,
        )  # fmt: skip
        console.answer(video=self.out, calibration=made.calibration, pictures=made.pictures)
        console.pairs(
            {
                "video": str(self.out),
                "calibration": str(made.calibration),
                "pictures": made.pictures,
            }
        )
        return 0
