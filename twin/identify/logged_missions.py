"""Logged missions: signals of each dive of a store for identification, checked and filtered.

`start_vehicle` is the shipped vehicle that suits a store.
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
from twin.water.density import STANDARD_OCEAN

NEEDED = ("measured_depth", "measured_pitch", "measured_roll", "measured_heading", "measured_pump")
OPTIONAL = (
    *("measured_density", "measured_temperature", "measured_gap"),
    *("measured_roll_rate", "measured_pitch_rate", "measured_yaw_rate"),
    *("measured_shift", "measured_rotation", "measured_fin"),
)
WINDOW, LEAST_WINDOW = 20.0, 5
"""Depth rate's filter: WINDOW [s], a quarter of an inflection, and at least LEAST_WINDOW samples"""
ATTITUDE_WINDOW = 8.0
"""[s] Window of the filter whose slope gives the rates of a log without gyroscopes"""
AFLOAT = 0.5
"""[m] Depth above which a vehicle floats at the surface, in balance with its weight"""
SETTLING = 20.0
"""[s] Time after the start of a record under water in which the model's start has an effect"""
SHALLOWEST = 3.0
"""[m] Depth above which a hull of two metres is in the waves or partly out of the water"""
DIVE_DEPTH = 8.0
"""[m] Smallest depth of a dive: rows that stay above it are left out."""
MAX_PITCH = 80.0
"""[degree] Largest pitch of a glide"""

SHALLOW_SLOCUM = {"measured_depth": 230.0, "measured_pump": 245.0}
"""[m], [cm3] Limits of a 200 m Slocum with its ballast pump; deep ones have an oil pump of 260 cm3
either way."""
KINDS = ("seaglider", "seaexplorer", "spray", "slocum")
"""Types of glider, as formats and platforms of logs call them"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """Signals that a glider's dive and a propelled vehicle's run share; arrays are (time,)."""

    index: int
    """Row in the store"""
    period: float
    """[s] Time between samples"""
    depth: Array
    """[m] Depth"""
    depth_rate: Array
    """[m/s] Depth rate, positive down, filtered over `window`"""
    window: int
    """Samples of the depth rate's filter"""
    roll: Array
    """[rad] Roll"""
    pitch: Array
    """[rad] Pitch by the sensor"""
    heading: Array
    """[rad] Heading from true north by the compass, unwrapped"""
    rates: Array
    """[rad/s] Roll, pitch, yaw rate, body FRD, (3, time); of a run minus the gyroscopes' biases"""
    use: Mask
    """True for samples that are compared with the model: under water and measured"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Log(Record):
    """One dive of a glider; arrays are (time,)."""

    density: Array | None
    """[kg/m3] In-situ density"""
    temperature: Array | None
    """[degree_Celsius] Temperature of the water"""
    pump: Array
    """[cm3] Pumped volume, + = lighter"""
    shift: Array | None
    """[m] Battery's position along the hull"""
    rotation: Array | None
    """[rad] Battery's rotation"""
    fin: Array | None = None
    """[rad] Rudder's position, + turns to starboard"""
    displacement: tuple[float, float] | None
    """[m] North and east over ground between the fixes"""
    follows: bool
    """True if the previous dive in the list ended shortly before: both currents are alike."""
    powered: bool = False
    """True if a thruster propelled the dive"""

    @property
    def duration(self) -> float:
        """[s] Time between the first and the last sample."""
        return self.period * (len(self.depth) - 1)

    def filtered(self, values: Array) -> Array:
        """Pass values (..., time) through the depth rate's filter, without the derivative."""
        return savgol_filter(values, self.window, 2)

    def hull_warming(self, lag: float) -> Array:
        """Temperature [K] of the hull above the reference, `lag` [s] behind the water's."""
        if self.temperature is None:
            return np.zeros_like(self.depth)
        return lagging(self.temperature, lag / self.period) - REFERENCE_TEMPERATURE


