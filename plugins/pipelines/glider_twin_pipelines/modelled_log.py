"""Modelled log: what a flight model says of the log in some files, at any times, in OG1.0's names.

    (log,) = modelled("seaglider", ["p5610002.nc", "p5610003.nc"], "mine.xml")
    log.at(times)["VERT_CURR_MODEL"].values

Speed, angle of attack, vertical velocity of the water, currents and the corrected track are those
that `factory export --to og1` writes for the same log.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1 import (
    FlownTracks,
    JoinedDives,
    Og1Variable,
    corrected_places,
    flight_variables,
    flown,
)
from factory.importing import import_logs
from twin import __version__
from twin.errors import TwinError
from twin.identify import start_vehicle
from twin.logs import DiveCurrent, place_of, summarise
from twin.records import LogStore, write_store

Array = NDArray[np.float64]

POSITIONS = ("LATITUDE", "LONGITUDE", "POSITION_SD")
"""Variables of the corrected track"""
CURRENTS = ("DAC_NORTH_MODEL", "DAC_EAST_MODEL", "DAC_SD_MODEL")
"""Held from fix to fix; all other variables are linear between the samples of the store"""
W = "VERT_CURR_MODEL"
"""The vertical velocity of the water"""
_OF_THEIR_FILE = ("ancillary_variables", "coordinates")
"""Attributes that name other variables of an OG1.0 file"""
LONGEST_STEP = 1.5
"""Periods of the store between two samples of one dive"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlacedCurrent:
    """The depth-averaged current of a dive, with the place of its middle on the track."""

    current: DiveCurrent
    latitude: float
    longitude: float
    """[degree]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ModelledLog:
    """One deployment, on the samples of its dives."""

    deployment: str
    model: str
    """Which flight model"""
    time: Array
    """[s] unix, increasing, (samples,)"""
    period: float
    """[s] of the store"""
    variables: dict[str, Og1Variable]
    """By OG1.0's name, values (samples,), NaN where missing"""
    fixes: tuple[Array, Array]
    """Latitude and longitude [degree] of the fixes that the track goes through, each (fix,)"""
    currents: tuple[PlacedCurrent, ...]
    doubt: str
    """Why the vehicle does not fit the log; empty where it does"""

    def at(self, times: Array) -> dict[str, Og1Variable]:
        """The variables at unix times [s], NaN between and beyond the dives and where NaN.

        Each has an attribute `source` that begins with `glider-twin`.
        """
        right = np.clip(np.searchsorted(self.time, times, side="right"), 1, len(self.time) - 1)
        left = right - 1
        step = self.time[right] - self.time[left]
        share = np.clip((times - self.time[left]) / step, 0.0, 1.0)
        with np.errstate(invalid="ignore"):
            inside = (times >= self.time[left]) & (times <= self.time[right])
            inside &= (step <= LONGEST_STEP * self.period) | (share == 0.0) | (share == 1.0)
            nearest = np.where(share < 0.5, left, right)
        found = {}
        for name, one in self.variables.items():
            values = np.asarray(one.values, float)
            if name in CURRENTS:
                made = values[nearest]
            else:
                change = values[right] - values[left]
                if name == "LONGITUDE":
                    change = (change + 180.0) % 360.0 - 180.0
                made = values[left] + share * change
                made = np.where(share == 0.0, values[left], made)
                made = np.where(share == 1.0, values[right], made)
                if name == "LONGITUDE":
                    made = np.where(np.abs(made) > 180.0, made - np.sign(made) * 360.0, made)
            about = {k: v for k, v in one.attributes.items() if k not in _OF_THEIR_FILE}
            about["source"] = f"glider-twin {__version__}, {self.model}"
            if name == W and self.doubt:
                about["comment"] = self.doubt
            found[name] = dataclasses.replace(
                one, values=np.where(inside, made, np.nan), attributes=about
            )
        return found


def modelled(
    kind: str, files: Sequence[Path | str], vehicle: str | None = None
) -> list[ModelledLog]:
    """The log in some files, a `ModelledLog` for each deployment.

    Args:
      kind: of the files, as `factory import` has it.
      files: of one or more deployments.
      vehicle: what `twin identify` wrote, or the name of a shipped vehicle; default the shipped one
        of the log's kind.

    Raises:
      InputError: files that cannot be read, or whose flight cannot be modelled; it says why.
      VehicleError: no such vehicle.
    """
    dataset, _ = import_logs(kind, files)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.zarr"
        logs = LogStore(write_store(dataset, path))
        every = range(len(logs))
        try:
            found = flown(logs, every, start_vehicle(path) if vehicle is None else vehicle)
        except TwinError as error:
            said = str(error).replace(f"store {path} has", "this log has")
            hint = _PUMP if "measured_pump" in said else ""
            raise type(error)(said.replace(str(path), "of this log") + hint) from error
        return [
            _modelled(logs, name, logs.missions_of(name), found)
            for name in dict.fromkeys(logs.deployments[mission] for mission in every)
        ]


_PUMP = (
    "; pyglider keeps the pump where netcdf_variables of its deployment.yml names the sensor: "
    "BallastPos, m_ballast_pumped or m_de_oil_vol"
)


def _modelled(
    logs: LogStore, name: str, missions: Sequence[int], found: FlownTracks
) -> ModelledLog:
    time = np.concatenate([logs.time(mission) for mission in missions])
    # a fix between two dives without a stay at the surface ends one and begins the other
    order = len(time) - 1 - np.unique(time[::-1], return_index=True)[1]
    joined = JoinedDives(logs, tuple(missions), order)
    variables = {n: v for n, v in corrected_places(joined, found) if n in POSITIONS}
    variables |= dict(flight_variables(joined, found))
    fixes, currents = [], []
    dives = [dive for m in missions if (dive := found.tracks[m].dive) is not None]
    for mission in missions:
        track, place = found.tracks[mission], place_of(logs, mission)
        fixes.append(np.array(place.degrees(*track.fixes.position.T)))
        for current in track.currents:
            north, east = track.position[(current.first + current.last) // 2]
            latitude, longitude = map(float, place.degrees(np.array(north), np.array(east)))
            currents.append(PlacedCurrent(current=current, latitude=latitude, longitude=longitude))
    latitudes, longitudes = np.concatenate(fixes, axis=1)
    return ModelledLog(
        deployment=name,
        model=found.model,
        time=time[order],
        period=logs.period,
        variables=variables,
        fixes=(latitudes, longitudes),
        currents=tuple(currents),
        doubt=summarise(dives).doubt(found.model.rpartition(" ")[2]),
    )
