"""Judged tracks: write dead-reckoned tracks to a file, and compare networks with a Doppler log.

The file is as `twin.records.tracks` reads it: variables NAME_north and NAME_east [m] over ground,
dimensions (mission, time). A track NAME restarts at each GPS fix and uses the previous dive's
depth-averaged current, as on board. If there are fixes, NAME_corrected uses each dive's own
current, known after its end. Without a known current, both are tracks through the water. A method
without a track in some mission is left out.

The paper's first study compares networks with a Doppler log in this way.
"""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.data.labels import LabelConfig, measured
from learn.evaluation.score import TARGETS, ReferenceVelocity, TrackError, track_statistics
from twin.errors import InputError
from twin.navigation.dead_reckoning import Array, CurrentKnowledge, ground_track, horizontal_error
from twin.navigation.estimators.base import Estimate
from twin.records.presence import is_derived
from twin.records.schema import MISSION, TIME
from twin.records.storage.whole import (
    check_file_target,
    check_folder_target,
    whole_file,
    whole_folder,
)
from twin.records.tracks import write_track_dataset

Numbers = NDArray[Any]
Arrays = Mapping[str, Numbers]

CORRECTED = "_corrected"
TRUTH_NAMES = ("floor",)
"""Methods without a track in the file, because they use the truth, unknown to a vehicle."""


class TrackCollector:
    """Collect the tracks of an evaluation; `add` is a callback for `evaluate`."""

    def __init__(self) -> None:
        self._missions: list[int] = []
        self._tracks: dict[str, dict[int, Array]] = {}
        self._time: NDArray[Any] = np.zeros(0)

    def add(self, reference: ReferenceVelocity, estimates: Mapping[str, Estimate]) -> None:
        """Add the tracks of one mission."""
        mission = reference.mission
        self._missions.append(mission.index)
        if mission.samples > len(self._time):
            self._time = mission.period * np.arange(mission.samples)
        for name, estimate in estimates.items():
            if name in TRUTH_NAMES:
                continue
            for suffix, track in ground_tracks(reference, estimate).items():
                self._tracks.setdefault(name + suffix, {})[mission.index] = track

    def _complete(self) -> dict[str, dict[int, Array]]:
        """Tracks that all missions have: readers refuse a track without samples.

        A mission without a corrected track gets its uncorrected track instead.
        """
        filled = {
            name: {**self._tracks.get(name.removesuffix(CORRECTED), {}), **tracks}
            for name, tracks in self._tracks.items()
        }
        return {n: t for n, t in filled.items() if all(m in t for m in self._missions)}

    def write(self, path: Path) -> Path:
        """Write all tracks to `path`, in the format of its ending.

        Raises:
          InputError: the ending is unknown, the path is taken, or the disk refuses.
        """
        check_target(path)
        missions = np.array(self._missions)
        arrays: dict[str, NDArray[Any]] = {}
        for name, tracks in self._complete().items():
            both = np.full((len(missions), len(self._time), 2), np.nan, np.float32)
            for row, mission in enumerate(self._missions):
                both[row, : len(tracks[mission])] = tracks[mission]
            arrays[f"{name}_north"], arrays[f"{name}_east"] = both[..., 0], both[..., 1]
        zarr = path.suffix == ".zarr"
        whole = whole_folder(path, overwrite=True, ours=is_derived) if zarr else whole_file(path)
        with whole as place:
            _WRITERS[path.suffix](place, missions, self._time, arrays)
        return path


def check_target(path: Path) -> None:
    """Refuse a path that tracks cannot be written to, before long computations.

    Raises:
      InputError: the ending is no known format, or the path is taken.
    """
    if path.suffix not in _WRITERS:
        raise InputError(
            f"track file {path}: the ending must be one of {', '.join(sorted(_WRITERS))}"
        )
    if path.suffix != ".zarr":
        check_file_target(path)
        return
    check_folder_target(path, overwrite=True, ours=is_derived)


def ground_tracks(reference: ReferenceVelocity, estimate: Estimate) -> dict[str, Array]:
    """[m] Tracks over ground, (time, 2), by the suffix of their names: "" and "_corrected"."""
    signals, period = reference.mission.signals, reference.mission.period
    start = np.array([signals["true_north"][0], signals["true_east"][0]])
    if estimate.ground_track is not None:
        return {"": np.asarray(estimate.ground_track, float)}
    if estimate.surge is None or estimate.sway is None:
        return {}
    moved = reference.track(estimate, reference.measured)
    kinds: dict[str, CurrentKnowledge] = {"": "previous"}
    if reference.dives:
        kinds[CORRECTED] = "corrected"
    return {
        suffix: ground_track(moved, signals, period, knowledge=knowledge, start=start)
        for suffix, knowledge in kinds.items()
    }


def _write_npz(path: Path, missions: Numbers, time: Numbers, arrays: Arrays) -> None:
    np.savez_compressed(path, **{MISSION: missions, TIME: time, **arrays})  # type: ignore[arg-type]


def _write_csv(path: Path, missions: Numbers, time: Numbers, arrays: Arrays) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["mission", "track", "time", "north", "east"])
        for name in (n.removesuffix("_north") for n in arrays if n.endswith("_north")):
            north, east = arrays[f"{name}_north"], arrays[f"{name}_east"]
            for row, mission in enumerate(missions):
                for k in np.flatnonzero(np.isfinite(north[row])):
                    writer.writerow(
                        [
                            mission,
                            name,
                            f"{time[k]:g}",
                            f"{north[row, k]:.3f}",
                            f"{east[row, k]:.3f}",
                        ]
                    )


_WRITERS: dict[str, Callable[[Path, Numbers, Numbers, Arrays], None]] = {
    ".nc": write_track_dataset,
    ".zarr": write_track_dataset,
    ".npz": _write_npz,
    ".csv": _write_csv,
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class DvlComparison:
    """Differences between networks and Doppler log on one mission."""

    mission: int
    track: TrackError
    """Distance of the networks' track, without a current, from the DVL-aided track."""
    samples: int = 0
    """Number of samples with a label of the Doppler log"""
    squared: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """[(m/s)^2] Sum of squared differences from the labels, for surge and sway"""


def compare(
    reference: ReferenceVelocity, network: Estimate, dvl: Estimate, labels: LabelConfig | None
) -> DvlComparison | None:
    """Compare networks with the Doppler log on one mission; None if the log never had lock.

    Args:
      labels: settings that take velocities from the log; None: velocities are not compared.
    """
    track = reference.tracks(network).get("ground")
    if dvl.ground_track is None or track is None:
        return None
    away = horizontal_error(track, dvl.ground_track)
    path = float(reference.path[-1])
    found = DvlComparison(
        mission=reference.mission.index,
        track=TrackError(float(away[-1]), float(away.max()), path),
    )
    if labels is None:
        return found
    log = measured(reference.mission, labels)
    squared = {
        name: float(np.nansum(np.square(getattr(network, name) - log.velocities[name])))
        for name in TARGETS
    }
    return dataclasses.replace(found, samples=int(log.usable.sum()), squared=squared)


def summarise(comparisons: Sequence[DvlComparison]) -> dict[str, Any]:
    """Summarise comparisons over missions; mean squared errors are None without labels."""
    samples = sum(found.samples for found in comparisons)
    mse = {
        f"{name}_mse": math.fsum(c.squared.get(name, 0.0) for c in comparisons) / samples
        if samples
        else None
        for name in TARGETS
    }
    return {
        "missions": len(comparisons),
        "samples": samples,
        **mse,
        **track_statistics("dr", [found.track for found in comparisons]),
    }
