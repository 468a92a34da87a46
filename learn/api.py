"""API: the functions of `import learn`, which train, evaluate and export networks.

The functions return values and print nothing. The command line calls them too.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learn.data.stores import Stores
from learn.finishing import check_finish, finish
from learn.report.contents import RunEvaluation
from learn.run import RUNS, Run, free_name, open_run
from learn.run_evaluation import LEAST_JUDGED, Say, evaluate_run, further_missions
from learn.run_folder import training_folder
from learn.training import fitting
from learn.training.fit_config import fit_settings
from learn.training.fitting import Watch
from learn.training.resources import training_resources
from twin.errors import InputError, unknown_name
from twin.extras import require
from twin.records.storage.store_path import StorePath

if TYPE_CHECKING:
    from learn.evaluation.evaluation import Watch as EvaluationWatch
    from learn.networks.onnx_export import Parity


def fit(
    store: str | StorePath | Stores | None = None,
    *,
    folder: str | Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
    workers: int | None = None,
    executor: Executor | None = None,
    memory: float | None = None,
    watch: Watch | None = None,
    say: Say = lambda _: None,
    history: str = "",
    report: bool = True,
    **settings: Any,
) -> Run:
    """Train networks for surge and sway on a store, evaluate them and write a report.

    Args:
      store: missions or logs of one vehicle, or several stores of simulated missions, each of one
        vehicle; None is data/missions.zarr or, with `resume`, the run's own store.
      folder: folder of the run; None creates one in runs/, named by date and number.
      resume: continue the run in `folder` with its own settings; start it if there is none.
      overwrite: replace the run in `folder` once the new one is trained; with `resume`, an
        interrupted replacement continues.
      workers: number of processes; None or 1 trains in this process. More processes need the
        script's main part behind `if __name__ == "__main__"`.
      executor: a `concurrent.futures` executor, or a dask client's, that trains instead of local
        processes. Its workers must reach `folder` and `store` by the same paths.
      memory: [GB] limit for the training data, see `learn.training.resources`; a larger store is
        streamed, with the same result.
      watch: called as watch(job, report) at every validation of every network.
      say: called with each warning, and with each step after the training, as text.
      history: a line for the record, such as the command.
      report: evaluate the networks and write the report; if not, call `learn.finishing.finish`.
      settings: fields of `FitSettings`.

    Returns:
      The run, with `folder`, `figures` and `predict`.

    Raises:
      InputError: a setting is wrong, or the folder holds another run.
      StoreError: the store cannot be used.
    """
    path = RUNS / free_name() if folder is None else Path(folder)
    place = training_folder(path, replace=overwrite)
    config = fit_settings(store, resumed=place if resume else None, **settings)
    for one in config.stores if report else ():
        check_finish(one)
    workers = 1 if workers is None and executor is None else workers
    with training_resources(workers, executor, memory) as resources:
        run = fitting.fit(
            config, path, resources, resume=resume, replace=overwrite, watch=watch, warn=say,
            say=say, history=history,
        )  # fmt: skip
    return finish(run, history=history, say=say) if report else run


def evaluate(
    run: Run | str | Path,
    store: str | StorePath | None = None,
    *,
    split: str = "test",
    baselines: Sequence[str] | None = None,
    watches: Sequence[EvaluationWatch] = (),
    least: int = LEAST_JUDGED,
    say: Say = lambda _: None,
) -> RunEvaluation:
    """Evaluate a run on a store, next to the baselines and a lower bound of the error.

    Args:
      run: a `Run`, or a run's folder or name.
      store: missions or logs; None is the run's own store.
      split: test, train, validation or all.
      baselines: names of velocity estimators; None runs all, an empty sequence none.
      watches: functions called with every mission of the store and all its estimates.
      least: least number of missions to judge by. What the split lacks is flown by the store's
        recipe with a seed of its own; 0 judges by the store's missions alone.
      say: called with a sentence before such flights.

    Returns:
      The evaluation; `figures` maps names to errors in m/s and in % of the path length.

    Raises:
      InputError: no such run or baseline.
      StoreError: a file of the run or of the store cannot be used.
    """
    found = run if isinstance(run, Run) else open_run(run)
    place = found.store if store is None else store
    with tempfile.TemporaryDirectory(prefix="glider-twin-") as elsewhere:
        own = () if found.shipped else found.stores
        kept = found.folder if place in own else Path(elsewhere)
        further = further_missions(place, split, kept, least=least, say=say)
        return evaluate_run(
            found, place, split=split, baselines=baselines, watches=watches, further=further
        )


EXPORTS = ("onnx", "c")
"""Formats that `export` writes."""


def export(
    run: Run | str | Path,
    folder: str | Path | None = None,
    *,
    to: str = "onnx",
    store: str | StorePath | None = None,
) -> dict[str, Parity]:
    """Export a run's networks for on-board use, and compare them with the originals over a mission.

    Args:
      run: a `Run`, or a run's folder or name.
      folder: folder of the files; None is onnx/ or c/ in the run's folder.
      to: `onnx` for one model per network, which computes one time step with explicit state; `c`
        for one C99 header that computes surge and sway from sensor samples.
      store: store whose longest mission is used for the comparison; None is the run's own.

    Returns:
      Each file with its difference from the network, by network name (such as surge-0), or under
      `velocity` for C.

    Raises:
      InputError: the extra onnx is not installed; torch cannot export the network; or there is no
        C compiler, or no C code of the network or of a feature.
      StoreError: a file differs by more than 1e-5 m/s, or cannot be read or written.
    """
    if to not in EXPORTS:
        raise InputError(unknown_name("export", to, EXPORTS))
    for package in ("onnx", "onnxscript", "onnxruntime") if to == "onnx" else ():
        require(package, extra="onnx", purpose="learn export")
    from learn.data.dataset import Selection
    from twin.navigation.features import channels_of
    from twin.records.reader import MissionStore

    found = run if isinstance(run, Run) else open_run(run)
    target = found.folder / to if folder is None else Path(folder)
    place = found.store if store is None else store
    with MissionStore(place) as reader:
        found = found.at(reader.period) if found.shipped else found
        networks = found.networks(reader.vehicle, plain=False)
    channels = [c for e in networks.values() for c in channels_of(e.members[0].features)]
    surge = networks["surge"]
    with Selection(
        place, channels, period=found.period, start=surge.start, spread=surge.spread
    ) as selection:
        (longest,) = selection.read([int(selection.lengths.argmax())])
        vehicle = selection.vehicle
    if to == "c":
        from learn.networks.c_export import NAME, export_c

        return {"velocity": export_c(networks, target / NAME, longest, vehicle)}
    from learn.networks.onnx_export import export_step

    return {
        f"{name}-{k}": export_step(member, target / f"{name}-{k}.onnx", longest)
        for name, ensemble in networks.items()
        for k, member in enumerate(ensemble.members)
    }
