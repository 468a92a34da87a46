"""Watch: stores of logs that arrive in a folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

from twin.errors import InputError
from twin.records.presence import is_store

POLL = 30.0
"""[s] between two looks"""


def newest_store(folder: Path) -> tuple[Path, float] | None:
    """The store of a folder that was written last, and when [s] unix; None without any.

    A folder that is itself a store is meant.

    Raises:
      InputError: there is no such folder.
    """
    check_watched(folder)
    stores = [folder] if is_store(folder) else [p for p in folder.iterdir() if is_store(p)]
    dated = [(path, _written(path)) for path in stores]
    return max(dated, key=lambda one: (one[1], one[0].name), default=None)


def check_watched(folder: Path) -> None:
    """Raise InputError where there is no such folder."""
    if not folder.is_dir():
        raise InputError(f"--watch {folder}: there is no such folder; make it, or name another")


def arrivals(
    folder: Path, *, poll: float = POLL, wait: Callable[[float], object] = time.sleep
) -> Iterator[Path]:
    """The newest store, again whenever one arrives or changes; never ends by itself.

    Raises:
      InputError: there is no such folder.
    """
    seen: tuple[Path, float] | None = None
    while True:
        found = newest_store(folder)
        if found is not None and found != seen:
            seen = found
            yield found[0]
        else:
            wait(poll)


def _written(store: Path) -> float:
    """When the newest file of a store's first two levels was written."""
    times = [store.stat().st_mtime]
    for path in store.iterdir():
        times.append(path.stat().st_mtime)
    return max(times)
