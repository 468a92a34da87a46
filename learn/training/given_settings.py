"""Given settings: the settings that a user gave, completed to all that a training needs.

What is not given is a resumed run's own, or the default.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from learn.data.labels import LabelConfig
from learn.data.parts import input_groups, parts_of
from learn.data.store_checks import check_window
from learn.networks.config import NetworkConfig
from learn.networks.registry import NETWORKS
from learn.runs.run import DEFAULT_STORE, DESCRIPTION, open_run, read_description
from learn.training.optimisers.registry import OPTIMISERS
from learn.training.schedule import TrainingConfig
from learn.training.settings import FitConfig
from twin.errors import InputError, unknown_name
from twin.navigation.features import INPUT_SETS, select_features
from twin.records.store_path import StorePath, store_path

DEFAULT_MEMBERS = 2
DEFAULT_INPUTS = "full"


def fit_settings(
    store: str | StorePath | None = None,
    *,
    resumed: Path | None = None,
    network: str | None = None,
    hidden: int | None = None,
    layers: int | None = None,
    delays: int | None = None,
    memories: Sequence[float] | None = None,
    inputs: str | None = None,
    features: Sequence[str] = (),
    without: Sequence[str] = (),
    optimiser: str | None = None,
    seconds: float | None = None,
    epochs: int | None = None,
    window: int | None = None,
    washin: int | None = None,
    buffer: int | None = None,
    seed: int | None = None,
    members: int | None = None,
    division: str | None = None,
    mirror: bool = True,
    period: float | None = None,
    start: str | Path | None = None,
    device: str | None = None,
    labels: str | None = None,
    known_current: str | None = None,
    smoothing: str | None = None,
) -> FitConfig:
    """The settings of a training: those given here, a resumed run's own, and the defaults.

    Args:
      store: of missions or of logs [default: data/missions.zarr].
      resumed: folder of the run that is continued, if it exists.
      network: a name of `learn.NETWORKS` [ema, the paper's is elman].
      hidden: units per hidden layer [50].
      layers: hidden layers [3].
      delays: elman: past outputs that a hidden layer is fed back [5].
      memories: ema: [s] of its averages, rising [2, 8, 30].
      inputs: `full` needs gyroscopes and accelerometers, `glider` is what every glider's log has
        [full].
      features: features or groups instead of a set of inputs.
      without: features, groups or sensors that the vehicle lacks.
      optimiser: a name of `learn.OPTIMISERS` [soap].
      seconds: [s] of computing of each network [120].
      epochs: passes over the training missions instead; the result does not depend on the
        machine's speed.
      window: samples that a piece of a mission counts [128]; networks with trained memory only,
        as `washin`.
      washin: samples before it in which the network finds its state [48].
      buffer: samples of the missions that are shuffled together; less needs less memory [1048576].
      seed: of initial weights and order [0].
      members: networks per velocity; with more than one their spread is an uncertainty [2].
      division: `missions`, the store's split, or `samples`, the paper's, which leaks [missions].
      mirror: show every mission mirrored too, port for starboard.
      period: [s] between samples, a multiple of the store's.
      start: run whose weights, inputs, scales and period the training begins with.
      device: cpu, cuda or auto [cpu].
      labels: `truth`, or `dvl` for what the Doppler log measured through the water [truth].
      known_current: with `dvl`, what is taken off bottom track: `none` is known and only water
        track is learned from, `store` for the current that the store holds, or "NORTH,EAST" in
        m/s, "0,0" in still water [none].
      smoothing: with `dvl`, after outliers are removed: `gaussian`, `causal` or `none` [gaussian].

    Raises:
      InputError: a name is unknown, a value impossible, or a setting has no use here.
    """
    base = _resumed(resumed)
    place = store or (base.store if base else DEFAULT_STORE)
    parts = tuple(parts_of(place))
    base = base or FitConfig(
        store=str(DEFAULT_STORE),
        features=select_features(input_groups(DEFAULT_INPUTS, place), (), parts),
        members=DEFAULT_MEMBERS,
    )
    sizes = _given(hidden=hidden, layers=layers, delays=delays, memories=memories)
    kinds = _given(kind=network) | sizes
    chosen, shape = base.features, base.network
    other_inputs = bool(features or without or inputs is not None)
    if start is not None:
        first = open_run(start)
        if other_inputs or kinds:
            raise InputError(
                "--start takes inputs and network from the run: leave out --inputs, --features, "
                "--without, --network, --hidden, --layers, --delays and --memories"
            )
        if period not in (None, first.period):
            raise InputError(
                f"run {first.name} has a sample every {first.period:g} s: leave --period out"
            )
        start, period, chosen = str(first.folder), first.period, first.features
        shape = NetworkConfig(**first.description["settings"]["network"])
    else:
        start, period = base.start, base.period if period is None else period
    if other_inputs:
        if inputs is not None and inputs not in INPUT_SETS:
            raise InputError(unknown_name("set of inputs", inputs, INPUT_SETS))
        wanted = tuple(features) or input_groups(inputs or DEFAULT_INPUTS, place)
        chosen = select_features(wanted, without, parts)
    budget = _given(seconds=seconds, epochs=epochs)
    if epochs is not None and seconds is None:
        budget["seconds"] = 0.0
    training = _given(
        optimiser=optimiser,
        seed=seed,
        device=device,
        window=window,
        washin=washin,
        buffer=buffer, **budget,
    )  # fmt: skip
    learned = _given(source=labels, known_current=known_current, smoothing=smoothing)
    config = FitConfig(
        store=_same_place(store, base),
        features=chosen,
        network=NetworkConfig(**{**dataclasses.asdict(shape), **kinds}),
        training=TrainingConfig(**{**dataclasses.asdict(base.training), **training}),
        members=base.members if members is None else members,
        division=base.division if division is None else division,  # type: ignore[arg-type]
        mirror=base.mirror and mirror,
        period=period,
        start=None if start is None else str(start),
        labels=LabelConfig(**{**dataclasses.asdict(base.labels), **learned}),
    )
    _check_uses(config, sizes, training, learned)
    if window is not None:
        check_window(config.store, window, division=config.division, period=config.period)
    return config


def _given(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _resumed(folder: Path | None) -> FitConfig | None:
    """Settings of the run that is continued, None where there is none yet."""
    if folder is None or not (folder / DESCRIPTION).is_file():
        return None
    return FitConfig.of(read_description(folder)["settings"], folder)


def _absolute(store: str | StorePath) -> StorePath:
    place = store_path(store)
    return place.absolute() if isinstance(place, Path) else place


def _same_place(store: str | StorePath | None, base: FitConfig) -> str:
    """The store as the settings have it: another path to the same folder is the same store."""
    if store is None or _absolute(store) == _absolute(base.store):
        return base.store
    return str(store)


def _check_uses(
    config: FitConfig,
    sizes: Mapping[str, object],
    training: Mapping[str, object],
    learned: Mapping[str, object],
) -> None:
    """Refuse what would be taken and then ignored."""
    from learn.networks.memory import FixedMemory

    for name in learned if config.labels.source == "truth" else ():
        if name != "source":
            raise InputError(
                f"--{name.replace('_', '-')} is about what a Doppler log measured, and this run "
                "learns from the truth: leave it out, or give --labels dvl"
            )
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
