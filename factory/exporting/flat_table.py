"""Flat table: a store written as one Parquet table with a row for every sample."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from factory.exporting.base import Advance, no_progress
from factory.generation.generated_store import GeneratedStore, StoredFlight
from twin.records.attributes import COMMENT, HISTORY, PLATFORM, SCENARIO, TITLE
from twin.records.coordinates import ATTRIBUTES, DATETIME, LATITUDE, LONGITUDE
from twin.records.logged import LogStore
from twin.records.reader import MissionStore
from twin.records.timeseries import sample_coordinates


def export_parquet(
    run: MissionStore, missions: Sequence[int], path: Path, advance: Advance = no_progress
) -> list[Path]:
    """Write the samples of `missions` as one table, with one row group for each mission.

    Raises:
      ModuleNotFoundError: pyarrow is not installed.
      OSError: the disk refuses.
      StoreError: no such mission, or its data cannot be read.
    """
    pq = import_module("pyarrow.parquet")
    flat = FlatTable(run)
    with pq.ParquetWriter(path, flat.schema, compression="zstd") as writer:
        for mission in missions:
            writer.write_table(flat.rows(mission))
            advance()
    return [path]


class FlatTable:
    """Table of a store's samples: mission, split, time, date, position, then every signal.

    Logs also have the deployment and the dive. Units and meanings are in the columns' metadata.

    Raises:
      ModuleNotFoundError: pyarrow is not installed.
    """

    def __init__(self, run: MissionStore) -> None:
        pa = import_module("pyarrow")
        self._run, self._pa = run, pa
        self._names = run.signals()
        fields = [
            pa.field("mission", pa.int32(), metadata={"units": "1"}),
            pa.field("split", pa.string()),
            pa.field("time", pa.float64(), metadata={"units": "s"}),
            pa.field(DATETIME, pa.timestamp("ms", tz="UTC")),
            *(
                pa.field(name, pa.float64(), metadata={"units": ATTRIBUTES[name]["units"]})
                for name in (LATITUDE, LONGITUDE)
            ),
        ]
        if isinstance(run, LogStore):
            fields += [
                pa.field("deployment", pa.string()),
                pa.field("dive", pa.int32(), metadata={"units": "1"}),
            ]
        for name in self._names:
            attributes = run.dataset[name].attrs
            metadata = {key: str(attributes[key]) for key in ("units", "long_name", "signal_group")}
            fields.append(pa.field(name, pa.float32(), metadata=metadata))
        self.schema = pa.schema(fields, metadata=_about(run))
        """Schema of pyarrow."""

    def rows(self, mission: int) -> Any:
        """Samples of a mission, as a pyarrow.Table.

        Raises:
          StoreError: the mission's data cannot be read.
        """
        run, pa = self._run, self._pa
        samples = int(run.samples[mission])
        where = sample_coordinates(run, mission)
        columns = [
            np.full(samples, mission, np.int32),
            [run.splits[mission]] * samples,
            np.arange(samples) * run.period,
            where[DATETIME].astype("datetime64[ms]"),
            where[LATITUDE],
            where[LONGITUDE],
        ]
        if isinstance(run, LogStore):
            columns += _logged(run, mission)
        columns += [run.row(name, mission)[:samples] for name in self._names]
        arrays = [pa.array(c, f.type) for c, f in zip(columns, self.schema, strict=True)]
        return pa.table(arrays, schema=self.schema)


def _about(run: MissionStore) -> dict[str, str]:
    """Metadata of the table."""
    if isinstance(run, GeneratedStore):
        return {"title": "SIMULATED underwater glider missions", "settings": str(run.settings)}
    if isinstance(run, StoredFlight):
        about = {key: str(run.attributes[key]) for key in (TITLE, "vehicle", "mission", SCENARIO)}
        places = {mission: run.place(mission) for mission in range(len(run))}
        return {**about, "places": json.dumps(places)}
    return {key: str(run.attributes[key]) for key in (TITLE, COMMENT, PLATFORM, HISTORY)}


def _logged(logs: LogStore, mission: int) -> list[Any]:
    """Columns that only logs have."""
    samples = int(logs.samples[mission])
    return [
        [logs.deployments[mission]] * samples,
        np.full(samples, logs.number("dive")[mission]).astype(np.int32),
    ]
