"""Run: the folder of one training: its networks, their settings, origin and evaluation.

runs/NAME/
  run.json              settings, data, versions, command line, figures of the training
  surge-0.safetensors   weights; surge-0.json has the network, its features and scales
  sway-0.safetensors    (more members of an ensemble: -1, -2 ...)
  metrics.jsonl         one line per validation of each network
  evaluation.json       what `learn evaluate --json` prints, on the store's test missions
  judged-HASH.zarr      missions flown to judge by, if the test split has too few
  README.md             model card
  report/               index.html and its figures as PNG
  checksums.json        size and SHA-256 of all these files, by which `factory verify` checks them
"""

from __future__ import annotations

import dataclasses
import datetime
import importlib.util
import json
import platform
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learn.files import SEAL, check_seal, read_json, read_sealed, write_sealed
from twin.errors import InputError, StoreError, quoted, shown, unknown_name
from twin.records.attributes import SAMPLE_PERIOD
from twin.records.storage.store_path import StorePath, store_path
from twin.records.storage.whole import whole_file
from twin.version import __version__

if TYPE_CHECKING:
    from learn.data.labels import LabelConfig
    from learn.evaluation.deviation import ErrorModel
    from learn.networks.familiarity import Familiarity, Tether
    from learn.networks.predictor import Adapted, Ensemble, Prediction
    from twin.navigation.estimators.base import VelocityDeviation
    from twin.navigation.flight_filter import FlightSpread
    from twin.vehicle.vehicle import Vehicle

RUNS = Path("runs")
SHIPPED = Path(__file__).parent / "shipped"
"""Folder of the networks of `learn.shipped`: runs `gliders`, `propelled` and theirs"""
DEFAULT_STORE = Path("data/missions.zarr")
"""Default path of a store, as in `factory generate`."""
DESCRIPTION = "run.json"
METRICS = "metrics.jsonl"
EVALUATION = "evaluation.json"
PAPER_TEST = "paper-test.json"
CARD = "README.md"
REPORT = Path("report") / "index.html"
FORMAT = 2
"""Version of `run.json`."""
UNSEALED = 1
"""Version of a `run.json` without checksum, as releases up to 0.1.0 wrote."""
FILTER = "flight filter"
"""Entry of `run.json`'s `versions`: the flight filter's version; runs of version 1 lack it"""
TRUTH = "truth"
"""Entry of `run.json`: the true channels in the run's store; runs of version 0.1.0 lack it."""
LABELS = "label_counts"
"""Entry of `run.json`: numbers of labels from Doppler logs, for a run that learned from them."""
ORIGIN = "started_from"
"""Entry of `run.json`: the run whose weights this training started from, and that run's store."""
TETHER = "tether"
"""Entry of `run.json`, if the networks read the flight filter: the vehicle models in the training,
and the bias limit [m/s] between network and filter surge on any other model."""
ADAPTATION = "adaptation"
"""Entry of `run.json`: the result of `learn adapt`, and the dives that it used"""
MORE_STORES = "more_stores"
"""Entry of `run.json`: vehicle and attributes of each store after the first, of a run that was
trained on several; the entry of this name in the settings has the stores' paths"""
FAMILIARITY = "familiarity"
"""Entry of `run.json`, if the networks read the flight filter: the hulls in the training"""
CARD_ENTRY = "card"
"""Entry of `run.json`, if the run is shipped (`learn.shipped`): its recipe, hours and licence"""
SETTINGS = ("store", "features", "network", "training", "members", "division")
"""Settings without which a run cannot be read."""
TARGETS = ("surge", "sway")
FACTORY_PERIOD = 0.5
"""[s] Sample period of a store without that attribute: the factory made all of them."""


