"""`learn fit`: train both networks, judge them, write a run with its page."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from learn.run import DEFAULT_STORE, DESCRIPTION, RUNS, free_name
from twin.console import Console, JsonOption
from twin.errors import InputError
from twin.program import EXIT_OK

if TYPE_CHECKING:
    from learn.fit import FitConfig, Job
    from learn.run import Run
    from learn.training import Report
    from twin.progress import Progress


@dataclass(frozen=True, kw_only=True)
class Fit(JsonOption):
    """Train surge and sway networks on a store, judge them by dead reckoning, write a report."""

    store: Annotated[Path, tyro.conf.Positional] = DEFAULT_STORE
    """store of missions"""
    name: str | None = None
    """name of the run, its folder in runs/ [default: date and number]"""
    kind: Literal["elman", "lstm", "gru", "tcn", "mlp"] | None = None
    """kind of network [default: elman, the paper's]"""
    hidden: int | None = None
    """units per hidden layer [default: 50]"""
    layers: int | None = None
    """hidden layers [default: 3]"""
    delays: int | None = None
    """elman: past outputs that a hidden layer is fed back [default: 5]"""
    inputs: Literal["full", "glider"] = "full"
    """full needs gyroscopes and accelerometers, glider is what every glider's log has"""
    features: tuple[str, ...] = ()
    """features or groups instead of a set of --inputs, such as attitude depth_rate glide_speed"""
    without: tuple[str, ...] = ()
    """features, groups or sensors (imu, attitude, controls) that the vehicle lacks"""
    optimiser: Literal["soap", "adam", "scg"] | None = None
    """soap or adam with a schedule, or scg, the paper's conjugate gradients [default: soap]"""
    seconds: float | None = None
    """time in training of each network; two are trained side by side [default: 120]"""
    epochs: int | None = None
    """passes over the training missions instead of a time (scg: iterations); repeatable"""
    window: int | None = None
    """samples that a piece of a mission counts; longer ones teach a longer memory [default: 128]"""
    washin: int | None = None
    """samples before it in which the network finds its state [default: 48]"""
    seed: int = 0
    """of initial weights and order; every network gets one of its own from it"""
    members: int = 2
    """networks per velocity; with more than one their spread is an uncertainty"""
    division: Literal["missions", "samples"] = "missions"
    """missions: the store's split; samples: the paper's random 70/15/15, which leaks"""
    no_mirror: bool = False
    """do not show every mission mirrored too, port for starboard: for a lopsided vehicle"""
    period: float | None = None
    """seconds between samples, a multiple of the store's: simulated missions as slow as a log"""
    start: Path | None = None
    """run whose networks the training goes on from, with their inputs, scales and period:
    simulation then real"""
    leave_out_each_dive: bool = False
    """real logs: train once per dive with truth, without it, and judge it; then go on as usual"""
    device: Literal["auto", "cpu", "cuda"] = "cpu"
    """auto takes a GPU when there is one"""
    workers: int | None = None
    """processes [default: the CPUs that this process may use]"""
    ablation: bool = False
    """train again without IMU, attitude and controls, for a table in the report (takes longer)"""
    tensorboard: bool = False
    """write TensorBoard events into the run too (needs the extra `tensorboard`)"""
    resume: bool = False
    """go on with the run of this --name; start it if there is none"""
    overwrite: bool = False
    """replace the run of this --name"""

    def run(self, console: Console) -> int:
        """Train, judge, report."""
        # must be said before numpy is imported: each network trains in one thread
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        from learn.fit import fit
        from learn.judge import finish

        if self.resume and self.name is None:
            raise InputError("--resume needs the --name of the run to go on with")
        config = self._config()
        folder = self._folder()
        workers = self.workers or len(os.sched_getaffinity(0))
        history = shlex.join(["learn", *sys.argv[1:]])
        try:
            with _Watcher(console, config, folder, events=self.tensorboard) as watcher:
                run = fit(
                    config,
                    folder,
                    resume=self.resume,
                    workers=workers,
                    watch=watcher.see,
                    history=history,
                )
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"what is trained so far is in {folder}; `learn fit --name {folder.name} --resume`"
                " with the same settings goes on from there"
            ) from None
        if self.leave_out_each_dive:
            self._leave_out(console, run, config, workers)
        if self.ablation:
            self._ablate(console, run, config, workers)
        run = finish(run, history=history, say=console.note)
        self._report(console, run)
        return EXIT_OK

    def _config(self) -> FitConfig:
        from learn.features import INPUT_SETS, select_features
        from learn.fit import FitConfig
        from learn.networks import NetworkConfig
        from learn.schedule import TrainingConfig

        chosen = {"kind": self.kind, "hidden": self.hidden, "layers": self.layers}
        chosen |= {"delays": self.delays}
        budget: dict[str, float | int | None] = {"seconds": self.seconds, "epochs": self.epochs}
        if self.epochs is not None and self.seconds is None:
            budget["seconds"] = 0.0
        features = select_features(self.features or INPUT_SETS[self.inputs], self.without)
        network = NetworkConfig(**{k: v for k, v in chosen.items() if v is not None})  # type: ignore[arg-type]
        period, start = self.period, None
        if self.start is not None:
            from learn.run import open_run

            if self.features or self.without or any(v is not None for v in chosen.values()):
                raise InputError(
                    "--start takes inputs and kind of network from the run: leave out --features, "
                    "--without, --kind, --hidden, --layers and --delays"
                )
            first = open_run(self.start)
            features, network = (
                first.features,
                NetworkConfig(**first.description["settings"]["network"]),
            )
            period, start = first.period, str(first.path)
            if self.period not in (None, period):
                raise InputError(
                    f"run {first.name} has a sample every {period:g} s: leave --period out"
                )
        settings = {"optimiser": self.optimiser, "seed": self.seed, "device": self.device, **budget}
        settings |= {"window": self.window, "washin": self.washin}
        return FitConfig(
            store=str(self.store),
            features=features,
            network=network,
            training=TrainingConfig(**{k: v for k, v in settings.items() if v is not None}),  # type: ignore[arg-type]
            members=self.members,
            division=self.division,
            mirror=not self.no_mirror,
            period=period,
            start=start,
        )

    def _folder(self) -> Path:
        name = self.name or free_name()
        if Path(name).name != name or name in (".", ".."):
            raise InputError(f"--name {name!r} must be a plain name: the run goes into {RUNS}/NAME")
        folder = RUNS / name
        if self.overwrite and folder.exists():
            if not (folder / DESCRIPTION).is_file():
                raise InputError(f"{folder} is in the way and is not a run; choose another --name")
            if not self.resume:
                shutil.rmtree(folder)
        return folder

    def _ablate(self, console: Console, run: Run, config: FitConfig, workers: int) -> None:
        from learn.ablation import ablate, masked

        jobs = len(masked(config)) * len(config.jobs())
        with console.progress(total=100.0 * jobs, label="ablation", unit="%") as progress:
            shares: dict[tuple[str, ...], float] = {}

            def see(job: Job, report: Report) -> None:
                key = (*job.config.features, job.name)
                progress.update(100.0 * (report.share - shares.get(key, 0.0)))
                shares[key] = report.share

            ablate(run, config, workers=workers, watch=see, say=progress.note)

    def _leave_out(self, console: Console, run: Run, config: FitConfig, workers: int) -> None:
        from learn.folds import dives_with_truth, leave_out_each

        dives = dives_with_truth(config)
        jobs = len(dives) * len(config.jobs())
        with console.progress(total=100.0 * jobs, label="leave one out", unit="%") as progress:
            shares: dict[tuple[tuple[int, ...], str], float] = {}

            def see(job: Job, report: Report) -> None:
                key = (job.config.held_out, job.name)
                progress.update(100.0 * (report.share - shares.get(key, 0.0)))
                shares[key] = report.share

            found = leave_out_each(run, config, dives, workers=workers, watch=see)
        console.answer(leave_out_each_dive=found.to_json())
        console.table(found.rows(), title="each dive by networks that never saw it", digits=3)
        console.say(found.sentence())
        console.say()

    def _report(self, console: Console, run: Run) -> None:
        from learn.report.tables import summary_rows, verdicts

        figures = run.evaluation()
        assert figures is not None
        console.answer(
            **figures,
            report=run.report,
            settings=run.description["settings"],
            networks=run.description["networks"],
        )
        console.table(
            summary_rows(figures),
            title=f"{figures['missions']} {figures['split']} missions of {figures['store']}: "
            "MSE in (m/s)^2, dead reckoning in % of the distance through the water",
            digits=3,
        )
        console.say()
        for sentence in verdicts(figures):
            console.say(f"- {sentence}")
        console.say()
        console.say(f"run:    {run.path}")
        console.say(f"report: {run.report}")


