"""Place: where a run is trained: under its name, or beside the run that it is to replace.

A run that replaces another one is trained in `.NAME.fitting/NAME` beside it. It takes that place in
one step when all its networks are trained; until then the old run is as it was. A start that ends
before anything is trained leaves nothing.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

from learn.run import DESCRIPTION
from twin.errors import InputError, quoted
from twin.records.storage.checksums import LIST
from twin.records.storage.disk import lock, sync_tree
from twin.records.storage.store_path import check_addresses
from twin.records.storage.whole import whole_folder

CHECKPOINT = ".checkpoint"
"""Ending of the file from which a network's training goes on."""
WEIGHTS = ".safetensors"


def training_folder(folder: Path, *, replace: bool) -> Path:
    """Where the run of this folder is trained; raises InputError where it is an address."""
    check_addresses(folder)
    return _outer(folder) / folder.name if replace else folder


def resume_command(folder: Path) -> str:
    """What goes on with a training.

    Args:
      folder: where it is trained.
    """
    replaces = " --overwrite" if folder.parent == _outer(folder.parent.parent / folder.name) else ""
    return f"`learn fit --name {quoted(folder.name)}{replaces} --resume`"


def is_run(folder: Path) -> bool:
    """Whether a folder holds a run, finished or not."""
    return (folder / DESCRIPTION).is_file()


def _outer(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.fitting")


class RunFolder:
    """A context in which a run is trained; `folder` is where.

    Args:
      target: folder of the run when it is complete.
      replace: an old run may be there.
      fresh: forget what an earlier training left in `folder`.

    Raises:
      InputError: another process trains there.
    """

    def __init__(self, target: Path, *, replace: bool, fresh: bool) -> None:
        self.target, self.folder = target, training_folder(target, replace=replace)
        self._replace, self.fresh = replace, fresh
        self._lock = -1

    def __enter__(self) -> RunFolder:
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = os.open(self.folder, os.O_RDONLY | os.O_DIRECTORY)
        if not lock(self._lock):
            os.close(self._lock)
            raise InputError(
                f"another `learn fit` trains run {self.target} at this moment: wait for it, or "
                "choose another --name"
            )
        if self.fresh and self._replace:
            for path in self.folder.iterdir():
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        # the list of a run that was complete: what follows changes files
        (self.folder / LIST).unlink(missing_ok=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None and self.fresh and not self.trained:
            self._remove()
        os.close(self._lock)

    @property
    def trained(self) -> bool:
        """Whether it holds anything that took training."""
        return any(any(self.folder.glob(f"*{ending}")) for ending in (CHECKPOINT, WEIGHTS))

    def complete(self) -> None:
        """Give the trained run its name; returns when it is on the disk.

        Raises:
          WriteError, OSError: the disk refuses; what is trained stays in `folder`.
        """
        if not self._replace:
            sync_tree(self.folder)
            return
        # a copy: whatever ends this command now, the next one can do it again
        with whole_folder(self.target, overwrite=True, ours=is_run) as whole:
            shutil.copytree(self.folder, whole, dirs_exist_ok=True)
        self._remove()

    def _remove(self) -> None:
        with contextlib.suppress(OSError):  # first: a kill leaves nothing that looks like a run
            (self.folder / DESCRIPTION).unlink()
        shutil.rmtree(self.folder, ignore_errors=True)
        if self._replace:
            with contextlib.suppress(OSError):
                self.folder.parent.rmdir()

    def outcome(self) -> str:
        """What an interrupted training leaves, in words."""
        if self.trained:
            return (
                f"what is trained so far is in {self.folder}; {resume_command(self.folder)} goes "
                "on from there"
            )
        was = f", run {self.target} is as it was" if self.target.exists() else ""
        return f"nothing was trained yet{was}"
