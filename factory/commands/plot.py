"""`factory plot`: a page that shows what a store holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.console import Console, JsonOption


@dataclass(frozen=True, kw_only=True)
class Plot(JsonOption):
    """Draw tracks, depths, currents and the histograms of inputs and targets on one page."""

    store: Annotated[Path, tyro.conf.Positional]
    """the store"""
    out: Path | None = None
    """PNG, PDF or SVG file [default: the store's name with .png]"""

    def run(self, console: Console) -> int:
        """Draw and save."""
        from factory.plot import store_page
        from factory.stored import StoredRun
        from twin.errors import InputError

        out = self.store.with_suffix(".png") if self.out is None else self.out
        figure = store_page(StoredRun(self.store))
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(out)
        except (OSError, ValueError) as error:
            raise InputError(f"cannot write plot {out}: {error}") from error
        console.say(f"wrote {out}")
        console.answer(store=self.store, out=out)
        return 0
