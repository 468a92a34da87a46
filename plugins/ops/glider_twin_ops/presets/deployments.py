"""Deployments: a store of logs of simulated deployments, half of them with a fault.

    make_deployments("faulty.zarr", vehicle="slocum-200", hours=2000.0, seed=3)

The store has the form that `factory import` writes, so that every reader of logs reads it. Its
dimension `deployment` holds each fault's type, first dive and size.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from factory.generation import local_pool
from factory.importing import (
    EMPTY,
    Channel,
    DeploymentLog,
    DiveRules,
    LoggedFixes,
    Tally,
    dives_dataset,
)
from glider_twin_ops.presets.deployment import (
    DeploymentDraw,
    DeploymentPlan,
    faulty_of,
    fly_deployments,
)
from twin import SensorSuite, Vehicle, load_vehicle
from twin.errors import InputError, MissionError, TwinError
from twin.geodesy import position, wrap_longitude
from twin.numbers import Array, processors
from twin.records import check_target, is_store, read_zarr, unix_seconds, write_zarr
from twin.records.attributes import DEPLOYMENT, DIVE, DIVE_DURATION, START_TIME, VEHICLE_MJCF
from twin.records.schema import MISSION, TIME, VARIABLES
from twin.records.storage import whole_folder
from twin.vehicle.parts import Fin

if TYPE_CHECKING:
    import xarray as xr

SATELLITE_SIGNALS = (
    "measured_depth", "measured_pressure", "measured_pitch", "measured_roll", "measured_heading",
    "measured_pump", "measured_shift", "measured_rotation", "measured_fin", "measured_vacuum",
    "measured_voltage", "measured_charge", "commanded_heading", "commanded_pitch",
)  # fmt: skip
"""Signals that are sent by satellite"""
UNLOGGED = ("measured_gps", "measured_dvl", "measured_specific", "measured_onboard")
"""First letters of signals that no glider logs, or that are logged as fixes"""
CHUNK = 8
"""Number of deployments that fly together in one batch"""
ATTEMPTS = 20
"""Maximum number of attempts to sample a deployment that can be flown"""
FAULT_KIND, FAULT_ONSET, FAULT_SIZE = "fault_kind", "fault_onset_dive", "fault_size"
LABELS, NAME = "fault_labels", "deployment_name"
"""Variables. LABELS: each deployment's fault with all settings, as JSON. NAME: deployment's name"""
HEALTHY = "none"
"""Type of fault of a deployment without one"""
KIND = "simulated"
"""Type of log in the store"""


class MadeDeployments(NamedTuple):
    """Summary of a store that was made."""

    store: Path
    deployments: int
    faulty: int
    dives: int
    days: float


def make_deployments(
    out: str | Path,
    *,
    vehicle: Vehicle | str = "slocum-200",
    preset: str = "faulty",
    hours: float | None = None,
    count: int | None = None,
    seed: int = 0,
    kinds: Sequence[str] = (),
    size: float | None = None,
    workers: int | None = None,
    overwrite: bool = False,
    watch: Callable[[float], None] = lambda hours: None,
) -> MadeDeployments:
    """Make a store of deployments, whole or not at all; equal bytes for any number of workers.

    Args:
      hours: [h] least duration of all deployments together; or `count`, their number. An even
        number is made, of which exactly half have a fault.
      kinds: types of faults that are sampled, by default all that the vehicle can have.
      size: size of the faults, by default sampled from their type's range.
      watch: called with the hours that are done, which add up to `hours` where that is given.

    Raises:
      InputError: nothing to make, or a fault that the vehicle cannot have. WriteError: the target
        exists. TwinError: no sample of a deployment can be flown.
    """
    check_target(out, overwrite=overwrite)
    plan = DeploymentPlan(
        vehicle=load_vehicle(vehicle) if isinstance(vehicle, str) else vehicle,
        preset=preset, seed=seed, kinds=tuple(kinds), size=size,
    )  # fmt: skip
    asked = 240.0 if hours is None else hours
    if count is None:
        draws = _lasting(plan, asked)
    elif count < 2:
        raise InputError(f"{count} deployments: give at least 2, one of which has a fault")
    else:
        draws = [first_draw(plan, index) for index in range(count + count % 2)]
    pieces = [draws[first : first + CHUNK] for first in range(0, len(draws), CHUNK)]
    # whole deployments last longer than `hours`
    share = asked / sum(draw.scenario.run_time() / 3600.0 for draw in draws) if not count else 1.0
    with whole_folder(out, overwrite=overwrite, ours=is_store) as folder:
        beside = folder.parent / "pieces"
        beside.mkdir()
        files = [beside / f"{k}.zarr" for k in range(len(pieces))]
        jobs = [(plan, piece, file) for piece, file in zip(pieces, files, strict=True)]
        processes = min(workers or processors(), len(jobs))
        with local_pool(processes) if processes > 1 else contextlib.nullcontext() as pool:
            for made in map(_piece, jobs) if pool is None else pool.map(_piece, jobs):
                watch(share * made)
        dives, days, faulty = _joined(files, folder)
    return MadeDeployments(Path(out), len(draws), faulty, dives, days)


def _lasting(plan: DeploymentPlan, hours: float) -> list[DeploymentDraw]:
    """Sample an even number of deployments that last `hours` [h] together."""
    if not 0.0 < hours < 1e9:
        raise InputError(f"--hours {hours:g} must be above 0 and below 1e9")
    total, draws = 0.0, list[DeploymentDraw]()
    while total < 3600.0 * hours or len(draws) % 2:
        draws.append(first_draw(plan, len(draws)))
        total += draws[-1].scenario.run_time()
    return draws


def first_draw(plan: DeploymentPlan, index: int, attempt: int = 0) -> DeploymentDraw:
    """First sample of a deployment, from an attempt on, that the vehicle's guidance can fly."""
    faulty, problem = faulty_of(plan.seed, index), ""
    for again in range(attempt, ATTEMPTS):
        try:
            return plan.draw(index, again, faulty)
        except TwinError as error:
            if isinstance(error, InputError) and not isinstance(error, MissionError):
                raise  # the request is wrong, not the sample
            problem = str(error)
    raise TwinError(f"deployment {index}: {ATTEMPTS} draws cannot be flown; the last: {problem}")


