"""Adaptation: fit a run to one vehicle from its first dives, without training its networks again.

The fit finds the hull's seven constants (`twin.navigation.flight_fit`). A second flight filter
starts from them, and in steady glides its surge is mixed with the networks'. The networks and the
flight filter that they read stay unchanged.
"""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import MissionSequence, Selection
from learn.run import ADAPTATION, METRICS, Run, open_run, write_description
from learn.run_folder import is_run
from twin.errors import InputError
from twin.identify.logged_missions import NEEDED
from twin.navigation.dead_reckoning import find_dives
from twin.navigation.features import channels_of
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.flight_filter_kernels import CHANNELS
from twin.navigation.flight_fit import FlightFit, Glides, adapt_flight, steady_glides
from twin.navigation.settings import ESTIMATED
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.records.storage.whole import whole_folder

Adapting = Literal["none", "dvl"]
"""Velocities to fit: the vertical velocity from depth alone, or also a Doppler log's water track"""
LOG_CHANNELS = tuple(f"measured_dvl_{name}" for name in ("surge", "sway", "heave", "mode"))
FIXES = ("measured_gps_north", "measured_gps_east")
FILTER_ONLY = frozenset(CHANNELS) - frozenset(NEEDED)
"""Channels that only the flight filter reads, not `twin identify`: rates, accelerations, density"""


def adapt(
    run: Run | str | Path,
    store: str | StorePath,
    folder: str | Path,
    *,
    missions: Sequence[int] = (),
    dives: int = 5,
    labels: Adapting = "none",
    overwrite: bool = False,
) -> tuple[Run, FlightFit]:
    """Copy a run and adapt the copy to a vehicle from its first dives.

    Args:
      run: a `Run`, or a run's folder or name; its networks must read the flight filter.
      store: dives of this one vehicle, simulated or logged.
      folder: folder of the new run.
      missions: rows of the store to use; empty uses all.
      dives: largest number of dives to use, from the first on.
      labels: `dvl` also uses the Doppler log.
      overwrite: replace a run in `folder`.

    Returns:
      The new run and the fit, which is judged on dives that were left out of it. If the vehicle
      file's constants predict these better, the new run behaves like the original.

    Raises:
      InputError: the networks do not read the flight filter, or the dives do not suffice.
      StoreError: a channel is missing.
      WriteError: `folder` holds something other than a run.
    """
    run, folder = (run if isinstance(run, Run) else open_run(run)), Path(folder)
    glides = first_glides(run, store, missions=missions, dives=dives, labels=labels)
    with MissionStore(store) as reader:
        flight = FlightFilter(reader.vehicle, run.period)
    fit = adapt_flight(flight, glides, log=labels == "dvl")
    found: dict[str, Any] = {
        "store": str(store), "dives": len(glides), "labels": labels, "from": str(run.folder),
        **dataclasses.asdict(fit),
    }  # fmt: skip
    with whole_folder(folder, overwrite=overwrite, ours=is_run) as place:
        for name in (*run.network_files, METRICS):
            if (run.folder / name).is_file():
                shutil.copy2(run.folder / name, place / name)
        write_description(place, {**run.description, ADAPTATION: found})
    return Run(folder, {**run.description, ADAPTATION: found}), fit


def first_glides(
    run: Run,
    store: str | StorePath,
    *,
    missions: Sequence[int] = (),
    dives: int = 5,
    labels: Adapting = "none",
) -> list[Glides]:
    """Steady glides in each of a store's first dives; arguments and errors as in `adapt`."""
    if not set(channels_of(run.features)) & set(ESTIMATED):
        raise InputError(
            f"the networks of run {run.name} do not read the flight filter, through which they "
            "adapt: train on a store of a glider with a CTD (`factory generate --preset family`)"
        )
    if dives < 1:
        raise InputError(f"--dives {dives}: adapting takes at least one dive")
    wanted = [*ESTIMATED, "measured_heading", *(LOG_CHANNELS if labels == "dvl" else ())]
    with MissionStore(store) as reader:
        wanted += [name for name in FIXES if name in reader]
    found: list[Glides] = []
    with Selection(store, wanted, period=run.period, advise=advice_on) as selection:
        assert selection.vehicle is not None  # estimated channels are among the wanted
        flight = FlightFilter(selection.vehicle, run.period, run.spread)
        rows = selection.rows.tolist()
        if unknown := sorted(set(missions) - set(rows)):
            raise InputError(f"store {store} has no mission {unknown[0]}: it has {len(rows)}")
        places = [k for k, row in enumerate(rows) if not missions or row in missions]
        for mission in selection.each(places):
            spans = dive_spans(mission, logged=selection.logged)[: dives - len(found)]
            found += steady_glides(flight, mission.signals, spans, log=labels == "dvl")
            if len(found) >= dives:
                break
    return found


def advice_on(channels: Iterable[str]) -> str:
    """Advice for an error about missing channels; empty if only a more complete log helps.

    Networks without these inputs are no alternative: they do not read the flight filter.
    """
    lost = set(channels)
    if lost <= set(LOG_CHANNELS):
        return ", or adapt by the depth rate alone: `--labels none`"
    if lost - set(LOG_CHANNELS) <= FILTER_ONLY:
        return (
            ". The flight filter, through which a run adapts, reads it; `twin identify` fits a "
            "glider's parameters without it"
        )
    return ""


def dive_spans(mission: MissionSequence, *, logged: bool) -> list[slice]:
    """Slices of a mission's samples, one per dive; a logged row is a single dive."""
    signals: Mapping[str, NDArray[np.float64]] = mission.signals
    spans = [] if logged else [dive.span for dive in find_dives(signals, mission.period)]
    return spans or [slice(0, mission.samples)]
