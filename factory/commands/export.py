"""`factory export`: a store in formats that others read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from twin.cli.console import Console, JsonOption
from twin.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Export(JsonOption):
    """Write OceanGliders OG1.0 netCDF files, one a simulated mission or one a logged deployment,
    or one flat Parquet table.
    """

    store: Annotated[Path, tyro.conf.Positional]
    """the store"""
    to: Literal["og1", "parquet"]
    """format"""
    out: Path | None = None
    """folder (og1) or file (parquet) [default: the store's name with -og1 or .parquet]"""
    mission: tuple[int, ...] | None = None
    """only these missions [default: all]"""

    def run(self, console: Console) -> int:
        """Export."""
        from factory.stores.generated import GeneratedStore, open_missions
        from twin.records.logs import LogStore

        if self.mission is not None:
            check_missions(self.mission)
        run = open_missions(self.store)
        run.check_arrays()
        missions = list(range(len(run))) if self.mission is None else list(self.mission)
        for mission in missions:
            run.check_mission(mission)
        written: list[Path] = []
        if self.to == "og1":
            folder = self.out or self.store.with_name(f"{self.store.stem}-og1")
            where = folder
        if self.to == "og1" and isinstance(run, LogStore):
            from factory.exporting.og1_logs import export_og1_logs

            written += export_og1_logs(run, missions, folder)
        elif self.to == "og1" and isinstance(run, GeneratedStore):
            from factory.exporting.og1_missions import export_og1

            with console.progress(total=len(missions), label="export", unit="missions") as progress:
                for mission in missions:
                    written.append(export_og1(run, mission, folder))
                    progress.update()
        else:
            from factory.exporting.parquet import export_parquet

            where = export_parquet(run, missions, self.out or self.store.with_suffix(".parquet"))
            written.append(where)
        size = sum(path.stat().st_size for path in written)
        what = "dives" if isinstance(run, LogStore) else "missions"
        console.say(f"wrote {len(missions)} {what} to {where} ({size / 1e6:.1f} MB)")
        console.answer(store=self.store, to=self.to, out=where, missions=missions, bytes=size)
        return 0


def check_missions(missions: Sequence[int]) -> None:
    """Raise InputError unless `--mission` has numbers, each once."""
    if not missions:
        raise InputError("--mission needs a number, such as 0; leave it out to export all")
    twice = [mission for mission, count in Counter(missions).items() if count > 1]
    if twice:
        raise InputError(f"--mission names mission {twice[0]} twice; name each once")
