"""Score: errors of estimated velocities and dead-reckoned tracks, per mission and over missions.

Dead-reckoning percent is the horizontal error at the mission's end over the horizontal path through
the water, without restarts at fixes. The largest error along the track is given too.

- `dr_water`: track through the water with measured attitude;
- `dr_velocity`: track through the water with true attitude: only errors of surge and sway count;
- `dr_ground`: track over ground, without any knowledge of the current.

Three more tracks run from GPS fix to GPS fix: without current, with the previous dive's
depth-averaged current, and corrected afterwards (`twin.navigation.dead_reckoning`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from learn.data.dataset import MissionSequence
from twin.navigation.dead_reckoning import (
    KNOWLEDGE,
    LEAST_DIVE_S,
    Array,
    AttitudeSeries,
    CurrentKnowledge,
    Dive,
    depth_averaged_current,
    depth_rate,
    dive_track,
    find_dives,
    finite_channel,
    gps_fixes,
    horizontal_error,
    horizontal_velocity,
    integrate,
    true_ground_track,
    true_water_path,
    true_water_track,
)
from twin.navigation.estimators.base import Estimate

NETWORK, FLOOR, DVL = "network", "floor", "dvl"
"""Names of methods. FLOOR: true velocities, a lower bound of error. DVL: Doppler log, a baseline"""
JUDGED_BY = "dr_velocity_percent_mean"
"""Figure that decides between methods: track error with true attitude, in % of the path"""
LAUNCH_S = 30.0
"""[s] Duration of the launch from rest, which numbers `..._after_30s` leave out."""
TARGETS = ("surge", "sway")
TRACKS = ("water", "velocity", "ground")
PERCENTILE = 90.0

TRUTH_CHANNELS = (
    *(f"true_{name}" for name in ("surge", "sway", "north", "east", "roll", "pitch", "heading")),
    *("true_velocity_north", "true_velocity_east", "true_current_north", "true_current_east"),
)
NAVIGATION_CHANNELS = ("measured_roll", "measured_pitch", "measured_heading", "measured_depth")
GPS_CHANNELS = ("measured_gps_north", "measured_gps_east")


@dataclasses.dataclass(frozen=True)
class TrackError:
    """Error of one track against the truth."""

    end_m: float
    max_m: float
    path_m: float
    """Length of the horizontal path through the water."""

    @property
    def percent(self) -> float:
        """Error at the end in % of the path; NaN for a path of length zero."""
        return 100.0 * self.end_m / self.path_m if self.path_m > 0 else math.nan

    @property
    def max_percent(self) -> float:
        """Largest error along the track in % of the whole path."""
        return 100.0 * self.max_m / self.path_m if self.path_m > 0 else math.nan


@dataclasses.dataclass(frozen=True)
class MissionScore:
    """Scores of one method on one mission, without entries for missing velocities and tracks."""

    mission: int
    samples: int
    late_samples: int
    """Samples later than LAUNCH_S."""
    squared: Mapping[str, float]
    """[(m/s)^2] Sum of squared errors of surge and sway over all samples."""
    squared_late: Mapping[str, float]
    """[(m/s)^2] Sum of squared errors of surge and sway over samples later than LAUNCH_S."""
    tracks: Mapping[str, TrackError]
    """Errors of whole tracks, by the names of TRACKS."""
    dives: Mapping[str, tuple[TrackError, ...]]
    """Errors per dive after the first, by the current's name in KNOWLEDGE."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReferenceVelocity:
    """True velocities and tracks of one mission, computed once for all methods."""

    mission: MissionSequence
    surge: Array
    sway: Array
    measured: AttitudeSeries
    true: AttitudeSeries
    depth_rate: Array
    """[m/s] Measured vertical velocity"""
    water_track: Array
    """[m] True track through the water, north and east, (time, 2)"""
    ground_track: Array
    path: Array
    """[m] Horizontal path through the water, (time,)"""
    dives: tuple[Dive, ...]

    @classmethod
    def of(cls, mission: MissionSequence) -> ReferenceVelocity:
        """Reference of a mission with TRUTH_CHANNELS and NAVIGATION_CHANNELS.

        Raises:
          StoreError: a channel is missing or not finite.
        """
        signals, period = mission.signals, mission.period
        return cls(
            mission=mission,
            surge=finite_channel(signals, "true_surge"),
            sway=finite_channel(signals, "true_sway"),
            measured=AttitudeSeries.of(signals, "measured"),
            true=AttitudeSeries.of(signals, "true"),
            depth_rate=depth_rate(finite_channel(signals, "measured_depth"), period),
            water_track=true_water_track(signals, period),
            ground_track=true_ground_track(signals),
            path=true_water_path(signals, period),
            dives=tuple(find_dives(signals, period)),
        )

    @property
    def surfaced(self) -> bool:
        """True if there is a fix later than LEAST_DIVE_S."""
        index, _ = gps_fixes(self.mission.signals)
        return bool(index.size) and float(index[-1]) * self.mission.period >= LEAST_DIVE_S

    def track(self, estimate: Estimate, attitude: AttitudeSeries) -> Array:
        """[m] Dead-reckoned track through the water, (time, 2)."""
        assert estimate.surge is not None
        assert estimate.sway is not None
        velocity = horizontal_velocity(
            np.asarray(estimate.surge, float),
            np.asarray(estimate.sway, float),
            self.depth_rate,
            attitude,
        )
        return integrate(velocity, self.mission.period)

    def tracks(self, estimate: Estimate) -> dict[str, Array]:
        """[m] Tracks of the method by the names of TRACKS, (time, 2)."""
        found: dict[str, Array] = {}
        if estimate.surge is not None and estimate.sway is not None:
            found["water"] = self.track(estimate, self.measured)
            found["velocity"] = self.track(estimate, self.true)
            found["ground"] = found["water"]
        if estimate.ground_track is not None:
            found.pop("ground", None)
            if not estimate.uses_fixes:
                found["ground"] = estimate.ground_track
            elif not self.surfaced:
                found["ground"] = estimate.ground_track
                if not estimate.saw_bottom:
                    # without a later fix or bottom lock, the method cannot know the current
                    found["water"] = estimate.ground_track
        return found