@dataclasses.dataclass(frozen=True)
class Run:
    """A finished run: its folder and the content of its `run.json`."""

    folder: Path
    description: Mapping[str, Any]
    """Content of `run.json`."""

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.name

    @property
    def store(self) -> StorePath:
        """Store that the run was trained on.

        Raises:
          InputError: the run was trained on several stores.
        """
        if self.shipped:
            raise InputError("shipped networks have no store of their own: give one")
        if len(self.stores) > 1:
            raise InputError(
                f"run {self.name} was trained on several stores: give the one that is meant of "
                f"{', '.join(map(str, self.stores))}, or another"
            )
        return self.stores[0]

    @property
    def stores(self) -> tuple[StorePath, ...]:
        """All stores that the run was trained on."""
        settings = self.description["settings"]
        return tuple(map(store_path, (settings["store"], *settings.get(MORE_STORES, ()))))

    @property
    def members(self) -> int:
        """Networks per velocity."""
        return int(self.description["settings"]["members"])

    @property
    def period(self) -> float:
        """[s] Sample period of the networks."""
        chosen = self.description["settings"].get("period")
        stored = self.description.get("store", {}).get(SAMPLE_PERIOD, FACTORY_PERIOD)
        return float(stored if chosen is None else chosen)

    @property
    def shipped(self) -> bool:
        """True for networks of `learn.shipped`, which suit several sample periods."""
        return CARD_ENTRY in self.description

    def at(self, period: float) -> Run:
        """Return shipped networks with another sample period [s]."""
        settings = {**self.description["settings"], "period": period}
        return Run(self.folder, {**self.description, "settings": settings})

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the networks' inputs, in order."""
        return tuple(self.description["settings"]["features"])

    @property
    def hulls(self) -> str:
        """Range of hulls in the training, a key of `twin.navigation.flight_filter.HULLS`."""
        return str(self.description["settings"].get("hulls", "any"))

    @property
    def labels(self) -> LabelConfig:
        """Source of the velocities that the networks learned from, with its settings."""
        from learn.data.labels import label_config

        return label_config(self.description["settings"])

    def label_sentences(self) -> list[str]:
        """Sentences on the Doppler log's labels; none if the networks learned from the truth."""
        from learn.data.labels import LabelCounts

        counts = self.description.get(LABELS)
        return [] if counts is None else LabelCounts(**counts).sentences(self.labels)

    @property
    def report(self) -> Path:
        """Path of the run's page."""
        return self.folder / REPORT

    def predict(self, store: str | StorePath, *, split: str = "all") -> list[Prediction]:
        """Predict surge and sway over a store's missions, each in one run from its start.

        Args:
          store: path of a store with the networks' input channels; samples of a shorter period are
            thinned to the run's period.
          split: train, validation, test or all.

        Raises:
          StoreError: a file of the run or of the store cannot be used.
        """
        from learn.networks.predictor import predict_missions
        from twin.records.reader import MissionStore

        with MissionStore(store) as reader:
            run = self.at(reader.period) if self.shipped else self
            networks = run.networks(reader.vehicle)
        return predict_missions(networks, store, split=split, period=run.period)

    def networks(
        self, vehicle: Vehicle | None = None, *, plain: bool | None = None
    ) -> dict[str, Ensemble]:
        """Load the networks for surge and sway.

        Args:
          plain: load networks `ema` without torch; None: if the run is shipped, or without torch.
          vehicle: their vehicle. If its model was not in the training, a bias limit holds surge to
            the flight filter's (`learn.networks.familiarity`). None: no limit.

        Raises:
          StoreError: a file is missing, damaged or of another format, or the networks were trained
            with another version of the flight filter.
        """
        from learn.networks.predictor import Ensemble, load_predictor
        from twin.navigation.features import channels_of
        from twin.navigation.flight_filter import FLIGHT_FILTER
        from twin.navigation.settings import ESTIMATED

        learned = str(self.description.get("versions", {}).get(FILTER, "1"))
        if learned != str(FLIGHT_FILTER) and set(channels_of(self.features)) & set(ESTIMATED):
            raise StoreError(
                f"the networks of run {self.name} learned to read flight filter {learned}, and "
                f"this program has {FLIGHT_FILTER}: fit the run again (`learn fit`)"
            )
        if plain is None:
            plain = self.shipped or importlib.util.find_spec("torch") is None
        found, model = {}, self.error_model()
        intervals = {"surge": model.surge_interval, "sway": model.sway_interval}
        for target in TARGETS:
            members = []
            for place in range(self.members):
                path = stem(self.folder, target, place)
                period = self.period if self.shipped else None
                members.append(load_predictor(path, period=period, plain=plain))
                if members[-1].target != target:
                    raise StoreError(
                        f"{path}.json holds a network for {members[-1].target}, not {target}"
                    )
            found[target] = Ensemble(
                tuple(members), self.adapted, self.familiar, intervals[target],
                self.tether(vehicle), self.spread,
            )  # fmt: skip
        return found

    @property
    def spread(self) -> FlightSpread:
        """Flight filter's prior spread of hulls about the vehicle file, as in the training.

        Raises:
          StoreError: `run.json` has an unknown word for the hulls.
        """
        from twin.navigation.flight_filter import HULLS

        if self.hulls not in HULLS:
            said = unknown_name("hulls", self.hulls, HULLS)
            raise StoreError(f"{self.folder / DESCRIPTION}: {said}")
        return HULLS[self.hulls]

    def tether(self, vehicle: Vehicle | None) -> Tether | None:
        """Bias limit of surge on a vehicle whose model was not in the training; else None.

        Raises:
          StoreError: the entry in `run.json` is incomplete.
        """
        from learn.networks.familiarity import Tether

        said = self.description.get(TETHER)
        if said is None or vehicle is None:
            return None
        try:
            known = bool(vehicle.model) and vehicle.model in said["models"]
            return None if known else Tether(float(said["most"]))
        except (TypeError, KeyError, ValueError) as error:
            raise StoreError(
                f"{self.folder / DESCRIPTION} is damaged: its {TETHER} is not one ({error}); "
                f"`learn fit --name {quoted(self.name)} --resume` makes it again"
            ) from error

    def strange(self, vehicle: Vehicle) -> str:
        """Warning that no vehicle of this model was in the training; empty if one was, or if
        `run.json` has no entry on it."""
        if self.tether(vehicle) is None:
            return ""
        known = ", ".join(self.description[TETHER]["models"])
        return (
            f"run {self.name} was trained on {known} and on none of the kind of {vehicle.name} "
            f"({vehicle.model}): what lasts of its surge is held to the flight filter's, and "
            "inputs of its moving parts mean something else there"
        )

    @property
    def network_files(self) -> tuple[str, ...]:
        """File names of the networks."""
        stems = [stem(Path(), target, k) for target in TARGETS for k in range(self.members)]
        return tuple(f"{one}{end}" for one in stems for end in (".safetensors", ".json"))

    @property
    def familiar(self) -> Familiarity | None:
        """Statistics of the training's hulls; None if the networks do not read the flight filter.

        Raises:
          StoreError: the entry in `run.json` is incomplete.
        """
        from learn.networks.familiarity import Familiarity

        said = self.description.get(FAMILIARITY)
        place = str(self.folder / DESCRIPTION)
        return None if said is None else Familiarity.read(said, place)

    @property
    def adapted(self) -> Adapted | None:
        """Vehicle constants that `learn adapt` fitted; None for a run that was not adapted.

        Raises:
          StoreError: the entry in `run.json` is not as this version writes it.
        """
        from learn.networks.predictor import Adapted
        from twin.navigation.flight_filter import FlightStart

        said = self.description.get(ADAPTATION, {}).get("start")
        if said is None:
            return None
        try:
            start = FlightStart(
                constants=tuple(map(float, said["constants"])),
                deviations=tuple(map(float, said["deviations"])),
                correlation=tuple(tuple(map(float, row)) for row in said["correlation"]),
                depth_rate=float(said["depth_rate"]),
            )
            return Adapted(start=start, deviation=self.error_model().surge_sd)
        except (TypeError, KeyError, ValueError, InputError) as error:
            raise StoreError(
                f"{self.folder / DESCRIPTION} is damaged: its adaptation is not one ({error}); "
                "adapt again with `learn adapt`"
            ) from error

    def metrics(self) -> list[dict[str, Any]]:
        """Entries of `metrics.jsonl`; none without the file, and none for an unfinished last line.

        Raises:
          StoreError: another line is damaged (named).
        """
        path = self.folder / METRICS
        if not path.is_file():
            return []
        found = []
        for number, line in enumerate(_whole_lines(path), 1):
            try:
                found.append(json.loads(line))
            except (ValueError, RecursionError) as error:
                raise StoreError(
                    f"{path} is damaged in line {number} ({error}); take that line out"
                ) from error
        return found

    @property
    def figures(self) -> dict[str, Any] | None:
        """Numbers of the evaluation, as `learn evaluate --json` prints them; None before it.

        Raises:
          StoreError: the file is damaged, or lacks a number (named).
        """
        return self._evaluated(EVALUATION)

    @property
    def paper_figures(self) -> dict[str, Any] | None:
        """Numbers on the paper's test by name; None if it was not flown (`learn.finishing`).

        Raises:
          StoreError: the file is damaged, or lacks a number (named).
        """
        return self._evaluated(PAPER_TEST)

    def _evaluated(self, name: str) -> dict[str, Any] | None:
        from learn.evaluation.score import summarise_scores

        path = self.folder / name
        if not path.is_file():
            return None
        remedy = f"`learn fit --name {quoted(self.name)} --resume` writes it again"
        found = read_sealed(path, remedy)
        figures = tuple(summarise_scores(()))
        _need(found, ("store", "split", *figures, "floor", "baselines"), path, remedy)
        _need(found["floor"], figures, path, remedy)
        for baseline in found["baselines"].values():
            _need(baseline, figures, path, remedy)
        return found

    def error_model(self) -> ErrorModel:
        """Error statistics from validation missions; defaults if the run has none.

        Raises:
          StoreError: the entry in `run.json` is not as this version writes it.
        """
        from learn.evaluation.deviation import ErrorModel

        try:
            return ErrorModel(**self.description.get("error_model", {}))
        except TypeError as error:
            raise StoreError(
                f"{self.folder / DESCRIPTION} is damaged: its error_model is not one ({error}); "
                f"`learn fit --name {quoted(self.name)} --resume` fits it again"
            ) from error

    def velocity_deviation(self, vehicle: Vehicle) -> VelocityDeviation:
        """Standard deviation of the velocity estimate at a vehicle's usual speed, from validation;
        errors as in `error_model`."""
        from twin.navigation.estimators.base import VelocityDeviation
        from twin.navigation.estimators.flight import usual_speed

        deviation = self.error_model().velocity_sd
        return VelocityDeviation(scale=deviation / usual_speed(vehicle), noise=deviation)

    def remember(self, **entries: object) -> Run:
        """Add entries to `run.json`; returns the run with them."""
        description = {**self.description, **entries}
        write_description(self.folder, description)
        return Run(self.folder, description)