def flown_logs(
    plan: DeploymentPlan, draws: Sequence[DeploymentDraw]
) -> list[tuple[DeploymentDraw, DeploymentLog]]:
    """Fly deployments; return each with its log, in order.

    A deployment that fails in flight is sampled and flown again.
    """
    suite = SensorSuite.preset("field")
    waiting = list(draws)
    found: dict[int, tuple[DeploymentDraw, DeploymentLog]] = {}
    while waiting:
        again = []
        for place, signals in fly_deployments(waiting, suite):
            draw = waiting[place]
            if isinstance(signals, TwinError):
                again.append(first_draw(plan, draw.number, draw.attempt + 1))
            else:
                found[draw.number] = draw, log_of(draw, signals, plan)
        waiting = again
    return [found[draw.number] for draw in draws]


def log_of(draw: DeploymentDraw, signals: dict[str, Array], plan: DeploymentPlan) -> DeploymentLog:
    """Log of a flight's signals."""
    place, vehicle = draw.scenario.place, draw.scenario.vehicle
    time = unix_seconds(str(place.time)) + signals["time"]
    rudders = {f"measured_{part.name}" for part in vehicle.parts if isinstance(part, Fin)}
    channels: dict[str, Channel] = {}
    for name, values in signals.items():
        known = "measured_fin" if name in rudders else name
        if known not in VARIABLES or known.startswith(UNLOGGED) or known.endswith("_rate"):
            continue
        finite = np.isfinite(values)
        if finite.any() and (plan.period < 60.0 or known in SATELLITE_SIGNALS):
            channels[known] = Channel(time[finite], values[finite])
    dive = np.nan_to_num(signals["commanded_segment"]).astype(int) // 2
    if plan.piloted:
        channels = draw.gaps.applied(channels, time, dive)
    north, east = signals["measured_gps_north"], signals["measured_gps_east"]
    fixed = np.flatnonzero(np.isfinite(north))
    origin = place.latitude_deg, place.longitude_deg
    latitude, longitude = position(north[fixed], east[fixed], *origin)
    return DeploymentLog(
        deployment=draw.name,
        platform=f"simulated {vehicle.name}",
        channels=channels,
        fixes=LoggedFixes(time[fixed], latitude, wrap_longitude(longitude)),
        magnetic_variation=EMPTY,
        auxiliary=draw.gaps.ran(time, dive),
        simulated=True,
        station=True,
    )


def _piece(job: tuple[DeploymentPlan, Sequence[DeploymentDraw], Path]) -> float:
    """Fly a chunk of deployments into a store of its own; return their hours [h]."""
    plan, draws, path = job
    flown = flown_logs(plan, draws)
    write_zarr(dataset_of_logs(flown, plan), path)
    return sum(draw.scenario.run_time() for draw, _ in flown) / 3600.0