class _Watcher:
    """Progress of all networks of a run, and TensorBoard events when asked."""

    def __init__(self, console: Console, config: FitConfig, folder: Path, *, events: bool) -> None:
        self._progress: Progress = console.progress(
            total=100.0 * len(config.jobs()), label="fit", unit="%"
        )
        self._shares: dict[str, float] = {}
        self._writer = _event_writer(folder) if events else None

    def __enter__(self) -> _Watcher:
        self._progress.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._progress.__exit__(*error)  # type: ignore[arg-type]
        if self._writer is not None:
            self._writer.close()

    def see(self, job: Job, report: Report) -> None:
        """Show one validation."""
        done = 100.0 * (report.share - self._shares.get(job.name, 0.0))
        self._shares[job.name] = report.share
        known = report.validation_mse == report.validation_mse  # not NaN
        error = report.validation_mse if known else report.train_mse
        self._progress.update(done, **{f"{job.name} MSE": error, "rate": report.rate})
        if self._writer is not None:
            for name in ("train_mse", "validation_mse", "rate"):
                self._writer.add_scalar(f"{job.name}/{name}", getattr(report, name), report.step)


def _event_writer(folder: Path):  # type: ignore[no-untyped-def]
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise InputError(
            "--tensorboard needs the package tensorboard: pip install 'glider-twin[tensorboard]'"
        ) from error
    return SummaryWriter(str(folder / "events"))
