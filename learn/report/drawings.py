"""Drawings: every registered figure in its place on the page."""

from __future__ import annotations

import itertools

from learn.report.contents import Contents
from learn.report.figures.registry import REPORT_FIGURES
from twin.show.figures.page_layout import Page


class Drawings:
    """Puts the figures of a section on a page when its turn comes."""

    def __init__(self, page: Page, contents: Contents) -> None:
        self._page, self._contents = page, contents

    def place(self, section: str, heading: str = "") -> None:
        """Draw what has something to show.

        Args:
          section: one of `learn.report.figures.base.SECTIONS`.
          heading: stands above the first figure.
        """
        drawn = []
        for name, kind in REPORT_FIGURES.items():
            if kind.section != section:
                continue
            figure = kind()
            drawing = figure.draw(self._contents)
            if drawing is not None:
                drawn.append((kind.beside, (name, drawing, figure.caption(self._contents))))
        if drawn and heading:
            self._page.section(heading)
        for beside, group in itertools.groupby(drawn, key=lambda entry: entry[0]):
            entries = [entry for _, entry in group]
            if beside:
                self._page.pair(entries)
                continue
            for entry in entries:
                self._page.figure(*entry)
