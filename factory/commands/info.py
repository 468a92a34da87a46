"""`factory info`: what a store holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from twin.records import LogStore

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument


@dataclass(frozen=True, kw_only=True)
class Info(JsonOption):
    """Preset, missions, splits, size, drawn values and failures of a store.

    Example:

        factory info data/missions.zarr
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""

    def _logs(self, logs: LogStore, console: Console) -> int:
        """A store of real logs: what was imported, and the report of it."""
        from factory.description import deployment_rows, stored_bytes

        report = logs.report
        size = stored_bytes(self.store)
        console.pairs(
            {
                "store": str(self.store),
                "logs": f"{report['kind']}: {', '.join(report['deployments'])}",
                "platform": logs.platform,
                "rows": f"{report['rows']}, {report['rows_with_fixes']} from GPS fix to GPS fix",
                "time": f"{report['hours']:.4g} h every {report['period']:g} s",
                "signals": len(report["channels"]),
                "size": f"{size / 1e6:.1f} MB",
                "history": logs.history,
            }
        )
        console.table(deployment_rows(logs), title="\ndeployments")
        entries = [
            {"what": e["action"], "of": e["subject"], "count": e["count"], "why": e["detail"]}
            for e in report["entries"]
        ]
        console.table(entries, title="\nwhat was done to the logs")
        console.answer(
            store=self.store, complete=True, bytes=size, report=report,
            deployments=deployment_rows(logs),
        )  # fmt: skip
        return 0

    def run(self, console: Console) -> int:
        """Print what the store holds."""
        from factory.description import drawn_rows, split_rows, stored_bytes, unfinished
        from factory.generation import open_missions
        from twin.records import LogStore

        begun = unfinished(self.store)
        if begun is not None:
            console.pairs(
                {
                    "store": f"{self.store} (incomplete)",
                    "preset": begun.settings["preset"],
                    "seed": begun.settings["seed"],
                    "hours wanted": begun.settings["hours"],
                    "missions kept": begun.missions_kept,
                    "to complete it": "the same `factory generate` command with --resume",
                }
            )
            console.answer(
                store=self.store,
                complete=False,
                settings=begun.settings,
                missions_kept=begun.missions_kept,
            )
            return 0
        run = open_missions(self.store)
        run.check_arrays()
        if isinstance(run, LogStore):
            return self._logs(run, console)
        size, splits, drawn = stored_bytes(self.store), split_rows(run), drawn_rows(run)
        versions = ", ".join(f"{name} {v}" for name, v in run.settings["versions"].items())
        console.pairs(
            {
                "store": str(self.store),
                "preset": run.settings["preset"],
                "seed": run.seed,
                "vehicle": run.settings["vehicle"],
                "sensors": run.sensor_preset,
                "missions": len(run),
                "simulated": f"{run.hours:.4g} h every {run.period:g} s",
                **({"engine": engine} if (engine := run.settings.get("engine")) else {}),
                "physics": f"{run.settings['integrator']}, steps of "
                f"{run.settings['timestep_s']:g} s, {run.settings['hydrodynamics']}",
                "signals": len(run.signals()),
                "size": f"{size / 1e6:.1f} MB, {size / 1e6 / run.hours:.2f} MB/h",
                "made with": versions,
                "history": run.history,
            }
        )
        console.table(splits, title="\nsplits")
        for title, key in (("drawn numbers", "n"), ("drawn words", "drawn")):
            rows = [row for row in drawn if key in row]
            if rows:
                console.table(rows, title=f"\n{title}")
        failures = run.failures()
        if failures:
            rows = [
                {
                    "mission": f.mission,
                    "attempt": f.attempt,
                    "time [s]": f.time_s,
                    "reason": f.reason,
                }
                for f in failures
            ]
            console.table(rows, title="\nfailed and replaced")
        console.answer(
            store=self.store,
            complete=True,
            missions=len(run),
            hours=run.hours,
            bytes=size,
            settings=run.settings,
            splits=splits,
            drawn=drawn,
            signals=run.signals(),
            failures=[
                {"mission": f.mission, "attempt": f.attempt, "reason": f.reason} for f in failures
            ],
        )
        return 0
