"""Tracks: dead-reckoned tracks as a file, to be drawn beside the true one.

Written as `twin.records.tracks` reads them: variables NAME_north and NAME_east [m] over ground,
dims (mission, time). A track is re-initialised at GPS fixes with the previous dive's
depth-averaged current, as a vehicle flies; where missions have fixes, NAME_corrected is the same
track after its end. Nothing known of a current, both are tracks through the water. A method that
has no track in some mission is left out.

Against the DVL: the networks beside a Doppler log, as the paper's first study judges them.
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
"""Methods that use truth: these are not tracks that a vehicle could have."""


class TrackCollector:
    """Gathers the tracks of an evaluation; give its `add` as the evaluation's watch."""

    def __init__(self) -> None:
        self._missions: list[int] = []
        self._tracks: dict[str, dict[int, Array]] = {}
        self._time: NDArray[Any] = np.zeros(0)

    def add(self, reference: ReferenceVelocity, estimates: Mapping[str, Estimate]) -> None:
        """The tracks of one mission."""
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
        """Tracks that every mission has: readers refuse one without samples.

        Where nothing was corrected, the corrected track is the plain one.
        """
        filled = {
            name: {**self._tracks.get(name.removesuffix(CORRECTED), {}), **tracks}
            for name, tracks in self._tracks.items()
        }
        return {n: t for n, t in filled.items() if all(m in t for m in self._missions)}

    def write(self, path: Path) -> Path:
        """Write everything to `path`, in the format of its ending.

        Raises:
          InputError: an unknown ending, something is in the way, or the disk refuses.
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
    """Refuse, before long work, what tracks cannot be written to.

    Raises:
      InputError: an ending that is no known format, or something else is in the way.
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
    """Tracks over ground [m], (time, 2), by the ending of their names: "" and "_corrected"."""
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
    """The networks beside the Doppler log on one mission."""

    mission: int
    track: TrackError
    """Their track over ground, taken for the one through the water, from the DVL-aided one."""
    samples: int = 0
    """With a label of the Doppler log"""
    squared: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Sum of squared differences [(m/s)^2] of surge and sway from the labels"""


def compare(
    reference: ReferenceVelocity, network: Estimate, dvl: Estimate, labels: LabelConfig | None
) -> DvlComparison | None:
    """One mission; None where the log never had lock.

    Args:
      labels: how velocities are taken from the log; None: they are not compared.
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
    """Figures over missions; mean squared errors are None without a label."""
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
