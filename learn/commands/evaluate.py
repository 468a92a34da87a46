"""`learn evaluate`: dead reckoning of a run on any store."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from learn import newest_run, open_run
from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument
from twin.cli.program import EXIT_OK
from twin.errors import InputError

if TYPE_CHECKING:
    from learn import Estimate
    from learn.evaluation import ReferenceVelocity


@dataclass(frozen=True, kw_only=True)
class Evaluate(JsonOption):
    """Evaluate a run's networks and baselines on a store: velocity and dead-reckoning errors.

    Example:

        learn evaluate demo data/missions.zarr --tracks tracks.nc
    """

    run_folder: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")] = None
    """folder or name of the run [default: the newest in runs/]"""
    store: Annotated[StoreArgument | None, tyro.conf.Positional] = None
    """store of missions [default: the one that the run was trained on]"""
    split: Literal["test", "train", "validation", "all"] = "test"
    """missions to evaluate"""
    tracks: Path | None = None
    """write the dead-reckoned tracks to this file (.nc, .zarr, .npz or .csv), for
    `twin render --tracks`"""
    out: Path | None = None
    """write a page with tables and figures into this folder"""

    def run(self, console: Console) -> int:
        """Evaluate, print the tables, write the tracks and the page if asked."""
        from learn import evaluate
        from learn.evaluation import TrackCollector, check_target, sentences
        from learn.files import check_file, check_folder
        from learn.finishing import write_evaluation_page
        from learn.report import dive_rows, judged_missions, summary_rows, verdicts
        from learn.run_evaluation import is_log_store

        run = newest_run() if self.run_folder is None else open_run(self.run_folder)
        store = self.store or run.store
        if self.tracks is not None and is_log_store(store):
            raise InputError(f"{store} holds real logs without true tracks: leave --tracks out")
        collector = TrackCollector()
        watches = [] if self.tracks is None else [collector.add]
        # the evaluation takes minutes, so output paths are checked first
        if self.tracks is not None:
            check_target(self.tracks)
            check_file(self.tracks, "--tracks", folder=self.tracks.suffix == ".zarr")
        if self.out is not None:
            from twin.show.figures import check_page_target

            check_folder(self.out, "--out")
            check_page_target(self.out)
        with console.progress(
            total=_count(store, self.split), label="evaluate", unit="missions"
        ) as progress:

            def see(reference: ReferenceVelocity, estimates: Mapping[str, Estimate]) -> None:
                progress.update(1)

            found = evaluate(
                run,
                store,
                split=self.split,
                watches=[*watches, see],
                say=progress.note,
            )
        reasons: dict[str, list[str]] = {}
        for name, why in found.evaluation.missing.items():
            reasons.setdefault(why, []).append(name)
        if reasons:
            parts = [f"{', '.join(names)}: {why}" for why, names in reasons.items()]
            console.warn(f"no baseline {'; '.join(parts)}")
        if self.tracks is not None:
            collector.write(self.tracks)
        page = None
        if self.out is not None:
            command = shlex.join(["learn", *sys.argv[1:]])
            page = write_evaluation_page(self.out, run, found, history=command)

        figures = dict(found.figures)
        console.answer(**figures, tracks=self.tracks, report=page)
        console.table(
            summary_rows(figures),
            title=f"{run.folder} on {judged_missions(figures)}: "
            "MSE in (m/s)², dead reckoning in % of the distance through the water",
            digits=3,
        )
        if dives := dive_rows(figures):
            console.say()
            console.table(dives, title="over ground between GPS fixes, % of the dive", digits=3)
        console.say()
        from twin.records import MissionStore

        with MissionStore(store) as reader:
            if odd := run.strange(reader.vehicle):
                console.warn(odd)
        if counts := found.evaluation.counts:
            for sentence in sentences(counts, run.labels):
                console.item(sentence)
        for sentence in verdicts(figures):
            console.item(sentence)
        for label, path in (("tracks", self.tracks), ("report", page)):
            if path is not None:
                console.say(f"{label}: {path}")
        return EXIT_OK


def _count(store: StoreArgument, split: str) -> int:
    """Number of missions to evaluate; errors as in `Selection`."""
    from learn.data import Selection

    with Selection(store, (), split=split) as selection:
        return len(selection)
