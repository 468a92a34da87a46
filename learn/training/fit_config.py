"""Fit config: all settings that decide a run's result, and the training jobs of its networks.

`fit_settings` takes the settings that a user did not give from a resumed run, else the defaults.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from learn.data.dataset import Division
from learn.data.labels import LabelConfig
from learn.data.stores import Stores, check_window, each_store, input_groups, parts_of
from learn.networks.base import NetworkConfig
from learn.networks.familiarity import training_hulls
from learn.run import DEFAULT_STORE, DESCRIPTION, TARGETS, open_run, read_description
from learn.seams import NETWORKS, OPTIMISERS
from learn.training.optimiser import TrainingConfig
from learn.training.settings import FitSettings
from twin.errors import InputError, StoreError, unknown_name
from twin.navigation.features import (
    INPUT_SETS,
    features_for,
    is_known,
    select_features,
    without_image,
)
from twin.navigation.flight_filter import ANY, HULLS
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath, store_path

FREE = ("device", "threads")
"""Settings that may change when a training is resumed, for example on another machine."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitConfig:
    """All settings that decide a run's result."""

    store: str
    """Path of the store; the first of several."""
    features: tuple[str, ...]
    """Names of the inputs, in order."""
    network: NetworkConfig = dataclasses.field(default_factory=NetworkConfig)
    training: TrainingConfig = dataclasses.field(default_factory=TrainingConfig)
    """Settings of the training; the first network has their seed, the others the next seeds."""
    members: int = 1
    """Networks per velocity; the standard deviation of their outputs estimates the error."""
    division: Division = "missions"
    """`missions`: the store's split. `samples`: the paper's random 70/15/15, which leaks."""
    mirror: bool = True
    """True: train on the mirror image of every mission too, port for starboard. `fit_settings`
    leaves it out for inputs without one, such as a thruster's: another thruster is its image."""
    period: float | None = None
    """[s] Sample period, a multiple of the store's; None takes all samples."""
    start: str | None = None
    """Run whose weights and normalisation the training starts from; None: random weights."""
    held_out: tuple[int, ...] = ()
    """Rows of the store that are not trained on, see `learn.data.preparation.prepare`."""
    labels: LabelConfig = dataclasses.field(default_factory=LabelConfig)
    """Source of the velocities to learn: the truth or a Doppler log."""
    more_stores: tuple[str, ...] = ()
    """Paths of further stores to train on."""
    hulls: str = ANY
    """Prior knowledge of the hulls: a key of `twin.navigation.flight_filter.HULLS`"""

    def __post_init__(self) -> None:
        if self.members < 1:
            raise InputError(f"members must be at least 1, not {self.members}")
        if self.period is not None and not (math.isfinite(self.period) and self.period > 0.0):
            raise InputError(f"period must be a finite number of seconds above 0: {self.period}")
        if self.hulls not in HULLS:
            raise InputError(unknown_name("hulls", self.hulls, HULLS))
        if not self.features:
            raise InputError("the networks need at least one input feature")
        places = [_absolute(one) for one in self.stores]
        if twice := [str(one) for k, one in enumerate(self.stores) if places[k] in places[:k]]:
            raise InputError(f"store {twice[0]} is given twice: its missions would count twice")
        if self.more_stores and self.held_out:
            raise InputError("rows are held out of one store, not of several")

    @property
    def stores(self) -> tuple[str, ...]:
        """Paths of all stores."""
        return (self.store, *self.more_stores)

    @classmethod
    def of(cls, settings: Mapping[str, Any], folder: Path) -> FitConfig:
        """Config from a run's stored settings; settings added since then get their defaults.

        Raises:
          StoreError: the settings are damaged, or of a later version.
        """
        values = dict(settings)
        try:
            values["network"] = NetworkConfig(**values["network"])
            values["training"] = TrainingConfig(**values["training"])
            values["labels"] = LabelConfig(**values.get("labels", {}))
            for name in ("features", "held_out", "more_stores"):
                values[name] = tuple(values.get(name, ()))
            return cls(**values)
        except (TypeError, KeyError) as error:
            raise StoreError(
                f"{folder / DESCRIPTION} has settings that this version does not know ({error})"
            ) from error

    def differences(self, other: FitConfig) -> list[str]:
        """Differences from `other` in words, one per setting, without the settings FREE."""
        ours, theirs = (dataclasses.asdict(config) for config in (self, other))
        for part in ("network", "training", "labels"):
            for values in (ours, theirs):
                values |= {k: v for k, v in values.pop(part).items() if k not in FREE}
        found = []
        for name, mine in ours.items():
            if mine == theirs[name]:
                continue
            if isinstance(mine, tuple):
                gone = [str(v) for v in mine if v not in theirs[name]]
                new = [str(v) for v in theirs[name] if v not in mine]
                parts = [f"with {', '.join(gone)}"] * bool(gone)
                parts += [f"without {', '.join(new)}"] * bool(new)
                found.append(f"{name} {' and '.join(parts) or 'in another order'}")
            else:
                found.append(f"{name} {mine} instead of {theirs[name]}")
        return found

    def jobs(self) -> list[TrainingJob]:
        """Jobs of all networks to train."""
        return [
            TrainingJob(
                target=target,
                member=member,
                config=self,
                seed=self.training.seed + member * len(TARGETS) + place,
            )
            for member in range(self.members)
            for place, target in enumerate(TARGETS)
        ]


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingJob:
    """Training of one network of a run."""

    target: str
    member: int
    config: FitConfig
    seed: int

    @property
    def name(self) -> str:
        """Name of the network's files."""
        return f"{self.target}-{self.member}"


