"""Evaluation: errors of estimated velocities and tracks against the truth."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from learn.evaluation.evaluation import evaluate as evaluate
    from learn.evaluation.judged_tracks import TrackCollector as TrackCollector
    from learn.evaluation.judged_tracks import check_target as check_target
    from learn.evaluation.log_score import sentences as sentences
    from learn.evaluation.score import NETWORK as NETWORK
    from learn.evaluation.score import ReferenceVelocity as ReferenceVelocity
    from learn.evaluation.score import best_method as best_method

__getattr__, __dir__ = attach(__name__, places(__name__))
