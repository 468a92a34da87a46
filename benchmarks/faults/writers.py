"""Writers: what the commands write, as functions that faults are injected into.

Each is prepared once, so that what is repeated is the writing: a flight of one dive, a store of
logs, tracks and a page of figures, a network. `fit` trains for real, on a store of small missions.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import os
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin.records.trajectory import Trajectory

SHORT = {"mission.duration_h": 0.05, "mission.segment_duration_s": "uniform(30, 90)"}
"""Missions of three minutes"""
Write = Callable[[Path, str], None]
"""Writes content of a variant, `old` or `new`, to a path; replaces what is there."""


def digest(target: Path) -> str:
    """SHA-256 over names and bytes of a file or folder."""
    found = hashlib.sha256()
    for path in sorted(target.rglob("*")) if target.is_dir() else [target]:
        found.update(str(path.relative_to(target)).encode())
        if path.is_file():
            found.update(path.read_bytes())
    return found.hexdigest()


def network_content(run: Path) -> str:
    """What a run holds of its network: nothing before the description is there."""
    files = [run / f"surge-0{ending}" for ending in (".json", ".safetensors")]
    return ", ".join(digest(path) for path in files) if files[0].exists() else "no network yet"


@dataclasses.dataclass(frozen=True)
class Writer:
    """One writer."""

    name: str
    target: str
    """Name of what it writes."""
    prepare: Callable[[Path], Write]
    """Imports and computes what is written, in a folder of its own for inputs."""
    content: Callable[[Path], str] = digest
    """What readers see of it, in a word; `digest` is every byte and name."""
    whole: Callable[[Path], str] = digest
    """What must be the same whenever the new content was written."""


def _folder(inputs: Path) -> Write:
    from twin.records.storage.whole import whole_folder

    def write(path: Path, variant: str) -> None:
        with whole_folder(path, overwrite=True) as folder:
            for name in ("a", "b/c"):
                (folder / name).parent.mkdir(exist_ok=True)
                (folder / name).write_text(3000 * variant)

    return write


def _file(inputs: Path) -> Write:
    from twin.records.storage.whole import whole_file

    def write(path: Path, variant: str) -> None:
        with whole_file(path) as place:
            place.write_text(3000 * variant)

    return write


def _small_file(inputs: Path) -> Write:
    from twin.errors import WriteError
    from twin.records.storage.disk import write_whole

    def write(path: Path, variant: str) -> None:
        try:
            write_whole(path, 3000 * variant.encode())
        except OSError as error:
            raise WriteError(str(error)) from error

    return write


def _simulate(inputs: Path) -> Write:
    from twin.records.mission_dataset import dataset_of
    from twin.records.store import write_store

    data = {variant: dataset_of([one]) for variant, one in _flights().items()}

    def write(path: Path, variant: str) -> None:
        write_store(data[variant], path, overwrite=True)

    return write


def _trajectory(inputs: Path) -> Write:
    flown = _flights()

    def write(path: Path, variant: str) -> None:
        flown[variant].save(path, overwrite=True)

    return write


@functools.cache
def _flights() -> dict[str, Trajectory]:
    """A shallow dive from fix to fix, sampled differently."""
    import twin
    from twin.mission import Mission
    from twin.mission.segments import SawTooth, Surface

    dive = SawTooth(heading_deg=40.0, max_depth_m=15.0, pitch_deg=24.0, net_mass_kg=0.2, yos=1.0)
    around = Surface(duration_s=60.0)
    mission = Mission(name="one dive", segments=(around, dive, around))
    start = {"latitude": 49.0, "longitude": -16.0, "time": "2003-08-01T00:00"}
    return {
        variant: twin.simulate(mission=mission, start=start, sensors="field", sample_period=period)
        for variant, period in (("old", 4.0), ("new", 5.0))
    }


def _generate(inputs: Path) -> Write:
    from benchmarks.faults.here import Here
    from factory.generation.completion import log_of
    from factory.generation.generation import generate
    from factory.sampling.recipe import make_recipe

    recipes = {
        variant: make_recipe(hours=0.2, seed=seed, changes=SHORT)
        for seed, variant in enumerate(("old", "new"))
    }

    def write(path: Path, variant: str) -> None:
        generate(recipes[variant], path, executor=Here(), resume=True, overwrite=True)
        log_of(path).unlink()  # it says when, and so is never the same

    return write


def _import(inputs: Path) -> Write:
    from factory.importing.import_run import import_logs
    from twin.records.store import write_store

    exported = inputs / "og1"
    export = _export("og1")(inputs)
    _in_child(lambda: export(exported, "new"))
    dataset = import_logs("og1", sorted(exported.glob("*.nc")))[0].load()

    def write(path: Path, variant: str) -> None:
        write_store(dataset.assign_attrs(comment=variant), path, overwrite=True)

    return write


def _export(kind: str) -> Callable[[Path], Write]:
    def prepare(inputs: Path) -> Write:
        from factory.exporting.base import EXPORTERS
        from factory.generation.generated_store import open_exportable

        # the same flight must give the same bytes: a file says when it was made
        os.environ["SOURCE_DATE_EPOCH"] = "1767225600"
        stores = {}
        for variant, flown in _flights().items():
            stores[variant] = inputs / f"{variant}.zarr"
            _in_child(functools.partial(flown.save, stores[variant]))

        def write(path: Path, variant: str) -> None:
            with open_exportable(stores[variant]) as run:
                EXPORTERS[kind].export(run, [0], path, overwrite=True)

        return write

    return prepare


def _tracks(inputs: Path) -> Write:
    import numpy as np

    from learn.evaluation.judged_tracks import TrackCollector

    def write(path: Path, variant: str) -> None:
        found = TrackCollector()
        found._missions, found._time = [0], np.arange(50.0)
        length = 40 if variant == "old" else 50
        found._tracks = {"network": {0: np.ones((length, 2))}}
        found.write(path)

    return write


def _page(inputs: Path) -> Write:
    from matplotlib.figure import Figure

    from twin.show.figures.page_layout import Page

    def write(path: Path, variant: str) -> None:
        page = Page(path, variant, variant)
        figure = Figure(figsize=(1, 1))
        figure.add_subplot().plot([1, 2])
        page.figure("drawn", figure, variant)
        page.write()

    return write


def _network(inputs: Path) -> Write:
    import torch

    from learn.data.normalisation import Normalisation
    from learn.networks.base import build_network
    from learn.networks.config import NetworkConfig
    from learn.networks.predictor import Predictor

    scales = Normalisation(
        target="surge",
        features=("pitch",),
        mean=(0.0,),
        scale=(1.0,),
        target_mean=0.0,
        target_scale=1.0,
    )

    def write(path: Path, variant: str) -> None:
        if variant == "old":  # a run is begun; a network is never written over another one
            path.mkdir(exist_ok=True)
            return
        torch.manual_seed(1)
        network = build_network(NetworkConfig(kind="gru", hidden=4, layers=1, inputs=1))
        path.mkdir(exist_ok=True)
        Predictor(network, scales).save(path / "surge-0")

    return write


def _fit(inputs: Path) -> Write:
    from benchmarks.faults.here import Here
    from factory.generation.generation import generate
    from factory.sampling.recipe import make_recipe
    from learn.networks.config import NetworkConfig
    from learn.training.fit_config import FitConfig
    from learn.training.fitting import fit
    from learn.training.schedule import TrainingConfig

    store = inputs / "missions.zarr"
    recipe = make_recipe(hours=0.2, changes=SHORT)
    _in_child(lambda: generate(recipe, store, executor=Here()))
    configs = {
        variant: FitConfig(
            store=str(store),
            features=("sin_pitch", "depth_rate"),
            network=NetworkConfig(hidden=4, layers=1),
            training=TrainingConfig(epochs=1, seconds=0.0, seed=seed),
        )
        for seed, variant in enumerate(("old", "new"))
    }

    def write(path: Path, variant: str) -> None:
        fit(configs[variant], path, replace=True, resume=True)

    return write


def run_content(run: Path) -> str:
    """What a run holds that does not tell the time: settings, whether it is complete, weights."""
    if not run.exists():
        return "nothing"
    description = json.loads((run / "run.json").read_text())
    weights = [digest(path) for path in sorted(run.glob("*.safetensors"))]
    return json.dumps([description["settings"], description["complete"], weights])


def _in_child(work: Callable[[], object]) -> None:
    """Do something in a forked process, so that this one has no threads of zarr's."""
    child = os.fork()
    if child == 0:
        try:
            work()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


WRITERS = {
    one.name: one
    for one in (
        Writer("whole_folder", "target", _folder),
        Writer("whole_file", "target.txt", _file),
        Writer("write_whole", "target.json", _small_file),
        Writer("simulate", "flight.zarr", _simulate),
        Writer("save", "flight.nc", _trajectory),
        Writer("generate", "missions.zarr", _generate),
        Writer("import", "log.zarr", _import),
        Writer("export-og1", "flight-og1", _export("og1")),
        Writer("export-parquet", "flight.parquet", _export("parquet")),
        Writer("evaluate-tracks", "tracks.nc", _tracks),
        Writer("evaluate-tracks-zarr", "tracks.zarr", _tracks),
        Writer("evaluate-page", "page", _page),
        Writer("fit-network", "run", _network, network_content),
        Writer("fit", "run", _fit, run_content, run_content),
    )
}
