"""Dive: one mission of a store as an estimator says that it was flown."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.identify.calibration import Calibration
from twin.identify.logged_missions import Log
from twin.identify.speed import horizontal, motion_of, start_of
from twin.identify.translation import Translation
from twin.logs.flight_estimator import FlightEstimator
from twin.logs.thermal_lag import CtdSeries
from twin.records.reader import MissionStore

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_COSINE = 0.2
"""cos(pitch) cos(roll) below which heave cannot be solved for"""
LEAST_KNOWN = 0.9
"""[1] of the time under water: what a cut log does not say is a guess, and no current follows"""
UNDER_WATER = 3.0
"""[m]"""
RATE_WINDOW = 20.0
"""[s] of the filter of depth rate and of vertical velocities, `WINDOW` of
`twin.identify.logged_missions`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownDive:
    """One mission; arrays are (time,), NaN where nothing is known."""

    mission: int
    """Row in the store."""
    motion: Translation | None
    """Through the water, body FRD; None for a mission that no model can fly"""
    velocity: Array
    """North, east through the water [m/s], (time, 2); zero where it is not known"""
    depth: Array
    """[m] as stored"""
    water_up: Array
    """[m/s] vertical velocity of the water, positive up, filtered over `RATE_WINDOW`"""
    sink_rate: Array
    """[m/s] downward through the water by the flight model: the depth rate in still water"""
    descending: Mask
    """In a dive, away from its turns and the surface"""
    ascending: Mask
    """In a climb"""
    ctd: CtdSeries | None
    """Corrected; None without one"""
    known: float = 1.0
    """[1] Part of the time under water in which the log has an attitude"""

    @property
    def tells_current(self) -> bool:
        """Whether its way through the water is known well enough for a current."""
        return self.motion is not None and self.known >= LEAST_KNOWN


def fly_dive(
    store: MissionStore,
    log: Log,
    calibration: Calibration,
    estimator: FlightEstimator,
    raw: CtdSeries | None,
    ctd: CtdSeries | None,
) -> FlownDive:
    """How a vehicle flew one dive.

    Args:
      store: of the dive.
      log: the dive.
      calibration: the vehicle and the errors of its sensors.
      estimator: for the velocity through the water.
      raw: its CTD as stored, None without.
      ctd: the same with its thermal lag corrected.
    """
    if raw is not None and ctd is not None and log.density is not None and ctd is not raw:
        change = np.nan_to_num(ctd.density - raw.density, nan=0.0)
        log = dataclasses.replace(log, density=log.density + change)
    first = start_of(log, calibration)
    model = motion_of(log, calibration, start=first)
    sink = model.sink_rate(log.roll, calibration.true_pitch(log.pitch))
    use = log.use
    motion = estimator.motion(store, log, calibration, first)
    if not np.isfinite(motion.heave).any():
        motion = dataclasses.replace(motion, heave=_heave(log, calibration, motion))
    down, up = _ways(store, log)
    count = int(store.samples[log.index])
    return FlownDive(
        mission=log.index,
        known=_known(store, log.index),
        motion=motion,
        velocity=np.nan_to_num(np.stack(horizontal(log, calibration, motion), axis=1), nan=0.0),
        depth=store.row("measured_depth", log.index)[:count].astype(float),
        water_up=np.where(use, log.filtered(sink) - log.depth_rate, np.nan),
        sink_rate=sink,
        descending=down & use,
        ascending=up & use,
        ctd=ctd,
    )


def _known(store: MissionStore, mission: int) -> float:
    count = int(store.samples[mission])
    depth, pitch, heading = (
        store.row(f"measured_{name}", mission)[:count] for name in ("depth", "pitch", "heading")
    )
    under = depth > UNDER_WATER
    return float(np.isfinite(pitch + heading)[under].mean()) if under.any() else 1.0


def still(store: MissionStore, mission: int, ctd: CtdSeries | None) -> FlownDive:
    """A mission that no model can fly: it moved with the water."""
    count = int(store.samples[mission])
    no = np.zeros(count, bool)
    return FlownDive(
        mission=mission,
        motion=None,
        velocity=np.zeros((count, 2)),
        depth=store.row("measured_depth", mission)[:count].astype(float),
        water_up=np.full(count, np.nan),
        sink_rate=np.full(count, np.nan),
        descending=no,
        ascending=no,
        ctd=ctd,
    )


def _ways(store: MissionStore, log: Log) -> tuple[Mask, Mask]:
    """Samples in dives and in climbs: the store's phases, or by the depth rate."""
    if "measured_phase" in store:
        phase = store.row("measured_phase", log.index)[: len(log.depth)]
        return phase == DESCENT, phase == CLIMB
    return log.depth_rate > LEVEL_RATE, log.depth_rate < -LEVEL_RATE


DESCENT, CLIMB = 1, 2
"""Flags of `measured_phase`"""
LEVEL_RATE = 0.03
"""[m/s] below which a vehicle turns or flies level, as the import's phases have it"""


def _heave(log: Log, calibration: Calibration, motion: Translation) -> Array:
    """Heave [m/s] that the filtered depth rate leaves to an estimator without one."""
    pitch, roll = calibration.true_pitch(log.pitch), log.roll
    sway = np.nan_to_num(motion.sway, nan=0.0)
    rest = log.depth_rate + motion.surge * np.sin(pitch) - sway * np.cos(pitch) * np.sin(roll)
    cosine = np.cos(pitch) * np.cos(roll)
    return np.asarray(rest * cosine / np.maximum(cosine**2, LEAST_COSINE**2))
