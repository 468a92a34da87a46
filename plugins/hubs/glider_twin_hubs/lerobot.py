"""LeRobot: export of missions as episodes in files of format v3.0.

Many episodes share a file; meta/episodes holds where each episode begins. Features divide the
signals into states and actions. Their statistics, per episode and in total, scale the inputs of
LeRobot's policies. Source: the definition of the format in LeRobot 0.4.4 (lerobot/datasets), which
reads these files.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting import Advance, ExportOptions, metadata_for
from factory.generation import GeneratedStore, StoredFlight
from glider_twin_hubs.huggingface import split_name, write_card
from twin.errors import StoreError
from twin.records import SPLITS, MissionStore
from twin.records.schema import VARIABLES

Floats = NDArray[np.float32]

STATE, TRUTH, ACTION, OTHER = (
    "observation.state",
    "observation.environment_state",
    "action",
    "other",
)
"""Names of vectors. STATE, ACTION: read by policies. TRUTH: true state. OTHER: signals with gaps
(NaN between fixes and without lock), and commands to no part, such as setpoints"""
BY_GROUP = {"measured": STATE, "true": TRUTH, "commanded": ACTION}
INDICES = {
    "timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64",
    "task_index": "int64",
}  # fmt: skip
"""Types of the columns that each row has in addition to the vectors"""


@dataclasses.dataclass(frozen=True)
class Features:
    """Names of the signals in each vector, by the vector's name."""

    vectors: Mapping[str, tuple[str, ...]]

    def described(self) -> dict[str, Any]:
        """Description of vectors and columns for info.json."""
        found: dict[str, Any] = {
            name: {"dtype": "float32", "shape": [len(signals)], "names": list(signals)}
            for name, signals in self.vectors.items()
        }
        return found | {
            name: {"dtype": kind, "shape": [1], "names": None} for name, kind in INDICES.items()
        }

    def read(self, run: MissionStore, mission: int) -> dict[str, Floats]:
        """Read the vectors of a mission, each (samples, signals).

        Raises:
          StoreError: the mission cannot be read.
        """
        count = int(run.samples[mission])
        return {
            name: np.stack([run.row(signal, mission)[:count] for signal in signals], axis=1)
            for name, signals in self.vectors.items()
        }


def choose_features(run: MissionStore, missions: Sequence[int]) -> Features:
    """Divide the signals into vectors: by group if no mission has a gap, else `other`.

    Actions are the commands to the vehicle's parts, without setpoints and segment numbers.

    Raises:
      StoreError: no measured signal is without gaps, or the data cannot be read.
    """
    commands = {f"commanded_{part}" for part in run.vehicle.part_names}
    vectors: dict[str, list[str]] = {name: [] for name in (STATE, TRUTH, ACTION, OTHER)}
    for name in run.signals():
        group = BY_GROUP[name.split("_", 1)[0]]
        apart = VARIABLES[name].gaps or (group == ACTION and name not in commands)
        vectors[OTHER if apart or _has_gap(run, name, missions) else group].append(name)
    if not vectors[STATE]:
        raise StoreError(
            f"store {run.path}: every measured signal has gaps in some mission, so that there is "
            "no state to learn from; choose missions with --mission"
        )
    return Features({name: tuple(some) for name, some in vectors.items() if some})


def _has_gap(run: MissionStore, name: str, missions: Sequence[int]) -> bool:
    return any(
        not np.isfinite(run.row(name, mission)[: run.samples[mission]]).all()
        for mission in missions
    )


Array = NDArray[np.float64]
Statistics = dict[str, Array]

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def episode_statistics(values: NDArray[np.generic]) -> Statistics:
    """Statistics of each column of an array (samples, columns), without NaN.

    A column of NaN alone has zeros and standard deviation one, and adds no samples to the count.
    """
    known = np.asarray(values, float).reshape(len(values), -1)
    counts = np.isfinite(known).sum(axis=0)
    filled = np.where(counts > 0, known, 0.0)
    found = {
        "min": np.nanmin(filled, axis=0),
        "max": np.nanmax(filled, axis=0),
        "mean": np.nanmean(filled, axis=0),
        "std": np.where(counts > 0, np.nanstd(filled, axis=0), 1.0),
        "count": np.array([float(counts.max(initial=0))]),
    }
    parts = np.nanquantile(filled, list(QUANTILES.values()), axis=0)
    return found | dict(zip(QUANTILES, parts, strict=True))


