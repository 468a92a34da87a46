"""Missions page: one page of figures on a store of simulated missions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from factory.generation.generated_store import GeneratedStore
from twin.cli.text_table import counted
from twin.records.attributes import SPLITS
from twin.records.schema import VARIABLES
from twin.records.trajectory import actuator_names
from twin.sensors.dvl import MODES, Dvl
from twin.show import style

Array = NDArray[np.float64]

MOST_TRACKS = 60
"""Maximum number of tracks in the figure; more would hide each other."""
MOST_PROFILES = 8
"""Maximum number of missions in the figure of depth over time"""
MOST_MISSIONS = 200
"""Maximum number of missions that the page reads, evenly chosen from the store"""
ALTITUDE = "true_altitude"
POINTS = 1500
"""Maximum number of samples of a mission that the page uses, evenly chosen"""
BINS = 60
COVERED = 0.1, 99.9
"""Percentiles at the ends of a histogram's axis; launches and surfacings lie outside."""
SPLIT_COLOURS = {
    "train": style.PALETTE["blue"],
    "validation": style.PALETTE["green"],
    "test": style.PALETTE["vermillion"],
}
VELOCITIES = [(f"true_{n}", f"{n} through the water [m/s]") for n in ("surge", "sway", "heave")]
MEASURED = (
    ("measured_pitch", "pitch [deg]"),
    ("measured_roll", "roll [deg]"),
    ("measured_depth", "depth [m]"),
)
PARTS = {
    "measured_pump": "pumped volume [cm3]",
    "measured_shift": "battery shift [mm]",
    "measured_rotation": "battery rotation [deg]",
}
"""Labels of a glider's parts in the order of the page; other parts have their signal's name."""
COLUMNS = 3
HEAD_HEIGHT, ROW_HEIGHT = 5.0, 1.4
"""[in] HEAD_HEIGHT: of title, tracks and depths together. ROW_HEIGHT: of a row of histograms"""
ERRORS = (
    ("pitch", "pitch error [deg]"),
    ("heading", "heading error [deg]"),
    ("depth", "depth error [m]"),
)
DOPPLER = [(f"dvl_{name}", f"DVL {name} error [m/s]") for name in ("surge", "sway")]
"""Errors of the Doppler log, for surveys near the sea floor"""
MILLIMETRES = {"measured_shift": 1000.0}


class Sampled(NamedTuple):
    """Evenly thinned samples of some missions of a store."""

    splits: list[str]
    """Split of each mission"""
    time: list[Array]
    signals: dict[str, list[Array]]
    """Signals by name, with one array for each mission"""

    def pooled(self, name: str, split: str) -> Array:
        """Join all samples of a signal in the missions of one split."""
        rows = [r for r, s in zip(self.signals[name], self.splits, strict=True) if s == split]
        return np.concatenate(rows) if rows else np.zeros(0)


def sample_store(run: GeneratedStore, names: list[str]) -> Sampled:
    """Read evenly thinned samples of the signals `names`."""
    count = min(len(run), MOST_MISSIONS)
    missions = np.unique(np.linspace(0, len(run) - 1, count).round().astype(int))
    period = run.period
    time: list[Array] = []
    signals: dict[str, list[Array]] = {name: [] for name in names}
    for mission in missions:
        samples = int(run.samples[mission])
        chosen = np.unique(np.linspace(0, samples - 1, min(samples, POINTS)).round().astype(int))
        time.append(chosen * period)
        for name in names:
            signals[name].append(run.row(name, int(mission))[chosen].astype(float))
    return Sampled([run.splits[m] for m in missions], time, signals)


