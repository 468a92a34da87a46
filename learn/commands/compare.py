"""`learn compare`: one table of runs and baselines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from learn import newest_run, open_run
from twin.cli.console import Console, JsonOption
from twin.cli.program import EXIT_OK
from twin.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Compare(JsonOption):
    """Runs side by side: as they were judged when fitted, or again on one store.

    Example:

        learn compare demo field --store data/missions.zarr
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN ...")] = ()
    """folders or names of runs [default: the newest in runs/]"""
    store: Path | None = None
    """evaluate all of them on this store instead of reading what each has on its own"""
    split: str = "test"
    """which missions of --store: test, train, validation or all"""

    def run(self, console: Console) -> int:
        """Print one table."""
        from learn.report import comparison_rows

        figures = {}
        for run in [open_run(path) for path in self.runs] or [newest_run()]:
            if self.store is not None:
                from learn import evaluate

                found = dict(evaluate(run, self.store, split=self.split).figures)
            else:
                found = run.figures or {}
                if not found:
                    raise InputError(f"run {run.folder} was not evaluated; give --store STORE")
            figures[run.name if run.name not in figures else str(run.folder)] = found
        console.answer(runs=figures)
        stores = {(f["store"], f["split"]) for f in figures.values()}
        if len(stores) > 1:
            console.warn(
                "these runs were judged on different missions: "
                + "; ".join(f"{name}: {f['store']} ({f['split']})" for name, f in figures.items())
                + ". Give --store to judge them on the same ones"
            )
        store, split = sorted(stores)[0]
        where = f"{store} ({split})" if len(stores) == 1 else "each on its own store"
        console.table(comparison_rows(figures), title=f"missions: {where}", digits=3)
        return EXIT_OK
