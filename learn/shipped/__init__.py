"""Shipped networks: surge and sway of gliders and of propelled vehicles, trained on all of them.

`shipped_run` opens the networks that suit a vehicle as a `Run`, for any sample period from 0.5 to
30 s. They run without torch. `scripts/ship_networks.py` makes them; the entry `card` of their
`run.json` tells recipe, seeds, hash and licence.
"""

from __future__ import annotations

from collections.abc import Collection

from learn.run import SHIPPED as FOLDER
from learn.run import Run, read_description
from learn.shipped.inputs import GROUPS as GROUPS
from learn.shipped.inputs import MISSING as MISSING
from learn.shipped.inputs import SORTS as SORTS
from learn.shipped.inputs import substituted as substituted
from twin.errors import InputError
from twin.navigation.features import channels_of
from twin.navigation.flight_filter import FlightFilter
from twin.navigation.settings import sources
from twin.vehicle.vehicle import Vehicle

PERIODS = (0.5, 30.0)
"""[s] Shortest and longest sample period in the training"""


def shipped_run(
    vehicle: Vehicle, period: float, channels: Collection[str] | None = None
) -> tuple[Run, tuple[str, ...]]:
    """Open the shipped networks for a vehicle.

    Args:
      vehicle: vehicle of the store or log, with the parameters of its file.
      period: [s] between samples.
      channels: channels that there are; None: all.

    Returns:
      The run, and the channels of MISSING that `substituted` must replace.

    Raises:
      InputError: no shipped networks suit the vehicle, the period or the channels.
    """
    sort = "propelled" if vehicle.steered("speed") is not None else "gliders"
    if not (FOLDER / sort).is_dir():
        raise InputError(f"no networks of {sort} vehicles are shipped; train some: `learn fit`")
    why = FlightFilter.unsuited(vehicle) if sort == "gliders" else ""
    if sort == "propelled" and vehicle.model not in _models(sort):
        why = f"its model {vehicle.model!r} is none of {', '.join(_models(sort))}"
    if not PERIODS[0] <= period <= PERIODS[1]:
        why = f"a sample every {period:g} s is outside of {PERIODS[0]:g} to {PERIODS[1]:g} s"
    needed = sources(channels_of(Run(FOLDER / sort, read_description(FOLDER / sort)).features))
    absent = () if channels is None else tuple(c for c in needed if c not in channels)
    if lost := [c for c in absent if not any(c in group for group in MISSING.values())]:
        why = f"there is no channel {lost[0]}"
    if why:
        raise InputError(
            f"no shipped networks suit vehicle {vehicle.name!r}: {why}; train some of your own "
            "(`learn fit --scratch`)"
        )
    folder = FOLDER / (f"{sort}-lacking" if absent else sort)
    return Run(folder, read_description(folder)).at(period), absent


def _models(sort: str) -> tuple[str, ...]:
    return tuple(read_description(FOLDER / sort)["card"]["models"])