def store_page(run: GeneratedStore) -> Figure:
    """Plot tracks, depths, currents, velocities, measured signals and, if any, sensor errors."""
    noisy = run.sensor_preset != "ideal"
    names = [f"true_{n}" for n in ("north", "east", "depth", "current_north", "current_east")]
    inputs = [*MEASURED, *part_inputs(run)]
    names += [name for name, _ in (*VELOCITIES, *inputs)]
    names += [f"{kind}_{name}" for name, _ in ERRORS for kind in ("true", "measured")]
    survey = ALTITUDE in run
    if survey:
        names += [ALTITUDE, "measured_dvl_mode", *(f"measured_{name}" for name, _ in DOPPLER)]
        names += [name for name in Dvl.reads if name.startswith("true_")]
    data = sample_store(run, sorted(set(names)))
    with style.styled():
        panels = [("velocities", *entry) for entry in VELOCITIES]
        panels += [("measured", *entry) for entry in inputs]
        panels += [("", "", "")] * (-len(panels) % COLUMNS)
        panels += [("sensor errors", *entry) for entry in ERRORS] if noisy else []
        if survey:
            panels += [("Doppler log", *entry) for entry in DOPPLER]
            panels += [("locks", "measured_dvl_mode", "its lock [% of samples]")]
        rows = len(panels) // COLUMNS
        figure = style.new_figure(style.PAGE_WIDTH, HEAD_HEIGHT + ROW_HEIGHT * rows)
        heights = [3.0, 1.9, *[1.7] * rows]
        grid = figure.add_gridspec(len(heights), 6, height_ratios=heights)
        _draw_tracks(figure.add_subplot(grid[0, :3]), data, len(run))
        _draw_currents(figure.add_subplot(grid[0, 3:]), data)
        _draw_depths(figure.add_subplot(grid[1, :]), data)
        for place, (kind, name, label) in enumerate(panels):
            if not name:
                continue
            row, column = 2 + place // COLUMNS, 2 * (place % COLUMNS)
            axes = figure.add_subplot(grid[row, column : column + 2])
            DRAW.get(kind, _draw_histogram)(axes, data, name, label)
            if column == 0:
                axes.set_ylabel(kind)
        headline = (
            f"{run.path.name}: preset {run.settings['preset']}, seed {run.seed}, "
            f"{counted(len(run), 'mission')}, {run.hours:.4g} h"
        )
        figure.suptitle(headline, fontsize=9.5, fontweight="bold", x=0.01, ha="left")
    return figure


def part_inputs(run: GeneratedStore) -> list[tuple[str, str]]:
    """List the measured positions of the vehicle's parts with labels, a glider's parts first."""
    parts = [part for part in actuator_names(run.signals()) if f"measured_{part}" in run]
    named = {f"measured_{n}": f"{n} [{VARIABLES[f'measured_{n}'].units}]" for n in parts}
    known = {name: label for name, label in PARTS.items() if name in named}
    return [*known.items(), *((n, label) for n, label in named.items() if n not in known)]


def _draw_tracks(axes: Axes, data: Sampled, missions: int) -> None:
    shown = min(len(data.splits), MOST_TRACKS)
    north, east = data.signals["true_north"][:shown], data.signals["true_east"][:shown]
    metres, unit = style.length_unit(*north, *east)
    for split in SPLITS:
        for place, i in enumerate(i for i in range(shown) if data.splits[i] == split):
            axes.plot(
                east[i] / metres, north[i] / metres, label=None if place else split,
                color=SPLIT_COLOURS[split], linewidth=0.8, alpha=0.8,
            )  # fmt: skip
    axes.plot(0.0, 0.0, "o", color=style.PALETTE["black"], markersize=3.5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"east [{unit}]")
    axes.set_ylabel(f"north [{unit}]")
    part = "" if shown == missions else f" ({shown} of {missions})"
    axes.set_title(f"tracks over ground{part}")
    axes.legend(loc="best")


def _draw_currents(axes: Axes, data: Sampled) -> None:
    for i in sorted(range(len(data.splits)), key=lambda i: SPLITS.index(data.splits[i])):
        axes.plot(
            data.signals["true_current_east"][i], data.signals["true_current_north"][i],
            color=SPLIT_COLOURS[data.splits[i]], linewidth=0.7, alpha=0.7, marker=".",
            markersize=2.5, markevery=[0, -1],
        )  # fmt: skip
    axes.axhline(0.0, color=style.GUIDE, linewidth=0.6)
    axes.axvline(0.0, color=style.GUIDE, linewidth=0.6)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east [m/s]")
    axes.set_ylabel("north [m/s]")
    axes.set_title("current met on the way")


