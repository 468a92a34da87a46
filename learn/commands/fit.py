"""`learn fit`: train networks for surge and sway, evaluate them, write a run with its page."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from learn.run import DEFAULT_STORE, RUNS, checked_name, free_name
from learn.training import CHOICES, FitSettings
from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument
from twin.cli.program import EXIT_OK
from twin.errors import InputError, unknown_name

if TYPE_CHECKING:
    from learn import FitConfig
    from learn.training import TrainingJob, TrainingReport


@dataclass(frozen=True, kw_only=True)
class Fit(FitSettings, JsonOption):
    """Train surge and sway networks on a store, evaluate dead reckoning, write a report.

    Several stores, one vehicle each, train networks for a family of vehicles.

    Examples:

        learn fit --seconds 30 --name first
        learn fit real.zarr --inputs glider --members 5
        learn fit seawing.zarr slocum.zarr seaglider.zarr --without shift pump
    """

    store: Annotated[tuple[StoreArgument, ...], tyro.conf.Positional] = ()
    """one or more stores of missions [default: data/missions.zarr]"""
    name: str | None = None
    """name of the run, its folder in runs/ [default: date and number]"""
    no_mirror: bool = False
    """leave out the mirror image of each mission, port for starboard: for an asymmetric vehicle"""
    workers: int | None = None
    """number of processes, one network each [default: the CPUs that this process may use]"""
    scheduler: str | None = None
    """train on the workers of a dask scheduler instead, such as tcp://127.0.0.1:8786; they must
    reach runs/ and the store by the same paths (needs the extra cluster)"""
    memory: float | None = None
    """GB for the training data, with --scheduler per network; a larger store is streamed, with the
    same result [default: half of the free memory]"""
    no_report: bool = False
    """only train: `learn report` evaluates the networks and writes the page later"""
    tensorboard: bool = False
    """also write TensorBoard events into the run (needs the package tensorboard)"""
    scratch: bool = False
    """start from random weights, not from the shipped networks that suit the store"""
    resume: bool = False
    """continue the run of this --name with its own settings; start it if it is missing"""
    overwrite: bool = False
    """replace the run of this --name once the new one is trained; --overwrite --resume continues
    an interrupted replacement"""

    def run(self, console: Console) -> int:
        """Train, evaluate, write the report."""
        shipped, told = None, ""
        if not self.resume:
            shipped, told = _start(self.store or (str(DEFAULT_STORE),), self)
        from learn.finishing import check_finish, finish
        from learn.report import tell_report
        from learn.run_folder import training_folder
        from learn.training import fit, fit_settings, training_resources

        if self.resume and self.name is None:
            raise InputError("--resume needs the --name of the run to continue")
        self._check_choices()
        folder = self._folder()
        settings = {one.name: getattr(self, one.name) for one in fields(FitSettings)}
        place = training_folder(folder, replace=self.overwrite)
        config = fit_settings(
            self.store or None,
            resumed=place if self.resume else None,
            **settings | {"mirror": not self.no_mirror, "start": self.start or shipped},
        )
        if not (config.mirror or self.no_mirror or self.resume):
            lone = "missions are not mirrored: parts such as thrusters have no image of their own"
            told = "; ".join(filter(None, (told, lone)))
        if self.tensorboard:
            event_writer_type()
        if not self.no_report:
            for store in config.stores:
                check_finish(store)
        history = shlex.join(["learn", *sys.argv[1:]])
        with contextlib.ExitStack() as stack:
            executor = None
            if self.scheduler is not None:
                from factory.generation import dask_executor

                executor = stack.enter_context(dask_executor(self.scheduler))
            watcher = stack.enter_context(Watcher(console, config, place, events=self.tensorboard))
            resources = stack.enter_context(training_resources(self.workers, executor, self.memory))
            watcher.first = told
            run = fit(
                config, folder, resources, resume=self.resume, replace=self.overwrite,
                watch=watcher.see, warn=watcher.warn, say=watcher.say, history=history,
            )  # fmt: skip
        if self.no_report:
            found = {name: run.description[name] for name in ("settings", "networks")}
            console.answer(run=run.folder, **found)
            console.say(f"run:    {run.folder}")
        else:
            tell_report(console, finish(run, history=history, say=console.note))
        return EXIT_OK

    def _check_choices(self) -> None:
        for option, allowed in CHOICES.items():
            given = getattr(self, option)
            if given is None or given in allowed:
                continue
            if isinstance(allowed, tuple):
                raise InputError(unknown_name(f"word for --{option}", given, allowed))
            _ = allowed[given]  # an extension point, whose error lists the known names

    def _folder(self) -> Path:
        return RUNS / (free_name() if self.name is None else checked_name(self.name))


WITH_START = ("network", "hidden", "layers", "delays", "memories", "inputs", "features", "without",
              "labels", "division")  # fmt: skip
"""Options that a start from shipped networks leaves no choice of"""


def _start(stores: Sequence[StoreArgument | str], options: Fit) -> tuple[Path | None, str]:
    """Open each store and choose the shipped networks to start from, before torch is imported.

    Returns:
      Folder of the shipped networks, and a sentence on them. None if the training starts from
      random weights: asked for, with options that need it, for logs, or if none suit the vehicle
      and its channels.
    """
    from learn.shipped import shipped_run
    from twin.records import MissionStore

    found: set[Path] = set()
    chosen = any(getattr(options, name) for name in WITH_START) or options.start is not None
    told = ""
    for store in stores:
        with MissionStore(store) as reader:
            if options.scratch or chosen or reader.logged:
                continue
            channels = set(map(str, reader.dataset.data_vars))
            try:
                run, absent = shipped_run(reader.vehicle, options.period or reader.period, channels)
            except InputError as error:
                told = f"starting from random weights: {error}"
                continue
            if absent:
                told = (
                    f"starting from random weights: store {store} has no {absent[0]}, which the "
                    "shipped networks read"
                )
                continue
            found.add(run.folder)
    if told or len(found) != 1:
        return None, told
    (folder,) = found
    return folder, f"starting from the shipped networks of {folder.name} (--scratch does not)"


class Watcher:
    """Show the training progress of a run's networks, and write TensorBoard events if asked."""

    def __init__(self, console: Console, config: FitConfig, folder: Path, *, events: bool) -> None:
        self._progress = console.progress(total=len(config.jobs()), label="fit", unit="networks")
        self._shares: dict[str, float] = {}
        """Progress of each network, 0 to 1"""
        self._folder, self._events, self._prog = folder, events, console.prog
        self._writer: Any = None
        self.first = ""
        """Note for the time when all checks are passed"""

    def __enter__(self) -> Watcher:
        self._progress.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._progress.__exit__(*error)  # type: ignore[arg-type]
        if self._writer is not None:
            self._writer.close()

    def say(self, text: str) -> None:
        """Print a note on its own line, after the note `first`."""
        if self.first:
            self._progress.note(self.first)
            self.first = ""
        self._progress.note(text)

    def warn(self, text: str) -> None:
        """Print a warning on its own line."""
        self._progress.note(f"{self._prog}: warning: {text}")

    def see(self, job: TrainingJob, report: TrainingReport) -> None:
        """Show one validation."""
        known = report.validation_mse == report.validation_mse  # not NaN
        error = report.validation_mse if known else report.train_mse
        figures = {f"{job.name} MSE [(m/s)²]": error, "learning rate": report.rate}
        self._progress.update(report.share - self._shares.get(job.name, 0.0), **figures)
        self._shares[job.name] = report.share
        if self._events:
            # created late: an early events folder would count as an existing run folder
            self._writer = self._writer or event_writer_type()(str(self._folder / "events"))
            for name in ("train_mse", "validation_mse", "rate"):
                self._writer.add_scalar(f"{job.name}/{name}", getattr(report, name), report.step)
            self._writer.flush()  # a replacement copies the folder after the last network


def event_writer_type() -> Any:
    """Import TensorBoard's event writer."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise InputError(
            "--tensorboard needs the package tensorboard: pip install tensorboard"
        ) from error
    return SummaryWriter
