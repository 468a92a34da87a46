"""Driven runs: signals of the runs of a propelled vehicle for identification.

A run has the attitude, the depth and the positions of the parts that propel and steer. With a
Doppler log, it also has the velocity, over ground or through the water.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from twin.errors import StoreError
from twin.fossen.equations import part_after
from twin.identify.calibration import Array, Mask
from twin.identify.logged_missions import (
    Record,
    body_rates,
    filled,
    layers,
    read_signals,
    unwrapped,
)
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.sensors.dvl import MODES
from twin.vehicle.parts import Part
from twin.vehicle.vehicle import Vehicle

RATES = tuple(f"measured_{name}_rate" for name in ("roll", "pitch", "yaw"))
NEEDED = ("measured_depth", "measured_roll", "measured_pitch", "measured_heading", *RATES)
DOPPLER = tuple(f"measured_dvl_{name}" for name in ("surge", "sway", "heave"))
TRUTH = ("true_surge", "true_sway", "true_heave")
STEERED = ("speed", "heading", "pitch")
"""Controls; without positions of the parts that serve them, the inputs of a run are unknown."""
DEPTH_WINDOW, LEAST_WINDOW = 3.0, 5
"""Window of the depth rate's filter, shorter than a change of pitch: DEPTH_WINDOW [s], and at least
LEAST_WINDOW samples"""
LAYER = 2.0
"""[m] Thickness of the layers of a run's density profile"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DrivenRun(Record):
    """One run; arrays are (time,) unless another shape is given."""

    velocity: Array
    """[m/s] Velocity by the Doppler log, body FRD, (3, time); NaN without lock"""
    ground: Mask
    """True: `velocity` is over ground; False: it is through the water"""
    positions: Array
    """Positions of the parts in their units, (time, parts)"""
    commanded: tuple[str, ...]
    """Parts with commands only; the vehicle file's lags and rates give their positions."""
    silent: tuple[str, ...]
    """Parts with neither positions nor commands; they count as resting."""
    density: tuple[Array, Array] | None
    """Depths [m] and in-situ densities [kg/m3] of the water; None: the run does not measure it"""
    true_velocity: Array | None
    """[m/s] Velocity through the water of a simulated run, body FRD, (3, time); never fitted"""

    def filtered(self, values: Array) -> Array:
        """Pass rates (time,) through the depth rate's filter: the filtered slope of their integral.

        A smoothing filter in its place was 2 cm/s off while a vehicle pitched over, because the
        slope of a parabola is smoother than its middle.
        """
        way = cumulative_trapezoid(values, dx=self.period, initial=0.0)
        return savgol_filter(way, self.window, 2, deriv=1, delta=self.period)


def load_runs(
    store: str | StorePath, vehicle: Vehicle, rows: Sequence[int] | None = None
) -> list[DrivenRun]:
    """Read the runs of a propelled vehicle from a store, real or simulated.

    Args:
      vehicle: names the parts. rows: numbers of the runs, all by default.

    Raises:
      StoreError: no such store, an unknown row, or a channel that is missing, by its name.
    """
    with MissionStore(store) as found:
        missing = [name for name in NEEDED if name not in found]
        steering = [vehicle.steering[c] for c in STEERED if c in vehicle.steering]
        missing += [
            f"measured_{part} or commanded_{part}"
            for part in steering
            if f"measured_{part}" not in found and f"commanded_{part}" not in found
        ]
        if missing:
            raise StoreError(
                f"store {store} has no {'; no '.join(missing)}: a vehicle under a propeller is "
                f"identified by its depth, its attitude, its gyroscopes and the positions of what "
                f"drives and steers it ({', '.join(steering)} of {vehicle.name!r}). Give their "
                "topics or columns in the import's mapping, or --vehicle with the parts that the "
                "log has"
            )
        names = (*NEEDED, *DOPPLER, *TRUTH, "measured_dvl_mode", "measured_density",
                 "measured_gap", *(f"{kind}_{part}" for part in vehicle.part_names
                                   for kind in ("measured", "commanded")))  # fmt: skip
        every = read_signals(found, names, rows, "run")
        read = [_run(row, signals, found.period, vehicle) for row, signals in every]
    runs = [run for run in read if run is not None]
    if not runs:
        raise StoreError(f"store {store} has no run with depth, attitude and {steering[0]}")
    return runs


