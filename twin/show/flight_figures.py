"""Flight figures: section and histogram of the vertical water velocity, and a map.

All take the dataset that `twin flight` writes, so that its file can be drawn later.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from twin.errors import InputError, StoreError
from twin.logs.flight_dataset import (
    DAC,
    DAC_MISSION,
    GPS_FIX,
    POSITIONS,
    W_WATER,
    flight_dataset,
)
from twin.logs.flight_estimate import Flight
from twin.logs.flight_estimator import CLIMB, DESCENT
from twin.records.attributes import DEPLOYMENT, N_SAMPLES, SAMPLE_PERIOD, START_TIME
from twin.records.logged import AVERAGED
from twin.records.presence import is_flight, open_flight
from twin.records.schema import MISSION
from twin.records.storage.whole import whole_file
from twin.show import style
from twin.show.figures.map import Currents, MapContent, draw_content, joined
from twin.show.figures.page_layout import MINUTES, add_caption
from twin.show.figures.water import ocean_map

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

CM, HOUR = 100.0, 3600.0
MOST_POINTS = 20000  # about the most points of a section; more than its pixels
BINS, MOST_PROFILES = 60, 4
UNFLOWN = "no vertical water velocity to draw: no dive that the model can fly"
COVERED = 98, 99.5  # percentiles of |velocity| at the ends of the colours and the histogram's axis
LEVEL_RATE = 0.03
"""[m/s] Vertical velocity below which a vehicle turns or flies level, as in the import's phases"""
PRINT_DPI = 200  # [pixel/in]


def read_flight(path: str | Path) -> xr.Dataset:
    """Read a file of `twin flight` into memory.

    Raises:
      StoreError: the file is of another type, or cannot be read.
    """
    path = Path(path)
    if not is_flight(path):
        raise StoreError(f"{path} is not a file that `twin flight` wrote")
    try:
        with open_flight(path) as dataset:
            return dataset.load()
    except (OSError, ValueError) as error:
        raise StoreError(f"flight {path} cannot be read: {' '.join(str(error).split())}") from error


def flight_caption(flight: xr.Dataset, path: Path) -> str:
    """Caption of one line that names a flight: deployments, missions, dates, vehicle."""
    names = dict.fromkeys(map(str, flight[DEPLOYMENT].values)) if DEPLOYMENT in flight else ()
    count = flight.sizes[MISSION]
    parts = [", ".join([*names][:3]) or path.name, f"{count} mission{'s' if count > 1 else ''}"]
    if (first := _start(flight)) is not None:
        lengths = float(flight.attrs[SAMPLE_PERIOD]) * (_samples(flight) - 1)
        last = first + float((_starts(flight) + lengths).max())
        begin, end = (f"{style.moment_of(unix):{MINUTES}}" for unix in (first, last))
        parts.append(f"{begin} to {end} UTC")
    return ", ".join([*parts, f"flight model {flight.attrs.get('vehicle', 'unknown')}"])


