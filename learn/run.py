"""Run: the folder of one training, with everything that its networks need and came from.

runs/NAME/
  run.json              settings, data, versions, command line, figures of the training
  surge-0.safetensors   weights; surge-0.json has the network, its features and scales
  sway-0.safetensors    (more members of an ensemble: -1, -2 ...)
  metrics.jsonl         one line per validation of each network
  evaluation.json       what `learn evaluate --json` prints, on the store's test missions
  README.md             model card
  report/               index.html and its figures as PNG
"""

from __future__ import annotations

import dataclasses
import datetime
import json
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.errors import InputError, StoreError
from twin.version import __version__

if TYPE_CHECKING:
    from learn.predictor import Ensemble
    from learn.uncertainty import ErrorModel

RUNS = Path("runs")
DEFAULT_STORE = Path("data/missions.zarr")
"""Where `factory generate` puts a store by default."""
DESCRIPTION = "run.json"
METRICS = "metrics.jsonl"
EVALUATION = "evaluation.json"
PAPER_TEST = "paper-test.json"
ABLATION = "ablation.json"
CARD = "README.md"
REPORT = Path("report") / "index.html"
FORMAT = 1
"""Version of `run.json`."""
TARGETS = ("surge", "sway")
FACTORY_PERIOD = 0.5
"""[s] of stores that do not say it: all were made by the factory."""


@dataclasses.dataclass(frozen=True)
class Run:
    """One run folder."""

    path: Path
    description: Mapping[str, Any]
    """What `run.json` says."""

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.path.name

    @property
    def store(self) -> Path:
        """The store that it was trained on."""
        return Path(self.description["settings"]["store"])

    @property
    def members(self) -> int:
        """Networks per velocity."""
        return int(self.description["settings"]["members"])

    @property
    def period(self) -> float:
        """[s] between the samples that its networks were trained on."""
        chosen = self.description["settings"].get("period")
        stored = self.description.get("store", {}).get("sample_period_s", FACTORY_PERIOD)
        return float(stored if chosen is None else chosen)

    @property
    def features(self) -> tuple[str, ...]:
        """Inputs of its networks, by name, in order."""
        return tuple(self.description["settings"]["features"])

    @property
    def report(self) -> Path:
        """Its page."""
        return self.path / REPORT

    def networks(self) -> dict[str, Ensemble]:
        """Surge and sway.

        Raises:
          StoreError: a file is missing, damaged or of another format.
        """
        from learn.predictor import Ensemble, load_predictor

        found = {}
        for target in TARGETS:
            members = []
            for place in range(self.members):
                path = stem(self.path, target, place)
                members.append(load_predictor(path))
                if members[-1].target != target:
                    raise StoreError(
                        f"{path}.json holds a network for {members[-1].target}, not {target}"
                    )
            found[target] = Ensemble(tuple(members))
        return found

    def metrics(self) -> list[dict[str, Any]]:
        """Lines of `metrics.jsonl`; none when it is missing."""
        path = self.path / METRICS
        if not path.is_file():
            return []
        return [json.loads(line) for line in path.read_text().splitlines() if line]

    def evaluation(self) -> dict[str, Any] | None:
        """What `evaluation.json` holds, None without one."""
        path = self.path / EVALUATION
        return json.loads(path.read_text()) if path.is_file() else None

    def error_model(self) -> ErrorModel:
        """What validation missions said about its errors; the defaults without any."""
        from learn.uncertainty import ErrorModel

        return ErrorModel(**self.description.get("error_model", {}))

    def remember(self, **entries: object) -> Run:
        """This run with more in its `run.json`."""
        description = {**self.description, **entries}
        write_description(self.path, description)
        return Run(self.path, description)


def stem(folder: Path, target: str, member: int) -> Path:
    """Path of one network's files without their endings."""
    return folder / f"{target}-{member}"


def open_run(path: str | Path) -> Run:
    """A finished run by its folder, or by its name in `runs/`.

    Raises:
      InputError: there is no such folder, or it is no run.
      StoreError: it is unfinished, damaged or of another version.
    """
    folder = Path(path)
    if not folder.exists() and (RUNS / folder).is_dir():
        folder = RUNS / folder
    description = read_description(folder)
    if not description.get("complete"):
        raise StoreError(f"run {folder} is not finished; go on with `learn fit --resume`")
    return Run(folder, description)


def read_description(folder: Path) -> dict[str, Any]:
    """`run.json` of a folder, finished or not; errors as `open_run`."""
    path = folder / DESCRIPTION
    if not path.is_file():
        if (folder / "zarr.json").is_file():
            raise InputError(f"{folder} is a store, not a run; give the run first, then the store")
        raise InputError(
            f"{folder} is not a run (no {DESCRIPTION} there nor in {RUNS / folder}); make one: "
            "`learn fit`"
        )
    try:
        description: dict[str, Any] = json.loads(path.read_text())
        version = int(description["format"])
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"{path} is damaged: {type(error).__name__} {error}") from error
    if version != FORMAT:
        raise StoreError(f"{path} has format {version}, this program reads {FORMAT}; fit it anew")
    return description


def write_description(folder: Path, description: Mapping[str, Any]) -> None:
    """Write `run.json` so that a kill leaves the old or the new one."""
    from twin.console import to_json

    half = folder / (DESCRIPTION + ".part")
    half.write_text(json.dumps(to_json(description), indent=2) + "\n")
    half.replace(folder / DESCRIPTION)


def newest_run(root: Path = RUNS) -> Run:
    """The finished run that was started last.

    Raises:
      InputError: there is none.
    """
    found = []
    for path in root.glob(f"*/{DESCRIPTION}"):
        try:
            found.append(open_run(path.parent))
        except (StoreError, InputError):
            continue  # unfinished or foreign: an older one will do
    if not found:
        raise InputError(f"no finished run in {root}/; make one with `learn fit`")
    return max(found, key=lambda run: (str(run.description.get("created")), run.name))


def free_name(root: Path = RUNS) -> str:
    """A name that no run has yet: the date and a number."""
    day = datetime.date.today().isoformat()
    number = 1
    while (root / f"{day}-{number}").exists():
        number += 1
    return f"{day}-{number}"


def now() -> str:
    """Time of day in UTC, ISO 8601."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """What can change a bit of a result."""
    import numpy
    import torch

    return {
        "glider-twin": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "numpy": numpy.__version__,
        "torch": torch.__version__,
    }
