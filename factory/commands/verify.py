"""`factory verify`: every chunk of a store read and checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.cli.console import Console, JsonOption


@dataclass(frozen=True, kw_only=True)
class Verify(JsonOption):
    """Read every chunk; check metadata, padding, finite values and ranges; of simulated missions
    also parameters and kinematics, of logs the order of dives, fixes and depth.
    """

    store: Annotated[Path, tyro.conf.Positional]
    """the store"""

    def run(self, console: Console) -> int:
        """Verify; exit code 1 when something is wrong."""
        from factory.inspect.verify import MAX_NAMED, verify_store
        from factory.inspect.verify_logs import verify_logs
        from factory.stores.generated import open_missions
        from twin.records.logs import LogStore

        run = open_missions(self.store)
        what = "dives" if isinstance(run, LogStore) else "missions"
        with console.progress(total=len(run), label="verify", unit=what) as progress:
            if isinstance(run, LogStore):
                report = verify_logs(run, watch=progress.update)
            else:
                report = verify_store(run, watch=progress.update)
        console.table(
            [{"check": c.name, "done": c.done, "problems": len(c.problems)} for c in report.checks]
        )
        for check in report.checks:
            for problem in check.problems[:MAX_NAMED]:
                console.say(f"{check.name}: {problem}")
            if len(check.problems) > MAX_NAMED:
                console.say(f"{check.name}: {len(check.problems) - MAX_NAMED} more")
        verdict = "sound" if report.ok else "NOT sound"
        console.say(f"{self.store} is {verdict}: {report.missions} {what}")
        console.answer(
            store=self.store,
            ok=report.ok,
            missions=report.missions,
            problems={check.name: check.problems for check in report.checks},
        )
        return 0 if report.ok else 1
