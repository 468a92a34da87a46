"""Log score: score networks and baselines on real logs, with the references that a log holds.

A log can hold two references. One is the velocity through the water, from a current profiler or a
DVL; samples without it are counted and not scored. Networks that learned from a DVL are scored by
its velocities on rows outside their training. The other is the position at each fix. A row is one
dive, so its track is scored at the row's end. The depth-averaged current of the previous row is
used if that row ended less than an hour ago. A track corrected afterwards ends at the fix, so it
has no error to score.

Errors in % refer to the horizontal path through the water from w / tan(|pitch| + |alpha|), with the
angle of attack alpha, since the true path is unknown.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from learn.data.dataset import MissionSequence
from learn.data.labels import LabelConfig
from learn.evaluation.score import (
    FLOOR,
    LAUNCH_S,
    NETWORK,
    TARGETS,
    MissionScore,
    TrackError,
    network_estimate,
    visible,
)
from twin.errors import StoreError
from twin.navigation.dead_reckoning import (
    Array,
    AttitudeSeries,
    depth_rate,
    finite_channel,
    horizontal_velocity,
    integrate,
)
from twin.navigation.estimators.base import Estimate, VelocityEstimator, check_estimate
from twin.navigation.estimators.flight import PitchPlusAlpha
from twin.records.logged import LogRow
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from learn.networks.predictor import Ensemble


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogReference:
    """Reference velocities and positions of one row."""

    mission: MissionSequence
    row: LogRow
    truth: Mapping[str, Array]
    """[m/s] Surge and sway through the water, (time,); NaN where unknown."""
    measured: AttitudeSeries
    depth_rate: Array | None
    """[m/s] Measured vertical velocity; None without depth: only velocities are scored then"""
    path: float
    """[m] Horizontal path through the water, see the module; NaN without depth"""

    @classmethod
    def of(cls, mission: MissionSequence, vehicle: Vehicle, labels: LabelConfig) -> LogReference:
        """Reference of a row with navigation channels; `labels` selects truth or Doppler log.

        Raises:
          StoreError: a navigation channel has no value at all.
        """
        assert mission.row is not None
        signals = mission.signals
        measured = AttitudeSeries.of(signals, "measured")
        truth = {
            "surge": np.asarray(labels.of(mission, "surge"), float),
            # a log with speed alone sets sway to zero for training, which is no reference here
            "sway": np.asarray(labels.of(mission, "sway"), float)
            if labels.device
            else signals.get("true_sway", np.full(mission.samples, np.nan)),
        }
        rate, path = None, math.nan
        if "measured_depth" in signals:
            rate = depth_rate(finite_channel(signals, "measured_depth"), mission.period)
            simple = PitchPlusAlpha(vehicle, mission.period).batch(signals)
            assert simple.surge is not None
            assert simple.sway is not None
            velocity = horizontal_velocity(simple.surge, simple.sway, rate, measured)
            path = float(integrate(np.hypot(*velocity.T), mission.period)[-1])
        return cls(
            mission=mission,
            row=mission.row,
            truth=truth,
            measured=measured,
            depth_rate=rate,
            path=path,
        )

    def moved(self, estimate: Estimate) -> Array | None:
        """[m] Displacement through the water during the row by an estimate, north and east, (2,);
        None if velocities or depth are missing."""
        if estimate.surge is None or estimate.sway is None or self.depth_rate is None:
            return None
        velocity = horizontal_velocity(
            np.asarray(estimate.surge, float),
            np.asarray(estimate.sway, float),
            self.depth_rate,
            self.measured,
        )
        return np.asarray(integrate(velocity, self.mission.period)[-1], float)


def score_row(
    reference: LogReference,
    estimate: Estimate,
    before: tuple[LogReference, Estimate] | None,
) -> MissionScore:
    """Score one method on one row.

    Args:
      before: previous row and the method's estimate on it, if this row follows directly; else None.
    """
    mission = reference.mission
    launch = min(mission.samples, math.ceil(LAUNCH_S / mission.period))
    squared, late = {}, {}
    for name in TARGETS:
        values, truth = getattr(estimate, name), reference.truth[name]
        if values is not None and np.isfinite(truth).any():
            error = np.square(np.asarray(values, float) - truth)
            squared[name] = float(np.nansum(error))
            late[name] = float(np.nansum(error[launch:]))
    known = np.isfinite(reference.truth["surge"])
    tracks: dict[str, TrackError] = {}
    dives: dict[str, tuple[TrackError, ...]] = {}
    if reference.row.displacement is not None and math.isfinite(reference.path):
        _over_ground(reference, estimate, before, tracks, dives)
    return MissionScore(
        mission=mission.index,
        samples=int(known.sum()),
        late_samples=int(known[launch:].sum()),
        squared=squared,
        squared_late=late,
        tracks=tracks,
        dives=dives,
    )


def _over_ground(
    reference: LogReference,
    estimate: Estimate,
    before: tuple[LogReference, Estimate] | None,
    tracks: dict[str, TrackError],
    dives: dict[str, tuple[TrackError, ...]],
) -> None:
    row = reference.row
    truth = np.array(row.displacement)

    def error(reckoned: Array) -> TrackError:
        missed = float(np.hypot(*(reckoned - truth)))
        return TrackError(missed, missed, reference.path)

    if estimate.ground_track is not None and estimate.uses_fixes:
        if before is not None:  # the same dives for all methods
            dives["previous"] = (error(np.asarray(estimate.ground_track[-1], float)),)
        return
    moved = reference.moved(estimate)
    if moved is None:
        return
    tracks["ground"] = error(moved)
    if before is None:
        return
    earlier, its_estimate = before
    its_moved = earlier.moved(its_estimate)
    if its_moved is None or earlier.row.displacement is None:
        return
    current = (np.array(earlier.row.displacement) - its_moved) / earlier.row.duration
    dives["none"] = (error(moved),)
    dives["previous"] = (error(moved + current * row.duration),)


@dataclasses.dataclass(frozen=True)
class LogScores:
    """Scores of all methods on the rows of a store."""

    scores: Mapping[str, tuple[MissionScore, ...]]
    counts: Mapping[str, int]
    """Numbers of rows and samples, with and without truth or fixes, and of rows left out."""


Watch = Callable[[LogReference, Mapping[str, Estimate]], None]


def score_logs(
    groups: Iterable[Sequence[MissionSequence]],
    chosen: Callable[[MissionSequence], bool],
    *,
    networks: Mapping[str, Ensemble],
    baselines: Mapping[str, VelocityEstimator],
    vehicle: Vehicle,
    labels: LabelConfig,
    watch: Watch | None = None,
) -> LogScores:
    """Score networks and baselines on the rows of a store, in the store's order.

    Args:
      groups: all rows, in groups: a row that is not scored still gives the next row its current.
      chosen: function that is True for the rows to score.
      labels: source of the reference velocities, the truth or a Doppler log.

    `FLOOR`, the method of true velocities, has no scores: a log's true velocities have gaps.
    """
    scores: dict[str, list[MissionScore]] = {NETWORK: [], FLOOR: [], **{n: [] for n in baselines}}
    last: tuple[LogReference, dict[str, Estimate]] | None = None
    counts = dict.fromkeys(
        ("rows", "rows_with_truth", "samples", "samples_with_truth", "rows_with_fixes",
         "rows_that_follow", "rows_left_out"), 0,
    )  # fmt: skip
    for group in groups:
        predicted = {name: ensemble.predict(group) for name, ensemble in networks.items()}
        for k, mission in enumerate(group):
            try:
                reference = LogReference.of(mission, vehicle, labels)
            except StoreError:  # a row without depth or attitude
                counts["rows_left_out"] += 1
                last = None
                continue
            estimates = {NETWORK: network_estimate({n: p[k] for n, p in predicted.items()})}
            seen = visible(mission)
            for name, runner in baselines.items():
                try:
                    found = runner.batch(seen)
                    estimates[name] = check_estimate(name, found, mission.samples)
                except StoreError:  # this row lacks a channel that others have
                    continue
            before = last if last is not None and reference.row.follows(last[0].row) else None
            if before is not None and before[0].row.displacement is None:
                before = None
            if chosen(mission):
                for name, found in estimates.items():
                    its = None if before is None or name not in before[1] else before[1][name]
                    pair = None if before is None or its is None else (before[0], its)
                    scores[name].append(score_row(reference, found, pair))
                known = np.isfinite(reference.truth["surge"])
                counts["rows"] += 1
                counts["rows_with_truth"] += int(known.any())
                counts["samples"] += mission.samples
                counts["samples_with_truth"] += int(known.sum())
                counts["rows_with_fixes"] += int(reference.row.displacement is not None)
                counts["rows_that_follow"] += int(before is not None)
                if watch is not None:
                    watch(reference, estimates)
            last = (reference, estimates)
    return LogScores({name: tuple(rows) for name, rows in scores.items()}, counts)


def sentences(counts: Mapping[str, Any], labels: LabelConfig) -> list[str]:
    """Sentences on the scored rows and their references; `labels` is the velocities' source."""
    known = (
        f"{counts['samples_with_truth']} of {counts['samples']} samples, in "
        f"{counts['rows_with_truth']} of {counts['rows']} dives; the others are not scored."
    )
    if labels.device:
        first = [
            f"Labels and reference are the {labels.device}'s cleaned velocities, at {known}",
            f"Nothing in these logs is a truth: errors of the {labels.device}, and of the current "
            "that was taken off, are in every figure.",
        ]
    else:
        first = [f"Truth at {known}"]
    return [
        *first,
        f"{counts['rows_with_fixes']} dives lie between two fixes, {counts['rows_that_follow']} of "
        "them follow on another one, whose current they are given.",
    ]
