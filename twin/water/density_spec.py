"""Density by name or file: what `--density` takes on the command line."""

from __future__ import annotations

from pathlib import Path

from twin.errors import InputError, unknown_name
from twin.water.density import DEFAULT_LATITUDE, DEFAULT_LONGITUDE, DensityProfile
from twin.water.table_file import column_numbers, read_table_file

NAMES = ("usual", "constant", "thermocline")
GRID = "grid"
"""The column of a gridded current's file; who knows the current makes it (`twin.facade`)"""
ALLOWED = (*NAMES, GRID, "a CSV file with columns depth,density")


def parse_density(
    text: str,
    *,
    latitude: float = DEFAULT_LATITUDE,
    longitude: float = DEFAULT_LONGITUDE,
) -> DensityProfile | None:
    """The profile of "usual", "constant", "thermocline", or a CSV file.

    "usual" is None, what a scenario without a density flies in; "constant" is the reference density
    at every depth, which no sea is: a hull that shrinks sinks ever faster there.

    The file has a header with `depth` [m] and either `density` [kg/m3] or `temperature` [degC]
    and `salinity` (practical). Lines that start with # are comments.

    Args:
      text: one of these names, or a path.
      latitude: [degree] north of where the water is, for densities that TEOS-10 gives.
      longitude: [degree] east, likewise.

    Raises:
      InputError: unknown name, unreadable file, missing column or bad row (named).
    """
    if text == "usual":
        return None
    if text == "constant":
        return DensityProfile.constant()
    if text == "thermocline":
        return DensityProfile.thermocline(latitude=latitude, longitude=longitude)
    if text == GRID:
        raise InputError(
            "density 'grid' is made of a current's file: `twin simulate --density grid`, or "
            'twin.simulate(density="grid", current=...)'
        )
    path = Path(text)
    if path.suffix.lower() != ".csv":
        raise InputError(unknown_name("density", text, ALLOWED))
    return read_density_csv(path, latitude=latitude, longitude=longitude)


def read_density_csv(
    path: Path, *, latitude: float = DEFAULT_LATITUDE, longitude: float = DEFAULT_LONGITUDE
) -> DensityProfile:
    """Read a profile from CSV; see `parse_density`."""
    frame = read_table_file(path, "density file")
    names = [str(name) for name in frame.columns]
    if not len(frame):
        raise InputError(f"density file {path} has no rows; it needs a header and one row or more")
    columns: dict[str, list[float]] = {}
    for name in (
        ("depth", "density") if "density" in names else ("depth", "temperature", "salinity")
    ):
        if names.count(name) != 1:
            lacks = "lacks the column" if name not in names else "has more than one column"
            raise InputError(
                f"density file {path} {lacks} {name!r} (found: {', '.join(names)}); it needs depth "
                "and density, or depth, temperature and salinity"
            )
        columns[name] = column_numbers(frame, name, f"density file {path}")
    if "density" in columns:
        return DensityProfile(depth=columns["depth"], values=columns["density"])  # type: ignore[arg-type]
    return DensityProfile.from_temperature_salinity(
        columns["depth"],
        columns["temperature"],
        columns["salinity"],
        latitude=latitude,
        longitude=longitude,
    )
