"""Against the DVL: the networks beside a Doppler log, as the paper's first study judges them.

On a real vehicle the log is the only reference. It errs too, so that its own error against the
truth belongs beside these figures. Tracks are compared over ground: the networks' is the one
through the water, as nothing is known of the current, the log's has the current wherever it saw the
bottom.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from learn.data.labels import LabelConfig, measured
from learn.evaluation.score import TARGETS, Reference, TrackError, track_statistics
from twin.navigation.baselines.base import Estimate
from twin.navigation.dead_reckoning import horizontal_error


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
    reference: Reference, network: Estimate, dvl: Estimate, labels: LabelConfig | None
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
