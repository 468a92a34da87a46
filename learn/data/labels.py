"""Labels: the velocities through the water that networks are trained on.

In a simulated store the truth is known and is the default label. A real vehicle has at best a DVL,
which measures the velocity through the water in water lock, and over ground in bottom lock; or a
camera beside it sees markers on it, and their poses give the velocity over ground. A known current
(from a profiler or mooring nearby, or zero in a basin) turns a velocity over ground into a label.
Samples without a label do not train.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import TARGETS, MissionSequence
from twin.errors import InputError, StoreError, unknown_name
from twin.frames import euler_to_matrix
from twin.navigation.estimators.dvl import (
    BOTTOM,
    SMOOTHING_S,
    SMOOTHINGS,
    WATER,
    Mask,
    Smoothing,
    outliers,
    smoothed,
)

Array = NDArray[np.float64]

Source = Literal["truth", "dvl", "camera"]
SOURCES: tuple[Source, ...] = get_args(Source)
MODE = "measured_dvl_mode"
DEVICES = {"dvl": "Doppler log", "camera": "camera"}
"""Instrument of each source but the truth, in words"""
CAMERA = {target: f"measured_camera_{target}" for target in TARGETS}
VELOCITIES = {target: f"measured_dvl_{target}" for target in TARGETS}
ATTITUDE = ("measured_roll", "measured_pitch", "measured_heading")
STORE_CURRENT = ("true_current_north", "true_current_east")
NO_CURRENT, FROM_STORE = "none", "store"
CURRENT_WORDS = f"{NO_CURRENT}, {FROM_STORE} or NORTH,EAST in m/s such as 0,0 for still water"


@dataclasses.dataclass(frozen=True, kw_only=True)
class LabelConfig:
    """Source of the velocities that networks are trained on.

    Raises:
      InputError: a word is unknown, or a current is no pair of finite numbers.
    """

    source: Source = "truth"
    """`truth`, `dvl` for the Doppler log's velocities, or `camera` for those of marker poses."""
    known_current: str = NO_CURRENT
    """Current to subtract from bottom track: `none`, so that bottom track is no label; `store`, the
    store's current at the vehicle; or NORTH,EAST [m/s] of a steady current."""
    smoothing: Smoothing = "gaussian"
    """Smoothing after outliers are removed, see `twin.navigation.estimators.dvl`."""

    def __post_init__(self) -> None:
        for what, given, allowed in (
            ("source of labels", self.source, SOURCES),
            ("smoothing", self.smoothing, SMOOTHINGS),
        ):
            if given not in allowed:
                raise InputError(unknown_name(what, given, allowed))
        if self.known_current not in (NO_CURRENT, FROM_STORE):
            self._steady()
        if self.source == "camera" and self.known_current == NO_CURRENT:
            raise InputError(
                "a camera measures velocities over ground: give --known-current "
                f"{CURRENT_WORDS.removeprefix(NO_CURRENT + ', ')}"
            )

    @property
    def device(self) -> str:
        """Instrument that measured the labels, in words; empty for the truth."""
        return DEVICES.get(self.source, "")

    def _steady(self) -> tuple[float, float]:
        """[m/s] North and east component of a current given as NORTH,EAST."""
        try:
            north, east = (float(part) for part in self.known_current.split(","))
        except ValueError:
            north = east = math.nan
        if not (math.isfinite(north) and math.isfinite(east)):
            raise InputError(
                f"known current {self.known_current!r} is unknown: give {CURRENT_WORDS}"
            ) from None
        return north, east

    def channels(self) -> tuple[str, ...]:
        """Schema variables that the labels are computed from."""
        if self.source == "truth":
            return tuple(TARGETS.values())
        current = STORE_CURRENT if self.known_current == FROM_STORE else ()
        if self.source == "camera":
            return (*CAMERA.values(), *ATTITUDE, *current)
        return (*VELOCITIES.values(), MODE, *ATTITUDE, *current)

    def of(self, mission: MissionSequence, target: str) -> NDArray[np.float32]:
        """`surge` or `sway` [m/s] through the water, (time,); NaN where there is no label.

        Raises:
          StoreError: the mission lacks a channel, or a simulated mission's truth is not finite.
        """
        if self.source == "truth":
            return mission.target(target)
        return measured(mission, self).velocities[target].astype(np.float32)

    def current(self, mission: MissionSequence) -> Array | None:
        """[m/s] Known current, north and east, (time, 2); None if no current is known.

        Raises:
          StoreError: the store's current is wanted, and the store has none.
        """
        if self.known_current == NO_CURRENT:
            return None
        if self.known_current != FROM_STORE:
            return np.broadcast_to(np.array(self._steady()), (mission.samples, 2))
        missing = [name for name in STORE_CURRENT if name not in mission.signals]
        if missing:
            raise StoreError(
                f"mission {mission.index} has no channel {missing[0]}, so that the store's current "
                f"is not known; give --known-current otherwise: {CURRENT_WORDS}"
            )
        return np.stack([mission.signals[name] for name in STORE_CURRENT], axis=1)