def section(flight: xr.Dataset) -> Figure:
    """Draw depth over time, coloured by the vertical velocity of the water [cm/s]."""
    period = float(flight.attrs[SAMPLE_PERIOD])
    starts, samples = _starts(flight), _samples(flight)
    depth, water = flight["depth"].values, CM * flight[W_WATER].values
    step = max(1, int(samples.sum()) // MOST_POINTS)
    pieces, values = [], []
    for row, (start, count) in enumerate(zip(starts, samples, strict=True)):
        part = slice(0, count, step)
        time = (start + period * np.arange(count)[::step]) / HOUR
        points, w = np.column_stack([time, depth[row, part]]), water[row, part]
        pieces.append(np.stack([points[:-1], points[1:]], axis=1))
        values.append(0.5 * (w[:-1] + w[1:]))
    segments, w = np.concatenate(pieces), np.concatenate(values)
    keep = np.isfinite(segments).all(axis=(1, 2)) & np.isfinite(w)
    segments, w = segments[keep], w[keep]
    if not w.size:
        raise InputError(UNFLOWN)
    with style.styled():
        figure = style.new_figure(width=style.PAGE_WIDTH, height=2.8)
        axes = figure.add_subplot()
        colours = ocean_map("vertical_velocity")
        lines = LineCollection(list(segments), array=w, cmap=colours, linewidths=1.6)
        largest = float(np.percentile(np.abs(w), COVERED[0]))
        lines.set_clim(-largest, largest)
        # the colour map is white at 0, as the page is: a grey rim keeps the dives visible
        axes.add_collection(LineCollection(list(segments), colors=style.GUIDE, linewidths=2.8))
        axes.add_collection(lines)
        time, deep = segments[:, :, 0], segments[:, :, 1]
        axes.set_xlim(float(time.min()), float(time.max()))
        style.depth_axis(axes, float(deep.max()))
        axes.set_xlabel("time since the first sample [h]")
        if (first := _start(flight)) is not None:
            style.draw_dates(axes, first, HOUR)
            axes.set_xlabel(style.LABEL)
        label = "vertical water velocity, up [cm/s]"
        style.colour_bar(axes, lines, label, pad=0.02, aspect=22)
    return figure


def histogram(flight: xr.Dataset) -> Figure:
    """Draw the histogram of the vertical velocity of the water, in descents and in climbs."""
    w = CM * flight[W_WATER].values.ravel()
    known = np.isfinite(w)
    if not known.any():
        raise InputError(UNFLOWN)
    largest = float(np.percentile(np.abs(w[known]), COVERED[1]))
    edges = np.linspace(-largest, largest, BINS + 1)
    down, up = _ways(flight)
    with style.styled():
        figure = style.new_figure()
        axes = figure.add_subplot()
        for label, mask, colour in (("dives", down, style.TRUTH), ("climbs", up, style.ESTIMATE)):
            part = w[mask.ravel() & known]
            if not part.size:
                continue
            text = f"{label}: mean {part.mean():.2f}, deviation {part.std():.2f} cm/s"
            look: dict[str, Any] = {"density": True, "histtype": "step", "lw": 1.3, "label": text}
            axes.hist(part, list(edges), color=colour, **look)
            axes.axvline(part.mean(), ymax=0.76, color=colour, lw=0.8, ls="--")
        axes.set_xlabel("vertical water velocity, up [cm/s]")
        axes.set_ylabel("share [1 per cm/s]")
        axes.set_ylim(top=1.3 * axes.get_ylim()[1])
        axes.legend(loc="upper left")
    return figure


def track_map(flight: xr.Dataset) -> Figure:
    """Draw the corrected tracks, the fixes and the depth-averaged currents on a map."""
    if any(name not in flight for name in POSITIONS):
        raise InputError("no map: the store does not say where its missions began")
    samples = _samples(flight)
    latitude, longitude = (flight[name].values for name in POSITIONS)
    longitude = joined(longitude.ravel()).reshape(longitude.shape)
    tracks = tuple(
        (latitude[row, :count], longitude[row, :count]) for row, count in enumerate(samples)
    )
    fixes = None
    if GPS_FIX in flight:  # files of earlier versions lack the fixes
        fixed = flight[GPS_FIX].values == 1
        fixes = (latitude[fixed], longitude[fixed])
    currents: tuple[Currents, ...] = ()
    if DAC in flight.sizes:
        rows = {int(number): row for row, number in enumerate(flight[MISSION].values)}
        period = float(flight.attrs[SAMPLE_PERIOD])
        middle = 0.5 * (flight["dac_start"].values + flight["dac_end"].values) / period
        place = ([rows[int(m)] for m in flight[DAC_MISSION].values], np.rint(middle).astype(int))
        flow = flight["dac_north"].values, flight["dac_east"].values
        currents = (Currents(latitude[place], longitude[place], *flow, AVERAGED),)
    return draw_content(MapContent(tracks, "corrected track", fixes, currents))


def current_figure(flight: xr.Dataset) -> Figure:
    """Draw currents against depth of at most `MOST_PROFILES` dives, with standard deviations."""
    if "profile_depth" not in flight:
        raise InputError("no current against depth: `twin flight --currents` finds it by cells")
    found = np.flatnonzero(np.isfinite(flight["profile_depth"].values[:, 0]))
    chosen = flight.isel({DAC: found[:: -(-len(found) // MOST_PROFILES)]})
    with style.styled():
        figure = style.new_figure(width=style.PAGE_WIDTH, height=3.6)
        for axes, name in zip(figure.subplots(1, 2), ("north", "east"), strict=True):
            for k, depth in enumerate(chosen["profile_depth"].values):
                now, sd = (CM * chosen[f"profile_{n}"].values[k] for n in (name, f"{name}_sd"))
                look, label = style.track_look(k), f"mission {chosen[DAC_MISSION].values[k]}"
                axes.plot(now, depth, label=label, **look)
                axes.fill_betweenx(depth, now - sd, now + sd, color=look["color"], alpha=0.2)
            axes.set_xlabel(f"current, {name} [cm/s]")
            style.depth_axis(axes, float(np.nanmax(chosen["profile_depth"])), label=name == "north")
        axes.legend()
    return figure


def _samples(flight: xr.Dataset) -> NDArray[np.int64]:
    return np.asarray(flight[N_SAMPLES].values, np.int64)


def _ways(flight: xr.Dataset) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks of the samples in descents and in climbs, by the store's phases or the depth rate."""
    if "phase" in flight:
        phase = flight["phase"].values
        return phase == DESCENT, phase == CLIMB
    rate = np.gradient(flight["depth"].values, float(flight.attrs[SAMPLE_PERIOD]), axis=1)
    return rate > LEVEL_RATE, rate < -LEVEL_RATE


def _start(flight: xr.Dataset) -> float | None:
    """Unix time [s] of the earliest sample; None if a mission's start is unknown."""
    starts = _unix(flight)
    return float(starts.min()) if starts.size and np.isfinite(starts).all() else None


def _starts(flight: xr.Dataset) -> Array:
    """[s] Start of each mission since the earliest; without dates missions follow each other."""
    if (first := _start(flight)) is not None:
        return _unix(flight) - first
    lengths = float(flight.attrs[SAMPLE_PERIOD]) * _samples(flight)
    return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])


def _unix(flight: xr.Dataset) -> Array:
    """Unix times [s] of the missions' first samples, (missions,), NaN where unknown; or empty."""
    starts = np.asarray(flight[START_TIME].values if START_TIME in flight else [])
    if not np.issubdtype(starts.dtype, np.datetime64):
        return starts.astype(float)
    nanoseconds = starts.astype("datetime64[ns]").astype(np.int64)
    return np.where(np.isnat(starts), np.nan, nanoseconds / 1e9)


FLIGHT_FIGURES = {
    "w_section": section, "w_histogram": histogram, "map": track_map, "currents": current_figure
}  # fmt: skip
"""Drawing functions by the names of their files"""


def write_flight_figures(flight: Flight, folder: Path) -> tuple[list[Path], list[str]]:
    """Draw all figures into a folder; return the files, and the reasons for missing figures.

    Raises:
      WriteError: the disk refuses.
    """
    dataset = flight_dataset(flight)
    written, missing = [], []
    for name, draw in FLIGHT_FIGURES.items():
        if draw is current_figure and not flight.profiles:
            continue  # nobody asked for it
        try:
            figure = draw(dataset)
        except InputError as error:
            missing.append(f"no {name} figure: {error}")
            continue
        path = folder / f"{name}.png"
        add_caption(figure, flight_caption(dataset, folder))
        with whole_file(path) as place:
            figure.savefig(place, dpi=PRINT_DPI)
        written.append(path)
    return written, missing
