"""`factory plot`: a page that shows what a store holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twin.records import LogStore

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
        pages = _pages(run, out) if isinstance(run, LogStore) else {out: store_page(run)}
        for path, figure in pages.items():
            with whole_file(path) as place:
                figure.savefig(place)
            console.say(f"wrote {path}")
        answer: dict[str, object] = {}
        if isinstance(run, LogStore):
            answer["current_error_m_s"] = _current_errors(run)
        console.answer(store=self.store, out=next(iter(pages)), pages=list(pages), **answer)
        return 0


def _pages(logs: LogStore, out: Path) -> dict[Path, Figure]:
    """A page for each deployment, by its file."""
    from factory.logs_page import deployment_page, page_names

    names = page_names(logs.deployments)
    pages = {}
    for name, word in names.items():
        path = out if len(names) == 1 else out.with_name(f"{out.stem}-{word}{out.suffix}")
        pages[path] = deployment_page(logs, name)
    return pages


def _current_errors(logs: LogStore) -> dict[str, dict[str, float]]:
    """Errors [m/s] of the depth-averaged currents of each deployment that has a profiler."""
    from factory.logs_page import current_errors

    found = {
        name: current_errors(logs, logs.missions_of(name))
        for name in dict.fromkeys(logs.deployments)
    }
    return {name: errors for name, errors in found.items() if errors}
