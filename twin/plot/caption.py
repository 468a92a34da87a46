"""Caption: which mission of which store a figure shows, so that a picture can be told apart."""

from __future__ import annotations

import datetime
import json
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from twin.records.place import START_LATITUDE, START_LONGITUDE, START_TIME, read_place
from twin.records.schema import MISSION

if TYPE_CHECKING:
    import xarray as xr

LETTERS_PER_INCH = 13.0
"""At the caption's size, with room to spare"""
LINE_HEIGHT = 0.16
"""[in]"""
FONT_SIZE = 7.5


def mission_caption(dataset: xr.Dataset, mission: int, name: str) -> str:
    """One line that names a mission: of a log its vehicle, dive, time (UTC) and place; of a
    simulation its store, preset and seed.
    """
    if "deployment" in dataset and "start_time" in dataset:
        return _logged(dataset, mission)
    settings = _json(dataset.attrs.get("settings"))
    parts = [f"{name}, mission {mission}"]
    if "preset" in settings:
        parts.append(f"preset {settings['preset']}")
    scenario = _json(dataset.attrs.get("scenario"))
    if scenario.get("name"):
        parts.append(str(scenario["name"]))
    seed = settings.get("seed", scenario.get("seed"))
    if seed is not None:
        parts.append(f"seed {seed}")
    began = read_place(dataset.isel({MISSION: mission}, missing_dims="ignore"))
    if START_LATITUDE in began:
        parts.append(place(float(began[START_LATITUDE]), float(began[START_LONGITUDE])))
    if START_TIME in began:
        parts.append(f"{began[START_TIME]} UTC")
    return ", ".join([*parts, "simulated"])


def _logged(dataset: xr.Dataset, mission: int) -> str:
    def number(key: str) -> float:
        return float(dataset[key].values[mission]) if key in dataset else float("nan")

    # the store's moments are decoded by xarray where it knows their units
    start = np.asarray(dataset["start_time"].values[mission])
    unix = (
        int(start.astype("datetime64[s]").astype(np.int64))
        if np.issubdtype(start.dtype, np.datetime64)
        else float(start)
    )
    moment = datetime.datetime.fromtimestamp(unix, datetime.UTC)
    parts = [str(dataset["deployment"].values[mission]), f"mission {mission}"]
    if np.isfinite(number("dive")):
        parts.append(f"dive {number('dive'):.0f}")
    parts.append(f"{moment:%Y-%m-%d %H:%M} UTC")
    latitude, longitude = number("start_latitude"), number("start_longitude")
    if np.isfinite(latitude) and np.isfinite(longitude):
        parts.append(place(latitude, longitude))
    if "simulated" in str(dataset.attrs.get("comment", "")):
        parts.append("simulated")
    return ", ".join(parts)


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
    style: dict[str, Any] = {"fontsize": FONT_SIZE, "ha": "left", "color": "#444444"}
    if not isinstance(
        figure.get_layout_engine(), ConstrainedLayoutEngine
    ):  # axes placed by hand: keep them where they were
        kept = height / (height + room)
        for axes in figure.axes:
            box = axes.get_position()
            axes.set_position((box.x0, box.y0 * kept, box.width, box.height * kept))
        for legend in figure.legends:
            legend.set_bbox_to_anchor((0.02, 0.99 * kept), transform=figure.transFigure)
        figure.text(0.02, 1.0 - 0.04 / (height + room), "\n".join(lines), va="top", **style)
        return
    figure.suptitle("\n".join(lines), x=0.01, **style)


def _json(text: object) -> dict[str, Any]:
    """A JSON object in an attribute; empty where there is none."""
    try:
        found = json.loads(str(text))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
