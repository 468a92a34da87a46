"""Attributes: names of a store's own attributes and of its bookkeeping arrays.

All readers and writers of stores take the names from this module, so each has one spelling.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Mapping
from typing import Any

from twin.errors import InputError, shown
from twin.records.schema import MISSION, SCHEMA_VERSION, TIME

SCHEMA, VERSION = "schema", "schema_version"
"""Attributes. SCHEMA: name of the store's schema. VERSION: its version"""
TITLE, COMMENT, SOURCE, HISTORY = "title", "comment", "source", "history"
SAMPLE_PERIOD = "sample_period_s"
"""[s] Attribute with the time between samples; generated stores keep it in SETTINGS instead."""

SETTINGS, CHANGES = "settings", "changes"
"""JSON. SETTINGS: all settings of `factory generate`. CHANGES: those that the user changed"""
PRESET, SEED, HOURS, SENSORS = "preset", "seed", "hours", "sensors"
FAILED_MISSIONS = "failed_missions"
"""JSON list of the failed attempts that others replaced, in stores without arrays of attempts"""
RECIPE = "recipe_sha256"
"""SHA-256 of everything that the bytes of a generated store depend on"""
VEHICLE_MJCF, VEHICLE_SHA256 = "vehicle_mjcf", "vehicle_sha256"
SCENARIO = "scenario"
"""JSON of the scenario that `twin simulate` flew"""
SENSOR_SUITE = "sensor_suite"
"""JSON of the sensors that measured a single flight"""

SOURCE_FORMAT = "source_format"
"""Attribute with the format of the imported logs; only stores of logs have it."""
IMPORT_REPORT, PLATFORM, FILES = "import_report", "platform", "files"
DEPLOYMENT_METADATA = "deployment_metadata"
"""Text of the YAML file beside the logs, which describes the deployment"""
PROGRAM_VERSION = "glider_twin_version"
READER_VERSION = "import_version"
"""Version of the readers that imported the logs (`twin.version.IMPORT_VERSION`); 1 if missing"""

N_SAMPLES, SPLIT, DURATION, ATTEMPT = "n_samples", "split", "duration", "attempt"
"""Names of arrays over missions"""
AXES: Mapping[str, Mapping[str, Any]] = {
    MISSION: {"long_name": "mission index"},
    TIME: {"units": "s", "long_name": "time since the start of the mission"},
}
"""CF attributes of the coordinates of a store of simulated missions"""
OF_MISSIONS: Mapping[str, Mapping[str, Any]] = {
    N_SAMPLES: {
        "units": "1",
        "long_name": "number of samples of the mission",
        "comment": "later ones are padding",
    },
    DURATION: {"units": "s", "long_name": "mission length"},
    ATTEMPT: {"units": "1", "long_name": "number of attempts that failed before this one"},
}
"""CF attributes of the arrays over missions in a store of simulated missions"""
DEPLOYMENT, START_TIME, DIVE_DURATION, DIVE = "deployment", "start_time", "dive_duration", "dive"
"""Names of arrays over the dives in a store of logs"""
SUSPECT = "suspect"
"""Array over dives with the reason why a dive's values are impossible; empty for a sound dive"""

SPLITS = ("train", "validation", "test")
"""Splits of a store, in the order of their flags. Each mission belongs to exactly one split."""

CONVENTIONS = {
    "Conventions": "CF-1.11",
    SCHEMA: "glider-twin missions",
    VERSION: SCHEMA_VERSION,
}
"""Attributes of every store"""
SIMULATED_ATTRIBUTES = {
    **CONVENTIONS,
    TITLE: "Simulated underwater vehicle missions",
    COMMENT: "Simulated data. NED frame with its origin at each mission's start; body axes "
    "forward, starboard, down about the centre of buoyancy.",
}
"""Attributes of every store of simulated missions"""


def is_logged(attributes: Mapping[str, Any]) -> bool:
    """Return whether `attributes` belong to a store of logs, which `factory import` wrote."""
    return SOURCE_FORMAT in attributes


def says_simulated(attributes: Mapping[str, Any]) -> bool:
    """Return whether the comment of a store of logs says that a simulation made the logs."""
    return "simulated" in str(attributes.get(COMMENT, ""))


def is_missions(attributes: Mapping[str, Any]) -> bool:
    """Return whether `attributes` belong to a store of missions, simulated or logged."""
    return attributes.get(SCHEMA) == CONVENTIONS[SCHEMA]


EPOCH = "SOURCE_DATE_EPOCH"
"""Environment variable with the creation time to write into files, in seconds since 1970. With it,
equal inputs give equal bytes (reproducible-builds.org/specs/source-date-epoch)."""


def made_at() -> datetime.datetime:
    """Creation time (UTC) that imports and exports write: the time in EPOCH if set, else now.

    Raises:
      InputError: EPOCH is no whole number of seconds, or has more than 11 digits.
    """
    given = os.environ.get(EPOCH, "")
    if not given:
        return datetime.datetime.now(datetime.UTC)
    if given.isascii() and given.isdecimal() and len(given) <= 11:
        return datetime.datetime.fromtimestamp(int(given), datetime.UTC)
    raise InputError(f"{EPOCH} is {shown(given)}: give whole seconds since 1970, or leave it unset")
