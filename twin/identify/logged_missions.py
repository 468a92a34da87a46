"""Logged missions: what identification reads of each mission of a store, checked and filtered.

A store also says which shipped vehicle suits it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.signal import lfilter, savgol_filter

from twin.errors import InputError, StoreError
from twin.identify.calibration import REFERENCE_TEMPERATURE, Array, Mask
from twin.records.attributes import PLATFORM, SOURCE_FORMAT
from twin.records.logged import log_rows
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import Vehicle, load_vehicle, parse_vehicle

NEEDED = ("measured_depth", "measured_pitch", "measured_roll", "measured_heading", "measured_pump")
OPTIONAL = (
    *("measured_density", "measured_temperature", "measured_gap"),
    *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate"),
    *("measured_shift", "measured_rotation", "measured_fin"),
)
WINDOW, LEAST_WINDOW = 20.0, 5
"""[s], samples of the depth rate's filter: a quarter of an inflection, ten times the noise."""
ATTITUDE_WINDOW = 8.0
"""[s] of the filter whose slope gives the rates of a log without gyroscopes."""
AFLOAT = 0.5
"""[m] above this a vehicle lies at the surface, where its weight rests on its own buoyancy."""
SETTLING = 20.0
"""[s] after the beginning of a record under water in which a model forgets how it was started"""
SHALLOWEST = 3.0
"""[m] above this a hull of two metres is in the waves or partly out of the water."""
DIVE_DEPTH = 8.0
"""[m] a mission that stays above this holds no dive."""
MAX_PITCH = 80.0
"""[degree] beyond which no glide is."""

SHALLOW_SLOCUM = {"measured_depth": 230.0, "measured_pump": 245.0}
"""[m], [cm3] beyond which a 200 m Slocum with its ballast pump does not go; deep ones have an oil
pump of 260 cm3 either way."""
KINDS = ("seaglider", "seaexplorer", "spray", "slocum")
"""Kinds of glider, as formats and platforms of logs call them."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """Signals that a glider's mission and a propelled vehicle's run share; arrays are (time,)."""

    index: int
    """Row in the store."""
    period: float
    """[s]"""
    depth: Array
    """[m]"""
    depth_rate: Array
    """[m/s], positive down, filtered over `window`."""
    window: int
    """samples of the depth rate's filter"""
    roll: Array
    """[rad]"""
    pitch: Array
    """[rad], the sensor's"""
    heading: Array
    """[rad] from true north, the compass', unwrapped"""
    rates: Array
    """roll, pitch, yaw rate [rad/s], body FRD, (3, time); of a run less the gyroscopes' biases"""
    use: Mask
    """Under water and measured: what is compared with the model."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Log(Record):
    """One mission of a glider; arrays are (time,)."""

    density: Array | None
    """[kg/m3] in situ"""
    temperature: Array | None
    """[degree_Celsius] of the water"""
    pump: Array
    """[cm3]"""
    shift: Array | None
    """[m]"""
    rotation: Array | None
    """[rad]"""
    fin: Array | None = None
    """[rad] of the rudder, + turns to starboard"""
    displacement: tuple[float, float] | None
    """North, east [m] over ground between the fixes."""
    follows: bool
    """The mission before it in the list ended shortly before: their currents are alike."""
    powered: bool = False
    """A thruster drove it."""

    @property
    def duration(self) -> float:
        """[s]"""
        return self.period * (len(self.depth) - 1)

    def filtered(self, values: Array) -> Array:
        """Values (..., time) through the same filter as the depth rate, without the derivative."""
        return savgol_filter(values, self.window, 2)

    def hull_warming(self, lag: float) -> Array:
        """Temperature of the hull above the reference [K], `lag` [s] behind the water's."""
        if self.temperature is None:
            return np.zeros_like(self.depth)
        return lagging(self.temperature, lag / self.period) - REFERENCE_TEMPERATURE


def check_channels(store: MissionStore, task: str = "identification") -> None:
    """Make sure that a store has what a flight model reads.

    Args:
      task: what it is for, as the error says it.

    Raises:
      StoreError: a channel is missing.
    """
    missing = [name for name in NEEDED if name not in store]
    if missing:
        raise StoreError(
            f"store {store.path} has no channel {missing[0]}"
            + (f" (nor {', '.join(missing[1:])})" if missing[1:] else "")
            + f"; {task} needs depth, attitude, heading and pumped volume as buoyancy-driven "
            "gliders log them, whatever --vehicle is given"
        )


