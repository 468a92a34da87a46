"""Progress of a long task: a bar on a terminal, else a line now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import IO, TYPE_CHECKING, Self

from twin.cli.text_table import format_number

if TYPE_CHECKING:
    from tqdm import tqdm

LINE_INTERVAL_S = 30.0
"""Seconds between two lines when standard error is a file or a pipe."""


class Progress:
    """Progress on standard error; a context manager.

    On a terminal it is a bar that is redrawn. Otherwise (a log file, a pipe) it is one line every
    `interval_s` seconds, and a task that is over before the first one prints nothing.

        with console.progress(total=10.0, label="generate", unit="h") as progress:
            progress.update(0.75, missions=1)
    """

    def __init__(
        self,
        *,
        total: float,
        label: str,
        unit: str,
        stream: IO[str] | None = None,
        interval_s: float = LINE_INTERVAL_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`total` is in `unit`, or an empty one where only the share that is done means anything;
        `clock` gives seconds and is replaced in tests.
        """
        self.total = total
        self.label = label
        self.unit = unit
        self.done = 0.0
        self._stream = sys.stderr if stream is None else stream
        self._interval_s = interval_s
        self._clock = clock
        self._figures: dict[str, str] = {}
        self._start = self._last_line = clock()
        self._printed = False
        self._bar: tqdm | None = None

    def __enter__(self) -> Self:
        self._start = self._last_line = self._clock()
        if self._stream.isatty():
            from tqdm import tqdm

            self._bar = tqdm(
                total=self.total,
                desc=self.label,
                unit=self.unit,
                file=self._stream,
                dynamic_ncols=True,
                bar_format="{desc}: {percentage:3.0f}% |{bar}| {n:.4g}/{total:.4g} {unit} "
                "[{rate_fmt}, {remaining} left{postfix}]"
                if self.unit
                else "{desc}: {percentage:3.0f}% |{bar}| {remaining} left{postfix}",
            )
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if self._bar is not None:
            self._bar.close()
        elif self._printed and not isinstance(error, KeyboardInterrupt):
            self._print_line()

    def update(self, amount: float = 1.0, **figures: object) -> None:
        """Add `amount` to what is done; `figures` (a loss, a count) are shown beside it."""
        self.done += amount
        self._figures.update({name: format_number(value, 3) for name, value in figures.items()})
        if self._bar is not None:
            if figures:
                self._bar.set_postfix(self._figures, refresh=False)
            self._bar.update(amount)
        elif self._clock() - self._last_line >= self._interval_s:
            self._print_line()

    def note(self, text: str) -> None:
        """A line of its own, without breaking the bar."""
        if self._bar is not None:
            self._bar.write(text, file=self._stream)
        else:
            self._write(text)

    def line(self) -> str:
        """The present state in words."""
        elapsed = self._clock() - self._start
        share = f"{100.0 * self.done / self.total:.0f} %" if self.total > 0.0 else ""
        done = f"{format_number(self.done, 3)} of {format_number(self.total, 3)} {self.unit}"
        parts = [(done + (f" ({share})" if share else "")) if self.unit else share]
        if elapsed > 0.0 and self.done > 0.0:
            rate = self.done / elapsed
            if self.unit:
                parts.append(f"{format_number(rate, 3)} {self.unit}/s")
            parts.append(f"{format_duration(max(self.total - self.done, 0.0) / rate)} left")
        parts += [f"{name} {text}" for name, text in self._figures.items()]
        return f"{self.label}: {', '.join(parts)}"

    def _print_line(self) -> None:
        self._last_line = self._clock()
        self._printed = True
        self._write(self.line())

    def _write(self, text: str) -> None:
        self._stream.write(text + "\n")
        self._stream.flush()


def format_duration(seconds: float) -> str:
    """Hours, minutes and seconds, e.g. `1:02:05` or `0:07`."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"
