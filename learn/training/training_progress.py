"""Progress: how far the networks of a training are, on the terminal and as TensorBoard events."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.cli.console import Console
from twin.errors import InputError

if TYPE_CHECKING:
    from learn.training.fit_config import FitConfig, TrainingJob
    from learn.training.trainer import TrainingReport
    from twin.cli.progress import Progress


class Watcher:
    """Progress of all networks of a run, and TensorBoard events when asked."""

    def __init__(self, console: Console, config: FitConfig, folder: Path, *, events: bool) -> None:
        self._progress: Progress = console.progress(
            total=len(config.jobs()), label="fit", unit="networks"
        )
        self._shares: dict[str, float] = {}
        """How far each network is, 0 to 1"""
        self._folder, self._events, self._prog = folder, events, console.prog
        self._writer: Any = None

    def __enter__(self) -> Watcher:
        self._progress.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._progress.__exit__(*error)  # type: ignore[arg-type]
        if self._writer is not None:
            self._writer.close()

    def say(self, text: str) -> None:
        """A note, a line of its own."""
        self._progress.note(text)

    def warn(self, text: str) -> None:
        """A warning, a line of its own."""
        self._progress.note(f"{self._prog}: warning: {text}")

    def see(self, job: TrainingJob, report: TrainingReport) -> None:
        """Show one validation."""
        known = report.validation_mse == report.validation_mse  # not NaN
        error = report.validation_mse if known else report.train_mse
        figures = {f"{job.name} MSE [(m/s)²]": error, "learning rate": report.rate}
        self._progress.update(report.share - self._shares.get(job.name, 0.0), **figures)
        self._shares[job.name] = report.share
        if self._events:
            # made late: a folder that is in the way of the run must not come from here
            self._writer = self._writer or event_writer_type()(str(self._folder / "events"))
            for name in ("train_mse", "validation_mse", "rate"):
                self._writer.add_scalar(f"{job.name}/{name}", getattr(report, name), report.step)
            self._writer.flush()  # the folder may be copied when the last network is trained


def event_writer_type() -> Any:
    """TensorBoard's writer, imported when it is wanted."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise InputError(
            "--tensorboard needs the package tensorboard: pip install tensorboard"
        ) from error
    return SummaryWriter
