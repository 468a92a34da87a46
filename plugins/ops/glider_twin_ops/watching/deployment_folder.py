"""Deployment folder: the files of one watched deployment, and its settings, `deployment.toml`.

calypso/
  deployment.toml   vehicle, source, plan, batteries: written once, edited by people
  log.zarr          the dives of all files that arrived, as `factory import` stores them
  beliefs.zarr      channels of health, dive by dive
  events.jsonl      alarms, and files that cannot be read
  page/             index.html, latest.json, summary.txt, forecast.geojson
"""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from factory.importing import IMPORTERS
from glider_twin_ops.forecast import mission_to
from glider_twin_ops.forecast.request import check_hours, check_members
from glider_twin_ops.health.judgement import threshold_of
from glider_twin_ops.watching.sources import source_of
from twin import Vehicle, load_vehicle
from twin.bounded import read_toml
from twin.errors import InputError, TwinError, WriteError, quoted, shown, unknown_name
from twin.identify import start_vehicle
from twin.records import whole_file
from twin.records.storage import check_folder_target
from twin.water.current import check_field

SETTINGS = "deployment.toml"
AUTO = "auto"
"""Value of `kind` by which the type of log is recognised from the files"""
FIRST_LINE = "# Written by `twin watch --new`. Edit it: the next pass takes it as it is then.\n"


def _key(default: Any, says: str) -> Any:
    """Field that is a key of the file, with the comment `says`; empty text or 0: not given."""
    return dataclasses.field(default=default, metadata={"says": says})


