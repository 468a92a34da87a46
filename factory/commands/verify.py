"""`factory verify`: every chunk of a store read and checked."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument
from twin.cli.text_table import counted
from twin.errors import InputError

if TYPE_CHECKING:
    from factory.store_check import StoreReport


@dataclass(frozen=True, kw_only=True)
class Verify(JsonOption):
    """Compare every file with its checksum and read every chunk; check metadata, padding, finite
    values and ranges; of simulated missions also parameters and kinematics, of logs the order of
    dives, fixes and depth.

    Example:

        factory verify data/missions.zarr
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store, or another folder that a command wrote: a run, a page, an export"""
    workers: int = 1
    """processes that read; every call reads all bytes again, since a changed disk does not change
    the size or the time of a file"""

    def run(self, console: Console) -> int:
        """Verify; exit code 1 when something is wrong."""
        if self.workers < 1:
            raise InputError(f"--workers {self.workers} must be at least 1")
        from factory.store_check import MAX_NAMED, StoreReport, check_files
        from twin.records.storage import LIST, files_at

        files = check_files(self.store, self.workers)
        plain = files_at(self.store).exists(LIST)
        ending = ""
        try:
            what, report = ("mission", StoreReport(0, 0, ())) if plain else self._read(console)
        except Exception:  # whatever damaged files make readers raise: the files are named
            if not files.problems:
                raise
            what, report = "mission", StoreReport(0, 0, ())
            ending = " read"
        report = dataclasses.replace(report, checks=(files, *report.checks))
        console.table(
            [{"check": c.name, "done": c.done, "problems": len(c.problems)} for c in report.checks]
        )
        for check in report.checks:
            said = check.alike()
            for problem in said[:MAX_NAMED]:
                console.say(f"{check.name}: {problem}")
            if len(said) > MAX_NAMED:
                console.say(f"{check.name}: {len(said) - MAX_NAMED} more kinds of problem")
        verdict = "sound" if report.ok else "NOT sound"
        count = counted(files.done, "file") if plain else counted(report.missions, what)
        console.say(f"{self.store} is {verdict}: {count}{ending}")
        console.answer(
            store=self.store,
            ok=report.ok,
            missions=report.missions,
            problems={check.name: check.problems for check in report.checks},
        )
        return 0 if report.ok else 1

    def _read(self, console: Console) -> tuple[str, StoreReport]:
        """What a mission is called, and what reading them shows."""
        from factory.generation import is_flight, open_missions
        from factory.soundness import verify_missions
        from factory.store_check import StoreReport
        from twin.records import LogStore, MissionStore

        with MissionStore(self.store) as reader:
            if is_flight(reader.attributes):
                return "mission", StoreReport(len(reader), 0, ())  # its files say all
        run = open_missions(self.store)
        what = "dive" if isinstance(run, LogStore) else "mission"
        with console.progress(total=len(run), label="verify", unit=what + "s") as progress:
            return what, verify_missions(run, progress.update, workers=self.workers)