def stem(folder: Path, target: str, member: int) -> Path:
    """Path of one network's files without their endings."""
    return folder / f"{target}-{member}"


def open_run(path: str | Path) -> Run:
    """Open a finished run by its folder, or by its name in `runs/` or among the shipped ones.

    Args:
      path: the folder or the name.

    Raises:
      InputError: there is no such folder, or the folder holds no run.
      StoreError: the run is unfinished, damaged or of another version.
    """
    folder = Path(path)
    if not folder.exists():
        folder = next((k / folder for k in (RUNS, SHIPPED) if (k / folder).is_dir()), folder)
    description = read_description(folder)
    if not description.get("complete"):
        raise StoreError(
            f"run {folder} is not finished; continue with "
            f"`learn fit --name {quoted(folder.name)} --resume`"
        )
    return Run(folder, description)


def read_description(folder: Path) -> dict[str, Any]:
    """Read `run.json` of a finished or unfinished run; errors as in `open_run`."""
    path = folder / DESCRIPTION
    if not path.is_file():
        from twin.records.presence import is_complete  # numpy, which help texts do without

        if is_complete(folder):
            raise InputError(
                f"{folder} is a store, not a run; give the run first, then the store, as in "
                f"`learn evaluate {_example()} {quoted(folder)}`"
            )
        raise InputError(
            f"{folder} is not a run (no {DESCRIPTION} there nor in {RUNS / folder}); make one: "
            "`learn fit`"
        )
    remedy = "bring it back from a copy, or fit the run again"
    description = read_json(path, remedy)
    try:
        version = int(description["format"])
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise StoreError(f"{path} is damaged: {type(error).__name__} {error}") from error
    if version not in (UNSEALED, FORMAT):
        raise StoreError(
            f"{path} has format {version}, this program reads {UNSEALED} and {FORMAT}; fit it again"
        )
    if version == FORMAT or SEAL in description:
        check_seal(path, description, remedy)
    _need(description, ("settings", "store", "versions", "created"), path, remedy)
    _need(description["settings"], SETTINGS, path, remedy)
    return description


