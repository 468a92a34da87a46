"""Style of all figures, readable at the width of a journal column; units, legends and date axes.

The palette is Okabe and Ito's (2008), distinguishable with every common colour blindness. The
colour maps, such as cividis, have steadily growing lightness. Figures are made without pyplot, so
that plotting leaves no global state and works in any thread.
"""

from __future__ import annotations

import contextlib
import datetime
from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.dates import AutoDateLocator
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, Locator
from numpy.typing import NDArray

from twin.records.attributes import is_logged
from twin.records.coordinates import START_TIME, unix_seconds
from twin.records.trajectory import Trajectory

Array = NDArray[np.float64]

COLUMN_WIDTH, PAGE_WIDTH = 3.5, 7.2
"""[in] COLUMN_WIDTH: a column of a two-column journal (89 mm). PAGE_WIDTH: both (183 mm)"""

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
"""Palette of Okabe and Ito, "Color Universal Design" (2008); black slightly softened."""
TRUTH, ESTIMATE, COMMAND = PALETTE["blue"], PALETTE["vermillion"], PALETTE["black"]
GUIDE = "#8A8F98"
"""Colours of roles, equal in every figure: truth, estimate, command and guide line."""
GROUND = "#C9B48A"
"""Colour of the sea floor"""
SEQUENTIAL_MAP = "cividis"

_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans", "font.size": 8.0, "figure.dpi": 150.0, "savefig.dpi": 200.0,
    "axes.titlesize": 8.5, "axes.titlelocation": "left", "axes.titleweight": "bold",
    "axes.labelsize": 8.0, "axes.linewidth": 0.7, "axes.formatter.useoffset": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=list(PALETTE.values())), "image.cmap": SEQUENTIAL_MAP,
    "grid.color": "#DDE1E6", "grid.linewidth": 0.5,
    "lines.linewidth": 1.2, "lines.solid_capstyle": "round",
    "xtick.labelsize": 7.5, "xtick.major.width": 0.7,
    "ytick.labelsize": 7.5, "ytick.major.width": 0.7,
    "legend.fontsize": 7.5, "legend.frameon": False, "legend.handlelength": 1.6,
    "figure.constrained_layout.use": True, "figure.constrained_layout.h_pad": 0.05,
}  # fmt: skip
TIME_UNITS = ((7200.0, 3600.0, "h"), (300.0, 60.0, "min"), (0.0, 1.0, "s"))
"""Rows (least duration [s], seconds per unit, unit), the longest duration first."""
OTHER_COLOURS = tuple(c for name, c in PALETTE.items() if name not in ("blue", "black"))
"""Colours of dead-reckoned tracks beside the truth"""
END: dict[str, Any] = {"mfc": "white", "mec": COMMAND, "mew": 1.2, "ls": "none"}
"""Marker of a track's start or end"""
MINUTE, DAY = 60.0, 86400.0  # [s]
LABEL = "time, UTC"


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Apply the project's style to axes that are made within this context."""
    with matplotlib.rc_context(_RC):
        yield


def new_figure(width: float = COLUMN_WIDTH, height: float = 2.6) -> Figure:
    """Make an empty figure of `width` by `height` [in]; call this inside `styled()`."""
    return Figure(figsize=(width, height), layout="constrained")


def time_unit(time: Array) -> tuple[float, str]:
    """Seconds per unit and the unit's name that suit the span of `time` [s]."""
    span = float(time[-1] - time[0]) if len(time) else 0.0
    return next((seconds, name) for least, seconds, name in TIME_UNITS if span >= least)


def length_unit(*arrays: Array) -> tuple[float, str]:
    """Metres per unit and the unit's name that suit the largest extent in `arrays` [m]."""
    spans = [float(np.nanmax(a) - np.nanmin(a)) for a in arrays if len(a) and np.isfinite(a).any()]
    return (1000.0, "km") if max(spans, default=0.0) >= 2000.0 else (1.0, "m")


def depth_axis(axes: Axes, deepest: float, *, label: bool = True) -> None:
    """Set a depth axis, positive down from the surface at the top; `deepest` [m] sets the range."""
    bottom = max(deepest * 1.06, 1.0)
    axes.set_ylim(bottom, 0.0)
    if label:
        axes.set_ylabel("depth [m]")


