"""Run folder: the folder in which a run is trained, its lock, and the replacement of an old run.

A run that replaces an old one is trained in `.NAME.fitting/NAME`, next to the old run. When all
networks are trained, the new run replaces the old one in one step. A training that ends before its
first checkpoint leaves no files.
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
"""Ending of the file from which a network's training resumes."""
WEIGHTS = ".safetensors"


def training_folder(folder: Path, *, replace: bool) -> Path:
    """Folder in which this run is trained; raises InputError if `folder` is a URL."""
    check_addresses(folder)
    return _outer(folder) / folder.name if replace else folder


def resume_command(folder: Path) -> str:
    """Command that resumes a training.

    Args:
      folder: folder in which the run is trained.
    """
    replaces = " --overwrite" if folder.parent == _outer(folder.parent.parent / folder.name) else ""
    return f"`learn fit --name {quoted(folder.name)}{replaces} --resume`"


def is_run(folder: Path) -> bool:
    """True if a folder holds a finished or unfinished run."""
    return (folder / DESCRIPTION).is_file()


def _outer(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.fitting")


class RunFolder:
    """Context manager that locks and prepares the folder in which a run is trained.

    Args:
      target: folder of the finished run.
      replace: replace an old run in `target`, if there is one.
      fresh: with `replace`, delete what an earlier training left in `folder`.

    Raises:
      InputError: another process trains in this folder.
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
        # checksums of an earlier complete run: the training changes the files
        (self.folder / LIST).unlink(missing_ok=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None and self.fresh and not self.trained:
            self._remove()
        os.close(self._lock)

    @property
    def trained(self) -> bool:
        """True if the folder holds a checkpoint or trained weights."""
        return any(any(self.folder.glob(f"*{ending}")) for ending in (CHECKPOINT, WEIGHTS))

    def complete(self) -> None:
        """Move the trained run to `target`; returns when all files are on the disk.

        Raises:
          WriteError, OSError: the disk refuses; the trained run stays in `folder`.
        """
        if not self._replace:
            sync_tree(self.folder)
            return
        # copied, not moved: if this command is killed now, the next one can repeat this step
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
        """Sentence on the files that an interrupted training leaves."""
        if self.trained:
            return (
                f"what is trained so far is in {self.folder}; {resume_command(self.folder)} goes "
                "on from there"
            )
        was = f", run {self.target} is as it was" if self.target.exists() else ""
        return f"nothing was trained yet{was}"
