"""ERDDAP data set: OG1.0 files, and the `datasets.xml` with which a server serves them.

Each file is one table with a row for each sample; a file's single values are repeated in each row.
All variables are served. Names and rules are those of "Working with the datasets.xml File", the
manual of ERDDAP's administrators (EDDTableFromMultidimNcFiles, cdm_data_type, ioos_category).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from factory.exporting.base import Advance, Exporter, ExportOptions
from factory.exporting.og1 import OG1
from twin.errors import InputError

if TYPE_CHECKING:
    from twin.records.reader import MissionStore

CHUNK = "datasets.xml"
DAY = "1440"
"""[minute] Interval at which a server reads the files again."""
REMOVED = "null"
"""Value with which ERDDAP leaves out an attribute of a file."""
SPECIAL = {"TIME": "time", "LONGITUDE": "longitude", "LATITUDE": "latitude", "DEPTH": "depth"}
"""Variables that ERDDAP renames; all others keep their names."""
TYPES = {"float64": "double", "float32": "float", "int32": "int", "int8": "byte"}
"""ERDDAP's data types, by numpy's; text is String."""
LARGEST_BYTE = "127"
"""Value of a byte variable that ERDDAP takes as missing."""
MILLISECONDS = "1970-01-01T00:00:00.000Z"
"""Layout in which times are written; without it ERDDAP cuts off fractions of seconds."""
ABOUT = ("infoUrl", "creator_url", "publisher_url", "references")
"""Attributes that may hold the address of a page about a file, in order of preference."""
ADDRESS, ABSOLUTE = r"https?://[!-~]+", r"(/|[A-Za-z]:[\\/]).*"
"""ADDRESS: pattern of a page's address. ABSOLUTE: of an absolute path of Unix or Windows."""
CATEGORIES = (
    (r"time", "Time"),
    (r"latitude|longitude|depth", "Location"),
    (r"status_flag", "Quality"),
    (r"sea_water_pressure", "Pressure"),
    (r"sea_water_temperature", "Temperature"),
    (r"sea_water_practical_salinity|sea_water_electrical_conductivity", "Salinity"),
    (r".*_sea_water_velocity", "Currents"),
    (r".*oxygen.*", "Dissolved O2"),
    (r".*chlorophyll.*", "Ocean Color"),
)
"""ERDDAP's IOOS category by standard name. Without one, text is an Identifier, the rest Other."""


def _write(
    run: MissionStore,
    missions: Sequence[int],
    folder: Path,
    advance: Advance,
    options: ExportOptions,
) -> list[Path]:
    from twin.records.logged import LogStore

    place = str(options.file_dir)
    if not (re.fullmatch(ABSOLUTE, place) and place.isprintable()):
        raise InputError(
            f"--file-dir {place!r} must be the absolute path of the files' folder on the server, "
            "such as /data/calypso"
        )
    assert callable(OG1.write)
    files = OG1.write(run, missions, folder, advance, options)
    root = ElementTree.Element("erddapDatasets")
    if isinstance(run, LogStore):  # one data set per deployment, as on glider servers
        for file in files:
            name, pattern = identifier(file.stem), re.escape(file.name)
            root.append(dataset(file, name, pattern, options, many=False))
    else:
        root.append(dataset(files[-1], identifier(run.path.stem), r".*\.nc", options, many=True))
    ElementTree.indent(root, "    ")
    chunk = folder / CHUNK
    ElementTree.ElementTree(root).write(chunk, encoding="UTF-8", xml_declaration=True)
    return [*files, chunk]


def identifier(name: str) -> str:
    """Make a datasetID: letters, digits and underscores, a letter first."""
    return re.sub(r"^(?![A-Za-z])", "glider_", re.sub(r"[^A-Za-z0-9]+", "_", name))


def dataset(
    file: Path, name: str, pattern: str, options: ExportOptions, *, many: bool
) -> ElementTree.Element:
    """Make the tag of one data set. ERDDAP also demands title, summary and institution, which the
    files hold.

    Args:
      file: OG1.0 file with the data set's variables.
      name: datasetID, which addresses contain.
      pattern: Java regular expression of the names of all its files.
      options: options with the server's folder.
      many: True if the data set has several missions, so that no mission's name is its title.
    """
    import netCDF4

    from factory.exporting.og1.og1_terms import TERMS

    made = ElementTree.Element(
        "dataset", type="EDDTableFromMultidimNcFiles", datasetID=name, active="true"
    )
    _tags(
        made, reloadEveryNMinutes=DAY, fileDir=str(options.file_dir), fileNameRegex=pattern,
        recursive="false", accessibleViaFiles="true", metadataFrom="last",
    )  # fmt: skip
    with netCDF4.Dataset(file) as source:
        variables = list(source.variables.values())
        once = ",".join(_destination(one.name) for one in variables if not one.dimensions)
        pages = [_address(source.__dict__.get(word)) for word in ABOUT]
        manual = TERMS["global"]["references"]
        attributes = {
            "cdm_data_type": "Trajectory",
            "cdm_trajectory_variables": once,
            "subsetVariables": once,
            "infoUrl": next(filter(re.compile(ADDRESS).fullmatch, pages), manual),
            "sourceUrl": "(local files)",
        }
        if many:
            attributes |= dict.fromkeys(("id", "internal_mission_identifier"), REMOVED)
        _attributes(made, [(word, value, None) for word, value in attributes.items()])
        for one in variables:
            made.append(_variable(one))
    return made


def _address(value: object) -> str:
    """Address from metadata, with a scheme if it has none."""
    return re.sub(r"^www\.", "https://www.", str(value))


def _destination(name: str) -> str:
    return SPECIAL.get(name, name)


def _variable(one: Any) -> ElementTree.Element:
    """Make the tag of one variable of a file."""
    kind = "String" if one.dtype is str else TYPES[one.dtype.name]
    own = one.__dict__
    made = ElementTree.Element("dataVariable")
    _tags(made, sourceName=one.name, destinationName=_destination(one.name), dataType=kind)
    added: list[tuple[str, str, str | None]] = [("ioos_category", _category(kind, own), None)]
    if own.get("standard_name") == "time":
        added.append(("time_precision", MILLISECONDS, None))
    if kind == "byte" and "_FillValue" not in own:
        added.append(("_FillValue", LARGEST_BYTE, "byte"))
    if "coordinates" in own:  # names of the file: rows of a table have all coordinates
        added.append(("coordinates", REMOVED, None))
    _attributes(made, added)
    return made


def _category(kind: str, own: Mapping[str, Any]) -> str:
    standard = str(own.get("standard_name", ""))
    for pattern, category in CATEGORIES:
        if re.fullmatch(pattern, standard):
            return category
    return "Identifier" if kind == "String" else "Other"


def _tags(made: ElementTree.Element, **texts: str) -> None:
    for tag, text in texts.items():
        ElementTree.SubElement(made, tag).text = text


def _attributes(made: ElementTree.Element, items: Sequence[tuple[str, str, str | None]]) -> None:
    added = ElementTree.SubElement(made, "addAttributes")
    for name, value, kind in items:
        tag = ElementTree.SubElement(added, "att", {"name": name})
        tag.text = value
        if kind is not None:
            tag.set("type", kind)


ERDDAP = Exporter(
    name="erddap",
    title="OG1.0 files with the datasets.xml of an ERDDAP server that serves them",
    ending="-erddap",
    takes=("vehicle", "metadata", "file_dir"),
    write=_write,
)
"""Exporter for servers of data with ERDDAP."""