def _need(figures: Any, names: Iterable[str], path: Path, remedy: str) -> None:
    """Raise StoreError if an object of a JSON file lacks one of these entries."""
    for name in names:
        if not isinstance(figures, Mapping) or name not in figures:
            raise StoreError(f"{path} is damaged: it has no {name!r}; {remedy}")


def _whole_lines(path: Path) -> list[str]:
    """Lines of a text file, without blank lines and without an unfinished last line."""
    text = path.read_text(encoding="utf-8", errors="replace")
    return [line for line in text[: text.rfind("\n") + 1].splitlines() if line]


def repair_metrics(folder: Path) -> None:
    """Remove an unfinished last line that a kill left, so that the next entry starts a new line."""
    path = folder / METRICS
    if path.is_file() and not path.read_bytes().endswith(b"\n"):
        lines = _whole_lines(path)
        with whole_file(path) as place:
            place.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def _example() -> str:
    """Folder of the newest run, or the word RUN, for an example in an error."""
    try:
        return str(newest_run().folder)
    except InputError:
        return "RUN"


def write_description(folder: Path, description: Mapping[str, Any]) -> None:
    """Write `run.json`."""
    from twin.cli.console import to_json

    write_sealed(folder / DESCRIPTION, {**to_json(description), "format": FORMAT})


