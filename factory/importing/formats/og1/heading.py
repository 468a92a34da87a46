"""Heading of an OG1.0 file from true north, and where its magnetic variation comes from."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.importing.reading.deployment_log import EMPTY, Channel, Fixes
from factory.importing.reading.tally import Tally
from factory.importing.repairs.declination import reference_declination
from twin.errors import InputError

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Variation:
    """Where the magnetic variation comes from."""

    given: float | None
    """[degree] By the user."""
    places: Fixes
    """Where the vehicle was: its fixes, else its own track."""
    deployment: str
    stored: Channel
    """[degree] By the file."""

    def at(self, time: Array, tally: Tally) -> Array | None:
        """[degree] east positive: the user's, the file's or the field's; None without a place."""
        if self.given is not None:
            return np.full(len(time), self.given)
        if len(self.stored):
            return self.stored.at(time)
        found = reference_declination(self.places, self.deployment, tally)
        return found.at(time) if len(found) else None


def places_for(fixes: Fixes, track: Mapping[str, Channel]) -> Fixes:
    """Where the vehicle was: its fixes, else its own track."""
    if len(fixes) or "latitude" not in track:
        return fixes
    latitude = track["latitude"]
    return Fixes(latitude.time, latitude.values, track["longitude"].at(latitude.time))


def true_heading(
    values: Array,
    time: Array,
    attributes: Mapping[str, Any],
    variation: Variation,
    path: Path,
    tally: Tally,
) -> tuple[Array, Channel]:
    """Heading from true north, and the variation that was added.

    A variable that calls itself magnetic needs one; others are true unless the user gives one.
    """
    words = " ".join(str(attributes.get(k, "")) for k in ("long_name", "comment", "standard_name"))
    if "magnetic" in words.lower():
        known = variation.at(time, tally)
        if known is None:
            raise InputError(
                f"{path.name}: HEADING is magnetic by its description, and no position is there "
                "from which the variation follows; give it with --variation-deg, east positive"
            )
        return np.mod(values + known, 360.0), Channel(time, known)
    if variation.given is not None:
        known = np.full(len(time), variation.given)
        return np.mod(values + known, 360.0), Channel(time, known)
    if len(variation.stored):  # the heading contains it
        return np.mod(values, 360.0), variation.stored
    tally.add("note", "measured_heading", len(values), "taken as true: the file does not say else")
    return np.mod(values, 360.0), EMPTY
