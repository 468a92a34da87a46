"""Parquet: a store as one flat table, a row for every sample, for tools that know no arrays."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np

from factory.stored import StoredRun
from twin.errors import InputError


def export_parquet(run: StoredRun, missions: Sequence[int], path: Path) -> Path:
    """Write the samples of `missions`: columns mission, split, time, then every signal.

    One row group for each mission; units and meanings are in the columns' metadata.

    Raises:
      InputError: pyarrow is not installed.
      StoreError: no such mission, or its data cannot be read.
    """
    try:
        pa, pq = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise InputError(
            "the Parquet export needs pyarrow, which is not installed: pip install pyarrow"
        ) from None
    names = run.signals()
    fields = [
        pa.field("mission", pa.int32(), metadata={"units": "1"}),
        pa.field("split", pa.string()),
        pa.field("time", pa.float64(), metadata={"units": "s"}),
    ]
    for name in names:
        attributes = run.dataset[name].attrs
        metadata = {key: str(attributes[key]) for key in ("units", "long_name", "signal_group")}
        fields.append(pa.field(name, pa.float32(), metadata=metadata))
    store = {"title": "SIMULATED underwater glider missions", "settings": str(run.settings)}
    schema = pa.schema(fields, metadata=store)
    period = float(run.settings["sample_period_s"])
    path.parent.mkdir(parents=True, exist_ok=True)
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for mission in missions:
            run.check_mission(mission)
            samples = int(run.samples[mission])
            columns = [
                pa.array(np.full(samples, mission, np.int32)),
                pa.array([run.splits[mission]] * samples),
                pa.array(np.arange(samples) * period),
                *(pa.array(run.row(name, mission)[:samples]) for name in names),
            ]
            writer.write_table(pa.table(columns, schema=schema))
    return path