DEFAULT_MEMBERS = 2
DEFAULT_INPUTS = "full"


def fit_settings(
    store: str | StorePath | Stores | None = None, *, resumed: Path | None = None, **settings: Any
) -> FitConfig:
    """Complete the given settings with a resumed run's own and the defaults.

    Args:
      store: missions or logs of one vehicle, or several stores of simulated missions, one vehicle
        each. Several stores need one sample period; inputs are the features that all their vehicles
        have. None is the resumed run's store or data/missions.zarr.
      resumed: folder of the run to continue, if it exists.
      settings: fields of `learn.FitSettings`.

    Raises:
      InputError: a name is unknown, a value is impossible, or a setting would have no effect.
    """
    own = FitSettings(**settings)
    base = continued = _resumed(resumed)
    places = each_store((base.stores if base else DEFAULT_STORE) if store is None else store)
    if not places:
        raise InputError("no store is given: an empty list of stores trains nothing")
    base = base or FitConfig(
        store=str(DEFAULT_STORE),
        features=_inputs(places, DEFAULT_INPUTS),
        members=DEFAULT_MEMBERS,
    )
    sizes = own.given("hidden", "layers", "delays", "memories")
    kinds = own.given(kind="network") | sizes
    chosen, shape = base.features, base.network
    start, period = base.start, base.period if own.period is None else own.period
    other_inputs = bool(own.features or own.without or own.inputs is not None)
    if own.start is not None:
        first = open_run(own.start)
        if first.shipped:
            with MissionStore(places[0]) as reader:
                first = first.at(own.period or reader.period)
        if other_inputs or kinds:
            raise InputError(
                "--start takes inputs and network from the run: leave out --inputs, --features, "
                "--without, --network, --hidden, --layers, --delays and --memories"
            )
        if own.period not in (None, first.period):
            raise InputError(
                f"run {first.name} has a sample every {first.period:g} s: leave --period out"
            )
        start, chosen = str(first.folder), first.features
        period = own.period if first.shipped else first.period
        if first.shipped and own.members is None:
            base = dataclasses.replace(base, members=first.members)
        shape = NetworkConfig(**first.description["settings"]["network"])
    if other_inputs:
        if own.inputs is not None and own.inputs not in INPUT_SETS:
            raise InputError(unknown_name("set of inputs", own.inputs, INPUT_SETS))
        chosen = _inputs(places, own.inputs or DEFAULT_INPUTS, own.features, own.without)
    training = own.given(
        *("optimiser", "seed", "device", "window", "washin", "buffer", "seconds", "epochs")
    )
    if own.epochs is not None:
        training.setdefault("seconds", 0.0)
    learned = own.given("known_current", "smoothing", source="labels")
    one, *more = _same_places(places, base)
    config = FitConfig(
        store=one,
        more_stores=tuple(more),
        features=chosen,
        network=NetworkConfig(**{**dataclasses.asdict(shape), **kinds}),
        training=TrainingConfig(**{**dataclasses.asdict(base.training), **training}),
        members=base.members if own.members is None else own.members,
        division=base.division if own.division is None else own.division,  # type: ignore[arg-type]
        mirror=base.mirror and own.mirror and not without_image(chosen, parts_of(places)),
        period=period,
        start=None if start is None else str(start),
        labels=LabelConfig(**{**dataclasses.asdict(base.labels), **learned}),
        held_out=tuple(own.held_out) or base.held_out,
        hulls=base.hulls,
    )
    if continued is None:
        hulls = training_hulls(places, chosen, period) if own.start is None else first.hulls
        config = dataclasses.replace(config, hulls=hulls)
    _check_uses(config, sizes, training, learned)
    if own.window is not None:
        check_window(config.stores, own.window, division=config.division, period=config.period)
    return config


