"""Facade: what the commands of `factory` do, as functions of plain values."""

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
    """Fly randomised missions in parallel and store them; the same bytes whoever flies them.

    Args:
      out: the store: a path, or an address such as s3://bucket/missions.zarr.
      store: instead of `out`, a zarr store that is empty and open for writing. Missions are made in
        a temporary folder of this machine and copied. Nothing is committed: a store with sessions,
        as icechunk has, keeps them by one commit of its own.
      preset: "paper", "field", "family" or "paper-test".
      hours: [h] of all missions together; None: 10, or what the preset's missions last.
      seed: root of every random draw.
      changes: distributions to replace, such as {"mission.pitch_deg": "uniform(15,35)"}.
      vehicle: shipped name, or the path of an MJCF file.
      sensors: suite, or its name, instead of the preset's.
      current: one current for all missions instead of drawn ones, as text.
      engine: what flies the missions: "mujoco", or "lanes", the Fossen model side by side.
      workers: processes; None: the CPUs that this process may use.
      executor: what flies missions instead of such processes; it must reach `out` by the same path.
      scheduler: address of a dask scheduler whose workers do, such as tcp://127.0.0.1:8786.
      resume: complete a store that an earlier run left incomplete; start it if there is none.
      overwrite: replace an existing store.

    Raises:
      InputError: a name or value that cannot be used. StoreError: something is in the way, or the
        disk refuses; finished missions are kept for `resume`. TwinError: a worker or a cluster was
        lost.
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
    """Everything that missions of a vehicle are drawn from, with unit and reason, by name.

    Args:
      vehicle: shipped name, or the path of an MJCF file.

    Raises:
      VehicleError: unknown name, or a file that cannot be used.
    """
    from factory.sampling.parameters import parameter_table
    from twin.vehicle.vehicle import load_vehicle

    return parameter_table(load_vehicle(vehicle))


def make_deployments(out: str | Path, *, preset: str = "faulty", **options: Any) -> Any:
    """Fly deployments of many dives, half of them with a fault, by the plugin `ops`.

    Args:
      options: of `glider_twin_ops.presets.make_deployments`.

    Returns:
      The store, and how many deployments, faults, dives and days are in it.

    Raises:
      InputError: the plugin is not installed, or cannot do as it is asked.
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
      kind: name of the kind of log, such as "slocum"; `factory import --help` lists them.
      files: files or folders.
      out: the store.
      overwrite: replace an existing store.
      options: of `factory.importing.import_run.import_logs`, such as period [s] and rules.

    Returns:
      What was done to the logs.

    Raises:
      InputError: a file cannot be used; the message names it and says why. WriteError: something
        is in the way of the store, or the disk refuses.
    """
    from factory.importing.import_run import import_logs as read
    from twin.records.store import check_target, write_store

    target = Path(out)
    check_target(target, overwrite=overwrite)  # refuses before anything is read
    dataset, report = read(kind, files, **options)
    write_store(dataset, target, overwrite=overwrite)
    return report