def score_mission(reference: ReferenceVelocity, estimate: Estimate) -> MissionScore:
    """Score one method on one mission."""
    samples = reference.mission.samples
    launch = min(samples, math.ceil(LAUNCH_S / reference.mission.period))
    squared, late = {}, {}
    for name in TARGETS:
        values = getattr(estimate, name)
        if values is not None:
            error = np.square(np.asarray(values, float) - getattr(reference, name))
            squared[name], late[name] = float(error.sum()), float(error[launch:].sum())
    length = float(reference.path[-1])
    tracks = {}
    for name, track in reference.tracks(estimate).items():
        truth = reference.ground_track if name == "ground" else reference.water_track
        error = horizontal_error(track, truth)
        tracks[name] = TrackError(float(error[-1]), float(error.max()), length)
    return MissionScore(
        mission=reference.mission.index,
        samples=samples,
        late_samples=samples - launch,
        squared=squared,
        squared_late=late,
        tracks=tracks,
        dives=_score_dives(reference, estimate),
    )


def _score_dives(
    reference: ReferenceVelocity, estimate: Estimate
) -> dict[str, tuple[TrackError, ...]]:
    """Errors of all dives but the first, so that all types of current have the same dives."""
    pairs = list(zip(reference.dives[:-1], reference.dives[1:], strict=True))
    own = estimate.ground_track
    if own is not None and estimate.uses_fixes:
        # the logged track jumps to the fix at the dive's end: score the sample before the jump
        judged = [
            _dive_error(reference, dive, own[dive.start : dive.end], dive.end) for _, dive in pairs
        ]
        return {"previous": tuple(judged)} if pairs else {}
    if own is None:
        if estimate.surge is None or estimate.sway is None:
            return {}
        own = reference.track(estimate, reference.measured)
    period = reference.mission.period
    found: dict[str, tuple[TrackError, ...]] = {}
    for knowledge in KNOWLEDGE if pairs else ():
        errors = []
        for before, dive in pairs:
            current = _current(knowledge, before, dive, own, period)
            track = dive_track(dive, own, current, period)
            errors.append(_dive_error(reference, dive, track, dive.end + 1))
        found[knowledge] = tuple(errors)
    return found