@dataclasses.dataclass(frozen=True)
class Measured:
    """Cleaned velocities of one mission's Doppler log or camera, and the lock of each sample."""

    velocities: Mapping[str, Array]
    """surge and sway [m/s] through the water, (time,); NaN where there is no label"""
    bottom: Mask
    """True for samples in bottom lock, or that a camera saw, (time,)"""
    water: Mask
    """True for samples in water lock, (time,)"""
    removed: Mask
    """True for outliers, (time,)"""

    @property
    def usable(self) -> Mask:
        """True for samples with a label, (time,)."""
        return np.isfinite(self.velocities["surge"])


def measured(mission: MissionSequence, config: LabelConfig) -> Measured:
    """Labels of one mission from its Doppler log, or from a camera.

    Water track is a label unchanged. From bottom track, the known current is subtracted, rotated
    into the body frame by the measured attitude. An outlier in surge or sway removes both
    velocities of the sample, because one bad beam falsifies all axes. A camera's velocities are
    over ground, and smoothed already.

    Raises:
      StoreError: a channel is missing.
    """
    log, mode = _seen(mission) if config.source == "camera" else _log(mission)
    locked = np.isfinite(log).all(axis=1)
    bottom, water = locked & (mode == BOTTOM), locked & (mode == WATER)
    current = config.current(mission)
    usable = water
    if current is not None:
        through = log - _in_body(current, mission)
        log = np.where(bottom[:, None], through, log)
        usable = water | (bottom & np.isfinite(through).all(axis=1))
    if config.source == "camera":
        kept = np.where(usable[:, None], log, np.nan)
        nothing = np.zeros_like(usable)
        return Measured(dict(zip(CAMERA, kept.T, strict=True)), bottom, water, nothing)
    causal = config.smoothing == "causal"
    removed = outliers(log[:, 0], usable, causal=causal) | outliers(
        log[:, 1], usable, causal=causal
    )
    kept = usable & ~removed
    velocities = {
        target: smoothed(log[:, k], kept, mission.period, config.smoothing)
        for k, target in enumerate(VELOCITIES)
    }
    return Measured(velocities, bottom, water, removed)


def _log(mission: MissionSequence) -> tuple[Array, NDArray[np.int64]]:
    """Doppler log's surge and sway [m/s], (time, 2), and its mode, (time,)."""
    _expect(mission, (*VELOCITIES.values(), MODE), "Doppler log")
    log = np.stack([mission.signals[name] for name in VELOCITIES.values()], axis=1)
    return log, np.rint(np.nan_to_num(mission.signals[MODE])).astype(np.int64)


def _seen(mission: MissionSequence) -> tuple[Array, NDArray[np.int64]]:
    """Camera's surge and sway [m/s] over ground, (time, 2), and BOTTOM as mode, (time,)."""
    _expect(mission, CAMERA.values(), "camera")
    seen = np.stack([mission.signals[name] for name in CAMERA.values()], axis=1)
    return seen.astype(np.float64), np.full(mission.samples, BOTTOM, np.int64)