class Total:
    """Statistics of all episodes, pooled from each episode's statistics.

    Quantiles are means of the episodes' quantiles weighted by length, as LeRobot computes them.
    """

    def __init__(self) -> None:
        self._found: dict[str, Statistics] = {}

    def add(self, episode: Mapping[str, Statistics]) -> None:
        """Add an episode's statistics, by feature."""
        for name, new in episode.items():
            old = self._found.get(name)
            self._found[name] = dict(new) if old is None else _joined(old, new)

    def result(self) -> dict[str, dict[str, list[float]]]:
        """Pooled statistics by feature and statistic, for stats.json."""
        return {
            name: {what: values.tolist() for what, values in found.items()}
            for name, found in self._found.items()
        }


def _joined(a: Statistics, b: Statistics) -> Statistics:
    """Pool two sets of statistics (Chan et al., 1979: the parallel algorithm for variances)."""
    count = a["count"] + b["count"]
    share = b["count"] / np.maximum(count, 1.0)
    apart = b["mean"] - a["mean"]
    variance = (1.0 - share) * a["std"] ** 2 + share * b["std"] ** 2
    found = {
        "min": np.minimum(a["min"], b["min"]),
        "max": np.maximum(a["max"], b["max"]),
        "mean": a["mean"] + share * apart,
        "std": np.sqrt(variance + share * (1.0 - share) * apart**2),
        "count": count,
    }
    return found | {name: a[name] + share * (b[name] - a[name]) for name in QUANTILES}


VERSION = "v3.0"
CHUNK, FILE_MB, VIDEO_MB = 1000, 100, 200
"""LeRobot's limits. CHUNK: files in a folder. FILE_MB: megabytes in a data file. VIDEO_MB:
megabytes in a video file"""
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
TASKS, INFO, STATS = "meta/tasks.parquet", "meta/info.json", "meta/stats.json"
AT_A_TIME = 256
"""Number of episodes whose metadata are written together"""
LAYOUT = f"""LeRobot data set, format v3.0. An episode is a mission: first all of training, then
validation, then test (`splits` in meta/info.json). `observation.state` has the measured signals,
`observation.environment_state` the truth, `action` the commands to the vehicle's parts, each only
signals without gaps. The vector `{OTHER}` has signals with gaps, NaN where there was none, and
setpoints. `names` in meta/info.json says which column is which.

```python
from lerobot.datasets.lerobot_dataset import LeRobotDataset

missions = LeRobotDataset("local/missions", root="this/folder")
```"""


def export_lerobot(
    run: MissionStore,
    missions: Sequence[int],
    folder: Path,
    advance: Advance,
    options: ExportOptions,
) -> list[Path]:
    """Write the missions as episodes, with statistics, tasks and README.md.

    Raises:
      ModuleNotFoundError: pyarrow is not installed.
      OSError: the disk refuses.
      StoreError: a mission is missing or cannot be read, or every measured signal has gaps.
    """
    ordered = [m for split in SPLITS for m in missions if split_name(run.splits[m]) == split]
    writer = _Writer(run, choose_features(run, ordered), folder)
    with writer:
        for mission in ordered:
            writer.add(mission)
            advance()
    counts = {split: sum(split_name(run.splits[m]) == split for m in ordered) for split in SPLITS}
    written = [*writer.files, *writer.finish(counts)]
    config = [{"config_name": "default", "data_files": "data/*/*.parquet"}]
    said = metadata_for(run, options.metadata)
    about = write_card(folder, run, ordered, said, config, tags=("LeRobot",), layout=LAYOUT)
    return [about, *written]