def check_channels(store: MissionStore, task: str = "identification") -> None:
    """Raise StoreError if a store lacks a channel that a flight model reads.

    Args:
      task: purpose, for the error's text.

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
    """Dives of a store of logs, real or simulated.

    Rows without a dive are left out. So are rows without density in a store where others have it,
    because their buoyancy is not known.

    Args:
      store: path of a zarr store of the schema.
      rows: numbers of the rows, all by default.
      task: purpose, for the errors' texts.

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
        if blind:  # none of these rows has a CTD, though others of the store do
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
    """Numbers of rows, all by default, each with those of the named signals that the store has.

    Raises:
      StoreError: an unknown row, which the error calls a `word`, or a damaged store.
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
    """Dives without a thruster, and the rows of the others.

    Raises:
      InputError: all dives ran their thruster.
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
    """Values with gaps interpolated in time; None if fewer than two are finite."""
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
    """Make one dive for identification; None without a dive or one of the needed channels.

    Args:
      row: number in the store. signals: by their names in the schema, in its units, (time,).
      period: [s] between samples.
      displacement: north, east [m] over ground between its fixes.
      follows: True where it began shortly after the dive before.
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
        depth_rate=_depth_rate(depth, density, window, period),
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


def _depth_rate(depth: Array, density: Array | None, window: int, period: float) -> Array:
    """Filtered rate of the depth [m/s], corrected where the density [kg/m3] is measured.

    The depth is made of pressure by standard ocean, so that its rate is off as the densities are.
    """
    rate = savgol_filter(depth, window, 2, deriv=1, delta=period)
    if density is None:
        return rate
    surface, growth = STANDARD_OCEAN
    return np.asarray(rate * (surface + growth * np.maximum(depth, 0.0)) / density)


def lagging(values: Array, samples: float) -> Array:
    """Pass values (time,) through a first-order lag of `samples` samples, settled at the start."""
    share = 1.0 - np.exp(-1.0 / samples)
    start = [values[0] * (1.0 - share)]
    return np.asarray(lfilter([share], [1.0, share - 1.0], values, zi=start)[0])


def layers(depth: Array, values: Array, thickness: float) -> tuple[Array, Array]:
    """Depths [m] of the layers that a record passes, and the median of its values in each."""
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
    """Body rates (3, time) by the gyroscopes, or else by the slopes of the attitude."""
    gyro = [optional.get(f"measured_{name}_rate") for name in ("roll", "pitch", "yaw")]
    if all(rate is not None for rate in gyro):
        return np.stack([np.asarray(rate) for rate in gyro])
    window = max(round(ATTITUDE_WINDOW / period), LEAST_WINDOW) | 1
    slopes = [
        savgol_filter(angle, window, 2, deriv=1, delta=period) for angle in (roll, pitch, heading)
    ]
    return body_rates(roll, pitch, *slopes)


def body_rates(roll: Array, pitch: Array, d_roll: Array, d_pitch: Array, d_heading: Array) -> Array:
    """Roll, pitch and yaw rate [rad/s], body FRD, (3, time), from the attitude [rad] and its slopes
    [rad/s] (Fossen 2011, 2.26)."""
    return np.stack(
        [
            d_roll - np.sin(pitch) * d_heading,
            np.cos(roll) * d_pitch + np.sin(roll) * np.cos(pitch) * d_heading,
            -np.sin(roll) * d_pitch + np.cos(roll) * np.cos(pitch) * d_heading,
        ]
    )


def start_vehicle(store: str | StorePath) -> Vehicle:
    """Vehicle that suits a store: a simulated store's own, else the shipped one of the log's type.

    Raises:
      StoreError: no such store, or a log of unknown type that lacks channels of a flight model.
      InputError: the log does not say the type of its glider.
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
    """Warning if a vehicle is of another type than the log; empty otherwise.

    A vehicle made from a shipped file keeps its model's name. Other names say nothing of the type.

    Args:
      kind: name of the logs' type, as `factory import` calls it, where `store` is no store yet.

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
    """Format and platform that a log names."""
    return [str(store.attributes.get(name, "")) for name in (SOURCE_FORMAT, PLATFORM)]


def _kind(store: MissionStore) -> str | None:
    """Type of glider that a log names; None if it names none."""
    return _glider(*_said(store))


def _glider(*said: str) -> str | None:
    return next((k for text in said for k in KINDS if k in text.lower()), None)


def _slocum(store: MissionStore) -> str:
    """Name of the shallow Slocum with a ballast pump, or of the deep one with an oil pump."""
    largest = 0.0
    for name, limit in SHALLOW_SLOCUM.items():
        if name in store:
            values = np.abs(store.rows(name, range(len(store))))
            known = values[np.isfinite(values)]
            if known.size:
                largest = max(largest, float(np.percentile(known, 99.5)) / limit)
    return "slocum-1000" if largest > 1.0 else "slocum-200"
