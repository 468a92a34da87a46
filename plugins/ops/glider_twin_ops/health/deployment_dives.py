"""Dives of a deployment: read from a store of logs, with what its pilot set and changed.

Echoes are the part that came back of those which earlier dives let expect. How much of a dive an
altimeter hears the floor in depends on how deep it dives, how far the floor is below and how its
beam lies near the turn. So pings are counted by the height above the floor, and a dive's echoes are
beside those that earlier dives had at its heights. Its beam is plumb in a dive; nose up, as a
vehicle that still sinks after its turn, it looks aft and hears nothing: what is pinged there says
nothing of the altimeter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast.logged_leg import legs_of
from glider_twin_ops.health.channels import CHANNELS, NAMES, PLACE
from glider_twin_ops.health.dive_channels import DiveSignals, channels_of, flight_model
from glider_twin_ops.health.signatures import TypicalDive, usual_dive
from twin import Vehicle
from twin.identify import Calibration
from twin.numbers import Array
from twin.records import LogStore, log_rows
from twin.records.attributes import DIVE, DIVE_DURATION
from twin.records.storage import StorePath

BIN, BINS = 5.0, 60
"""[m] of height whose pings are counted together, and how many of them"""
LEAST, SOUND = 10.0, 0.5
"""Echoes that must be expected for a dive to tell, and the part from which on it teaches the next:
what a blind one hears is not what there is"""


@dataclasses.dataclass(eq=False)
class Echoes:
    """What the dives so far heard of the floor."""

    floor: float = math.nan
    """[m] its depth where it was heard last"""
    pings: Array = dataclasses.field(default_factory=lambda: np.zeros(BINS))
    heard: Array = dataclasses.field(default_factory=lambda: np.zeros(BINS))

    def part(self, depth: Array, altitude: Array, pitch: Array | None = None) -> float:
        """Echoes of the next dive over those expected [1]; NaN where too few are, as at first.

        Args:
          depth, altitude: [m], (n,); altitude NaN where no echo came back.
          pitch: [degree], nose up positive, (n,); None: not known.
        """
        down = np.isfinite(depth) & (np.diff(depth, prepend=math.nan) > 0.0)
        if pitch is not None:
            down &= ~(pitch > 0.0)
        deep, back = depth[down], np.isfinite(altitude[down])
        found = math.nan
        if back.sum() >= LEAST:
            found = float(np.median((deep + altitude[down])[back]))
        if found > self.floor + BIN:
            self.floor = found  # deeper than it was: echoes that are due are those of today's
        elif deep.size and deep.max() > self.floor + BIN:
            self.floor = math.nan  # it dived to below where the floor was heard
        part = math.nan
        if math.isfinite(self.floor):
            at = self._bins(deep)
            expected = float((self.heard / np.maximum(self.pings, 1.0))[at].sum())
            if expected >= LEAST:
                part = float((back & (self.pings[at] > 0.0)).sum()) / expected
        if math.isfinite(found) and not part < SOUND:
            self.floor = found
            at = self._bins(deep)
            self.pings += np.bincount(at, minlength=BINS)
            self.heard += np.bincount(at, back, BINS)
        return part

    def _bins(self, depth: Array) -> NDArray[np.int64]:
        return np.clip((self.floor - depth) / BIN, 0, BINS - 1).astype(np.int64)


CHANGED = {"depth": 0.2, "pitch": 3.0, "volume": 25.0}
"""Changes of a dive from which on a pilot has changed it: of the depth's logarithm, [degree] and
[cm3] of dive and climb; nine of ten dives of preset `faulty`, where nobody does, stay within"""
UNTOLD_WARMING = 0.0015
"""Part by which a hull's air changes from dive to dive where a log lacks its temperature: 0.4 K, as
the mean of a dive's water does in 81 pairs of dives of seven real deployments (rms)"""
ROUND = 10.0
"""[m], and tenths of a degree and of the pump's reach, to which the typical dive is rounded, so
that deployments of one vehicle share its signatures"""
READ = (
    "depth", "pressure", "pitch", "roll", "heading", "pump", "shift", "rotation", "fin", "density",
    "temperature", "conductivity", "salinity", "altitude", "charge", "voltage", "battery_current",
    "pump_power", "vacuum", "dvl_mode",
)  # fmt: skip
"""Signals that channels are made of, without `measured_`"""


