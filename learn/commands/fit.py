"""`learn fit`: train both networks, judge them, write a run with its page."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from learn import NETWORKS, OPTIMISERS
from learn.run import RUNS, checked_name, free_name
from learn.training import Shares, Watcher, event_writer_type
from twin.cli.console import Console, JsonOption
from twin.cli.durations import Seconds
from twin.cli.options import StoreArgument
from twin.cli.program import EXIT_OK
from twin.cli.text_table import counted
from twin.errors import InputError, unknown_name

if TYPE_CHECKING:
    from learn import FitConfig, Run
    from learn.folds import Unit
    from learn.training import Resources, TrainingJob, TrainingReport

CHOICES: Mapping[str, Mapping[str, object] | tuple[str, ...]] = {
    "network": NETWORKS,
    "inputs": ("full", "glider"),
    "optimiser": OPTIMISERS,
    "division": ("missions", "samples"),
    "device": ("auto", "cpu", "cuda"),
    "labels": ("truth", "dvl"),
    "smoothing": ("gaussian", "causal", "none"),
}
"""Options of few words. They are text for the parser, which would list None among the words."""


def _words(option: str) -> Any:
    """How the help shows an option of `CHOICES`."""
    return tyro.conf.arg(metavar="{" + ",".join(CHOICES[option]) + "}")


NETWORK, INPUTS, OPTIMISER, DIVISION, DEVICE, LABELS, SMOOTHING = map(_words, CHOICES)


@dataclass(frozen=True, kw_only=True)
class Fit(JsonOption):
    """Train surge and sway networks on a store, judge them by dead reckoning, write a report.

    Several stores, each of its own vehicle, train networks of a family of vehicles.

    Examples:

        learn fit --seconds 30 --name first
        learn fit real.zarr --inputs glider --members 5
        learn fit seawing.zarr slocum.zarr seaglider.zarr --without shift pump
    """

    # An option that is not given is None, so that a resumed run keeps its own.
    store: Annotated[tuple[StoreArgument, ...], tyro.conf.Positional] = ()
    """store of missions, or several [default: data/missions.zarr]"""
    name: str | None = None
    """name of the run, its folder in runs/ [default: date and number]"""
    network: Annotated[str | None, NETWORK] = None
    """kind of network [default: ema, the paper's is elman]"""
    hidden: int | None = None
    """units per hidden layer [default: 50]"""
    layers: int | None = None
    """hidden layers [default: 3]"""
    delays: int | None = None
    """elman: past outputs that a hidden layer is fed back [default: 5]"""
    memories: tuple[float, ...] | None = None
    """ema: seconds of its averages, rising [default: 2 8 30]"""
    inputs: Annotated[str | None, INPUTS] = None
    """full needs gyroscopes and accelerometers, glider is what every glider's log has
    [default: full]"""
    features: tuple[str, ...] = ()
    """features or groups instead of a set of --inputs, such as attitude depth_rate glide_speed"""
    without: tuple[str, ...] = ()
    """features, groups or sensors (imu, attitude, controls) that the vehicle lacks"""
    optimiser: Annotated[str | None, OPTIMISER] = None
    """soap or adam with a schedule, or scg, the paper's conjugate gradients [default: soap]"""
    seconds: Seconds | None = None
    """time in training of each network, such as 120 (seconds) or 10min, to which preparing
    and judging add (10 s of one member take some 36 s in all); two are trained side by side
    [default: 120]"""
    epochs: int | None = None
    """passes over the training missions instead of a time (scg: iterations); repeatable"""
    window: int | None = None
    """networks with trained memory: samples that a piece of a mission counts; longer ones teach a
    longer memory [default: 128]"""
    washin: int | None = None
    """samples before it in which the network finds its state [default: 48]"""
    seed: int | None = None
    """of initial weights and order; every network gets one of its own from it [default: 0]"""
    members: int | None = None
    """networks per velocity; with more than one their spread is an uncertainty [default: 2]"""
    division: Annotated[str | None, DIVISION] = None
    """missions: the store's split; samples: the paper's random 70/15/15, which leaks
    [default: missions]"""
    no_mirror: bool = False
    """do not show every mission mirrored too, port for starboard: for a lopsided vehicle"""
    labels: Annotated[str | None, LABELS] = None
    """what is learned: the truth of a simulated store, or what its Doppler log measured, cleaned
    [default: truth]"""
    known_current: str | None = None
    """--labels dvl: what is taken off bottom track. none: it is unknown, only water track is
    learned from; store: the store's current; or NORTH,EAST in m/s, 0,0 in still water
    [default: none]"""
    smoothing: Annotated[str | None, SMOOTHING] = None
    """--labels dvl: after outliers are removed; causal looks back only [default: gaussian]"""
    period: float | None = None
    """seconds between samples, a multiple of the store's: simulated missions as slow as a log"""
    start: Path | None = None
    """run whose networks the training starts from, with their inputs, scales and period:
    simulation then real"""
    leave_out_each_dive: bool = False
    """real logs: train once per dive with truth, without it, and judge it; then go on as usual"""
    leave_out_each_deployment: bool = False
    """the same per deployment, such as one run of a vehicle"""
    device: Annotated[str | None, DEVICE] = None
    """auto takes a GPU when there is one [default: cpu]"""
    workers: int | None = None
    """networks trained at a time, a process each [default: the CPUs that this process may use]"""
    scheduler: str | None = None
    """train on the workers of a dask scheduler instead, such as tcp://127.0.0.1:8786; they must
    reach runs/ and the store by the same paths (needs the extra cluster)"""
    memory: float | None = None
    """GB for the training data; a store that needs more is streamed, with the same result. With
    --scheduler it is for each network [default: half of the memory that is free]"""
    buffer: int | None = None
    """samples of the missions that are shuffled together [default: 1048576]"""
    seeds: int = 1
    """train so many runs that differ by their seed alone, for a table of what chance does"""
    ablation: bool = False
    """train again without IMU, attitude and controls, for a table in the report (takes longer)"""
    tensorboard: bool = False
    """write TensorBoard events into the run too (needs the package tensorboard)"""
    resume: bool = False
    """continue the run of this --name and its settings; start it if it is missing"""
    overwrite: bool = False
    """replace the run of this --name once the new one is trained; --overwrite --resume continues
    such a replacement"""

    def run(self, console: Console) -> int:
        """Train, judge, report."""
        from learn.api import train_and_finish
        from learn.run_folder import training_folder
        from learn.training import fit_settings

        if self.resume and self.name is None:
            raise InputError("--resume needs the --name of the run to continue")
        self._check_choices()
        folder = self._folder()
        options = {name: getattr(self, name) for name in SETTINGS} | {"store": self.store or None}
        place = training_folder(folder, replace=self.overwrite)
        config = fit_settings(
            resumed=place if self.resume else None, mirror=not self.no_mirror, **options
        )
        if self.tensorboard:
            event_writer_type()
        units = [unit for unit in UNITS if getattr(self, f"leave_out_each_{unit}")]
        if units:
            from learn.folds import folds_with_labels

            for unit in units:
                folds_with_labels(config, unit)
        if self.seeds < 1:
            raise InputError(f"--seeds {self.seeds} must be at least 1")
        with contextlib.ExitStack() as stack:
            executor = None
            if self.scheduler is not None:
                from factory.generation import dask_executor

                executor = stack.enter_context(dask_executor(self.scheduler))
            watcher = stack.enter_context(Watcher(console, config, place, events=self.tensorboard))

            def studies(run: Run, resources: Resources) -> None:
                watcher.close()
                for unit in units:
                    self._leave_out(console, run, config, unit, resources)
                if self.seeds > 1:
                    self._seeds(console, run, config, resources)
                if self.ablation:
                    self._ablate(console, run, config, resources)

            run = train_and_finish(
                config,
                folder,
                resume=self.resume,
                overwrite=self.overwrite,
                workers=self.workers,
                executor=executor,
                memory=self.memory,
                watch=watcher.see,
                studies=studies,
                warn=watcher.warn,
                say=watcher.say,
                history=shlex.join(["learn", *sys.argv[1:]]),
            )
        self._report(console, run)
        return EXIT_OK

    def _check_choices(self) -> None:
        for option, allowed in CHOICES.items():
            given = getattr(self, option)
            if given is None or given in allowed:
                continue
            if isinstance(allowed, tuple):
                raise InputError(unknown_name(f"word for --{option}", given, allowed))
            _ = allowed[given]  # says what there is

    def _folder(self) -> Path:
        return RUNS / (free_name() if self.name is None else checked_name(self.name))

    def _ablate(self, console: Console, run: Run, config: FitConfig, resources: Resources) -> None:
        from learn.repeated_fits import ablate, masked

        jobs = len(masked(config)) * len(config.jobs())
        with console.progress(total=jobs, label="ablation", unit="networks") as progress:
            shares = Shares(progress)

            def see(job: TrainingJob, report: TrainingReport) -> None:
                shares.reach((*job.config.features, job.name), report.share)

            ablate(run, config, resources, watch=see, say=progress.note)

    def _seeds(self, console: Console, run: Run, config: FitConfig, resources: Resources) -> None:
        from learn.repeated_fits import other_seeds, train_seeds

        jobs = len(other_seeds(config, self.seeds)) * len(config.jobs())
        with console.progress(total=jobs, label="seeds", unit="networks") as progress:
            shares = Shares(progress)

            def see(job: TrainingJob, report: TrainingReport) -> None:
                shares.reach((job.config.training.seed, job.name), report.share)

            found = train_seeds(run, config, self.seeds, resources, watch=see)
        console.answer(seeds=found.to_json())
        console.table(found.rows(), title="what chance does: runs of other seeds", digits=3)
        console.say()

    def _leave_out(
        self, console: Console, run: Run, config: FitConfig, unit: Unit, resources: Resources
    ) -> None:
        from learn.folds import folds_with_labels, leave_out_each

        folds = folds_with_labels(config, unit)
        jobs = len(folds) * len(config.jobs())
        with console.progress(total=jobs, label="leave one out", unit="networks") as progress:
            shares = Shares(progress)

            def see(job: TrainingJob, report: TrainingReport) -> None:
                shares.reach((job.config.held_out, job.name), report.share)

            found = leave_out_each(run, config, folds, resources, unit=unit, watch=see)
        console.answer(**{f"leave_out_each_{unit}": found.to_json()})
        console.table(
            found.rows(),
            title=f"each {unit} by networks that never saw it, RMSE in m/s",
            digits=3,
        )
        console.say(found.sentence())
        console.say()

    def _report(self, console: Console, run: Run) -> None:
        from learn.report import paper_sentence, summary_rows, verdicts

        figures, paper = run.figures, run.paper_figures
        assert figures is not None
        console.answer(
            **figures,
            report=run.report,
            settings=run.description["settings"],
            networks=run.description["networks"],
            label_counts=run.description.get("label_counts"),
        )
        console.table(
            summary_rows(figures),
            title=f"{counted(figures['missions'], figures['split'] + ' mission')} of "
            f"{figures['store']}: "
            "MSE in (m/s)², dead reckoning in % of the distance through the water",
            digits=3,
        )
        console.say()
        if paper is not None:
            console.answer(paper_test=paper)
            console.item(paper_sentence(paper))
        for sentence in (*run.label_sentences(), *verdicts(figures)):
            console.item(sentence)
        console.say()
        console.say(f"run:    {run.folder}")
        console.say(f"report: {run.report}")


UNITS: tuple[Unit, ...] = ("dive", "deployment")
"""What `--leave-out-each-...` leaves out."""
SETTINGS = (
    *(
        "store",
        "network",
        "hidden",
        "layers",
        "delays",
        "memories",
        "inputs",
        "features",
        "without",
    ),
    *("optimiser", "seconds", "epochs", "window", "washin", "buffer", "seed", "members"),
    "division",
    *("period", "start", "device", "labels", "known_current", "smoothing"),
)
"""Options that `learn.fit_settings` takes under the same name."""
