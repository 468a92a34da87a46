"""`factory info`: what a store holds, complete or not."""

from __future__ import annotations

import datetime
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument

if TYPE_CHECKING:
    from factory.generation import GeneratedStore
    from twin.records import LogStore


@dataclass(frozen=True, kw_only=True)
class Info(JsonOption):
    """Preset, missions, splits, size, drawn values and failures of a store.

    Example:

        factory info data/missions.zarr
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""

    def run(self, console: Console) -> int:
        """Print what the store holds."""
        from factory.generation import open_missions, unfinished
        from twin.errors import StoreError
        from twin.records import LogStore
        from twin.records.storage import files_at

        begun = unfinished(self.store)
        if begun is not None:
            kept, settings = begun.missions_kept, begun.settings
            console.pairs(
                {
                    "store": f"{self.store} (incomplete)",
                    "preset": settings["preset"],
                    "seed": settings["seed"],
                    "hours wanted": settings["hours"],
                    "missions kept": kept,
                    "to complete it": "the same `factory generate` command with --resume",
                }
            )
            console.answer(store=self.store, complete=False, settings=settings, missions_kept=kept)
            return 0
        run = open_missions(self.store)
        run.check_arrays()
        try:
            size = files_at(self.store).stored_bytes()
        except OSError as error:
            raise StoreError(f"cannot read {self.store}: {error.strerror or error}") from error
        if isinstance(run, LogStore):
            self._logs(run, size, console)
        else:
            self._missions(run, size, console)
        return 0

    def _missions(self, run: GeneratedStore, size: int, console: Console) -> None:
        """A store of simulated missions."""
        settings, splits, drawn = run.settings, split_rows(run), drawn_rows(run)
        console.pairs(
            {
                "store": str(self.store),
                "preset": settings["preset"],
                "seed": run.seed,
                "vehicle": settings["vehicle"],
                "sensors": run.sensor_preset,
                "missions": len(run),
                "simulated": f"{run.hours:.4g} h every {run.period:g} s",
                **({"engine": engine} if (engine := settings.get("engine")) else {}),
                "physics": f"{settings['integrator']}, steps of {settings['timestep_s']:g} s, "
                f"{settings['hydrodynamics']}",
                "signals": len(run.signals()),
                "size": f"{size / 1e6:.1f} MB, {size / 1e6 / run.hours:.2f} MB/h",
                "made with": ", ".join(f"{name} {v}" for name, v in settings["versions"].items()),
                "history": run.history,
            }
        )
        console.table(splits, title="\nsplits")
        for title, key in (("drawn numbers", "n"), ("drawn words", "drawn")):
            if rows := [row for row in drawn if key in row]:
                console.table(rows, title=f"\n{title}")
        failures = [
            {"mission": f.mission, "attempt": f.attempt, "time [s]": f.time_s, "reason": f.reason}
            for f in run.failures()
        ]
        if failures:
            console.table(failures, title="\nfailed and replaced")
        console.answer(
            store=self.store,
            complete=True,
            missions=len(run),
            hours=run.hours,
            bytes=size,
            settings=settings,
            splits=splits,
            drawn=drawn,
            signals=run.signals(),
            failures=[
                {name: one[name] for name in ("mission", "attempt", "reason")} for one in failures
            ],
        )

    def _logs(self, logs: LogStore, size: int, console: Console) -> None:
        """A store of real logs: what was imported, and the report of it."""
        report, deployments = logs.report, deployment_rows(logs)
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
        console.table(deployments, title="\ndeployments")
        entries = [
            {"what": e["action"], "of": e["subject"], "count": e["count"], "why": e["detail"]}
            for e in report["entries"]
        ]
        console.table(entries, title="\nwhat was done to the logs")
        console.answer(
            store=self.store, complete=True, bytes=size, report=report, deployments=deployments
        )


def drawn_rows(run: GeneratedStore) -> list[dict[str, object]]:
    """One row for each drawn parameter: its distribution beside what was drawn."""
    import numpy as np

    rows: list[dict[str, object]] = []
    for name, parameter in run.table.items():
        if parameter.variable not in run:
            continue
        values = run.array(parameter.variable).ravel()
        meanings = run.flags(parameter.variable)
        row: dict[str, object] = {"parameter": name, "unit": parameter.unit}
        row["distribution"] = run.distributions[name].text()
        if meanings:
            counts = Counter(meanings[int(value)] for value in values if value >= 0)
            row["drawn"] = ", ".join(
                f"{counts[word]} {word}" for word in meanings.values() if counts[word]
            )
        else:
            finite = values[np.isfinite(values)]
            row |= {
                "n": int(finite.size),
                "least": float(finite.min()),
                "mean": float(finite.mean()),
                "most": float(finite.max()),
            }
        rows.append(row)
    return rows


def split_rows(run: GeneratedStore) -> list[dict[str, object]]:
    """Missions and hours of each split."""
    from twin.records import SPLITS

    hours = run.array("duration") / 3600.0
    return [
        {
            "split": split,
            "missions": run.splits.count(split),
            "hours": float(sum(h for h, s in zip(hours, run.splits, strict=True) if s == split)),
        }
        for split in SPLITS
        if split in run.splits
    ]


def deployment_rows(logs: LogStore) -> list[dict[str, object]]:
    """Dives, time, place and depth of each deployment."""
    import numpy as np

    from twin.records import SPLITS

    rows: list[dict[str, object]] = []
    for deployment in dict.fromkeys(logs.deployments):
        missions = logs.missions_of(deployment)
        first, last = missions[0], missions[-1]
        begin, end = (
            datetime.datetime.fromtimestamp(float(unix), datetime.UTC)
            for unix in (logs.starts[first], logs.time(last)[-1])
        )
        depths = np.concatenate([logs.signal("measured_depth", k) for k in missions])
        deepest = float(np.nanmax(depths)) if np.isfinite(depths).any() else None
        fixed = [logs.fixes(k)[0] for k in missions if np.isfinite(logs.fixes(k)[0]).all()]
        splits = [logs.splits[k] for k in missions]
        rows.append(
            {
                "deployment": deployment,
                "dives": len(missions),
                "from [UTC]": f"{begin:%Y-%m-%d %H:%M}",
                "to [UTC]": f"{end:%Y-%m-%d %H:%M}",
                "latitude": f"{np.mean([fix[0] for fix in fixed]):.3f}" if fixed else None,
                "longitude": f"{np.mean([fix[1] for fix in fixed]):.3f}" if fixed else None,
                "deepest [m]": deepest,
                " / ".join(SPLITS): "/".join(str(splits.count(name)) for name in SPLITS),
            }
        )
    return rows
