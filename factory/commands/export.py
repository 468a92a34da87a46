"""`factory export`: a store in formats that others read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from twin.console import Console, JsonOption


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
    mission: tuple[int, ...] = ()
    """only these missions [default: all]"""

    def run(self, console: Console) -> int:
        """Export."""
        from factory.stored import StoredRun
        from factory.stored_logs import StoredLogs, open_stored

        run = open_stored(self.store)
        missions = list(self.mission) or list(range(len(run)))
        for mission in missions:
            run.check_mission(mission)
        written: list[Path] = []
        if self.to == "og1":
            folder = self.out or self.store.with_name(f"{self.store.stem}-og1")
            where = folder
        if self.to == "og1" and isinstance(run, StoredLogs):
            from factory.og1_logs import export_og1_logs

            written += export_og1_logs(run, missions, folder)
        elif self.to == "og1" and isinstance(run, StoredRun):
            from factory.og1 import export_og1

            with console.progress(total=len(missions), label="export", unit="missions") as progress:
                for mission in missions:
                    written.append(export_og1(run, mission, folder))
                    progress.update()
        else:
            from factory.parquet import export_parquet

            where = export_parquet(run, missions, self.out or self.store.with_suffix(".parquet"))
            written.append(where)
        size = sum(path.stat().st_size for path in written)
        what = "dives" if isinstance(run, StoredLogs) else "missions"
        console.say(f"wrote {len(missions)} {what} to {where} ({size / 1e6:.1f} MB)")
        console.answer(store=self.store, to=self.to, out=where, missions=missions, bytes=size)
        return 0
