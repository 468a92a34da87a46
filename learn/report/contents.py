"""Contents: everything that a page is made of."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from learn.data.dataset import Mission
from learn.evaluation.evaluation import Evaluation
from learn.evaluation.uncertainty import ErrorModel
from learn.report.shown import Shown


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunEvaluation:
    """A run on the missions of a store: `figures` is what `learn evaluate --json` prints."""

    evaluation: Evaluation
    figures: Mapping[str, Any]
    """By the names of `learn evaluate`: errors of the networks, the floor and each baseline."""
    shown: tuple[Shown, ...]
    """Missions that a page draws; none of a store of logs, whose true tracks nobody knows."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Study:
    """A table of a page about further networks of the run."""

    title: str
    rows: Sequence[Mapping[str, object]]
    caption: str
    sentence: str
    """The result in words."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Contents:
    """Everything that a page is made of; what is missing is left out."""

    title: str
    lead: str
    test: RunEvaluation
    paper_test: RunEvaluation | None = None
    """The paper's three missions."""
    labels: Sequence[str] = ()
    """What was learned, in sentences, where it was not the truth."""
    error_model: ErrorModel | None = None
    metrics: Sequence[Mapping[str, Any]] = ()
    training: Mission | None = None
    ablation: Mapping[str, Mapping[str, Any]] = dataclasses.field(default_factory=dict)
    """Figures of networks without some inputs, by what they lack."""
    studies: Sequence[Study] = ()
    """Further networks of the run."""
    provenance: Mapping[str, object] = dataclasses.field(default_factory=dict)
    command: str = ""

    @property
    def tracks(self) -> tuple[Shown, ...]:
        """Missions whose tracks are drawn: the paper's where they were flown."""
        return (self.paper_test or self.test).shown
