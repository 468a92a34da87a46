"""Caption: which mission of which store a figure shows, so that a picture can be told apart."""

from __future__ import annotations

import datetime
import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from twin.records.attributes import DIVE, PRESET, SCENARIO, SEED, SETTINGS, says_simulated
from twin.records.logs import log_rows, numbers
from twin.records.place import NOMINAL, START_LATITUDE, START_LONGITUDE, START_TIME, read_place
from twin.records.reader import MissionStore
from twin.records.schema import MISSION

LETTERS_PER_INCH = 13.0
"""At the caption's size, with room to spare"""
LINE_HEIGHT = 0.16
"""[in]"""
FONT_SIZE = 7.5
MINUTES = "%Y-%m-%d %H:%M"
"""How figures write a moment"""


def mission_caption(store: MissionStore, mission: int) -> str:
    """One line that names a mission: of a log its vehicle, dive, time (UTC) and place; of a
    simulation its store, preset and seed.
    """
    if store.logged:
        return _logged(store, mission)
    settings, scenario = (
        store.json(name) if name in store.attributes else {} for name in (SETTINGS, SCENARIO)
    )
    parts = [f"{store.path.name}, mission {mission}"]
    if PRESET in settings:
        parts.append(f"preset {settings[PRESET]}")
    if scenario.get("name"):
        parts.append(str(scenario["name"]))
    seed = settings.get(SEED, scenario.get(SEED))
    if seed is not None:
        parts.append(f"seed {seed}")
    began = read_place(store.dataset.isel({MISSION: mission}, missing_dims="ignore"))
    nominal = str(began.get(NOMINAL, ""))
    if START_LATITUDE in began and "place" not in nominal:
        parts.append(place(float(began[START_LATITUDE]), float(began[START_LONGITUDE])))
    if START_TIME in began and "date" not in nominal:
        moment = datetime.datetime.fromisoformat(str(began[START_TIME]))
        parts.append(f"{moment:{MINUTES}} UTC")
    return ", ".join([*parts, "simulated"])


def _logged(store: MissionStore, mission: int) -> str:
    row = log_rows(store)[mission]
    parts = [row.deployment, f"mission {mission}"]
    dive = numbers(store, DIVE)[mission]
    if np.isfinite(dive):
        parts.append(f"dive {dive:.0f}")
    if np.isfinite(row.start):
        moment = datetime.datetime.fromtimestamp(row.start, datetime.UTC)
        parts.append(f"{moment:{MINUTES}} UTC")
    latitude, longitude = (numbers(store, f"start_{n}")[mission] for n in ("latitude", "longitude"))
    if np.isfinite(latitude) and np.isfinite(longitude):
        parts.append(place(latitude, longitude))
    if says_simulated(store.attributes):
        parts.append("simulated")
    return ", ".join(parts)


def missions_caption(store: MissionStore, missions: Sequence[int], vehicle: str | None) -> str:
    """As `mission_caption`, of dives of a log, and whose flight model tells their velocities."""
    first, last = missions[0], missions[-1]
    text = mission_caption(store, first)
    if last != first:
        rows = log_rows(store)
        text = f"{rows[first].deployment}, missions {first} to {last}"
        ends = [rows[k].start + rows[k].duration for k in missions]
        moments = [rows[first].start, max(ends) if np.isfinite(ends).all() else rows[last].start]
        if np.isfinite(moments).all():
            begin, end = (datetime.datetime.fromtimestamp(m, datetime.UTC) for m in moments)
            text += f", {begin:{MINUTES}} to {end:{MINUTES}} UTC"
    return text if vehicle is None else f"{text}, flight model {vehicle}"


def place(latitude: float, longitude: float) -> str:
    """Latitude and longitude [degree] as people write them."""
    north = "N" if latitude >= 0.0 else "S"
    turned = (longitude + 180.0) % 360.0 - 180.0
    east = "E" if turned >= 0.0 else "W"
    return f"{abs(latitude):.3f}°{north} {abs(turned):.3f}°{east}"


def add_caption(figure: Figure, text: str) -> None:
    """Write a caption above everything, and make the figure that much higher."""
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(text, max(20, int(width * LETTERS_PER_INCH)))
    room = LINE_HEIGHT * len(lines) + 0.08
    figure.set_size_inches(width, height + room)
    kept = height / (height + room)
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        rows = 0.0  # of legends, which the layout forgets as soon as they are moved
        for legend in figure.legends:
            legend.set_bbox_to_anchor((0.0, 0.0, 1.0, kept), transform=figure.transFigure)
            rows = max(rows, legend.get_window_extent().height / figure.bbox.height)
        engine.set(rect=(0.0, 0.0, 1.0, kept - rows))
    else:  # axes placed by hand: keep them where they were
        for axes in figure.axes:
            box = axes.get_position()
            axes.set_position((box.x0, box.y0 * kept, box.width, box.height * kept))
        for legend in figure.legends:
            legend.set_bbox_to_anchor((0.02, 0.99 * kept), transform=figure.transFigure)
    figure.text(
        0.02,
        1.0 - 0.04 / (height + room),
        "\n".join(lines),
        va="top",
        ha="left",
        fontsize=FONT_SIZE,
        color="#444444",
    )
