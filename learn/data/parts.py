"""Parts: what the vehicle of a store is made of, as far as networks see it."""

from __future__ import annotations

from twin.errors import StoreError
from twin.navigation.features import GLIDER_PARTS
from twin.records.reader import MissionStore
from twin.records.store_path import StorePath


def parts_of(store: str | StorePath) -> dict[str, float | None]:
    """Parts of a store's vehicle, with what the mirror port to starboard makes of each.

    A glider's for logs, and for a store that cannot be opened: what is wrong with it is said where
    it is read.
    """
    try:
        with MissionStore(store) as reader:
            if reader.logged:
                return dict.fromkeys(GLIDER_PARTS)
            return {part.name: part.mirrored() for part in reader.vehicle.parts}
    except StoreError:
        return dict.fromkeys(GLIDER_PARTS)
