"""Stores: several stores, one vehicle each, as one selection of missions to train networks on.

Checks before the training refuse a store with too little to learn from.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import SPEED, TARGETS, Division, MissionSequence, Selection
from learn.data.labels import (
    NO_CURRENT,
    STORE_CURRENT,
    LabelConfig,
    LabelCounts,
    count_labels,
    measured,
)
from twin.errors import InputError, StoreError, quoted
from twin.navigation.features import FLIGHT, GLIDER_PARTS, INPUT_SETS
from twin.navigation.flight_filter import FlightSpread
from twin.navigation.settings import can_estimate
from twin.records.attributes import SPLIT
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath


def parts_of(stores: str | StorePath | Stores) -> dict[str, float | None]:
    """Parts that the vehicles of all stores share, with each part's sign in the mirror image.

    A part whose sign differs between vehicles is left out."""
    first, *others = map(_parts_of, each_store(stores))
    return {n: sign for n, sign in first.items() if all((n, sign) in o.items() for o in others)}


def _parts_of(store: str | StorePath) -> dict[str, float | None]:
    """Parts of a store's vehicle with their signs in the mirror image.

    Logs have a glider's parts. If a store cannot be opened, reading it raises the error later.
    """

    try:
        with MissionStore(store) as reader:
            if reader.logged:
                return dict.fromkeys(GLIDER_PARTS)
            return {part.name: part.mirrored() for part in reader.vehicle.parts}
    except StoreError:
        return dict.fromkeys(GLIDER_PARTS)


def input_groups(inputs: str, store: str | StorePath) -> tuple[str, ...]:
    """Groups of features in a set of INPUT_SETS, for networks of a store.

    `full` is `thrusters` for a simulated vehicle whose thrusters hold a pose. It includes the group
    `flight` if the store is a simulated glider's with a CTD. Logs lack the vehicle constants that
    the flight filter needs.
    """
    groups = INPUT_SETS[inputs]
    if inputs != "full":
        return groups
    try:
        with MissionStore(store) as reader:
            if not reader.logged and reader.vehicle.holds_pose:
                return INPUT_SETS["thrusters"]
            channels = map(str, reader.dataset.data_vars)
            flies = not reader.logged and can_estimate(reader.vehicle, channels)
    except StoreError:  # reading the store raises this error later
        return groups
    return (*groups, FLIGHT) if flies else groups


def no_measured_labels(
    store: str | StorePath, target: str, counts: LabelCounts, labels: LabelConfig
) -> StoreError:
    """Error for a camera that saw nothing, or a Doppler log that had no lock, or only bottom
    lock without a known current."""
    if labels.source == "camera":
        return StoreError(
            f"store {store} has no sample to learn {target} from: its camera saw none"
        )
    nothing = f"store {store} has no sample to learn {target} from: its Doppler log never had"
    with MissionStore(store) as reader:
        otherwise = "" if reader.logged else "; or learn from the truth with --labels truth"
    if not counts.bottom:
        return StoreError(f"{nothing} lock{otherwise}")
    share = 100.0 * counts.bottom / counts.samples
    return StoreError(
        f"{nothing} water lock, and no current is known to take off what it measured over ground "
        f"(bottom lock in {share:.3g} % of the samples). {_which_current(store)}{otherwise}"
    )


def _which_current(store: str | StorePath) -> str:
    """Advice on --known-current for a store with bottom track alone."""
    with MissionStore(store) as reader:
        simulated = not reader.logged and all(name in reader for name in STORE_CURRENT)
    if not simulated:
        return (
            "Give --known-current NORTH,EAST in m/s, 0,0 in still water; or take a log with water "
            "lock"
        )
    highest = max(
        float(np.hypot(*(mission.signals[name] for name in STORE_CURRENT)).max())
        for mission in _each(store, STORE_CURRENT)
    )
    if highest == 0.0:
        return "The water of this store stands still: give --known-current 0,0"
    return (
        f"Its missions have currents of their own, of up to {highest:.2g} m/s: give "
        "--known-current store, which takes what the simulation knows of each and no vehicle knows "
        "at sea; or take a store with water that stands still (--preset paper of a vehicle with a "
        "propeller, or --set current.speed=0) and give --known-current 0,0; or one with water "
        "lock, which needs no --known-current"
    )


def no_truth(store: str | StorePath, target: str) -> StoreError:
    """Error for a log without any velocity through the water."""
    return StoreError(
        f"store {store} has no truth to learn {target} from (neither {TARGETS[target]} nor "
        f"{SPEED}); a run that is trained on another store can be judged on it: "
        f"`learn evaluate RUN {quoted(store)}`"
    )


def check_truth(store: str | StorePath) -> None:
    """Refuse logs without a channel of true velocity, before their signals are read.

    Raises:
      StoreError: see `prepare`.
    """
    with MissionStore(store) as reader:
        if reader.logged:
            for target, channel in TARGETS.items():
                if channel not in reader and SPEED not in reader:
                    raise no_truth(store, target)


def labels_in(
    store: str | StorePath,
    labels: LabelConfig,
    *,
    division: Division = "missions",
    period: float | None = None,
) -> LabelCounts:
    """Count the Doppler logs' labels in the missions for training and validation.

    Raises:
      StoreError: the missions for training have no label; or as in `Selection`.
    """
    with Selection(store, labels.channels(), period=period) as selection:
        places: Sequence[int] = range(len(selection))
        learned = places
        if division == "missions":
            places = [k for k in places if selection.splits[k] in ("train", "validation")]
            learned = [k for k in places if selection.splits[k] == "train"]
        if learned and not any(measured(m, labels).usable.any() for m in selection.each(learned)):
            counts = count_labels(selection.each(learned), labels)
            raise no_measured_labels(store, " or ".join(TARGETS), counts, labels)
        return count_labels(selection.each(places), labels)


def _each(store: str | StorePath, channels: tuple[str, ...]) -> Iterator[MissionSequence]:
    with Selection(store, channels) as selection:
        yield from selection.each()


FEW_LABELS = 0.1
"""[1] Fraction of samples with labels below which `few_labels` warns."""


def few_labels(store: str | StorePath, labels: LabelConfig, counts: LabelCounts) -> str | None:
    """Warning if few samples have labels because bottom track lacks a known current, else None."""
    if labels.known_current != NO_CURRENT or counts.used >= FEW_LABELS * counts.samples:
        return None
    if counts.bottom <= counts.water:
        return None
    return (
        f"store {store} has labels in {counts.used} of {counts.samples} samples alone: the Doppler "
        "log mostly measured over ground, and no current is known to take off that (bottom lock in "
        f"{100.0 * counts.bottom / counts.samples:.3g} % of the samples). {_which_current(store)}"
    )


def few_missions(store: str | StorePath, division: Division = "missions") -> str | None:
    """Warning if there is a single mission for training, else None.

    A store without a split gives no warning: reading it raises an error.

    Raises:
      StoreError: the store's split cannot be read.
    """
    with MissionStore(store) as reader:
        rows = list(range(len(reader)))
        if division == "missions":
            if SPLIT not in reader:
                return None
            rows = [row for row in rows if reader.splits[row] == "train"]
        noun = "row" if reader.logged else "mission"
    if len(rows) != 1:
        return None
    return (
        f"store {store} has one {noun} for training ({noun} {rows[0]}): what the networks learn "
        f"holds for its water and its manoeuvres; take a store of more {noun}s"
    )


def check_window(
    stores: str | StorePath | Stores,
    window: int,
    *,
    division: Division = "missions",
    period: float | None = None,
) -> None:
    """Refuse a training window that is longer than every training mission.

    Raises:
      InputError: the window is longer than the longest training mission.
      StoreError: see `Selection`.
    """
    missions: list[tuple[int, int, str | StorePath]] = []
    for store in each_store(stores):
        with Selection(store, (), period=period) as selection:
            missions += [
                (int(length), -int(row), store)
                for length, row, split in zip(
                    selection.lengths, selection.rows, selection.splits, strict=True
                )
                if division == "samples" or split == "train"
            ]
    length, row, store = max(missions, key=lambda one: one[:2], default=(window, 0, ""))
    if window > length:
        raise InputError(
            f"--window {window} is longer than every training mission of {store}: the longest, "
            f"mission {-row}, has {length} samples"
        )


Stores = Sequence[str | StorePath]


class SeveralStores(Selection):
    """Selection of missions from several stores, one store after the other.

    Estimated channels of a mission are computed for the vehicle of its own store. `rows` numbers
    the missions of all stores; a mission's `index` is its row in its own store.
    """

    def __init__(self, parts: Sequence[Selection]) -> None:
        """Join these selections; `close` closes them.

        Raises:
          StoreError: a store holds logs, or its sample period differs from the first store's.
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
        """Close all stores' files."""
        for part in self._parts:
            part.close()

    def read(self, places: Sequence[int] | NDArray[np.int64]) -> list[MissionSequence]:
        """Read missions, see `Selection.read`.

        Raises:
          StoreError: as in `Selection.read`, with the store's name.
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
    """Open all missions of one or more stores; arguments and errors as in `Selection`."""
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
    """Tuple of the stores, also for a single store."""
    return (stores,) if isinstance(stores, str | StorePath) else tuple(stores)