def _draw_depths(axes: Axes, data: Sampled) -> None:
    deepest = 0.0
    shown = np.unique(np.linspace(0, len(data.splits) - 1, MOST_PROFILES).round().astype(int))
    seconds, unit = style.time_unit(max((data.time[i] for i in shown), key=len))
    for i in shown:
        depth = data.signals["true_depth"][i]
        deepest = max(deepest, float(depth.max()))
        colour = SPLIT_COLOURS[data.splits[i]]
        axes.plot(data.time[i] / seconds, depth, color=colour, linewidth=0.9, alpha=0.9)
        if ALTITUDE in data.signals:
            floor = depth + data.signals[ALTITUDE][i]
            deepest = max(deepest, float(floor.max()))
            axes.plot(data.time[i] / seconds, floor, color=style.GUIDE, linewidth=0.8)
    style.depth_axis(axes, deepest)
    style.label_time(axes, unit)
    axes.margins(x=0.01)
    below = ", grey: the sea floor under each" if ALTITUDE in data.signals else ""
    axes.set_title(f"depth of {counted(len(shown), 'mission')}{below}")


def _draw_histogram(axes: Axes, data: Sampled, name: str, label: str) -> None:
    scale = MILLIMETRES.get(name, 1.0)
    values = {split: scale * data.pooled(name, split) for split in SPLITS}
    _histograms(axes, values, label)


def _draw_error(axes: Axes, data: Sampled, name: str, label: str) -> None:
    values = {}
    for split in SPLITS:
        error = data.pooled(f"measured_{name}", split) - data.pooled(f"true_{name}", split)
        values[split] = (error + 180.0) % 360.0 - 180.0 if name == "heading" else error
    _histograms(axes, values, label)


def _draw_doppler(axes: Axes, data: Sampled, name: str, label: str) -> None:
    """Draw errors of the Doppler log: measured minus true velocity, relative to bottom or water."""
    values: dict[str, Array] = {split: np.zeros(0) for split in SPLITS}
    for i, split in enumerate(data.splits):
        signals = {signal: rows[i] for signal, rows in data.signals.items()}
        seen = Dvl.observed(name, signals)
        assert seen is not None
        values[split] = np.concatenate([values[split], signals[f"measured_{name}"] - seen])
    _histograms(axes, values, label)


def _draw_locks(axes: Axes, data: Sampled, name: str, label: str) -> None:
    """Draw how often the Doppler log locked on bottom, water or nothing, for each split."""
    present = [split for split in SPLITS if split in data.splits]
    for row, split in enumerate(present):
        mode = data.pooled(name, split)
        shares = [100.0 * np.mean(mode == number) for number in MODES.values()]
        places = np.arange(len(MODES)) + 0.27 * (row - 0.5 * (len(present) - 1))
        axes.bar(places, shares, width=0.25, color=SPLIT_COLOURS[split], alpha=0.8)
    axes.set_xticks(np.arange(len(MODES)), list(MODES))
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_yticks([0.0, 1.0, 10.0, 100.0], ["0", "1", "10", "100"])
    axes.set_xlabel(label)


DRAW = {"sensor errors": _draw_error, "Doppler log": _draw_doppler, "locks": _draw_locks}
"""Functions that draw a panel, by its type; all other types are histograms of a signal."""


def _histograms(axes: Axes, values: Mapping[str, Array], label: str) -> None:
    """Draw a histogram of area 1 for each split, with common bins."""
    everything = np.concatenate(list(values.values()))
    everything = everything[np.isfinite(everything)]
    low, high = np.percentile(everything, COVERED) if everything.size else (0.0, 0.0)
    if high - low < 1e-9:
        low, high = low - 0.5, high + 0.5
    margin = 0.03 * (high - low)
    edges = np.linspace(low - margin, high + margin, BINS + 1)
    for split in SPLITS:
        present = values[split][np.isfinite(values[split])]
        if not present.size:
            continue
        filled = split == "train" or not values["train"].size
        axes.hist(
            present, bins=edges.tolist(), density=True, histtype="stepfilled" if filled else "step",
            color=SPLIT_COLOURS[split], alpha=0.45 if filled else 1.0, linewidth=1.0,
        )  # fmt: skip
    axes.set_xlabel(label)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.0)
