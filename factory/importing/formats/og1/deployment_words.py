"""Deployment words: what people said of a deployment, in the attributes of an OG1.0 file.

They become the same text as a pyglider `deployment.yml` beside a log, so that the next export says
it again.
"""

from __future__ import annotations

import json
import re
from typing import Any

from factory.exporting.metadata import INSTRUMENTS
from factory.exporting.og1.terms import NOT_LOGGED, ON_A_GRID
from factory.importing.reading.netcdf import attributes_of, text_of

PEOPLE = frozenset(
    {
        "title", "summary", "comment", "acknowledgement", "acknowledgment", "institution",
        "license", "project", "program", "network", "site", "sea_name", "naming_authority", "doi",
        "principal_investigator", "principal_investigator_email", "rtqc_method", "rtqc_method_doi",
        "contributing_institutions", "contributing_institutions_role",
        "contributing_institutions_vocabulary", "contributing_institutions_role_vocabulary",
        "references", "keywords", "keywords_vocabulary",
    }
)  # fmt: skip
"""Attributes that a person wrote: ACDD's and the format's"""
_PERSON = re.compile(r"(creator|publisher|contributor)_\w+")
_OURS = re.compile(r"(SIMULATED )?OceanGliders trajectory file, deployment .*|\d+ dives of .*")
"""Title and summary that an export writes by itself"""
_NOTHING = frozenset({"", "n/a", "glider-twin", "No QC applied", NOT_LOGGED})
_DEVICE = {
    "long_name": "long_name",
    "sensor_model": "make_model",
    "sensor_maker": "make",
    "sensor_serial_number": "serial_number",
    "sensor_calibration_date": "calibration_date",
    "comment": "comment",
}


def deployment_words(file: Any, deployment: str) -> str | None:
    """The text, as JSON, which is YAML too; None where the file says nothing of the kind."""
    said = {}
    for name in file.ncattrs():
        value = " ".join(str(file.getncattr(name)).replace(ON_A_GRID, "").split())
        by_people = name in PEOPLE or _PERSON.fullmatch(name)
        if by_people and value not in _NOTHING and not _OURS.fullmatch(value):
            said[name] = value
    for name, variable, usual in (
        ("wmo_id", "WMO_IDENTIFIER", ""),
        ("glider_serial", "PLATFORM_SERIAL_NUMBER", deployment),
    ):
        value = text_of(file.variables.get(variable)).strip()
        if value not in {*_NOTHING, usual}:
            said[name] = value
    devices = {}
    for sensor, words in INSTRUMENTS.items():
        named = next((n for n in file.variables if n.startswith(sensor)), None)
        if named is None:
            continue
        described = attributes_of(file.variables[named])
        found = {
            ours: str(described[theirs])
            for theirs, ours in _DEVICE.items()
            if theirs in described and str(described[theirs]) not in _NOTHING
        }
        if set(found) - {"long_name"}:
            devices[words[0]] = found
    if not said and not devices:
        return None
    return json.dumps({"metadata": said, "glider_devices": devices}, ensure_ascii=False)