def load_logs(
    store: str | StorePath, rows: Sequence[int] | None = None, *, task: str = "identification"
) -> list[Log]:
    """Missions of a store of logs, real or simulated.

    Left out are missions without a dive, and those without density where others have it: their
    buoyancy is not known.

    Args:
      store: path of a zarr store of the schema.
      rows: which missions, all by default.
      task: what they are for, as errors say it.

    Raises:
      StoreError: no such store, a missing channel, an unknown row, or no dive in any of them.
    """
    found = MissionStore(store)
    check_channels(found, task)
    every = read_signals(found, (*NEEDED, *OPTIONAL), rows, "mission")
    density = [one["measured_density"] for _, one in every if "measured_density" in one]
    blind = not any(np.isfinite(one).any() for one in density)
    period, dives = found.period, log_rows(found)
    logs: list[Log] = []
    before: int | None = None
    for row, signals in every:
        if blind:  # other vehicles of the store have a CTD, these have none
            signals.pop("measured_density", None)
        follows = before is not None and row == before + 1 and dives[row].follows(dives[before])
        log = log_of(row, signals, period, dives[row].displacement, follows)
        if log is not None:
            logs.append(dataclasses.replace(log, powered=dives[row].powered))
            before = row
    if not logs:
        raise StoreError(
            f"store {store} has no dive: no mission reaches {DIVE_DEPTH:g} m with attitude and "
            "pumped volume"
        )
    return logs


def read_signals(
    store: MissionStore, names: Iterable[str], rows: Sequence[int] | None, word: str
) -> list[tuple[int, dict[str, Array]]]:
    """Rows of a store, all by default, and their signals of these names, as far as it has them.

    Raises:
      StoreError: an unknown row, which the error calls by `word`, or a damaged store.
    """
    chosen = list(range(len(store))) if rows is None else list(rows)
    for row in chosen:
        if not 0 <= row < len(store):
            last = len(store) - 1
            raise StoreError(f"store {store.path} has no {word} {row}; it holds 0 to {last}")
    arrays = {name: store.rows(name, chosen) for name in names if name in store}
    store.check_samples(chosen)
    return [
        (row, {n: a[k, : store.samples[row]].astype(float) for n, a in arrays.items()})
        for k, row in enumerate(chosen)
    ]


def gliding(logs: Sequence[Log]) -> tuple[list[Log], tuple[int, ...]]:
    """The missions that no thruster drove, and the rows of the others.

    Raises:
      InputError: a thruster drove all of them.
    """
    kept: list[Log] = []
    for log in logs:
        if not log.powered:
            follows = log.follows and bool(kept) and kept[-1].index == log.index - 1
            kept.append(dataclasses.replace(log, follows=follows))
    powered = tuple(log.index for log in logs if log.powered)
    if not kept:
        raise InputError(
            f"all {len(logs)} missions ran their thruster: their speeds say nothing of a glide; "
            "give logs of the vehicle without it (--missions)"
        )
    return kept, powered


def filled(values: Array | None) -> Array | None:
    """Values with gaps interpolated in time; None where fewer than two are finite."""
    if values is None:
        return None
    finite = np.isfinite(values)
    if finite.sum() < 2:
        return None
    index = np.arange(len(values))
    return np.interp(index, index[finite], values[finite])


def log_of(
    row: int,
    signals: dict[str, Array],
    period: float,
    displacement: tuple[float, float] | None,
    follows: bool,
) -> Log | None:
    """One mission for identification; None without a dive or one of the needed channels.

    Args:
      row: of the store. signals: by their names in the schema, in its units, (time,).
      period: [s] between samples.
      displacement: north, east [m] over ground between its fixes.
      follows: whether it began shortly after the one before.
    """
    depth = filled(signals["measured_depth"])
    finite = np.isfinite(np.stack([signals[name] for name in NEEDED])).all(axis=0)
    window = max(round(WINDOW / period), LEAST_WINDOW) | 1
    if depth is None or len(depth) < 3 * window or np.nanmax(depth) < DIVE_DEPTH:
        return None
    pitch, roll, pump = (filled(signals[f"measured_{n}"]) for n in ("pitch", "roll", "pump"))
    heading = filled(np.rad2deg(unwrapped(signals["measured_heading"])))
    if pitch is None or roll is None or pump is None or heading is None:
        return None
    optional = {name: filled(signals[name]) for name in OPTIONAL if name in signals}
    density = optional.get("measured_density")
    if "measured_density" in signals and density is None:
        return None
    use = finite & (depth > SHALLOWEST) & (np.abs(pitch) < MAX_PITCH)
    if depth[0] > AFLOAT:
        use[: round(SETTLING / period)] = False
    if "measured_gap" in signals:
        use &= ~(np.nan_to_num(signals["measured_gap"], nan=1.0) > 0)
    roll, pitch, heading = np.deg2rad(roll), np.deg2rad(pitch), np.deg2rad(heading)
    rotation, fin = optional.get("measured_rotation"), optional.get("measured_fin")
    return Log(
        index=row,
        period=period,
        depth=depth,
        depth_rate=savgol_filter(depth, window, 2, deriv=1, delta=period),
        window=window,
        density=density,
        temperature=optional.get("measured_temperature"),
        pump=pump,
        roll=roll,
        pitch=pitch,
        heading=heading,
        rates=_rates(optional, roll, pitch, heading, period),
        shift=optional.get("measured_shift"),
        rotation=None if rotation is None else np.deg2rad(rotation),
        fin=None if fin is None else np.deg2rad(fin),
        use=use,
        displacement=displacement,
        follows=follows,
    )


