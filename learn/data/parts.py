"""Parts: the parts of a store's vehicle, as far as networks see them."""

from __future__ import annotations

from twin.errors import StoreError
from twin.navigation.features import FLIGHT, GLIDER_PARTS, INPUT_SETS
from twin.navigation.settings import can_estimate
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath


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


def input_groups(inputs: str, store: str | StorePath) -> tuple[str, ...]:
    """Groups of the set of inputs of that name, a key of INPUT_SETS, for networks of a store.

    `full` has the group `flight` too where the store is a simulated glider's and has a CTD: logs
    say nothing of the vehicle that the flight filter must know.
    """
    groups = INPUT_SETS[inputs]
    if inputs != "full":
        return groups
    try:
        with MissionStore(store) as reader:
            channels = map(str, reader.dataset.data_vars)
            flies = not reader.logged and can_estimate(reader.vehicle, channels)
    except StoreError:  # what is wrong with it is said where it is read
        return groups
    return (*groups, FLIGHT) if flies else groups
