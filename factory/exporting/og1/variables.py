"""Variables of an OG1.0 file with their attributes, and the writer of the netCDF-4 file.

`quality` makes the flags of variables, which OceanGliders adopted from Argo.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.og1_terms import COORDINATES, N_MEASUREMENTS, TERMS, bounds

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Og1Variable:
    """Variable of an OG1.0 file."""

    values: NDArray[Any]
    attributes: Mapping[str, Any]
    fill: float | int | None = None
    dimensions: tuple[str, ...] = (N_MEASUREMENTS,)
    kind: str = field(default="f8")


Variables = Iterator[tuple[str, Og1Variable]]
"""Variables with their names."""


def write_og1(
    folder: Path,
    identity: Mapping[str, Any],
    variables: Iterable[tuple[str, Og1Variable]],
    samples: int,
) -> Path:
    """Write a file into `folder`, under the name that the format prescribes: the attribute `id`.

    Raises:
      OSError: the disk refuses; the netCDF library gives no reason.
    """
    path = folder / f"{identity['id']}.nc"
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
            _fill(file, identity, variables, samples)
    except RuntimeError as error:
        raise OSError(errno.EIO, " ".join(str(error).split()), str(path)) from error
    return path


def _fill(
    file: Any,
    identity: Mapping[str, Any],
    variables: Iterable[tuple[str, Og1Variable]],
    samples: int,
) -> None:
    file.createDimension(N_MEASUREMENTS, None)  # unlimited, as the format demands
    place = {}
    for name, one in variables:
        options: dict[str, Any] = {}
        if one.dimensions:
            options = {"compression": "zlib", "chunksizes": (samples,)}
        if name in COORDINATES.split():
            place[name] = one.values
        kind: Any = str if one.kind == "str" else one.kind
        variable: Any = file.createVariable(
            name, kind, one.dimensions, fill_value=one.fill, **options
        )
        attributes = dict(one.attributes)
        if one.dimensions:
            attributes.setdefault("coverage_content_type", _content(name, one.kind))
        variable.setncatts(attributes)
        if one.kind == "str":
            variable[...] = str(one.values)
        else:
            # replace missing values before the cast: an integer cannot be NaN
            values = np.asarray(one.values)
            if one.fill is not None:
                values = np.where(np.isnan(values), one.fill, values)
            variable[...] = values.astype(one.kind)
    limits = bounds(place["LATITUDE"], place["LONGITUDE"], place["DEPTH"])
    file.setncatts({**identity, **limits, **_duration(place["TIME"])})


def _content(name: str, kind: str) -> str:
    """ACDD's coverage_content_type of a variable."""
    if name in COORDINATES.split():
        return "coordinate"
    return "auxiliaryInformation" if kind.startswith("i") else "physicalMeasurement"


def _duration(time: Array) -> dict[str, str]:
    """Duration and resolution of the data for ACDD, as ISO 8601 durations."""
    steps = np.diff(time)
    words = {"time_coverage_duration": f"PT{float(time[-1] - time[0]):.0f}S"}
    if len(steps):
        words["time_coverage_resolution"] = f"PT{float(np.median(steps)):g}S"
    return words


def variable(
    name: str, values: NDArray[Any] | float | str, *, like: str = "", **more: Any
) -> tuple[str, Og1Variable]:
    """Make a variable with its attributes of `og1.yaml` and further ones.

    Args:
      name: name in the file.
      values: NaN where missing.
      like: variable whose attributes are used if `og1.yaml` has none for `name`.
      more: further attributes; `kind` and `fill` set how the values are stored.
    """
    attributes = {**TERMS["variables"][like or name], **more}
    kind, fill = attributes.pop("kind", "f8"), attributes.pop("fill", None)
    dimensions = () if attributes.pop("once", False) else (N_MEASUREMENTS,)
    if fill and not dimensions and np.isfinite(values):
        fill = None
    if meanings := attributes.pop("flags", None):
        attributes["flag_values"] = np.array(list(meanings), np.int8)
        attributes["flag_meanings"] = " ".join(meanings.values())
    return name, Og1Variable(np.asarray(values), attributes, fill and float(fill), dimensions, kind)


def deployment(start: float, latitude: float, longitude: float) -> Variables:
    """Time [s since 1970] and position [degree] of the deployment's start."""
    yield variable("DEPLOYMENT_TIME", start)
    yield variable("DEPLOYMENT_LATITUDE", latitude)
    yield variable("DEPLOYMENT_LONGITUDE", longitude)


Mask = NDArray[np.bool_]

NOT_CHECKED, GOOD, ESTIMATED, MISSING = 0, 1, 8, 9
FLAGS = dict(enumerate((
    "no_qc_performed", "good_data", "probably_good_data",
    "bad_data_that_are_potentially_correctable", "bad_data", "value_changed", "not_used",
    "not_used", "estimated_value", "missing_value",
)))  # fmt: skip
ENDING = "_QC"


def quality(name: str, values: Array, *, estimated: Mask | None = None, good: Mask | None = None
            ) -> tuple[str, Og1Variable]:  # fmt: skip
    """Flag variable of one variable: missing values, estimated values, and values known to be good.

    Args:
      name: name of the variable.
      values: the variable's values, NaN where missing.
      estimated: True where values are interpolated or dead-reckoned.
      good: True where a measurement confirms the value.
    """
    codes = np.full(len(values), NOT_CHECKED)
    if estimated is not None:
        codes[estimated] = ESTIMATED
    if good is not None:
        codes[good] = GOOD
    codes[~np.isfinite(values)] = MISSING
    meanings = [f"{word}_{code}" if word == "not_used" else word for code, word in FLAGS.items()]
    attributes = {
        "long_name": f"quality flag of {name}",
        "standard_name": "status_flag",
        "flag_values": np.array(list(FLAGS), np.int8),
        "flag_meanings": " ".join(meanings),
        "coverage_content_type": "qualityInformation",
    }
    return f"{name}{ENDING}", Og1Variable(codes, attributes, fill=-127, kind="i1")
