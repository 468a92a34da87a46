"""Attributes: the names that a store's own attributes and its bookkeeping arrays have.

They stand here and nowhere else, so that what a store says about itself has one spelling.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Mapping
from typing import Any

from twin.errors import InputError, shown
from twin.records.schema import MISSION, SCHEMA_VERSION, TIME

SCHEMA, VERSION = "schema", "schema_version"
"""Whose layout a store has, and which version of it."""
TITLE, COMMENT, SOURCE, HISTORY = "title", "comment", "source", "history"
SAMPLE_PERIOD = "sample_period_s"
"""[s] between samples; stores of `factory generate` have it in their settings."""

SETTINGS, CHANGES = "settings", "changes"
"""JSON: everything that decides what `factory generate` makes, and what of it a user changed."""
PRESET, SEED, HOURS, SENSORS = "preset", "seed", "hours", "sensors"
FAILED_MISSIONS = "failed_missions"
"""JSON list of the attempts that were replaced, in stores that have no arrays of them."""
RECIPE = "recipe_sha256"
"""Of everything that the bytes of a generated store depend on."""
VEHICLE_MJCF, VEHICLE_SHA256 = "vehicle_mjcf", "vehicle_sha256"
SCENARIO = "scenario"
"""JSON of the scenario that `twin simulate` flew."""
SENSOR_SUITE = "sensor_suite"
"""JSON of the sensors that measured a single flight."""

SOURCE_FORMAT = "source_format"
"""Which kind of log was imported: the mark of a store of logs."""
IMPORT_REPORT, PLATFORM, FILES = "import_report", "platform", "files"
DEPLOYMENT_METADATA = "deployment_metadata"
"""Text of the YAML file that lay beside the logs: what people said of the deployment."""
PROGRAM_VERSION = "glider_twin_version"
READER_VERSION = "import_version"
"""Which readers made a store of logs (`twin.version.IMPORT_VERSION`); 1 where it does not say"""

N_SAMPLES, SPLIT, DURATION, ATTEMPT = "n_samples", "split", "duration", "attempt"
"""Arrays over missions."""
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
"""CF attributes of its arrays over missions"""
DEPLOYMENT, START_TIME, DIVE_DURATION, DIVE = "deployment", "start_time", "dive_duration", "dive"
"""Arrays over the dives of a store of logs."""
SUSPECT = "suspect"
"""Array over them: why a dive holds what no ocean or vehicle allows; empty where it does not."""

SPLITS = ("train", "validation", "test")
"""Parts of a store, by their flag. A mission belongs to exactly one."""

CONVENTIONS = {
    "Conventions": "CF-1.11",
    SCHEMA: "glider-twin missions",
    VERSION: SCHEMA_VERSION,
}
"""What every store says."""
SIMULATED_ATTRIBUTES = {
    **CONVENTIONS,
    TITLE: "Simulated underwater vehicle missions",
    COMMENT: "Simulated data. NED frame with its origin at each mission's start; body axes "
    "forward, starboard, down about the centre of buoyancy.",
}
"""What every store of simulated missions says."""


def is_logged(attributes: Mapping[str, Any]) -> bool:
    """Whether these are the attributes of a store of logs, which `factory import` wrote."""
    return SOURCE_FORMAT in attributes


def says_simulated(attributes: Mapping[str, Any]) -> bool:
    """Whether logs were made by a simulation, by their store's comment."""
    return "simulated" in str(attributes.get(COMMENT, ""))


def is_missions(attributes: Mapping[str, Any]) -> bool:
    """Whether these are the attributes of a store of missions, simulated or logged."""
    return attributes.get(SCHEMA) == CONVENTIONS[SCHEMA]


EPOCH = "SOURCE_DATE_EPOCH"
"""Environment variable with the seconds since 1970 that files say they were made at, so that the
same inputs give the same bytes (reproducible-builds.org/specs/source-date-epoch)"""


def made_at() -> datetime.datetime:
    """What imports and exports say of when they were made, UTC: now, or what EPOCH says.

    Raises:
      InputError: EPOCH is no whole number of seconds in a year that has four digits.
    """
    given = os.environ.get(EPOCH, "")
    if not given:
        return datetime.datetime.now(datetime.UTC)
    if given.isascii() and given.isdecimal() and len(given) <= 11:
        return datetime.datetime.fromtimestamp(int(given), datetime.UTC)
    raise InputError(f"{EPOCH} is {shown(given)}: give whole seconds since 1970, or leave it unset")
