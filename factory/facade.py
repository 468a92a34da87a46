"""Facade: what the commands of `factory` do, as functions of plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from factory.generation.generate import Summary
from factory.generation.generate import generate as _generate
from factory.recipe.parameter import Parameter
from factory.recipe.recipe import make_recipe

if TYPE_CHECKING:
    from factory.importing.reading.tally import ImportReport
    from twin.sensors import SensorSuite


def generate(
    out: str | Path,
    *,
    preset: str = "paper",
    hours: float | None = None,
    seed: int = 0,
    changes: Mapping[str, str | float] | None = None,
    vehicle: str = "glider",
    sensors: str | SensorSuite | None = None,
    current: str | None = None,
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> Summary:
    """Fly randomised missions in parallel and store them; the same bytes for any `workers`.

    Args:
      out: the store.
      preset: "paper", "field" or "paper-test".
      hours: [h] of all missions together; None: 10, or what the preset's missions last.
      seed: root of every random draw.
      changes: distributions to replace, such as {"mission.pitch_deg": "uniform(15,35)"}.
      vehicle: shipped name, or the path of an MJCF file.
      sensors: suite, or its name, instead of the preset's.
      current: one current for all missions instead of drawn ones, as text.
      workers: processes; None: the CPUs that this process may use.
      resume: complete a store that an earlier run left incomplete; start it if there is none.
      overwrite: replace an existing store.

    Raises:
      InputError: a name or value that cannot be used. StoreError: something is in the way, or the
        disk refuses; finished missions are kept for `resume`.
    """
    recipe = make_recipe(
        preset=preset,
        hours=hours,
        seed=seed,
        changes=changes,
        vehicle=vehicle,
        sensors=sensors,
        current=current,
    )
    return _generate(recipe, out, workers=workers, resume=resume, overwrite=overwrite)


def parameters(vehicle: str | Path = "glider") -> dict[str, Parameter]:
    """Everything that missions of a vehicle are drawn from, with unit and reason, by name.

    Args:
      vehicle: shipped name, or the path of an MJCF file.

    Raises:
      VehicleError: unknown name, or a file that cannot be used.
    """
    from factory.recipe.parameters import parameter_table
    from twin.vehicle.vehicle import load_vehicle

    return parameter_table(load_vehicle(vehicle))


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
      kind: "slocum", "seaglider", "seaexplorer", "og1" or "lrauv".
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