def _current(
    knowledge: CurrentKnowledge, before: Dive, dive: Dive, track: Array, period: float
) -> Array:
    if knowledge == "none":
        return np.zeros(2)
    return depth_averaged_current(before if knowledge == "previous" else dive, track, period)


def _dive_error(reference: ReferenceVelocity, dive: Dive, track: Array, end: int) -> TrackError:
    signals = reference.mission.signals
    start = np.array([signals["true_north"][0], signals["true_east"][0]])
    error = horizontal_error(track, reference.ground_track[dive.start : end] + start)
    path = float(reference.path[dive.end] - reference.path[dive.start])
    return TrackError(float(error[-1]), float(error.max()), path)


def summarise_scores(scores: Sequence[MissionScore]) -> dict[str, Any]:
    """Summarise one method's scores; a number that no mission has is None.

    Squared errors are means over all samples of all missions, track errors are statistics over
    missions, and dive errors are statistics over dives.
    """
    figures: dict[str, Any] = {"missions": len(scores)}
    for name in TARGETS:
        figures[f"{name}_mse"] = _pooled(scores, "squared", "samples", name)
    for name in TARGETS:
        figures[f"{name}_mse_after_30s"] = _pooled(scores, "squared_late", "late_samples", name)
    for name in TRACKS:
        errors = [score.tracks[name] for score in scores if name in score.tracks]
        figures |= track_statistics(f"dr_{name}", errors)
    figures["dives"] = {
        knowledge: track_statistics("dr", [e for s in scores for e in s.dives.get(knowledge, ())])
        | {"dives": sum(len(score.dives.get(knowledge, ())) for score in scores)}
        for knowledge in KNOWLEDGE
    }
    return figures


def _pooled(scores: Sequence[MissionScore], sums: str, counts: str, target: str) -> float | None:
    known = [score for score in scores if target in getattr(score, sums)]
    count = sum(getattr(score, counts) for score in known)
    return math.fsum(getattr(s, sums)[target] for s in known) / count if count else None


def track_statistics(prefix: str, errors: Sequence[TrackError]) -> dict[str, float | None]:
    """Mean, median and 90th percentile of end errors [%, m] and of largest errors [%]."""

    def statistics(name: str, values: list[float]) -> dict[str, float | None]:
        finite = np.array([v for v in values if math.isfinite(v)])
        if not finite.size:
            return {f"{name}_{kind}": None for kind in ("mean", "median", "p90")}
        return {
            f"{name}_mean": float(finite.mean()),
            f"{name}_median": float(np.median(finite)),
            f"{name}_p90": float(np.percentile(finite, PERCENTILE)),
        }

    return {
        **statistics(f"{prefix}_percent", [e.percent for e in errors]),
        **statistics(f"{prefix}_max_percent", [e.max_percent for e in errors]),
        **statistics(f"{prefix}_m", [e.end_m for e in errors]),
    }


def visible(mission: MissionSequence) -> dict[str, Array]:
    """Channels of a mission that a vehicle has: all but the true channels."""
    return {
        name: np.asarray(values, float)
        for name, values in mission.signals.items()
        if not name.startswith("true_")
    }


def network_estimate(predictions: Mapping[str, tuple[Any, Any]]) -> Estimate:
    """Estimate from networks' predictions, mean and standard deviation for each velocity."""
    fields: dict[str, Any] = {}
    for name, (mean, spread) in predictions.items():
        fields[name] = np.asarray(mean, float)
        if np.any(spread):
            fields[f"{name}_sd"] = np.asarray(spread, float)
    return Estimate(**fields)


def best_method(figures: Mapping[str, Any]) -> tuple[str, dict[str, float]]:
    """Name of the method with the least track error in an evaluation, and the error of each.

    Without any error it is the networks.
    """
    known = {NETWORK: figures, **figures["baselines"]}
    errors = {name: one[JUDGED_BY] for name, one in known.items() if one[JUDGED_BY]}
    return min(errors, key=lambda name: errors[name], default=NETWORK), errors
