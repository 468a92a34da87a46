"""Style: one look for every figure, readable at the width of a journal column.

The palette is Okabe and Ito's (2008), distinguishable with every common colour blindness; the maps
are cividis and its kin, whose lightness grows steadily. Figures are made without pyplot, so that
plotting leaves no global state and works in any thread.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLUMN_WIDTH = 3.5
"""[in] one column of a two-column journal (89 mm)"""
PAGE_WIDTH = 7.2
"""[in] both columns (183 mm)"""

PALETTE = {
    "blue": "#0072B2",
    "vermillion": "#D55E00",
    "green": "#009E73",
    "purple": "#CC79A7",
    "sky": "#56B4E9",
    "orange": "#E69F00",
    "black": "#1A1A1A",
    "yellow": "#F0E442",
}
"""Okabe and Ito, "Color Universal Design" (2008); black a little softened, yellow last."""
TRUTH, ESTIMATE, COMMAND, GUIDE = (
    PALETTE["blue"],
    PALETTE["vermillion"],
    PALETTE["black"],
    "#8A8F98",
)
"""Roles that keep their colour in every figure."""
GROUND = "#C9B48A"
"""The sea floor"""
SEQUENTIAL_MAP = "cividis"

_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=list(PALETTE.values())),
    "grid.color": "#DDE1E6",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.h_pad": 0.05,
    "figure.dpi": 150.0,
    "savefig.dpi": 200.0,
    "image.cmap": SEQUENTIAL_MAP,
    "axes.formatter.useoffset": False,
}


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Within it, new axes take the project's look."""
    with matplotlib.rc_context(_RC):
        yield


def new_figure(width: float = COLUMN_WIDTH, height: float = 2.6) -> Figure:
    """An empty figure of `width` by `height` [in]; call it inside `styled()`."""
    return Figure(figsize=(width, height), layout="constrained")


TIME_UNITS = ((7200.0, 3600.0, "h"), (300.0, 60.0, "min"), (0.0, 1.0, "s"))
"""Longest duration first: (from this duration [s], seconds per unit, unit)."""


def time_unit(time: Array) -> tuple[float, str]:
    """Seconds per unit and the unit's name that suit the span of `time` [s]."""
    span = float(time[-1] - time[0]) if len(time) else 0.0
    for least, seconds, name in TIME_UNITS:
        if span >= least:
            return seconds, name
    raise AssertionError("the last unit suits every span")


def length_unit(*arrays: Array) -> tuple[float, str]:
    """Metres per unit and the unit's name that suit the largest extent in `arrays` [m]."""
    spans = [float(np.nanmax(a) - np.nanmin(a)) for a in arrays if len(a) and np.isfinite(a).any()]
    return (1000.0, "km") if max(spans, default=0.0) >= 2000.0 else (1.0, "m")


def label_time(axes: Axes, unit: str) -> None:
    """The label of a time axis that counts from the start."""
    axes.set_xlabel(f"time [{unit}]")


def depth_axis(axes: Axes, deepest: float, *, label: bool = True) -> None:
    """Depth positive down from the surface at the top; `deepest` [m] sets the range."""
    bottom = max(deepest * 1.06, 1.0)
    axes.set_ylim(bottom, 0.0)
    if label:
        axes.set_ylabel("depth [m]")


OTHER_COLOURS = tuple(c for name, c in PALETTE.items() if name not in ("blue", "black"))
"""of tracks beside the truth"""


def track_look(index: int) -> dict[str, Any]:
    """Colour and dashes of a track beside the truth; no two of the first 28 are alike."""
    return {
        "color": OTHER_COLOURS[index % len(OTHER_COLOURS)],
        "ls": ("-", "--", "-.", ":")[index // len(OTHER_COLOURS) % 4],
    }


def thin(*arrays: Array, most: int = 4000) -> tuple[Array, ...]:
    """Every n-th sample so that at most `most` are left: enough for any printed width."""
    step = max(1, -(-len(arrays[0]) // most))
    return tuple(np.asarray(a)[::step] for a in arrays)


def pad_limits(axes: Axes, *, least: float, which: str = "y") -> None:
    """Widen an axis whose data hardly vary to a span of `least`, so that noise stays small."""
    low, high = axes.get_ylim() if which == "y" else axes.get_xlim()
    if abs(high - low) < least:
        middle = (low + high) / 2
        setter = axes.set_ylim if which == "y" else axes.set_xlim
        setter(middle - least / 2, middle + least / 2)


END: dict[str, Any] = {"mfc": "white", "mec": COMMAND, "mew": 1.2, "ls": "none"}
"""Marker of a track's start or end"""


def legend_above(axes: Axes, columns: int, at: float = 0.97, **look: Any) -> None:
    """Names in the corner above the axes, where no curve is; `at` is their lower edge over the
    height of the axes."""
    corner: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, at), "borderaxespad": 0.1}
    axes.legend(**corner, ncols=columns, **look)


def colour_bar(axes: Axes, drawn: ScalarMappable, label: str, **look: Any) -> Colorbar:
    """The bar beside the axes that says what the colours of `drawn` mean."""
    bar = axes.figure.colorbar(drawn, ax=axes, **look)
    bar.set_label(label)
    bar.outline.set_visible(False)
    return bar


def say_instead(axes: Axes, text: str) -> None:
    """A line of text in place of what the axes would show."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center")
    axes.set_axis_off()
