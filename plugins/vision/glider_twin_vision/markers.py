"""Markers: five ArUco plates on a vehicle, their places, printed sheets and picture coordinates.

The plates look up, to port, to starboard, ahead and astern. They stand on brackets outside the
thrusters of a BlueROV2 Heavy. Body axes are forward-starboard-down from the centre of buoyancy.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError

Array = NDArray[np.float64]
MODULES = 8
"""Modules of a plate's side: six of the marker with its black border, one white on each side"""
PLATES: dict[str, tuple[tuple[float, float, float], ...]] = {
    "top": ((0.0, 0.0, -0.15), (0, 1, 0), (-1, 0, 0)),
    "port": ((0.0, -0.29, 0.0), (-1, 0, 0), (0, 0, 1)),
    "starboard": ((0.0, 0.29, 0.0), (1, 0, 0), (0, 0, 1)),
    "stern": ((-0.30, 0.0, 0.0), (0, 1, 0), (0, 0, 1)),
    "bow": ((0.30, 0.0, 0.0), (0, -1, 0), (0, 0, 1)),
}
"""Each plate's centre [m], and the body axes to the right and downwards on its print"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Board:
    """Markers of one vehicle: ids 0 to 4 of the dictionary 4x4_50, in the order of `PLATES`."""

    side: float = 0.15
    """[m] Side of a marker's black square"""

    def __post_init__(self) -> None:
        if not 0.02 <= self.side <= 1.0:
            raise InputError(
                f"marker side is {self.side:g} m: give the printed black square, 0.02 to 1"
            )

    def corners(self, side: float | None = None) -> Array:
        """[m] Corners of all markers, (5, 4, 3), body axes: top left, top right, bottom right,
        bottom left. `side` gives those of another square on the same centres."""
        half = 0.5 * (self.side if side is None else side)
        found = []
        for centre, right, down in (np.array(one, float) for one in PLATES.values()):
            found.append([centre + half * (i * right + j * down)
                          for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])  # fmt: skip
        return np.array(found)

    @property
    def outward(self) -> Array:
        """Unit vectors out of the plates, (5, 3), body axes."""
        return np.array([np.cross(down, right) for _, right, down in PLATES.values()], float)


def dictionary() -> cv2.aruco.Dictionary:
    """Dictionary of the markers."""
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)


def plate(number: int, module: int = 32) -> NDArray[np.uint8]:
    """Grey picture of a plate with its white margin; `module` [pixel] is a square of the code."""
    inner = cv2.aruco.generateImageMarker(dictionary(), number, (MODULES - 2) * module)
    return np.asarray(np.pad(inner, module, constant_values=255), np.uint8)


def write_sheets(folder: Path, board: Board) -> list[Path]:
    """Write one printable page for each plate, A4 at 300 dpi, with its name and size; return them.

    Raises:
      InputError: the plates do not fit on the paper.
    """
    from PIL import Image, ImageDraw, ImageFont

    dpi, paper = 300.0, (2480, 3508)
    size = round(board.side / (MODULES - 2) * MODULES / 0.0254 * dpi)
    if size > paper[0]:
        raise InputError(f"a marker of {board.side:g} m does not fit on A4: at most 0.157")
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for number, name in enumerate(PLATES):
        page = Image.new("L", paper, 255)
        picture = Image.fromarray(plate(number)).resize((size, size), Image.Resampling.NEAREST)
        page.paste(picture, ((paper[0] - size) // 2, 400))
        text = f"{number}: {name}. Black square {1000 * board.side:g} mm: measure it. This edge is "
        text += {"top": "aft", "bow": "down"}.get(name, "down")
        where = (paper[0] // 2, 500 + size)
        ImageDraw.Draw(page).text(where, text, fill=0, font=ImageFont.load_default(64), anchor="ma")
        path = folder / f"marker_{number}_{name}.png"
        page.save(path, dpi=(dpi, dpi))
        found.append(path)
    return found