def dataset_of_logs(
    flown: Sequence[tuple[DeploymentDraw, DeploymentLog]], plan: DeploymentPlan
) -> xr.Dataset:
    """Data set of deployments as `factory import` stores logs, with their faults."""
    import xarray as xr

    parts = [  # one by one: together they would be sorted by time
        dives_dataset(
            [log], kind=KIND, period=plan.period, rules=DiveRules(), tally=Tally(),
            files=[log.deployment],
        )[0]
        for _, log in flown
    ]  # fmt: skip
    how: dict[str, Any] = {"combine_attrs": "override", "compat": "override", "join": "outer"}
    dataset = xr.concat(parts, MISSION, data_vars="minimal", coords="minimal", **how)
    dataset = dataset.assign_coords({MISSION: np.arange(dataset.sizes[MISSION])})
    labels: tuple[tuple[str, type, str, list[Any]], ...] = (
        (FAULT_KIND, object, "fault; none: it is healthy", [d.kind for d, _ in flown]),
        (FAULT_ONSET, float, "number of the first dive with the fault, as in `dive`; NaN where it "
         "is healthy", [_onset(d, one) for (d, _), one in zip(flown, parts, strict=True)]),
        (FAULT_SIZE, float, "size of the fault in its kind's unit; NaN where it is healthy",
         [math.nan if d.fault is None else d.fault.size for d, _ in flown]),
        (LABELS, object, "JSON of the fault with all of its settings",
         [json.dumps({} if d.fault is None else d.fault.describe()) for d, _ in flown]),
        (NAME, object, "name, as in `deployment`", [d.name for d, _ in flown]),
    )  # fmt: skip
    # the dimension shares its name with an array over missions, which `assign` would overwrite
    variables = {str(name): dataset[name].variable for name in dataset.variables}
    added: dict[str, Any] = {
        name: (DEPLOYMENT, np.array(values, kind), {"long_name": says})
        for name, kind, says, values in labels
    }
    found = xr.Dataset(
        {**variables, **added}, attrs={**dataset.attrs, VEHICLE_MJCF: plan.vehicle.xml}
    )
    return found.set_coords([str(name) for name in dataset.coords])


def _onset(draw: DeploymentDraw, dives: xr.Dataset) -> float:
    """Number of the log's first dive with the fault."""
    if draw.fault is None:
        return math.nan
    begin = unix_seconds(str(draw.scenario.place.time)) + draw.fault.start
    ends = np.asarray(dives[START_TIME], float) + np.asarray(dives[DIVE_DURATION], float)
    later = np.flatnonzero(ends > begin)
    return float(dives[DIVE][later[0]]) if later.size else math.nan


def _joined(files: Sequence[Path], folder: Path) -> tuple[int, float, int]:
    """Join stores of deployments into one; return dives, days and faulty deployments.

    One store is in memory at a time.
    """
    import xarray as xr

    parts = [read_zarr(path) for path in files]
    longest = max(parts, key=lambda part: part.sizes[TIME])
    known: dict[str, xr.Variable] = {}
    for part in parts:
        known |= {str(name): part[name].variable for name in part.variables}
    labels = [name for name, one in known.items() if DEPLOYMENT in one.dims]
    begun, days, faulty = 0, 0.0, 0
    for part in parts:
        count = part.sizes[MISSION]
        whole = part.load().drop_vars([*labels, TIME])
        whole = whole.pad({TIME: (0, longest.sizes[TIME] - part.sizes[TIME])})
        for name in known.keys() - set(map(str, whole.variables)) - {*labels, TIME}:
            one = known[name]
            shape = [count if d == MISSION else longest.sizes[TIME] for d in one.dims]
            whole[name] = (one.dims, np.full(shape, np.nan, one.dtype), one.attrs)
        whole = whole.assign_coords({
            MISSION: (MISSION, begun + np.arange(count), known[MISSION].attrs),
            TIME: longest[TIME],
        })  # fmt: skip
        write_zarr(whole, folder, along=MISSION if begun else None)
        begun += count
        days += float(np.nansum(part[DIVE_DURATION])) / 86400.0
        faulty += sum(str(kind) != HEALTHY for kind in part[FAULT_KIND].values)
    told = xr.concat(
        [part[labels].drop_vars(MISSION, errors="ignore") for part in parts], DEPLOYMENT
    )
    write_zarr(told.drop_vars(DEPLOYMENT, errors="ignore"), folder, beside=True)
    return begun, days, faulty
