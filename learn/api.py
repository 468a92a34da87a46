"""The functions of `import learn`: train, evaluate and export in a few lines.

They return values and print nothing. The command line calls the same functions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learn.data.labels import LabelConfig
from learn.data.parts import input_groups, parts_of
from learn.data.store_checks import check_window
from learn.networks.config import NetworkConfig
from learn.networks.registry import NETWORKS
from learn.report.contents import RunEvaluation
from learn.runs.place import training_folder
from learn.runs.run import (
    DEFAULT_STORE,
    DESCRIPTION,
    RUNS,
    Run,
    free_name,
    open_run,
    read_description,
)
from learn.studies.finishing import Say, finish
from learn.studies.run_evaluation import evaluate_run
from learn.training import fitting
from learn.training.fitting import Watch
from learn.training.optimisers.registry import OPTIMISERS
from learn.training.resources import Resources, training_resources
from learn.training.schedule import TrainingConfig
from learn.training.settings import FitConfig
from twin.arguments import argument_names, check_names, explained
from twin.errors import InputError, unknown_name
from twin.extras import require
from twin.navigation.features import INPUT_SETS, select_features
from twin.records.store_path import StorePath, store_path

if TYPE_CHECKING:
    from learn.evaluation.evaluation import Watch as EvaluationWatch
    from learn.networks.parity import Parity

DEFAULT_MEMBERS = 2
DEFAULT_INPUTS = "full"


def fit(
    store: str | StorePath | None = None,
    *,
    folder: str | Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
    workers: int | None = None,
    executor: Executor | None = None,
    memory: float | None = None,
    watch: Watch | None = None,
    say: Say = lambda _: None,
    history: str = "",
    **settings: Any,
) -> Run:
    """Train networks for surge and sway on a store, evaluate them and write a report.

    Args:
      store: of missions or of logs; None is data/missions.zarr, or the run's own with `resume`.
      folder: of the run; None is a new one in runs/, named by date and number.
      resume: continue the run in `folder` with its own settings; start it if there is none.
      overwrite: replace the run in `folder`, which is kept until the new one is trained; with
        `resume` such a replacement is continued.
      workers: processes; None or 1 trains in this one, more need the script's main part behind
        `if __name__ == "__main__"`.
      executor: trains instead of such processes: any of `concurrent.futures`, that of a dask
        client too. It must reach `folder` and `store` by the same paths.
      memory: [GB] for the training data, see `learn.training.resources`; a store that needs more
        is streamed, with the same result.
      watch: called as watch(job, report) at every validation of every network.
      say: told warnings, and what is being done after the training.
      history: a line for the record, such as the command.
      settings: as of `fit_settings`, which names and explains them.

    Returns:
      The run, with `folder`, `figures` and `predict`.

    Raises:
      InputError: a setting is wrong, or the folder holds another run.
      StoreError: the store cannot be used.
    """
    check_names(settings, argument_names(fit, fit_settings), "learn.fit")
    path = RUNS / free_name() if folder is None else Path(folder)
    place = training_folder(path, replace=overwrite)
    read = explained(fit_settings, "fit", "learn")
    config = read(store, resumed=place if resume else None, **settings)
    return train_and_finish(
        config,
        path,
        resume=resume,
        overwrite=overwrite,
        workers=1 if workers is None and executor is None else workers,
        executor=executor,
        memory=memory,
        watch=watch,
        warn=say,
        say=say,
        history=history,
    )


def train_and_finish(
    config: FitConfig,
    folder: Path,
    *,
    resume: bool = False,
    overwrite: bool = False,
    workers: int | None = None,
    executor: Executor | None = None,
    memory: float | None = None,
    watch: Watch | None = None,
    studies: Callable[[Run, Resources], None] = lambda *_: None,
    warn: Say = lambda _: None,
    say: Say = lambda _: None,
    history: str = "",
) -> Run:
    """As `fit`, with all settings decided.

    Args:
      workers: None is as many as this process may use CPUs.
      studies: called with the trained run, and what trains more, before it is evaluated; what it
        writes into the run's folder, such as an ablation, goes into the report.
    """
    with training_resources(workers, executor, memory) as resources:
        run = fitting.fit(
            config, folder, resources, resume=resume, replace=overwrite, watch=watch, warn=warn,
            say=say, history=history,
        )  # fmt: skip
        studies(run, resources)
    return finish(run, history=history, say=say)


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


def evaluate(
    run: Run | str | Path,
    store: str | StorePath | None = None,
    *,
    split: str = "test",
    baselines: Sequence[str] | None = None,
    watches: Sequence[EvaluationWatch] = (),
) -> RunEvaluation:
    """A run on the missions of a store, beside the floor and the baselines.

    Args:
      run: as `fit` or `open_run` give it, or its folder or name.
      store: of missions or logs; None is the run's own.
      split: test, train, validation or all.
      baselines: names of `learn.BASELINES`; None runs all, an empty sequence none.
      watches: called with every mission and all estimates of it.

    Returns:
      The evaluation; its `figures` are errors in m/s and in % of the path, by name.

    Raises:
      InputError: no such run or baseline.
      StoreError: a file of the run or of the store cannot be used.
    """
    found = run if isinstance(run, Run) else open_run(run)
    place = found.store if store is None else store
    return evaluate_run(found, place, split=split, baselines=baselines, watches=watches)


EXPORTS = ("onnx", "c")
"""What `export` writes."""


def export(
    run: Run | str | Path,
    folder: str | Path | None = None,
    *,
    to: str = "onnx",
    store: str | StorePath | None = None,
) -> dict[str, Parity]:
    """Write a run for on-board use, and check it over a mission.

    Args:
      run: as `fit` or `open_run` give it, or its folder or name.
      folder: for the files; None is onnx/ or c/ in the run's folder.
      to: `onnx`, one model per network, one time step with explicit state; or `c`, one C99 header
        from sensor samples to surge and sway, features included.
      store: of the mission that is run through network and file; None is the run's own. Its
        longest mission is taken.

    Returns:
      By the name of the network, such as surge-0, or `velocity` for C, the file and how far it is
      from the network.

    Raises:
      InputError: the extra onnx is not installed; torch cannot export the network; or there is no
        C compiler, or no C code of the network or of a feature.
      StoreError: a file differs by more than 1e-5 m/s, or cannot be read or written.
    """
    if to not in EXPORTS:
        raise InputError(unknown_name("export", to, EXPORTS))
    for package in ("onnx", "onnxscript", "onnxruntime") if to == "onnx" else ():
        require(package, extra="onnx", purpose="learn export")
    from learn.data.dataset import Selection
    from twin.navigation.features import channels_of

    found = run if isinstance(run, Run) else open_run(run)
    target = found.folder / to if folder is None else Path(folder)
    networks = found.networks()
    channels = [c for e in networks.values() for c in channels_of(e.members[0].features)]
    place = found.store if store is None else store
    with Selection(place, channels, period=found.period) as selection:
        (longest,) = selection.read([int(selection.lengths.argmax())])
        vehicle = selection.vehicle
    if to == "c":
        from learn.networks.c_export import NAME, export_c

        return {"velocity": export_c(networks, target / NAME, longest, vehicle)}
    from learn.networks.onnx_export import export_step

    return {
        f"{name}-{k}": export_step(member, target / f"{name}-{k}.onnx", longest)
        for name, ensemble in networks.items()
        for k, member in enumerate(ensemble.members)
    }