def _expect(mission: MissionSequence, names: Iterable[str], device: str) -> None:
    """Raise StoreError if the mission lacks one of these channels of a device."""
    for name in names:
        if name not in mission.signals:
            raise StoreError(f"mission {mission.index} has no channel {name}: no {device}")


def _in_body(current: Array, mission: MissionSequence) -> Array:
    """[m/s] Forward and starboard component, (time, 2), of a current (north, east), (time, 2)."""
    angles = (np.deg2rad(mission.signals[name]) for name in ATTITUDE)
    to_ned = euler_to_matrix(*angles)
    return np.einsum("tij,ti->tj", to_ned[:, :2, :2], current)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LabelCounts:
    """Numbers of samples with Doppler lock, outliers and labels in some missions."""

    samples: int
    bottom: int
    """Samples in bottom lock"""
    water: int
    """Samples in water lock"""
    outliers: int
    used: int
    """Samples with a label"""
    current_mean: float | None = None
    """[m/s] Mean speed of the current subtracted from bottom track; None: no current was known"""
    current_max: float | None = None
    """[m/s] Highest speed of the subtracted current; None: no current was known"""

    def sentences(self, config: LabelConfig) -> list[str]:
        """Sentences on the numbers, for a page or a terminal."""
        share = {
            name: 100.0 * getattr(self, name) / max(self.samples, 1)
            for name in ("bottom", "water", "used", "outliers")
        }
        smoothing = {
            "gaussian": f"smoothed with a Gaussian of {SMOOTHING_S:g} s",
            "causal": f"smoothed with the past half of a Gaussian of {SMOOTHING_S:g} s",
            "none": "not smoothed",
        }[config.smoothing]
        if config.known_current == NO_CURRENT:
            current = "No current was known, so that bottom track was no label."
        else:
            where = {FROM_STORE: "the store's, at the vehicle"}.get(
                config.known_current, f"{config.known_current} north, east, as given"
            )
            current = (
                f"The current taken off bottom track is {where}: mean speed "
                f"{self.current_mean:.3f} m/s, highest {self.current_max:.3f} m/s."
            )
        if config.source == "camera":
            return [
                f"Networks learned from a camera, not from the truth: {self.used} of "
                f"{self.samples} samples ({share['used']:.1f} %) have a label.",
                current.replace("bottom track", "its velocity over ground"),
            ]
        return [
            f"Networks learned from the Doppler log, not from the truth: {self.used} of "
            f"{self.samples} samples ({share['used']:.1f} %) have a label; bottom lock in "
            f"{share['bottom']:.1f} %, water lock in {share['water']:.1f} %.",
            f"{self.outliers} outliers ({share['outliers']:.2f} % of the samples) were removed; "
            f"the rest was {smoothing}.",
            current,
        ]


def count_labels(missions: Iterable[MissionSequence], config: LabelConfig) -> LabelCounts:
    """Count the labels that the Doppler logs of missions give; errors as in `measured`."""
    counts = dict.fromkeys(("samples", "bottom", "water", "outliers", "used"), 0)
    total, highest = 0.0, 0.0
    for mission in missions:
        found = measured(mission, config)
        counts["samples"] += mission.samples
        for name, mask in (
            ("bottom", found.bottom), ("water", found.water), ("outliers", found.removed),
            ("used", found.usable),
        ):  # fmt: skip
            counts[name] += int(mask.sum())
        if (current := config.current(mission)) is not None:
            speed = np.hypot(*current.T)
            total += float(np.nansum(speed))
            highest = max(highest, float(np.nanmax(speed, initial=0.0)))
    known = config.known_current != NO_CURRENT
    return LabelCounts(
        **counts,
        current_mean=total / max(counts["samples"], 1) if known else None,
        current_max=highest if known else None,
    )


def label_config(settings: Mapping[str, Any]) -> LabelConfig:
    """Label settings from a run's stored settings; earlier versions always used the truth."""
    return LabelConfig(**settings.get("labels", {}))
