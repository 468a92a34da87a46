"""Hashes of the project's results, for comparison before and after a refactoring.

    python scripts/hashes.py --write before.json
    python scripts/hashes.py --compare before.json    # 1 where a value differs; names each
    python scripts/hashes.py --only flights currents

Hashed are flights of every vehicle by both engines, currents at a thousand points, a generated run
and one that is killed and resumed, imports in every layout, exports, an identified vehicle, and a
short training of every network. An error is a result too: its text is hashed.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import logging
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

Values = Iterator[tuple[str, Any]]
"""Names, and the value that is hashed under each"""
SECONDS = 300.0
MISSIONS: dict[str, dict[str, Any]] = {
    "still": {},
    "sea": {
        "sensors": "field", "seed": 3, "floor": "rough:150,height=3,length=400",
        "current": "ekman:tau=0.1,direction=90+tide:m2=0.1,s2=0.03,direction=30",
        "faults": ("compass_iron:degrees=40,toward=90",),
    },
    "navigated": {"sensors": "field", "seed": 4, "current": "uniform:0.1,0.05", "navigate": "ekf"},
}  # fmt: skip
CURRENTS = (
    "none", "uniform:speed=0.3,direction=90", "ekman:tau=0.1,direction=90",
    "geostrophic:surface=0.2,direction=45,scale=800,barotropic=0.05",
    "tide:m2=0.1,s2=0.03,direction=30", "inertial:speed=0.08,layer=40",
    "log-layer:friction=0.01,direction=0,bottom=100",
    "gauss-markov:speed=0.1,std=0.05,direction=90,direction_std=20,time=10800,seed=1",
    "series:interval=3600,north=0.1/0.2/0.1,east=0/0/0.05",
)  # fmt: skip


def digest(value: Any) -> str:
    """Hash arrays by name, a data set, a file's bytes, or a value that JSON can write."""
    total = hashlib.sha256()

    def add(name: str, array: np.ndarray) -> None:
        words = array.dtype == object
        total.update(name.encode() + (repr(array.tolist()).encode() if words else array.tobytes()))

    if isinstance(value, Path):
        total.update(value.read_bytes())
    elif hasattr(value, "data_vars"):
        for name in sorted(map(str, [*value.data_vars, *value.coords])):
            add(name, np.asarray(value[name].values))
    elif isinstance(value, Mapping):
        assert value, "nothing was made"
        for name in sorted(value):
            array = np.ascontiguousarray(value[name])
            add(f"{name}{array.dtype}{array.shape}", array)
    else:
        total.update(json.dumps(value, sort_keys=True, default=repr).encode())
    return total.hexdigest()[:16]


def attempted(make: Callable[..., Any], *given: Any, **named: Any) -> Any:
    """Return the result of a call, or the text of the error that it raises."""
    from twin.errors import TwinError

    try:
        return make(*given, **named)
    except TwinError as error:
        return str(error)


def flights() -> Values:
    """Fly every shipped vehicle by both engines."""
    import twin

    for vehicle in twin.vehicle_names():
        for name, settings in MISSIONS.items():
            for engine in ("mujoco", "lanes"):
                given = {"vehicle": vehicle, "engine": engine, "duration": SECONDS, **settings}
                yield f"{vehicle} {name} {engine}", attempted(twin.simulate, **given)


def currents() -> Values:
    """Sample each type of current at a thousand points of time and space."""
    from twin.water.current import parse_current

    chance = np.random.default_rng(5)
    low, high = np.array([[0.0, -5e3, -5e3, 0.0], [7.2e3, 5e3, 5e3, 300.0]])
    points = chance.uniform(low, high, (1000, 4))
    for text in CURRENTS:
        yield text, {"velocity": parse_current(text).velocity(*points.T)}