def newest_run(root: Path = RUNS) -> Run:
    """Open the finished run that was started last.

    Args:
      root: folder of the runs.

    Raises:
      InputError: there is no finished run.
    """
    found = []
    for path in root.glob(f"[!.]*/{DESCRIPTION}"):
        try:
            found.append(open_run(path.parent))
        except (StoreError, InputError):
            continue  # unfinished or foreign: an older one will do
    if not found:
        raise InputError(f"no finished run in {root}/; make one with `learn fit`")
    return max(found, key=lambda run: (str(run.description.get("created")), run.name))


LONGEST_NAME = 100
"""Bytes that a run's name may have: names of files next to the run's folder contain it"""


def checked_name(name: str) -> str:
    """Check a name for a run's folder in `runs/`; returns the name.

    Raises:
      InputError: the name is empty, a path, hidden, too long, or not printable.
    """
    plain = name.strip() and Path(name).name == name and not name.startswith(".")
    if not plain or not name.isprintable() or len(name.encode()) > LONGEST_NAME:
        raise InputError(
            f"--name {shown(name)} must be a plain name of at most {LONGEST_NAME} printable "
            f"characters: the run goes into {RUNS}/NAME"
        )
    return name


def free_name(root: Path = RUNS) -> str:
    """Unused name for a run: the date and a number."""
    day = datetime.date.today().isoformat()
    number = 1
    while (root / f"{day}-{number}").exists():
        number += 1
    return f"{day}-{number}"


def now() -> str:
    """Present date and time in UTC, ISO 8601."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """Versions of all software that can change a bit of a result."""
    import numpy
    import torch

    from twin.navigation.flight_filter import FLIGHT_FILTER

    return {
        "glider-twin": __version__,
        FILTER: str(FLIGHT_FILTER),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "numpy": numpy.__version__,
        "torch": torch.__version__,
    }
