"""Speed histogram: a figure for `twin plot --figure speed_histogram`."""

import numpy as np

from twin.show import style
from twin.show.figures import FigureKind, register


def speed_histogram(trajectory, bins=20):
    with style.styled():
        figure = style.new_figure()
        axes = figure.add_subplot()
        axes.hist(np.linalg.norm(trajectory.v_rel, axis=1), bins)
        axes.set_xlabel("speed through the water [m/s]")
        axes.set_ylabel("samples [1]")
    return figure


FIGURE = register(
    FigureKind(name="speed_histogram", summary="how often which speed", draw=speed_histogram)
)
