"""Facade: the commands of `factory` as Python functions with plain arguments."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from factory.generation.generation import Summary
from factory.generation.generation import generate as _generate
from factory.sampling.distribution import Parameter
from factory.sampling.recipe import make_recipe
from twin.errors import InputError
from twin.plugins import entry_point, load_entry_point

if TYPE_CHECKING:
    from factory.importing.tally import ImportReport
    from twin.records.storage.sharded import AnyStore
    from twin.sensors import SensorSuite


def generate(
    out: str | Path | None = None,
    *,
    store: AnyStore | None = None,
    preset: str = "paper",
    hours: float | None = None,
    seed: int = 0,
    changes: Mapping[str, str | float] | None = None,
    vehicle: str = "glider",
    sensors: str | SensorSuite | None = None,
    current: str | None = None,
    engine: str = "mujoco",
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> Summary:
    """Fly randomised missions in parallel and store them; the bytes do not depend on the workers.

    Args:
      out: path of the store, or an address such as s3://bucket/missions.zarr.
      store: an empty zarr store, open for writing, instead of `out`. Missions are made in a
        temporary folder and copied. For a store with sessions, such as icechunk's, the caller must
        commit the session afterwards.
      preset: "paper", "field", "family" or "paper-test".
      hours: [h] of all missions together; None: 10, or the duration of the preset's missions.
      seed: root of every random draw.
      changes: distributions to replace, such as {"mission.pitch_deg": "uniform(15,35)"}.
      vehicle: shipped name, or the path of an MJCF file.
      sensors: suite, or its name, instead of the preset's.
      current: one current for all missions instead of sampled ones, as text.
      engine: "mujoco", or "lanes", the batched engine with the Fossen model.
      workers: number of processes; None: the number of CPUs that this process may use.
      executor: executor that flies missions instead; it must reach `out` by the same path.
      scheduler: address of a dask scheduler, such as tcp://127.0.0.1:8786, to fly missions instead.
      resume: complete an unfinished store; start the store if there is none.
      overwrite: replace an existing store.

    Raises:
      InputError: a name or value that cannot be used.
      StoreError: the store exists, or the disk refuses; finished missions are kept for `resume`.
      TwinError: a worker or a cluster was lost.
    """
    if (out is None) == (store is None):
        raise InputError("give either out, a path or an address, or store, an open zarr store")
    if store is not None and (resume or overwrite):
        raise InputError("resume and overwrite go with out: a zarr store must be empty")
    if scheduler is not None and executor is not None:
        raise InputError("give either a scheduler or an executor")
    recipe = make_recipe(
        preset=preset, hours=hours, seed=seed, changes=changes, vehicle=vehicle, sensors=sensors,
        current=current, engine=engine,
    )  # fmt: skip
    with contextlib.ExitStack() as stack:
        if scheduler is not None:
            from factory.generation.executors import dask_executor

            executor = stack.enter_context(dask_executor(scheduler))
        if store is not None:
            from factory.generation.generation import generate_into

            return generate_into(recipe, store, workers=workers, executor=executor)
        assert out is not None
        return _generate(
            recipe, out, workers=workers, executor=executor, resume=resume, overwrite=overwrite
        )


def parameters(vehicle: str | Path = "glider") -> dict[str, Parameter]:
    """List the parameters from which missions of a vehicle are sampled, with unit and reason.

    Args:
      vehicle: shipped name, or the path of an MJCF file.

    Raises:
      VehicleError: unknown name, or a file that cannot be used.
    """
    from factory.sampling.parameters import parameter_table
    from twin.vehicle.vehicle import load_vehicle

    return parameter_table(load_vehicle(vehicle))


def make_deployments(out: str | Path, *, preset: str = "faulty", **options: Any) -> Any:
    """Fly deployments of many dives, half of them with a fault; needs the plugin `ops`.

    Args:
      options: options of `glider_twin_ops.presets.make_deployments`.

    Returns:
      The store, and its numbers of deployments, faults, dives and days.

    Raises:
      InputError: the plugin is not installed, or refuses an option.
    """
    point = entry_point("glider_twin.deployments", "faulty")
    if point is None:
        raise InputError(
            f"preset {preset} comes with a plugin that is not installed: "
            "`pip install ./plugins/ops` in a clone"
        )
    return load_entry_point(point, f"preset {preset}")(out, preset=preset, **options)


def import_logs(
    kind: str,
    files: Sequence[str | Path],
    out: str | Path,
    *,
    overwrite: bool = False,
    **options: Any,
) -> ImportReport:
    """Read the logs of real vehicles, cut them into dives and store them.

    Args:
      kind: format of the logs, such as "slocum"; `factory import --help` lists all.
      files: files or folders.
      out: path of the store.
      overwrite: replace an existing store.
      options: options of `factory.importing.import_run.import_logs`, such as period [s] and rules.

    Returns:
      The import report.

    Raises:
      InputError: a file cannot be used; the message names the file and the reason.
      WriteError: `out` exists and may not be replaced, or the disk refuses.
    """
    from factory.importing.import_run import import_logs as read
    from twin.records.store import check_target, write_store

    target = Path(out)
    check_target(target, overwrite=overwrite)  # before the long work of reading
    dataset, report = read(kind, files, **options)
    write_store(dataset, target, overwrite=overwrite)
    return report