def _run(
    row: int, signals: Mapping[str, Array], period: float, vehicle: Vehicle
) -> DrivenRun | None:
    """Read one run; None if a needed channel has no values."""
    depth, roll, pitch = (filled(signals[name]) for name in NEEDED[:3])
    heading = filled(unwrapped(signals["measured_heading"]))
    measured = [filled(signals[name]) for name in RATES]
    rates = [rate for rate in measured if rate is not None]
    window = max(round(DEPTH_WINDOW / period), LEAST_WINDOW) | 1
    if depth is None or heading is None or roll is None or pitch is None:
        return None
    if len(rates) < len(RATES) or len(depth) < 3 * window:
        return None
    use = np.isfinite(np.stack([signals[name] for name in NEEDED])).all(axis=0)
    use &= depth > vehicle.hull_length
    if "measured_gap" in signals:
        use &= ~(np.nan_to_num(signals["measured_gap"], nan=1.0) > 0)
    roll, pitch = np.deg2rad(roll), np.deg2rad(pitch)
    gyroscopes = np.stack(rates)
    gyroscopes -= _biases(gyroscopes, roll, pitch, heading, period)[:, None]
    positions = np.tile(vehicle.rest, (len(depth), 1))
    commanded, silent = [], []
    for place, part in enumerate(vehicle.parts):
        kinds = [filled(signals.get(f"{k}_{part.name}")) for k in ("measured", "commanded")]
        values = next((v for v in kinds if v is not None), None)
        if values is None:
            silent.append(part.name)
            continue
        positions[:, place] = values / part.quantity.scale
        if kinds[0] is None:
            commanded.append(part.name)
            positions[:, place] = _followed(part, positions[:, place], period)
    if any(vehicle.steering.get(control) in silent for control in STEERED):
        return None
    nowhere = np.full(len(depth), np.nan)
    velocity = np.stack([signals.get(name, nowhere) for name in DOPPLER])
    mode = signals.get("measured_dvl_mode")
    ground = np.ones(len(depth), bool) if mode is None else mode != MODES["water"]
    truth = [signals[name] for name in TRUTH if name in signals]
    density = signals.get("measured_density", nowhere)
    known = np.isfinite(density)
    return DrivenRun(
        index=row,
        period=period,
        depth=depth,
        depth_rate=savgol_filter(depth, window, 2, deriv=1, delta=period),
        window=window,
        roll=roll,
        pitch=pitch,
        heading=heading,
        rates=gyroscopes,
        velocity=velocity,
        ground=ground,
        positions=positions,
        commanded=tuple(commanded),
        silent=tuple(silent),
        density=layers(depth[known], density[known], LAYER) if known.any() else None,
        use=use,
        true_velocity=np.stack(truth) if len(truth) == len(TRUTH) else None,
    )


def _biases(rates: Array, roll: Array, pitch: Array, heading: Array, period: float) -> Array:
    """Biases of the gyroscopes, (3,): medians of their rates minus rates from the attitude.

    Minutes of attitude determine the biases to 0.01 deg/s. The bias after switching on is several
    times that, and would shift a rudder's neutral position. A mean in place of the median would
    include the error of the roll in every turn.
    """
    slopes = [np.gradient(a, period) for a in (roll, pitch, heading)]
    return np.asarray(np.median(rates - body_rates(roll, pitch, *slopes), axis=1))


def _followed(part: Part, commands: Array, period: float) -> Array:
    """Positions of a part that follows its commands; each command holds until the next sample."""
    positions = commands.copy()
    for k in range(1, len(commands)):
        positions[k] = part_after(
            *(positions[k - 1], commands[k - 1], part.low, part.high, part.lag, part.rate),
            float(part.one_way),
            period,
        )
    return positions
