"""Modelled log: results of a flight model for a log, at any times, by OG1.0's names.

    (log,) = modelled("seaglider", ["p5610002.nc", "p5610003.nc"], "mine.xml")
    log.at(times)["VERT_CURR_MODEL"].values

Speed, angle of attack, vertical velocity of the water, currents and corrected track are equal to
those that `factory export --to og1` writes for the log.
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
"""Variables that are constant from fix to fix; all others are interpolated between samples"""
WATER_VELOCITY = "VERT_CURR_MODEL"
"""Name of the vertical velocity of the water"""
_OF_THEIR_FILE = ("ancillary_variables", "coordinates")
"""Attributes that name other variables of an OG1.0 file"""
LONGEST_STEP = 1.5
"""Longest step between two samples of one dive, in periods of the store"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlacedCurrent:
    """Depth-averaged current of a dive, with the position of the middle of its track."""

    current: DiveCurrent
    latitude: float
    longitude: float
    """[degree] Longitude; the latitude has the same unit"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ModelledLog:
    """Results of a flight model for one deployment, at the samples of its dives."""

    deployment: str
    model: str
    """Name of the flight model"""
    time: Array
    """[s] Unix times, increasing, (samples,)"""
    period: float
    """[s] Sample period of the store"""
    variables: dict[str, Og1Variable]
    """Variables by OG1.0's name, with values (samples,), NaN for missing ones"""
    fixes: tuple[Array, Array]
    """[degree] Latitude and longitude of the fixes on the track, each (fix,)"""
    currents: tuple[PlacedCurrent, ...]
    doubt: str
    """Reason why the vehicle does not fit the log; empty if it fits"""

    def at(self, times: Array) -> dict[str, Og1Variable]:
        """Interpolate the variables to unix times [s]; NaN between and beyond the dives.

        Each variable gets an attribute `source` that begins with `glider-twin`.
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
            if name == WATER_VELOCITY and self.doubt:
                about["comment"] = self.doubt
            found[name] = dataclasses.replace(
                one, values=np.where(inside, made, np.nan), attributes=about
            )
        return found


def modelled(
    kind: str, files: Sequence[Path | str], vehicle: str | None = None
) -> list[ModelledLog]:
    """Model the log in some files; returns a `ModelledLog` for each deployment.

    Args:
      kind: format of the files, as named by `factory import`.
      files: files of one or more deployments.
      vehicle: file that `twin identify` wrote, or the name of a shipped vehicle; None takes the
        shipped vehicle for the log's type.

    Raises:
      InputError: files cannot be read, or their flight cannot be modelled (with the reason).
      VehicleError: the vehicle is missing.
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
    # if one fix ends a dive and starts the next, keep the next dive's sample
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
