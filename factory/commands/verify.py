"""`factory verify`: every chunk of a store read and checked, or missions of it flown again."""

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

    With --replay, missions of `factory generate` are flown again instead, from what the store
    holds, and every byte is compared.

    Examples:

        factory verify data/missions.zarr
        factory verify data/missions.zarr --replay 0 4
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store, or another folder that a command wrote: a run, a page, an export"""
    workers: int = 1
    """processes that read; every call reads all bytes again, since a changed disk does not change
    the size or the time of a file"""
    replay: tuple[int, ...] = ()
    """missions to fly again"""
    attempt: int | None = None
    """with --replay: fly this failed attempt at the mission instead, to see it fail"""

    def run(self, console: Console) -> int:
        """Verify; exit code 1 when something is wrong."""
        if self.workers < 1:
            raise InputError(f"--workers {self.workers} must be at least 1")
        if self.attempt is not None and not self.replay:
            raise InputError("--attempt is of a mission: give --replay MISSION too")
        if self.replay:
            return self._replay(console)
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

    def _replay(self, console: Console) -> int:
        """Fly missions again; exit code 1 when a byte differs."""
        from factory.generation import GeneratedStore
        from factory.soundness import replay_failure, replay_mission

        run = GeneratedStore(self.store)
        if self.attempt is not None:
            then, now = replay_failure(run, self.replay[0], self.attempt)
            console.say(f"then: {then}\nnow:  {now}")
            console.answer(then=then, now=now, identical=then == now)
            return 0 if then == now else 1
        results = [replay_mission(run, mission) for mission in self.replay]
        for other in results[0].other_versions:
            console.warn(f"the store was made with another version, bits may differ: {other}")
        for one in results:
            worst = sorted(one.different.items(), key=lambda item: -item[1])
            text = ", ".join(f"{name} (up to {gap:.3g})" for name, gap in worst)
            console.say(
                f"mission {one.mission}: identical, {one.signals} signals of {one.samples} "
                f"samples, {one.bytes_compared} bytes"
                if one.identical
                else f"mission {one.mission}: DIFFERENT in {len(worst)} signals: {text}"
            )
        identical = all(one.identical for one in results)
        missions = [
            {"mission": one.mission, "identical": one.identical, "different": one.different}
            for one in results
        ]
        console.answer(store=self.store, identical=identical, missions=missions)
        return 0 if identical else 1
