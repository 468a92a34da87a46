"""Velocity figures: predicted surge and sway, their stated errors, training data and progress."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from learn.data.dataset import MissionSequence
from learn.evaluation.score import LAUNCH_S, NETWORK
from learn.report.contents import Shown
from twin.navigation.dead_reckoning import Array, sample_times
from twin.show import style

MILLIMETRES_PER_METRE = 1e3
SHOWN_PERCENT = 99.5
"""[%] Percentile of the errors after the launch that the axes cover"""
TRAINING_PANELS = (
    ("true_surge", "surge [m/s]"),
    ("true_sway", "sway [m/s]"),
    ("measured_pitch", "pitch [deg]"),
    ("measured_roll", "roll [deg]"),
    ("measured_depth", "depth [m]"),
    ("measured_shift", "shift [mm]"),
    ("measured_rotation", "rotation [deg]"),
    ("measured_pump", "pump [cm³]"),
    ("measured_propeller", "propeller [rad/s]"),
    ("measured_rudder", "rudder [deg]"),
    ("measured_elevator", "elevator [deg]"),
)
"""Channel and label of each panel of the training-data figure."""
MILLIMETRES = {"measured_shift": 1e3}
LABELS = {"true_surge": "label_surge", "true_sway": "label_sway"}
"""Signals with the labels that were learned instead of the truth, by the true channel."""
LABEL_LINE: dict[str, Any] = {"color": style.PALETTE["orange"], "lw": 0.9}
TRUE_LINE: dict[str, Any] = {"color": style.TRUTH, "lw": 3.0, "alpha": 0.35}
"""Line of a truth that was not learned: wide and pale, below the labels"""


def velocity_figure(shown: Shown) -> Figure:
    """Draw predicted and true surge and sway over a mission, with the errors below.

    The axes of errors fit the time after the launch from rest: the launch has far larger errors.
    """
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 4.2)
        axes = figure.subplots(2, 2, sharex=True, height_ratios=(2, 1))
        seconds, unit = style.time_unit(shown.time)
        estimate = shown.estimates[NETWORK]
        clipped = False
        for column, name in enumerate(("surge", "sway")):
            truth = getattr(shown.reference, name)
            predicted = np.asarray(getattr(estimate, name), float)
            time, true, guess = style.thin(shown.time / seconds, truth, predicted)
            top, bottom = axes[:, column]
            top.plot(time, guess, color=style.ESTIMATE, lw=1.8, label="predicted")
            # thin and on top, so that both lines are visible where they agree
            top.plot(time, true, color=style.TRUTH, lw=0.8, label="true", zorder=3)
            spread = getattr(estimate, f"{name}_sd")
            if spread is not None:
                (sd,) = style.thin(np.asarray(spread, float))
                top.fill_between(
                    time, guess - 2 * sd, guess + 2 * sd, color=style.ESTIMATE, alpha=0.2, lw=0,
                    label="2 standard deviations of the ensemble",
                )  # fmt: skip
            top.set_title(name)
            bottom.axhline(0.0, color=style.GUIDE, lw=0.8, zorder=1)
            bottom.plot(time, MILLIMETRES_PER_METRE * (guess - true), color=style.ESTIMATE, lw=0.8)
            reach = after_launch(MILLIMETRES_PER_METRE * (predicted - truth), shown.time)
            bottom.set_ylim(-reach, reach)
            worst = float(np.max(np.abs(predicted - truth))) * MILLIMETRES_PER_METRE
            clipped |= worst > reach
            style.label_time(bottom, unit)
        for bottom in axes[1]:
            what = "predicted − true" + (", launch and spikes clipped" if clipped else "")
            bottom.set_title(what, fontweight="normal")
        axes[0, 0].set_ylabel("through the water [m/s]")
        axes[1, 0].set_ylabel("error [mm/s]")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
        figure.suptitle(shown.label, x=0.01, ha="left", fontsize=8.5)
    return figure


def after_launch(error: Array, time: Array) -> float:
    """Half-range of an axis about zero for the errors after the launch, without spikes.

    Args:
      error: errors in any unit, (time,).
      time: [s] time since the start, (time,).
    """
    late = np.abs(error[time > LAUNCH_S])
    late = late[np.isfinite(late)]
    reach = float(np.percentile(late, SHOWN_PERCENT)) if late.size else 0.0
    return 1.25 * reach or 1.0


def uncertainty_figure(shown: Shown, deviation: Array) -> Figure:
    """Draw the horizontal error through the water and two predicted standard deviations.

    Args:
      deviation: [m] standard deviation of the horizontal position, (time,).
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
            time,
            0.0,
            2.0 * sd,
            color=style.GUIDE,
            alpha=0.3,
            lw=0,
            label="2 predicted standard deviations",
        )
        axes.plot(time, wrong, color=style.ESTIMATE, label="error of the networks")
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel("horizontal position error [m]")
        style.label_time(axes, unit)
        inside = error[-1] <= 2.0 * deviation[-1]
        place = "inside" if inside else "outside"
        axes.set_title(f"{shown.label}:\nthe end lies {place} 2 deviations")
        axes.set_ylim(top=1.3 * axes.get_ylim()[1])  # room for the legend above the curves
        axes.legend(loc="upper left")
    return figure


def training_figure(mission: MissionSequence) -> Figure:
    """Draw the velocities to learn and the main measured signals of a training mission."""
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
            labels = mission.signals.get(LABELS.get(name, ""))
            if labels is None:
                place.plot(t / seconds, y, color=colour, lw=0.9)
            else:
                place.plot(t / seconds, y, **TRUE_LINE)
                t, y = style.thin(time, labels)
                place.plot(t / seconds, y, **LABEL_LINE)
            place.set_ylabel(label)
            place.yaxis.set_major_locator(MaxNLocator(3))
            if name == "measured_depth":
                place.invert_yaxis()
        for place in axes.T.flat[len(panels) :]:
            place.set_visible(False)
        for place in axes[-1]:
            style.label_time(place, unit)
    return figure


def learning_figure(metrics: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw each network's validation error over the time in training."""
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
