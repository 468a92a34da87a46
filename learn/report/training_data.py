"""Training data: a mission that the networks were trained on."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from learn.data.dataset import MissionSequence
from learn.report.contents import Contents, ReportFigure
from twin.navigation.dead_reckoning import sample_times
from twin.show import style

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
"""What was learned in place of a truth, among the signals where it was not the truth itself."""
LABEL_LINE: dict[str, Any] = {"color": style.PALETTE["orange"], "lw": 0.9}
TRUE_LINE: dict[str, Any] = {"color": style.TRUTH, "lw": 3.0, "alpha": 0.35}
"""Of a truth that was not learned: wide and pale, below the labels"""


class TrainingData(ReportFigure):
    """See the module."""

    summary = "surge, sway and measured signals of a training mission"
    section = "training"

    def draw(self, contents: Contents) -> Figure | None:
        """See `ReportFigure`."""
        return None if contents.training is None else training_figure(contents.training)

    def caption(self, contents: Contents) -> str:
        """See `ReportFigure`."""
        assert contents.training is not None
        learned = "the velocities to learn in blue"
        if set(LABELS.values()) & set(contents.training.signals):
            learned = (
                "the velocities to learn, from the Doppler log, in orange, the truth in pale blue"
            )
        return f"A training mission ({contents.training.index}): {learned}, and what was measured."


def training_figure(mission: MissionSequence) -> Figure:
    """A training mission: the velocities to learn and the main measured signals."""
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
