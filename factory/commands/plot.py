"""`factory plot`: a page that shows what a store holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument

FORMATS = (".png", ".pdf", ".svg")
"""Endings that a page may have."""


@dataclass(frozen=True, kw_only=True)
class PlotStore(JsonOption):
    """Simulated missions: tracks, depths, currents and histograms of velocities and measured
    signals on one page. Logs: map with currents, depth over time and figures of the dives, one page
    a deployment.

    Example:

        factory plot data/missions.zarr --out missions.png
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""
    out: Path | None = None
    """PNG, PDF or SVG file [default: the store's name with .png]; of a store with several
    deployments each page has its deployment's name added"""

    def run(self, console: Console) -> int:
        """Draw and save."""
        from factory.generation import open_missions
        from factory.logs_page import current_errors, deployment_page, page_names
        from factory.missions_page import store_page
        from twin.errors import InputError
        from twin.records import LogStore, whole_file

        if self.out is not None and self.out.suffix.lower() not in FORMATS:
            raise InputError(f"--out {self.out}: the ending must be one of {', '.join(FORMATS)}")
        run = open_missions(self.store)
        run.check_arrays()
        place = self.store if isinstance(self.store, Path) else Path(self.store.name)
        place = place if place.name not in ("", "..") else place.resolve()
        out = place.with_suffix(".png") if self.out is None else self.out
        answer: dict[str, object] = {}
        if isinstance(run, LogStore):
            words = page_names(run.deployments)
            paths = {
                name: out.with_name(f"{out.stem}-{w}{out.suffix}") for name, w in words.items()
            }
            paths = dict.fromkeys(words, out) if len(words) == 1 else paths
            pages = {path: deployment_page(run, name) for name, path in paths.items()}
            errors = {name: current_errors(run, run.missions_of(name)) for name in words}
            answer["current_error_m_s"] = {name: found for name, found in errors.items() if found}
        else:
            pages = {out: store_page(run)}
        for path, figure in pages.items():
            with whole_file(path) as place:
                figure.savefig(place)
            console.say(f"wrote {path}")
        console.answer(store=self.store, out=next(iter(pages)), pages=list(pages), **answer)
        return 0
