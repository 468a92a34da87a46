"""Figures of a report, in the project's plot style; every function returns a matplotlib Figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from learn.dataset import Mission
from learn.dead_reckoning import Array, sample_times
from learn.dives import KNOWLEDGE
from learn.evaluate import FLOOR, NETWORK, Evaluation
from learn.report.names import KNOWLEDGE_TITLES, colour_of, title_of
from learn.report.shown import Shown
from twin.plot import style
from twin.plot.space import LEGEND, space_axes

TRAINING_PANELS = (
    ("true_surge", "surge [m/s]"),
    ("true_sway", "sway [m/s]"),
    ("measured_pitch", "pitch [deg]"),
    ("measured_roll", "roll [deg]"),
    ("measured_depth", "depth [m]"),
    ("measured_shift", "shift [mm]"),
    ("measured_rotation", "rotation [deg]"),
    ("measured_pump", "pump [cm³]"),
)
"""Channel and label of each panel of the training-data figure."""
MILLIMETRES = {"measured_shift": 1e3}
LEAST_ERROR_M = 0.05
"""Span of an error axis that hardly varies: centimetres are noise to a navigator."""


def training_figure(mission: Mission) -> Figure:
    """A training mission: the targets and the main inputs."""
    panels = [(name, label) for name, label in TRAINING_PANELS if name in mission.signals]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 0.95 * -(-len(panels) // 2) + 0.4)
        axes = figure.subplots(-(-len(panels) // 2), 2, sharex=True, squeeze=False)
        time = sample_times(mission.samples, mission.period)
        seconds, unit = style.time_unit(time)
        for place, (name, label) in zip(axes.T.flat, panels, strict=False):
            values = mission.signals[name] * MILLIMETRES.get(name, 1.0)
            colour = style.TRUTH if name.startswith("true_") else style.COMMAND
            t, y = style.thin(time, values)
            place.plot(t / seconds, y, color=colour, lw=0.9)
            place.set_ylabel(label)
            place.yaxis.set_major_locator(MaxNLocator(3))
            if name == "measured_depth":
                place.invert_yaxis()
        for place in axes.T.flat[len(panels) :]:
            place.set_visible(False)
        for place in axes[-1]:
            style.label_time(place, unit)
    return figure


def velocity_figure(shown: Shown) -> Figure:
    """Predicted against true surge and sway over a mission, with the errors below."""
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 4.0)
        axes = figure.subplots(2, 2, sharex=True, height_ratios=(2, 1))
        seconds, unit = style.time_unit(shown.time)
        estimate = shown.estimates[NETWORK]
        for column, name in enumerate(("surge", "sway")):
            truth = getattr(shown.reference, name)
            predicted = np.asarray(getattr(estimate, name), float)
            time, true, guess = style.thin(shown.time / seconds, truth, predicted)
            top, bottom = axes[:, column]
            top.plot(time, true, color=style.TRUTH, lw=1.8, label="true")
            top.plot(time, guess, color=style.ESTIMATE, lw=0.9, ls="--", label="predicted")
            spread = getattr(estimate, f"{name}_sd")
            if spread is not None:
                (sd,) = style.thin(np.asarray(spread, float))
                top.fill_between(
                    time, guess - 2 * sd, guess + 2 * sd, color=style.ESTIMATE, alpha=0.2, lw=0
                )
            top.set_title(name)
            bottom.plot(time, 1e3 * (guess - true), color=style.ESTIMATE, lw=0.8)
            style.label_time(bottom, unit)
        axes[0, 0].set_ylabel("through the water [m/s]")
        axes[1, 0].set_ylabel("error [mm/s]")
        axes[0, 1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    return figure


def track_figure(shown: Shown, methods: Sequence[str]) -> Figure:
    """North-east track through the water, from above."""
    with style.styled():
        figure = style.new_figure(style.COLUMN_WIDTH * 1.25, 3.9)
        axes = figure.add_subplot()
        lines = _water_lines(shown, methods)
        metres, unit = style.length_unit(*(line[:, k] for line in lines.values() for k in (0, 1)))
        for name, line in lines.items():
            north, east = style.thin(line[:, 0], line[:, 1])
            axes.plot(east / metres, north / metres, **_line_style(name))
        _ends(axes, lines["truth"] / metres)
        axes.set_xlabel(f"east [{unit}]")
        axes.set_ylabel(f"north [{unit}]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.06)
        figure.legend(loc="outside upper left", ncols=2, columnspacing=1.0)
    return figure


def track_3d_figure(shown: Shown, methods: Sequence[str]) -> Figure:
    """The same track in space, depth down; the vertical scale is its own."""
    with style.styled():
        figure = style.new_figure(style.COLUMN_WIDTH * 1.25, 3.9)
        lines = _water_lines(shown, methods)
        metres, unit = style.length_unit(*(line[:, k] for line in lines.values() for k in (0, 1)))
        depth = shown.reference.mission.signals["measured_depth"]
        axes = space_axes(figure, floor=float(np.max(depth)) * 1.1 + 1.0, unit=unit, top=0.90)
        for name, line in lines.items():
            north, east, down = style.thin(line[:, 0], line[:, 1], depth, most=2500)
            axes.plot(east / metres, north / metres, down, **_line_style(name))
        figure.legend(**LEGEND, ncols=2)
    return figure


def error_figure(missions: Sequence[Shown]) -> Figure:
    """North and east error of the networks against time, one line per mission and its current.

    The paper's figure for its three currents, through the water (above) and over ground with
    nothing known of the current (below); no fixes.
    """
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 4.2)
        axes = figure.subplots(2, 2, sharex=True)
        seconds, unit = style.time_unit(max((s.time for s in missions), key=len))
        for k, shown in enumerate(missions):
            track = shown.water_track(NETWORK)
            assert track is not None
            for row, truth in zip(
                axes, (shown.reference.water_track, shown.reference.ground_track), strict=True
            ):
                for place, values in zip(row, (track - truth).T, strict=True):
                    time, error = style.thin(shown.time / seconds, values)
                    look = CURRENT_LINES[k % len(CURRENT_LINES)]
                    place.plot(time, error, label=shown.current_label, **look)
        for place in axes.flat:
            place.axhline(0.0, color=style.GUIDE, lw=0.7, zorder=0)
            style.pad_limits(place, least=LEAST_ERROR_M)
        for place, name in zip(axes[0], ("north", "east"), strict=True):
            place.set_title(f"{name} error")
        for place in axes[1]:
            style.label_time(place, unit)
        axes[0, 0].set_ylabel("through the water [m]")
        axes[1, 0].set_ylabel("over ground [m]")
        figure.legend(
            *axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=len(missions)
        )
    return figure


CURRENT_LINES: tuple[dict[str, Any], ...] = (
    {"color": style.TRUTH, "lw": 3.2, "alpha": 0.45},
    {"color": style.PALETTE["green"], "lw": 1.7},
    {"color": style.ESTIMATE, "lw": 0.9, "ls": "--"},
)
"""Lines that cover each other stay visible: wide ones below, thin ones on top."""


def distribution_figure(evaluation: Evaluation) -> Figure:
    """Dead-reckoning error through the water over missions, each a dot, on a logarithmic axis."""
    rows = [
        (name, [s.tracks["water"].percent for s in method.scores if "water" in s.tracks])
        for name, method in evaluation.methods.items()
    ]
    rows = [(name, values) for name, values in rows if values]
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH * 0.75, 0.42 * len(rows) + 0.8)
        axes = figure.add_subplot()
        for place, (name, values) in enumerate(reversed(rows)):
            _dots(axes, place, np.array(values), colour_of(name))
        axes.set_yticks(range(len(rows)), [title_of(name) for name, _ in reversed(rows)])
        axes.set_xscale("log")
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("error at mission end [% of the path through the water]")
        axes.set_title("through the water, measured attitude")
    return figure


def dive_figure(evaluation: Evaluation) -> Figure | None:
    """Error over ground at the end of a dive, by what is known of the current; None without dives.

    Corrected afterwards the end is pinned to the fix, so there it is the largest error on the way.
    """
    kept: dict[str, dict[str, Array]] = {}
    for name, method in evaluation.methods.items():
        for knowledge in KNOWLEDGE:
            errors = [e for score in method.scores for e in score.dives.get(knowledge, ())]
            if errors:
                values = [e.max_percent if knowledge == "corrected" else e.percent for e in errors]
                kept.setdefault(name, {})[knowledge] = np.array(values)
    if not kept:
        return None
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 0.36 * len(kept) + 1.0)
        axes = figure.subplots(1, len(KNOWLEDGE), sharey=True, sharex=True)
        for place, knowledge in zip(axes, KNOWLEDGE, strict=True):
            for row, (name, found) in enumerate(reversed(kept.items())):
                if knowledge in found:
                    _dots(place, row, found[knowledge], colour_of(name))
            place.set_title(KNOWLEDGE_TITLES[knowledge])
            place.set_xscale("log")
            place.grid(visible=False, axis="y")
        axes[0].set_yticks(range(len(kept)), [title_of(name) for name in reversed(kept)])
        axes[1].set_xlabel("error over ground [% of the dive's path through the water]")
    return figure


def learning_figure(metrics: Sequence[Mapping[str, Any]]) -> Figure:
    """Validation error against time of each network."""
    with style.styled():
        figure = style.new_figure(style.COLUMN_WIDTH * 1.25, 2.6)
        axes = figure.add_subplot()
        for name in dict.fromkeys(row["network"] for row in metrics):
            rows = [row for row in metrics if row["network"] == name]
            key = "train_mse" if rows[0]["validation_mse"] is None else "validation_mse"
            colour = style.ESTIMATE if name.startswith("surge") else style.TRUTH
            label = name.removesuffix("-0")
            member = not name.endswith("-0")
            axes.plot(
                [row["seconds"] for row in rows],
                [row[key] for row in rows],
                color=colour,
                alpha=0.5 if member else 1.0,
                label=None if member else label,
            )
        axes.set_yscale("log")
        axes.set_xlabel("time in training [s]")
        axes.set_ylabel("validation MSE [(m/s)²]")
        axes.legend()
    return figure


def uncertainty_figure(shown: Shown, deviation: Array) -> Figure:
    """Horizontal error through the water against two standard deviations as predicted.

    Args:
      deviation: standard deviation [m] of the horizontal position, (time,).
    """
    track = shown.water_track(NETWORK)
    assert track is not None
    with style.styled():
        figure = style.new_figure(style.COLUMN_WIDTH * 1.25, 2.6)
        axes = figure.add_subplot()
        seconds, unit = style.time_unit(shown.time)
        error = np.hypot(*(track - shown.reference.water_track).T)
        time, wrong, sd = style.thin(shown.time / seconds, error, deviation)
        axes.fill_between(
            time, 0.0, 2.0 * sd, color=style.GUIDE, alpha=0.3, lw=0, label="2 standard deviations"
        )
        axes.plot(time, wrong, color=style.ESTIMATE, label="error")
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel("horizontal position [m]")
        style.label_time(axes, unit)
        axes.legend(loc="upper left")
    return figure


def _water_lines(shown: Shown, methods: Sequence[str]) -> dict[str, Array]:
    lines = {"truth": shown.reference.water_track}
    for name in methods:
        track = shown.water_track(name) if name in shown.estimates else None
        if track is not None and name != FLOOR:
            lines[name] = track
    return lines


def _line_style(name: str) -> dict[str, Any]:
    if name == "truth":
        return {"color": style.TRUTH, "lw": 2.0, "label": "truth"}
    dashes = "--" if name == NETWORK else ":"
    return {"color": colour_of(name), "lw": 1.1, "ls": dashes, "label": title_of(name)}


def _ends(axes: Axes, track: Array) -> None:
    for index, marker in ((0, "o"), (-1, "s")):
        axes.plot(
            track[index, 1],
            track[index, 0],
            marker,
            ms=5,
            mfc="white",
            mec=style.COMMAND,
            mew=1.2,
            ls="none",
            label="start" if index == 0 else "end",
        )


def _dots(axes: Axes, row: int, values: Array, colour: str) -> None:
    """Each value a dot, the median a bar; jittered by rank so that equal ones stay visible."""
    values = np.maximum(values[np.isfinite(values)], LEAST_PERCENT)
    jitter = 0.22 * (np.mod(np.arange(len(values)) * GOLDEN, 1.0) - 0.5)
    axes.plot(values, row + jitter, "o", ms=3.2, color=colour, alpha=0.55, mew=0)
    median = float(np.median(values))
    axes.plot([median, median], [row - 0.3, row + 0.3], color=colour, lw=2.2)


LEAST_PERCENT = 1e-4
"""Left end of logarithmic axes: a metre in a thousand kilometres."""
GOLDEN = 0.6180339887
"""Fractional part of the golden ratio, whose multiples spread evenly."""