def lagging(values: Array, samples: float) -> Array:
    """Values (time,) through a first-order lag of so many samples, which begins settled."""
    share = 1.0 - np.exp(-1.0 / samples)
    start = [values[0] * (1.0 - share)]
    return np.asarray(lfilter([share], [1.0, share - 1.0], values, zi=start)[0])


def layers(depth: Array, values: Array, thickness: float) -> tuple[Array, Array]:
    """Depths [m] of the layers that a record passes, and the medians of its values in each."""
    numbers = np.maximum(np.round(depth / thickness), 0).astype(int)
    used = np.unique(numbers)
    return used * thickness, np.array([np.median(values[numbers == k]) for k in used])


def unwrapped(degrees: Array) -> Array:
    """Heading [rad] without jumps at north; NaN stays NaN."""
    out = np.full(len(degrees), np.nan)
    finite = np.isfinite(degrees)
    out[finite] = np.unwrap(np.deg2rad(degrees[finite]))
    return out


def _rates(
    optional: dict[str, Array | None], roll: Array, pitch: Array, heading: Array, period: float
) -> Array:
    """Body rates (3, time): the gyroscopes', or the slopes of the attitude."""
    gyro = [optional.get(f"measured_{name}_rate") for name in ("roll", "pitch", "yaw")]
    if all(rate is not None for rate in gyro):
        return np.stack([np.asarray(rate) for rate in gyro])
    window = max(round(ATTITUDE_WINDOW / period), LEAST_WINDOW) | 1
    slopes = [
        savgol_filter(angle, window, 2, deriv=1, delta=period) for angle in (roll, pitch, heading)
    ]
    return body_rates(roll, pitch, *slopes)


def body_rates(roll: Array, pitch: Array, d_roll: Array, d_pitch: Array, d_heading: Array) -> Array:
    """Roll, pitch and yaw rate [rad/s], body FRD, (3, time), of an attitude [rad] and its slopes
    [rad/s] (Fossen 2011, 2.26)."""
    return np.stack(
        [
            d_roll - np.sin(pitch) * d_heading,
            np.cos(roll) * d_pitch + np.sin(roll) * np.cos(pitch) * d_heading,
            -np.sin(roll) * d_pitch + np.cos(roll) * np.cos(pitch) * d_heading,
        ]
    )


def start_vehicle(store: str | StorePath) -> Vehicle:
    """The vehicle file that suits a store: a simulated one's own, else that of the log's kind.

    Raises:
      StoreError: no such store, or a log of an unknown kind that no flight model can read.
      InputError: the log does not say which kind of glider it is of.
    """
    with MissionStore(store) as found:
        driven = any(f"{said}_propeller" in found for said in ("measured", "commanded"))
        if driven and not found.says_vehicle:
            raise InputError(
                f"store {store} is of a vehicle under a propeller and does not say which: give "
                "--vehicle, such as remus or tethys, or the path of its own file"
            )
        if not found.logged:
            flown = found.vehicle
            return parse_vehicle(flown.xml, flown.path)
        kind = _kind(found)
        if kind is None:
            check_channels(found, "a flight model")  # no --vehicle helps a log without them
            source, platform = _said(found)
            raise InputError(
                f"store {store} does not say which glider it is of "
                f"(source_format {source!r}, platform {platform!r}); give --vehicle, such as "
                f"{', '.join(KINDS[:2])} or slocum-200"
            )
        return load_vehicle(_slocum(found) if kind == "slocum" else kind)


def other_kind(store: str | StorePath, vehicle: Vehicle, kind: str = "") -> str:
    """A warning if a vehicle is of another kind than the log, both as they say; empty if not.

    A vehicle made from a shipped file still has its model's name; of other names nothing is known.

    Args:
      kind: of the logs in `store`, as `factory import` calls it, where that is no store yet.

    Raises:
      StoreError: no such store.
    """
    flown = _glider(kind)
    if not kind:
        with MissionStore(store) as found:
            flown = _kind(found) if found.logged else None
    model = vehicle.model
    if flown is None or model not in vehicle_names() or flown in model:
        return ""
    return (
        f"vehicle {vehicle.name} ({model}) is of another kind than that of the log {store} "
        f"({flown}): it did not fly these dives; give --vehicle of the log's kind"
    )


def _said(store: MissionStore) -> list[str]:
    """Format and platform of a log."""
    return [str(store.attributes.get(name, "")) for name in (SOURCE_FORMAT, PLATFORM)]


def _kind(store: MissionStore) -> str | None:
    """Kind of the glider, as a log says; None where it does not."""
    return _glider(*_said(store))


def _glider(*said: str) -> str | None:
    return next((k for text in said for k in KINDS if k in text.lower()), None)


def _slocum(store: MissionStore) -> str:
    """The shallow one with a ballast pump, or the deep one with an oil pump."""
    largest = 0.0
    for name, limit in SHALLOW_SLOCUM.items():
        if name in store:
            values = np.abs(store.rows(name, range(len(store))))
            known = values[np.isfinite(values)]
            if known.size:
                largest = max(largest, float(np.percentile(known, 99.5)) / limit)
    return "slocum-1000" if largest > 1.0 else "slocum-200"