def _inputs(
    stores: Stores, inputs: str, features: Sequence[str] = (), without: Sequence[str] = ()
) -> tuple[str, ...]:
    """Names of the inputs that all stores have, from a set of inputs or from `features`.

    Raises:
      InputError: a name is unknown, no input is left, or a store's vehicle lacks a feature.
    """
    for store in stores if len(stores) > 1 else ():
        had = features_for(tuple(parts_of(store)))
        if lacking := [name for name in features if is_known(name) and name not in had]:
            raise InputError(
                f"the vehicle of store {store} has no {lacking[0]}, and networks of several stores "
                "read what all of them have: leave it out of --features, or the store"
            )
    wanted = tuple(features) or min((input_groups(inputs, one) for one in stores), key=len)
    return select_features(wanted, without, tuple(parts_of(stores)))


def _resumed(folder: Path | None) -> FitConfig | None:
    """Settings of the run to continue; None if there is no run yet."""
    if folder is None or not (folder / DESCRIPTION).is_file():
        return None
    return FitConfig.of(read_description(folder)["settings"], folder)


def _absolute(store: str | StorePath) -> StorePath:
    place = store_path(store)
    return place.absolute() if isinstance(place, Path) else place


def _same_places(stores: Stores, base: FitConfig) -> tuple[str, ...]:
    """Paths of the stores; a path that leads to a store of the settings is replaced by its path."""
    known = {_absolute(store): store for store in base.stores}
    return tuple(known.get(_absolute(store), str(store)) for store in stores)


def _check_uses(
    config: FitConfig,
    sizes: Mapping[str, object],
    training: Mapping[str, object],
    learned: Mapping[str, object],
) -> None:
    """Raise InputError for a given setting that would have no effect."""
    from learn.networks.fixed_memory import FixedMemory

    for name in learned if config.labels.source == "truth" else ():
        if name != "source":
            raise InputError(
                f"--{name.replace('_', '-')} is about what a Doppler log or camera measured, and "
                "this run learns from the truth: leave it out, or give --labels dvl or camera"
            )
    if config.labels.source == "camera" and "smoothing" in learned:
        raise InputError("a camera's velocities are smoothed already: leave --smoothing out")
    kind = config.network.kind
    for name in sizes:
        if name not in NETWORKS[kind].sizes:
            users = [k for k in NETWORKS if name in NETWORKS[k].sizes]
            raise InputError(
                f"network {kind!r} has no --{name} (its sizes: {', '.join(NETWORKS[kind].sizes)}); "
                f"leave it out, or take a network that has: {', '.join(users)}"
            )
    given = [name for name in ("window", "washin") if name in training]
    if given and issubclass(NETWORKS[kind], FixedMemory):
        users = [k for k in NETWORKS if not issubclass(NETWORKS[k], FixedMemory)]
        raise InputError(
            f"network {kind!r} has no --{given[0]}: its memory has no weights, so that it learns "
            f"from single samples; leave it out, or take a network that has: {', '.join(users)}"
        )
    used = OPTIMISERS[config.training.optimiser].settings
    if "window" in training and "window" not in used:
        raise InputError(
            f"optimiser {config.training.optimiser!r} has no --window (it uses "
            f"{', '.join(used)}): it sees all samples at once; leave it out"
        )