def runs() -> Values:
    """Generate a store; an interrupted and resumed store must have the same values."""
    import factory
    from factory.generation import generate
    from factory.sampling import make_recipe

    def interrupt(hours: float, failures: int) -> None:
        raise KeyboardInterrupt

    with tempfile.TemporaryDirectory() as folder:
        for engine in ("mujoco", "lanes"):
            out, half = Path(folder) / f"{engine}.zarr", Path(folder) / f"{engine}-half.zarr"
            settings: dict[str, Any] = {"hours": 2.0, "seed": 7, "engine": engine}
            factory.generate(out, preset="field", workers=2, **settings)
            recipe = make_recipe(preset="field", **settings)
            with contextlib.suppress(KeyboardInterrupt):
                generate(recipe, half, workers=2, watch=interrupt)
            assert not half.exists()
            generate(recipe, half, workers=2, resume=True)
            assert digest(xr.open_zarr(half)) == digest(xr.open_zarr(out)), "resumed otherwise"
            yield f"field {engine}", xr.open_zarr(out)


def imports() -> Values:
    """Import a log in every layout of samples."""
    from factory import samples
    from factory.importing import import_logs

    flight = samples.Flight(dives=2, surface=600.0, swing=1.0)
    for kind, layouts in samples.formats().items():
        for number, layout in enumerate(layouts):
            with tempfile.TemporaryDirectory() as folder:
                logs = f"{folder}/logs"  # some deployments are named after this folder
                samples.write(kind, logs, flight, layout=layout)
                given = samples.options(kind, logs, flight)
                dataset, report = import_logs(kind, [logs], **given)
                yield f"{kind}:{number}", dataset
                yield f"{kind}:{number} report", [repr(entry) for entry in report.entries]


def exports() -> Values:
    """Export a flown store in every format that needs no other package."""
    import factory
    from factory.exporting import EXPORTERS

    os.environ["SOURCE_DATE_EPOCH"] = "1700000000"
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run.zarr"
        factory.generate(out, preset="field", hours=0.5, seed=2, workers=1)
        for name in ("og1", "parquet", "mcap", "erddap"):
            paths = EXPORTERS[name].export(factory.open(out), [0], Path(folder) / name)
            for path in sorted(paths):
                yield f"{name} {path.name}", _exported(path, folder)


def _exported(path: Path, folder: str) -> Any:
    """Read an exported file: netCDF's values, or a text without the folder's name."""
    if path.suffix == ".xml":
        return path.read_text(encoding="utf-8").replace(folder, "")
    if path.suffix != ".nc":
        return path
    with xr.open_dataset(path, decode_times=False) as dataset:
        return dataset.load()


def networks() -> Values:
    """Train each type of network for two passes."""
    import factory
    import learn

    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "run.zarr"
        factory.generate(store, preset="paper", hours=2.0, seed=1, workers=2)
        for network in learn.NETWORKS.names():
            place = Path(folder) / network
            run = attempted(learn.fit, store, folder=place, network=network, epochs=2, members=1)
            yield network, run if isinstance(run, str) else _weights(place)


def _weights(folder: Path) -> dict[str, Any]:
    from safetensors.numpy import load_file

    return {
        f"{path.stem} {name}": values
        for path in sorted(folder.rglob("*.safetensors"))
        for name, values in load_file(path).items()
    }


FAMILIES: dict[str, Callable[[], Values]] = {
    "flights": flights, "currents": currents, "runs": runs, "imports": imports,
    "exports": exports, "networks": networks,
}  # fmt: skip


def made(only: Sequence[str]) -> dict[str, str]:
    """Hash each result of the families, by name; each hash is printed at once."""
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for family in only:
            for name, value in FAMILIES[family]():
                found[f"{family}: {name}"] = digest(value)
                print(f"{found[f'{family}: {name}']} {family}: {name}", flush=True)
    return found


def main(given: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", type=Path, help="JSON file for the hashes")
    parser.add_argument("--compare", type=Path, help="JSON file that --write made")
    parser.add_argument("--only", nargs="+", choices=FAMILIES, default=list(FAMILIES))
    options = parser.parse_args(given)
    logging.disable(logging.WARNING)
    found = made(options.only)
    if options.write:
        options.write.write_text(json.dumps(found, indent=1) + "\n")
    if not options.compare:
        return 0
    before = json.loads(options.compare.read_text())
    before = {n: h for n, h in before.items() if n.partition(":")[0] in options.only}
    names = [n for n in sorted({*before, *found}) if before.get(n) != found.get(n)]
    print("\n".join(f"DIFFERS {name}" for name in names))
    print(f"{len(found) - len([n for n in names if n in found])} of {len(before)} equal")
    return 1 if names else 0


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        sys.exit(main())
