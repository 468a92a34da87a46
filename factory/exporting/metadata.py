"""Metadata: facts on a deployment that no log holds, from a YAML file written by people.

The layout is pyglider's: a section `metadata` (`global` in older files) with attributes of the
whole file, and `glider_devices` (or `sensors`) with one section for each instrument. Other
sections, such as `netcdf_variables`, are for pyglider itself and are ignored.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from twin.bounded import MOST_SETTINGS, read_text
from twin.errors import InputError
from twin.records.attributes import DEPLOYMENT_METADATA
from twin.records.reader import MissionStore

MOST_DEPTH = 32
"""Maximum number of sections inside each other in a metadata file; pyglider's has 3."""
MOST_REFERENCES = 8
"""Maximum number of references (*name) in a metadata file; each can double the values before it."""

GLOBAL = ("metadata", "global")
DEVICES = ("glider_devices", "sensors")
VEHICLE = "glider"
BESIDE = ("metadata.yml", "deployment.yml", "metadata.yaml", "deployment.yaml")
"""Names of metadata files that are looked for beside a store."""
OWN = frozenset(
    {
        "Conventions", "Metadata_Conventions", "id", "date_created", "featureType", "history",
        "format_version", "source", "cdm_data_type", "standard_name_vocabulary", "platform",
        "platform_vocabulary", "wmo_id", "glider_name", "glider_serial", "glider_model",
        "glider_instrument_name", "deployment_start", "deployment_end",
    }
)  # fmt: skip
"""Attributes that are ignored: the export sets them itself, or has a variable for them."""
SPELT = {"acknowledgment": "acknowledgement"}
INSTRUMENTS = {
    "SENSOR_CTD": ("ctd",),
    "SENSOR_PRESSURE": ("pressure",),
    "SENSOR_AHRS": ("ahrs", "attitude", "compass"),
    "SENSOR_DVL": ("dvl", "adcp", "ad2cp"),
}
"""Names of devices in metadata files, by the sensor variable of the format."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Metadata:
    """Contents of a metadata file; empty without one."""

    attributes: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Attributes of the whole file."""
    devices: Mapping[str, Mapping[str, str]] = dataclasses.field(default_factory=dict)
    """Attributes of each instrument, by its name in small letters."""
    wmo: str = ""
    """Identifier of the World Meteorological Organization."""
    serial: str = ""
    """Serial number of the glider."""
    model: str = ""
    """Model of the glider."""

    def sensor(self, variable: str) -> Mapping[str, str]:
        """Attributes of the instrument behind a sensor variable such as SENSOR_CTD."""
        for name, device in self.devices.items():
            if any(word in name for word in INSTRUMENTS.get(variable, ())):
                return device
        return {}


def metadata_for(run: MissionStore, given: Path | None) -> Metadata:
    """Find metadata: in the given file, else beside the store, else in the store; empty if none.

    Raises:
      InputError: the file cannot be read or has another layout.
    """
    if given is not None:
        return read_metadata(given)
    if isinstance(run.path, Path):
        folder = run.path.resolve().parent
        for name in BESIDE:
            if (folder / name).is_file():
                return read_metadata(folder / name)
    if DEPLOYMENT_METADATA in run.attributes:
        return parse_metadata(str(run.attributes[DEPLOYMENT_METADATA]), f"of {run.path}")
    return Metadata()


def read_metadata(path: Path) -> Metadata:
    """Read the metadata of a YAML file; errors as in `parse_metadata`, or if it is unreadable."""
    return parse_metadata(read_text(path, "metadata", most=MOST_SETTINGS), str(path))


def parse_metadata(text: str, path: str) -> Metadata:
    """Parse the metadata of a YAML text; `path` is named in errors.

    Raises:
      InputError: the text is not YAML or has another layout.
    """
    import yaml

    if len(text) > MOST_SETTINGS:
        raise InputError(f"metadata {path} is longer than {MOST_SETTINGS // 1024} kB")
    try:
        _refuse_bombs(yaml.parse(text, yaml.SafeLoader), path)
        loaded: Any = yaml.safe_load(text)
    except InputError:
        raise
    except (yaml.YAMLError, ValueError) as error:  # ValueError: an impossible date
        raise InputError(f"metadata {path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(loaded, dict) or not any(name in loaded for name in GLOBAL):
        raise InputError(
            f"metadata {path} has no section `metadata` (or `global`) with title, institution and "
            "the like: pyglider's deployment.yml has it"
        )
    words = _words(path, loaded, GLOBAL)
    vehicle = _words(path, loaded, (VEHICLE,))
    sections = (loaded.get(name) for name in DEVICES)
    devices = next((one for one in sections if isinstance(one, dict)), {})
    return Metadata(
        attributes={SPELT.get(name, name): text for name, text in words.items() if name not in OWN},
        devices={
            str(name).lower(): _words(path, devices, (name,))
            for name in devices
            if isinstance(devices[name], dict)
        },
        wmo=words.get("wmo_id", "") or vehicle.get("WMO", ""),
        serial=words.get("glider_serial", "") or vehicle.get("serial", ""),
        model=words.get("glider_model", "") or vehicle.get("type", ""),
    )


def _refuse_bombs(events: Iterable[Any], path: str) -> None:
    """Raise InputError for a text whose references or nesting could fill the memory."""
    depth = references = 0
    for event in events:
        kind = type(event).__name__
        depth += kind in ("MappingStartEvent", "SequenceStartEvent")
        depth -= kind in ("MappingEndEvent", "SequenceEndEvent")
        references += kind == "AliasEvent"
        if depth > MOST_DEPTH or references > MOST_REFERENCES:
            raise InputError(
                f"metadata {path} has more than {MOST_DEPTH} values inside each other, or more "
                f"than {MOST_REFERENCES} references (*name): write them out"
            )


def _words(path: str, loaded: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, str]:
    """Entries of the first of these sections that exists, as text; empty entries are left out."""
    section: Any = next((loaded[name] for name in names if name in loaded), {}) or {}
    if not isinstance(section, dict):
        raise InputError(f"metadata {path}: section `{names[0]}` must hold names and values")
    return {
        str(name): " ".join(str(value).split())
        for name, value in section.items()
        if value is not None and not isinstance(value, (dict, list)) and str(value).strip()
    }


def with_metadata(own: dict[str, Any], metadata: Metadata, *, simulated: bool) -> dict[str, Any]:
    """Merge attributes with metadata: comments are joined, a simulation stays marked as one."""
    given = dict(metadata.attributes)
    if "comment" in given:
        given["comment"] = f"{given['comment']} {own['comment']}"
    if simulated:
        for name in ("title", "summary"):
            if name in given and "simulated" not in given[name].lower():
                given[name] = f"SIMULATED: {given[name]}"
    if "institution" in given:
        given.setdefault("contributing_institutions", given["institution"])
    for part in ("name", "email"):  # creators of the data are contributors
        if f"creator_{part}" in given:
            given.setdefault(f"contributor_{part}", given[f"creator_{part}"])
    merged = {**own, **given}
    for name in ("creator", "publisher"):
        if f"{name}_name" in given:
            merged.setdefault(f"{name}_type", "person" if name == "creator" else "institution")
    return merged