def track_look(index: int) -> dict[str, Any]:
    """Colour and dashes of a track beside the truth; the first 24 tracks all differ."""
    return {
        "color": OTHER_COLOURS[index % len(OTHER_COLOURS)],
        "ls": ("-", "--", "-.", ":")[index // len(OTHER_COLOURS) % 4],
    }


def thin(*arrays: Array, most: int = 4000) -> tuple[Array, ...]:
    """Take every n-th sample so that at most `most` are left: enough for any printed width."""
    step = max(1, -(-len(arrays[0]) // most))
    return tuple(np.asarray(a)[::step] for a in arrays)


def pad_limits(axes: Axes, *, least: float, which: str = "y") -> None:
    """Widen an axis to a span of at least `least`, so that noise stays small."""
    low, high = getattr(axes, f"get_{which}lim")()
    if abs(high - low) < least:
        middle = (low + high) / 2
        axes.set(**{f"{which}lim": (middle - least / 2, middle + least / 2)})


def legend_above(axes: Axes, columns: int, at: float = 0.97, **look: Any) -> None:
    """Draw the legend at the right corner above the axes, where no curve is; `at` is its lower
    edge over the height of the axes."""
    corner: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, at), "borderaxespad": 0.1}
    axes.legend(**corner, ncols=columns, **look)


def colour_bar(axes: Axes, drawn: ScalarMappable, label: str, **look: Any) -> Colorbar:
    """Draw the colour bar of `drawn` beside the axes."""
    bar = axes.figure.colorbar(drawn, ax=axes, **look)
    bar.set_label(label)
    bar.outline.set_visible(False)
    return bar


def say_instead(axes: Axes, text: str) -> None:
    """Write a line of text in place of the axes' content."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center")
    axes.set_axis_off()


class DateLocator(Locator):
    """Ticks at round dates on an axis whose unit is `seconds` and whose 0 is unix time `start`."""

    def __init__(self, start: float, seconds: float, most: int = 7):
        self._start, self._seconds = start, seconds
        self._dates = AutoDateLocator(minticks=3, maxticks=most)

    def __call__(self) -> Sequence[float]:
        """Ticks for the axis's present view."""
        assert self.axis is not None
        low, high = self.axis.get_view_interval()
        return self.tick_values(low, high)

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Ticks between two values of the axis, as the date locator chooses them."""
        ends = (moment_of(self._start + self._seconds * x) for x in sorted((vmin, vmax)))
        days = np.asarray(self._dates.tick_values(*ends), float)
        found: list[float] = ((days * DAY - self._start) / self._seconds).tolist()
        return found


class DateFormatter(Formatter):
    """Labels of date ticks: time of day over the date, or day over year, each only when new."""

    def __init__(self, start: float, seconds: float):
        self._start, self._seconds = start, seconds

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Text of one moment, as at the mouse pointer."""
        return f"{moment_of(self._start + self._seconds * x):%Y-%m-%d %H:%M:%S}"

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Texts of all ticks of the axis."""
        moments = [moment_of(self._start + self._seconds * x) for x in values]
        steps = np.diff([one.timestamp() for one in moments])
        step = float(steps.min()) if len(steps) else 0.0
        if step >= DAY - 1.0:
            upper, lower = "%m-%d", "%Y"
        else:
            upper, lower = "%H:%M" if step >= MINUTE else "%H:%M:%S", "%Y-%m-%d"
        texts, said = [], ""
        for one in moments:
            below = f"{one:{lower}}"
            texts.append(f"{one:{upper}}" + (f"\n{below}" if below != said else ""))
            said = below
        return texts


def moment_of(unix: float) -> datetime.datetime:
    """Date and time of a unix time [s], rounded to the second."""
    return datetime.datetime.fromtimestamp(round(unix), datetime.UTC)


def draw_dates(axes: Axes, start: float, seconds: float) -> None:
    """Make dates the ticks of a time axis.

    Args:
      start: unix time [s] at 0 of the axis.
      seconds: [s] unit of the axis.
    """
    axes.xaxis.set_major_locator(DateLocator(start, seconds))
    axes.xaxis.set_major_formatter(DateFormatter(start, seconds))


def label_time(axes: Axes, unit: str) -> None:
    """Label a time axis that counts from the start."""
    axes.set_xlabel(f"time [{unit}]")


def label_mission_time(axes: Axes, trajectory: Trajectory, seconds: float, unit: str) -> None:
    """Label a mission's time axis; the axis of a log gets dates.

    Args:
      seconds: [s] unit of the axis, whose name is `unit`.
    """
    start = trajectory.provenance.get(START_TIME) if is_logged(trajectory.provenance) else None
    if start is None:
        label_time(axes, unit)
        return
    draw_dates(axes, unix_seconds(str(start)), seconds)
    axes.set_xlabel(LABEL)
