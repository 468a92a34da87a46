"""Commands `factory info`, `verify`, `plot`: describe, check and plot a store."""

from __future__ import annotations

import dataclasses
import datetime
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument
from twin.cli.text_table import counted
from twin.errors import InputError, StoreError

if TYPE_CHECKING:
    from factory.generation import GeneratedStore
    from factory.store_check import StoreReport
    from twin.records import LogStore

FORMATS = (".png", ".pdf", ".svg")
"""Allowed endings of a page's file"""


@dataclass(frozen=True, kw_only=True)
class Info(JsonOption):
    """Show preset, missions, splits, size, sampled values and failures of a store.

    Example:

        factory info data/missions.zarr
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""

    def run(self, console: Console) -> int:
        """Print the description of the store."""
        from factory.generation import open_missions, unfinished
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
        """Print the description of a store of simulated missions."""
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
        """Print the description of a store of logs, with the import report."""
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


@dataclass(frozen=True, kw_only=True)
class Verify(JsonOption):
    """Compare every file with its checksum and read every chunk; check metadata, padding, finite
    values and ranges. For simulated missions, also check parameters and kinematics; for logs, the
    order of dives, fixes and depth.

    With --replay, fly missions of `factory generate` again instead and compare every byte.

    Examples:

        factory verify data/missions.zarr
        factory verify data/missions.zarr --replay 0 4
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store, or another folder that a command wrote: a run, a page, an export"""
    workers: int = 1
    """number of reading processes; each call reads all bytes, since damage on a disk does not
    change a file's size or time"""
    replay: tuple[int, ...] = ()
    """missions to fly again"""
    attempt: int | None = None
    """with --replay: fly this failed attempt at the mission again"""

    def run(self, console: Console) -> int:
        """Verify; returns exit code 1 if a check fails."""
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
        except Exception:  # readers of damaged files raise any error; `files` names these files
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
        """Check a whole store; returns "mission" or "dive" for messages, and the report."""
        from factory.generation import is_flight, open_missions
        from factory.soundness import verify_logs, verify_store
        from factory.store_check import StoreReport
        from twin.records import LogStore, MissionStore

        with MissionStore(self.store) as reader:
            if is_flight(reader.attributes):
                return "mission", StoreReport(len(reader), 0, ())  # checksums are the only check
        run = open_missions(self.store)
        what = "dive" if isinstance(run, LogStore) else "mission"
        with console.progress(total=len(run), label="verify", unit=what + "s") as progress:
            if isinstance(run, LogStore):
                return what, verify_logs(run, progress.update, workers=self.workers)
            return what, verify_store(run, progress.update, workers=self.workers)

    def _replay(self, console: Console) -> int:
        """Fly missions again; returns exit code 1 if a byte differs."""
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


@dataclass(frozen=True, kw_only=True)
class PlotStore(JsonOption):
    """Plot a page of figures. Simulated missions: tracks, depths, currents, and histograms of
    velocities and measured signals. Logs: map with currents, depth over time and figures of the
    dives, one page for each deployment.

    Example:

        factory plot data/missions.zarr --out missions.png
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""
    out: Path | None = None
    """PNG, PDF or SVG file [default: the store's name with .png]; for several deployments, the
    name of each page's file also contains its deployment"""

    def run(self, console: Console) -> int:
        """Plot and save the pages."""
        from factory.generation import open_missions
        from factory.logs_page import current_errors, deployment_page, page_names
        from factory.missions_page import store_page
        from twin.records import LogStore, whole_file

        if self.out is not None and self.out.suffix.lower() not in FORMATS:
            raise InputError(f"--out {self.out}: the ending must be one of {', '.join(FORMATS)}")
        run = open_missions(self.store)
        run.check_arrays()
        place = self.store if isinstance(self.store, Path) else Path(self.store.name)
        place = place if place.name not in ("", "..") else place.resolve()
        out = place.with_suffix(".png") if self.out is None else self.out
        answer: dict[str, object] = {}
        if isinstance(run, LogStore):
            words = page_names(run.deployments)
            paths = {
                name: out.with_name(f"{out.stem}-{w}{out.suffix}") for name, w in words.items()
            }
            paths = dict.fromkeys(words, out) if len(words) == 1 else paths
            pages = {path: deployment_page(run, name) for name, path in paths.items()}
            errors = {name: current_errors(run, run.missions_of(name)) for name in words}
            answer["current_error_m_s"] = {name: found for name, found in errors.items() if found}
        else:
            pages = {out: store_page(run)}
        for path, figure in pages.items():
            with whole_file(path) as place:
                figure.savefig(place)
            console.say(f"wrote {path}")
        console.answer(store=self.store, out=next(iter(pages)), pages=list(pages), **answer)
        return 0


def drawn_rows(run: GeneratedStore) -> list[dict[str, object]]:
    """Return a table row for each sampled parameter: its distribution and the sampled values."""
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
    """Return a table row for each split: missions and hours."""
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
    """Return a table row for each deployment: dives, times, place and depth."""
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