def dives_of(logs: LogStore, deployment: str) -> tuple[list[int], list[DiveSignals], Array]:
    """Dives of a deployment in order of time, and their ways through the water.

    Returns:
      Rows of the store; the signals of each; mean velocity through the water by the compass, north
      and east [m/s], (dives, 2), NaN where it is not known.
    """
    rows = logs.missions_of(deployment)
    names = [name for name in (*(f"measured_{one}" for one in READ), "commanded_heading")
             if name in logs]  # fmt: skip
    blocks = {name: logs.rows(name, rows) for name in names}
    legs = {leg.mission: leg for leg in legs_of(logs, deployment)}
    dives, ways = [], np.full((len(rows), 2), math.nan)
    of_rows, echoes = log_rows(logs), Echoes()
    for k, row in enumerate(rows):
        count, powered = int(logs.samples[row]), of_rows[row].powered
        signals = {name: block[k, :count].astype(float) for name, block in blocks.items()}
        heading, current = signals.get("measured_heading"), (math.nan, math.nan)
        # a current by the heading that was wanted, or beside a thruster's speed, says nothing
        if row in legs and not powered and heading is not None and np.isfinite(heading).any():
            leg = legs[row].leg
            ways[k] = np.array(leg.through_water) / leg.duration
            moved = np.array(leg.over_ground) / leg.duration - ways[k]
            current = (float(moved[0]), float(moved[1]))
        part, pitch = math.nan, signals.get("measured_pitch")
        if {"measured_depth", "measured_altitude"} <= signals.keys():
            part = echoes.part(signals["measured_depth"], signals["measured_altitude"], pitch)
        told: dict[str, Any] = {"current": current, "echoes": part, "powered": powered}
        dives.append(DiveSignals(period=logs.period, signals=signals, **told))
    return rows, dives, ways


def told_by(logs: LogStore, deployment: str, vehicle: Vehicle) -> dict[str, Any]:
    """Arguments of `judged` that a deployment's log tells."""
    rows, dives, ways = dives_of(logs, deployment)
    calibration = flight_model(vehicle)
    numbers = logs.array(DIVE) if DIVE in logs else np.arange(len(logs))
    lasted = np.nan_to_num(logs.number(DIVE_DURATION)[rows])
    wander = np.zeros(len(NAMES))
    if all(dive.get("temperature") is None for dive in dives):
        wander[PLACE["air"]] = UNTOLD_WARMING
    return {
        "name": deployment,
        "numbers": tuple(int(numbers[row]) for row in rows),
        "values": values_of(dives, calibration),
        "time": np.asarray(logs.starts)[rows] + 0.5 * lasted,
        "ways": ways,
        "dive": typical(dives, vehicle),
        "changes": changes_of(dives),
        "powered": [dive.powered for dive in dives],
        "wander": wander,
    }


def values_of(dives: Sequence[DiveSignals], calibration: Calibration | None) -> Array:
    """Channels of dives, (dives, channels), as they are judged.

    Waves that move the water between a dive and its climb look like a slow thermistor: where
    conductivity is beside it, what is left between the two tells and the thermistor alone does not.
    """
    found = np.array([channels_of(dive, calibration) for dive in dives]).reshape(-1, len(NAMES))
    for channel in CHANNELS:
        if channel.instead:
            found[np.isfinite(found[:, PLACE[channel.instead]]), PLACE[channel.name]] = math.nan
    return found


def changes_of(dives: Sequence[DiveSignals]) -> Array:
    """By how much each dive is another than the one before, in `CHANGED`, (dives,).

    What a model lacks differs from a depth, a pitch and a volume to others.
    """
    rows = np.array([dive.settings() for dive in dives]).reshape(-1, 5)
    rows[:, 0] = np.log(np.maximum(rows[:, 0], 1.0)) / CHANGED["depth"]
    rows[:, 1::2] /= CHANGED["pitch"]
    rows[:, 2::2] /= CHANGED["volume"]
    steps = np.nan_to_num(np.diff(rows, axis=0))
    return np.concatenate([[0.0], np.linalg.norm(steps, axis=1)])


def typical_dive(store: str | StorePath, deployment: str, vehicle: Vehicle) -> TypicalDive:
    """Dive that is usual in a deployment's log; see `typical`."""
    with LogStore(store) as logs:
        return typical(dives_of(logs, deployment)[1], vehicle)


def typical(dives: Sequence[DiveSignals], vehicle: Vehicle) -> TypicalDive:
    """The dive that is usual in a log, rounded; what the log lacks is the vehicle file's."""
    rows = np.array([dive.settings() for dive in dives]).reshape(-1, 5)
    deepest = rows[np.isfinite(rows[:, 0]), 0]
    depth = float(np.median(deepest)) if len(deepest) else 150.0
    period = dives[0].period if dives else 4.0
    usual = usual_dive(vehicle, period, max(round(depth / ROUND) * ROUND, 30.0))
    down, up = (
        ways[np.isfinite(ways).all(axis=1)] * [sign, 1.0]
        for ways, sign in ((rows[:, 1:3], -1.0), (rows[:, 3:5], 1.0))
    )
    if not len(down) or not len(up):
        return usual
    lightest, heaviest = vehicle.net_mass_range
    # half of what the two pumped volumes differ by pulls each way
    heavy, light = (vehicle.net_mass_for_pump(float(np.median(one[:, 1]))) for one in (down, up))
    pull = float(np.clip(0.5 * abs(heavy - light), 0.3 * heaviest, min(heaviest, -lightest)))
    pitch, climb_pitch = (
        round(float(np.clip(np.median(one[:, 0]), 12.0, 40.0)) / 2.0) * 2.0 for one in (down, up)
    )
    return dataclasses.replace(
        usual,
        pitch=pitch,
        climb_pitch=climb_pitch,
        net_mass=round(pull / heaviest, 1) * heaviest,
        climb_net_mass=round(pull / -lightest, 1) * -lightest,
    )