@dataclasses.dataclass(frozen=True, kw_only=True)
class WatchedDeployment:
    """One deployment's folder and its settings; every field but `folder` is a key of the file."""

    folder: Path
    source: str = _key(
        dataclasses.MISSING, "folder in which files of the vehicle arrive, or a server's data set"
    )
    vehicle: str = _key(
        "", 'what `twin identify` wrote, or a shipped name; "": that of the kind of log'
    )
    kind: str = _key(AUTO, "of the logs, as `factory import` names it; auto: what they look like")
    recursive: bool = _key(False, "whether folders below the source are watched, too")
    cache: str = _key("", 'folder of a Slocum\'s .cac files; "": beside the logs')
    mapping: str = _key("", "for kind csv: what the columns are")
    variation_deg: float | str = _key("", 'magnetic variation, east positive; "": the log\'s own')
    goto: str = _key("", 'LAT,LON[;LAT,LON] that it is sent to; "": it goes on as in its last dive')
    mission: str = _key("", "or the mission file that it flies")
    current: str = _key(
        "", 'its forecast, forecast.nc or grid:forecast.nc,...; "": what the dives told goes on'
    )
    samples: float = _key(
        1.0, "part of the samples that a Seaglider's proposed science file keeps; 1: none is"
    )
    depth_m: float = _key(0.0, "of its dives to goto; 0: as the last ones")
    surface_every_h: float = _key(0.0, "under water between surfacings; 0: as the last dives")
    hours: float = _key(12.0, "that the forecast reaches ahead")
    members: int = _key(100, "that the forecast draws")
    energy_kwh: float = _key(0.0, "in the batteries when the first dive began; 0: not known")
    home: str = _key("", 'LAT,LON that it must reach before its energy is gone; "": none')
    false_alarm_days: float = _key(30.0, "in which one false alarm is borne")

    def __post_init__(self) -> None:
        where = f"{self.folder / SETTINGS}"
        for field in dataclasses.fields(self):
            value, wanted = getattr(self, field.name), type(field.default)
            if field.name in ("folder", "source", "variation_deg"):
                continue
            taken = int | float if wanted is float else wanted
            if isinstance(value, bool) != (wanted is bool) or not isinstance(value, taken):
                raise InputError(
                    f"{where}: {field.name} = {shown(value)} must be {_WORDS[wanted]}, such as "
                    f"{json.dumps(field.default)}"
                )
        for name in ("depth_m", "surface_every_h", "energy_kwh"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{where}: {name} = {value:g} must be 0 or above")
        if not self.samples > 0.0:
            raise InputError(f"{where}: samples = {self.samples:g} must be above 0")
        variation = self.variation_deg
        number = isinstance(variation, int | float) and not isinstance(variation, bool)
        if variation != "" and not (number and math.isfinite(variation)):  # type: ignore[arg-type]
            raise InputError(f'{where}: variation_deg = {shown(variation)} must be degrees, or ""')
        if not isinstance(self.source, str) or not self.source:
            raise InputError(f"{where}: source = {shown(self.source)} must name a folder")
        kinds = [AUTO, *IMPORTERS.names()]
        if self.kind not in kinds:
            raise InputError(f"{where}: {unknown_name('kind', self.kind, kinds)}")
        source_of(self.source, "" if self.kind == AUTO else self.kind)
        if self.cache and not (cache := self.place(self.cache)).is_dir():
            raise InputError(
                f"{where}: cache = {shown(self.cache)} is no folder ({cache}): give one from the "
                "deployment's folder on, or absolute"
            )
        if self.goto and self.mission:
            raise InputError(f"{where}: give goto or mission, not both")
        try:
            self.own_vehicle()
            check_members(self.members)
            check_hours(self.hours)
            if self.goto:  # check with usual depth and pitch: those of the dives are not known yet
                deep, every = self.depth_m or 100.0, 3600.0 * (self.surface_every_h or 3.0)
                usual = {"pitch_deg": 26.0, "radius": 500.0}
                mission_to(self.goto, depth=deep, surface_after_s=every, **usual)
            if self.current:
                check_field(self.field)
            threshold_of(self.false_alarm_days)
        except TwinError as error:
            raise InputError(f"{where}: {error}") from None
        self.harbour  # noqa: B018 - refuses what is no place

    def own_vehicle(self) -> Vehicle | None:
        """Load the vehicle that the setting `vehicle` names; None where the setting is empty.

        Raises:
          VehicleError: no such file or name, or a file that cannot be flown.
        """
        if not self.vehicle:
            return None
        path = self.place(self.vehicle)
        return load_vehicle(path if path.is_file() else self.vehicle)

    def vehicle_of(self, log: Path) -> Vehicle:
        """Vehicle of the settings, or else the shipped vehicle for the type of a log."""
        return self.own_vehicle() or start_vehicle(log)

    @property
    def field(self) -> str:
        """Setting `current`, with a file in it resolved against the deployment's folder."""
        kind, colon, path = self.current.rpartition(":")
        place = self.place(path)
        return f"{kind}{colon}{place}" if path and place.exists() else self.current

    @property
    def harbour(self) -> tuple[float, float] | None:
        """Latitude, longitude [degree] of `home`; None where it is empty."""
        if not self.home:
            return None
        try:
            latitude, longitude = (float(word) for word in self.home.split(","))
        except ValueError:
            latitude = math.nan
        if not abs(latitude) <= 90.0:
            raise InputError(
                f"{self.folder / SETTINGS}: home = {shown(self.home)} must be LAT,LON in degrees"
            )
        return latitude, longitude

    @classmethod
    def read(cls, folder: Path | str) -> WatchedDeployment:
        """Read the deployment of a folder.

        Raises:
          InputError: no such folder, no settings in it, or a setting that cannot be used.
        """
        folder = Path(folder)
        path = folder / SETTINGS
        if not path.is_file():
            raise InputError(
                f"{folder} holds no {SETTINGS}: make one with `twin watch --new {quoted(folder)} "
                "--from FOLDER`"
            )
        found = read_toml(path, "settings")
        names = list(cls.meanings())
        for name in found:
            if name not in names:
                raise InputError(f"{path}: {unknown_name('key', name, names)}")
        if "source" not in found:
            raise InputError(f"{path}: the key source is missing: the folder in which files arrive")
        return cls(folder=folder, **found)

    @classmethod
    def meanings(cls) -> dict[str, str]:
        """Comment of each key of the file."""
        return {
            field.name: field.metadata["says"]
            for field in dataclasses.fields(cls)
            if field.name != "folder"
        }

    def write(self) -> Path:
        """Make the folder with the settings.

        Raises:
          WriteError: settings are there already, the folder is taken, or the disk refuses.
        """
        path = self.folder / SETTINGS
        if path.exists():
            raise WriteError(f"{path} is there already: edit it, or name another folder")
        check_folder_target(self.folder, overwrite=True, ours=lambda place: False)
        lines = [
            f"{name} = {json.dumps(getattr(self, name))}  # {says}\n"
            for name, says in self.meanings().items()
        ]
        with whole_file(path) as place:
            place.write_text("".join([FIRST_LINE, *lines]), encoding="utf-8")
        return path

    def place(self, name: str) -> Path:
        """Resolve a path of the settings against the deployment's folder; absolute paths stay."""
        return self.folder / Path(name).expanduser()

    def settings(self) -> dict[str, Any]:
        """Every key of the file with its value."""
        return {name: getattr(self, name) for name in self.meanings()}


_WORDS = {str: "a text", bool: "true or false", int: "a whole number", float: "a number"}
