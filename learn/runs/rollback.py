"""Rollback: a run's folder from the start of a fit until something is trained in it.

A start that fails or is interrupted leaves everything as it was: a new folder goes away again, and
a run that was to be replaced comes back. That run waits beside the new one under a name of its own,
so that a kill does not lose it either; the next fit of that name puts it back.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from types import TracebackType

CHECKPOINT = ".checkpoint"
"""Ending of the file from which a network's training goes on."""
WEIGHTS = ".safetensors"


def trained(folder: Path) -> bool:
    """Whether a folder holds anything that took training."""
    return any(any(folder.glob(f"*{ending}")) for ending in (CHECKPOINT, WEIGHTS))


def aside(folder: Path) -> Path:
    """Where a run waits while another one takes its place."""
    return folder.with_name(f".{folder.name}.replaced")


def recover(folder: Path) -> None:
    """Tidy up after a fit that was killed while it replaced a run."""
    old = aside(folder)
    if not old.is_dir():
        return
    if trained(folder):
        shutil.rmtree(old)
        return
    if folder.exists():
        shutil.rmtree(folder)
    old.rename(folder)


class Rollback:
    """A context in which a run is begun or continued.

    Args:
      new: the folder is made here, and an old run of its name makes room; else it is there already.
    """

    def __init__(self, folder: Path, *, new: bool) -> None:
        self.folder, self._new = folder, new
        self._given_up = False

    def __enter__(self) -> Rollback:
        if self._new:
            if self.folder.exists() and any(self.folder.iterdir()):
                self.folder.rename(aside(self.folder))
            self.folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is not None and self._new and not trained(self.folder):
            self._give_up()
        else:
            self.settle()

    def settle(self) -> None:
        """Let go of the old run once something of the new one is on the disk."""
        old = aside(self.folder)
        if self._new and old.is_dir() and trained(self.folder):
            shutil.rmtree(old)

    def _give_up(self) -> None:
        self._given_up = True
        shutil.rmtree(self.folder)
        if (old := aside(self.folder)).is_dir():
            old.rename(self.folder)

    def outcome(self) -> str:
        """What an interrupted fit leaves, in words."""
        if not self._given_up:
            return (
                f"what is trained so far is in {self.folder}; "
                f"`learn fit --name {self.folder.name} --resume` goes on from there"
            )
        if self.folder.exists():
            return f"nothing was trained yet, run {self.folder} is as it was"
        return "nothing was trained yet"