class _Writer:
    """Writer of the data set's files, an episode at a time; a context manager that closes them."""

    def __init__(self, run: MissionStore, features: Features, folder: Path) -> None:
        self._pa, self._pq = import_module("pyarrow"), import_module("pyarrow.parquet")
        self._run, self._features, self._folder = run, features, folder
        self._tasks: dict[str, int] = {}
        self._total = Total()
        self._rows = self._episodes = 0
        self._kept: list[dict[str, Any]] = []
        self._data: Any = None
        self._meta: Any = None
        self._file = -1
        self.files: list[Path] = []
        """Paths of the written files"""

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._flush()
        for writer in (self._data, self._meta):
            if writer is not None:
                writer.close()

    def add(self, mission: int) -> None:
        """Write a mission as the next episode."""
        run, count = self._run, int(self._run.samples[mission])
        task = _task(run, mission)
        number = self._tasks.setdefault(task, len(self._tasks))
        vectors = self._features.read(run, mission)
        frames = np.arange(count)
        columns: dict[str, Any] = {
            "timestamp": (frames * run.period).astype(np.float32),
            "frame_index": frames,
            "episode_index": np.full(count, self._episodes),
            "index": self._rows + frames,
            "task_index": np.full(count, number),
        }
        statistics = {n: episode_statistics(v) for n, v in (vectors | columns).items()}
        self._total.add(statistics)
        self._write_rows({n: self._vector(v) for n, v in vectors.items()} | columns)
        self._kept.append(
            {
                "episode_index": self._episodes,
                "tasks": [task],
                "length": count,
                "data/chunk_index": self._file // CHUNK,
                "data/file_index": self._file % CHUNK,
                "dataset_from_index": self._rows,
                "dataset_to_index": self._rows + count,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                "mission": mission,
                "split": run.splits[mission],
                **{
                    f"stats/{name}/{what}": values.tolist()
                    for name, found in statistics.items()
                    for what, values in found.items()
                },
            }
        )
        self._rows += count
        self._episodes += 1
        if len(self._kept) >= AT_A_TIME:
            self._flush()

    def finish(self, counts: dict[str, int]) -> list[Path]:
        """Write the files of totals: information, statistics and tasks."""
        import pandas as pd

        fps = 1.0 / self._run.period
        edges = np.cumsum([0, *(counts[split] for split in SPLITS)])
        info = {
            "codebase_version": VERSION,
            "robot_type": self._run.vehicle.name,
            "total_episodes": self._episodes,
            "total_frames": self._rows,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK,
            "data_files_size_in_mb": FILE_MB,
            "video_files_size_in_mb": VIDEO_MB,
            "fps": int(fps) if fps.is_integer() else fps,
            "splits": {
                split: f"{edges[k]}:{edges[k + 1]}"
                for k, split in enumerate(SPLITS)
                if counts[split]
            },
            "data_path": DATA,
            "video_path": None,
            "features": self._features.described(),
        }
        paths = [self._folder / name for name in (INFO, STATS, TASKS)]
        for path, content in zip(paths, (info, self._total.result()), strict=False):
            path.write_text(json.dumps(content, indent=4), encoding="utf-8")
        tasks = pd.DataFrame({"task_index": list(self._tasks.values())}, index=list(self._tasks))
        tasks.to_parquet(paths[2])
        return paths

    def _vector(self, values: Any) -> Any:
        """Arrow column of vectors; vectors of length one become numbers, as in LeRobot."""
        pa = self._pa
        flat = pa.array(values.ravel(), pa.float32())
        width = values.shape[1]
        return flat if width == 1 else pa.FixedSizeListArray.from_arrays(flat, width)

    def _write_rows(self, columns: dict[str, Any]) -> None:
        table = self._pa.table({name: self._typed(name, v) for name, v in columns.items()})
        if self._data is None:
            self._file += 1
            name = DATA.format(chunk_index=self._file // CHUNK, file_index=self._file % CHUNK)
            self._data = self._open(name, table.schema)
        self._data.write_table(table)
        if self.files[-1].stat().st_size > FILE_MB * 2**20:
            self._data.close()
            self._data = None

    def _typed(self, name: str, values: Any) -> Any:
        pa = self._pa
        return pa.array(values, getattr(pa, INDICES[name])()) if name in INDICES else values

    def _flush(self) -> None:
        if not self._kept:
            return
        table = self._pa.Table.from_pylist(self._kept)
        if self._meta is None:
            self._meta = self._open(EPISODES, table.schema, first=True)
        self._meta.write_table(table.cast(self._meta.schema))
        self._kept = []

    def _open(self, name: str, schema: Any, *, first: bool = False) -> Any:
        path = self._folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        self.files.insert(0 if first else len(self.files), path)
        return self._pq.ParquetWriter(path, schema, compression="zstd")


def _task(run: MissionStore, mission: int) -> str:
    """Task of a mission in words, from its segments."""
    if isinstance(run, GeneratedStore):
        kinds = [str(one["mission.kind"]) for one in run.parameters(mission).segments]
        return f"fly {', '.join(dict.fromkeys(kinds))}"
    if isinstance(run, StoredFlight):
        return f"fly {run.attributes['mission']}"
    return "dive"
