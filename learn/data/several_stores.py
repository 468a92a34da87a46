"""Several stores: missions of some stores, each of one vehicle, that train the same networks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import MissionSequence, Selection
from twin.errors import StoreError
from twin.navigation.flight_filter import FlightSpread
from twin.records.storage.store_path import StorePath

Stores = Sequence[str | StorePath]


class SeveralStores(Selection):
    """The missions of selections, one store after the other, as those of one.

    What is estimated of a mission is so for the vehicle of its own store: that is all that makes
    vehicles comparable. `rows` number the missions through; a mission's `index` is its row in its
    own store.
    """

    def __init__(self, parts: Sequence[Selection]) -> None:
        """Take over these selections, which are closed with it.

        Raises:
          StoreError: one is of logs, or has another time between its samples than the first.
        """
        self._parts = tuple(parts)
        try:
            self._check()
        except BaseException:
            self.close()
            raise
        first = self._parts[0]
        self.store = ", ".join(str(part.store) for part in self._parts)
        self.lengths = np.concatenate([part.lengths for part in self._parts])
        self.rows = np.arange(len(self.lengths))
        self.splits = [split for part in self._parts for split in part.splits]
        self.period = first.period
        self._begin = np.cumsum([0, *map(len, self._parts)])

    def _check(self) -> None:
        first = self._parts[0]
        for part in self._parts:
            if part.logged:
                raise StoreError(
                    f"store {part.store} holds real logs: give it alone, or train on simulated "
                    "stores first and go on from that run with --start"
                )
            if abs(part.period - first.period) > 1e-6 * first.period:
                raise StoreError(
                    f"store {part.store} has a sample every {part.period:g} s, store "
                    f"{first.store} every {first.period:g} s: give --period with a multiple of both"
                )

    @property
    def logged(self) -> bool:
        """False: real logs are refused."""
        return False

    def close(self) -> None:
        """Let go of all stores' files."""
        for part in self._parts:
            part.close()

    def read(self, places: Sequence[int] | NDArray[np.int64]) -> list[MissionSequence]:
        """See `Selection`.

        Raises:
          StoreError: see `Selection`; the store is named.
        """
        wanted = np.asarray(places, np.int64)
        owners = np.searchsorted(self._begin, wanted, side="right") - 1
        found: dict[int, MissionSequence] = {}
        for k in np.unique(owners):
            part, of_part = self._parts[k], np.flatnonzero(owners == k)
            try:
                missions = part.read(wanted[of_part] - self._begin[k])
            except StoreError as error:
                if str(part.store) in str(error):
                    raise
                raise StoreError(f"store {part.store}: {error}") from error
            found |= dict(zip(of_part.tolist(), missions, strict=True))
        return [found[place] for place in range(len(wanted))]


def open_stores(
    stores: str | StorePath | Stores,
    channels: Iterable[str],
    *,
    period: float | None = None,
    spread: FlightSpread | None = None,
) -> Selection:
    """All missions of a store or of several ones; arguments and errors as of `Selection`."""
    names = tuple(channels)
    parts: list[Selection] = []
    try:
        for store in each_store(stores):
            parts.append(Selection(store, names, period=period, spread=spread))
    except BaseException:
        for part in parts:
            part.close()
        raise
    return parts[0] if len(parts) == 1 else SeveralStores(parts)


def each_store(stores: str | StorePath | Stores) -> tuple[str | StorePath, ...]:
    """Stores as a tuple, one store too."""
    return (stores,) if isinstance(stores, str | StorePath) else tuple(stores)
