"""Space: 3-D axes with depth down, as every figure of a track in space has them."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

VIEW_ELEVATION, VIEW_AZIMUTH = 24, -58
"""[degree] from where the box is seen"""
BOX = (1.25, 1.25, 0.9)
"""East, north and depth sides of the box; the vertical scale is its own"""
ZOOM = 0.92
"""Smaller than matplotlib's 1, so that no label is cut off"""
TICKS = 4
PANE = (0.97, 0.98, 0.99, 1.0)
"""Colour of the box's walls"""
BOTTOM, RIGHT = 0.02, 0.94
"""Edges of the axes over the figure's size: the depth label reaches beyond the right one"""
BLANK = 0.15
"""Of a square's height that a box this flat leaves free above itself"""
LEGEND: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0.02, 0.99), "columnspacing": 1.0}
"""Where `figure.legend` goes"""


def space_axes(figure: Figure, *, floor: float, unit: str, top: float) -> Any:
    """3-D axes that fill a figure; call it inside `style.styled()`.

    Args:
      floor: [m] depth of the box's floor.
      unit: of east and north.
      top: upper edge of the axes over the figure's height; the legend goes above.

    Returns:
      matplotlib's Axes3D, which takes east, north and depth in this order.
    """
    figure.set_layout_engine("none")  # it does not know how far the labels of 3-D axes reach
    # the blank above the box reaches beyond `top`, under the legend, and is not a white stripe
    height = (top - BOTTOM) / (1.0 - BLANK)
    axes: Any = figure.add_axes((0.0, BOTTOM, RIGHT, height), projection="3d")
    axes.set_zlim(floor, 0.0)
    axes.set_xlabel(f"east [{unit}]")
    axes.set_ylabel(f"north [{unit}]")
    axes.set_zlabel("depth [m]")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color(PANE)
        axis.set_major_locator(MaxNLocator(TICKS))
    axes.view_init(elev=VIEW_ELEVATION, azim=VIEW_AZIMUTH)
    axes.set_box_aspect(BOX, zoom=ZOOM)
    return axes
