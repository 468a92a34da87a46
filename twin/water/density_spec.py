"""Water columns by name: what `--density` takes on the command line."""

from __future__ import annotations

from pathlib import Path

from twin.errors import InputError, unknown_name
from twin.water.density import DensityProfile
from twin.water.separators import check_commas

NAMES = ("constant", "thermocline")
ALLOWED = (*NAMES, "a CSV file with columns depth,density")


def parse_density(text: str) -> DensityProfile | None:
    """The profile of "constant" (None: the reference density), "thermocline", or a CSV file.

    The file has a header with `depth` [m] and either `density` [kg/m3] or `temperature` [degC]
    and `salinity` (practical). Lines that start with # are comments.

    Raises:
      InputError: unknown name, unreadable file, missing column or bad row (named).
    """
    if text == "constant":
        return None
    if text == "thermocline":
        return DensityProfile.thermocline()
    path = Path(text)
    if path.suffix.lower() != ".csv":
        raise InputError(unknown_name("density", text, ALLOWED))
    return read_density_csv(path)


def read_density_csv(path: Path) -> DensityProfile:
    """Read a profile from CSV; see `parse_density`."""
    import csv

    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read density file {path}: {error}") from error
    numbered = [
        (number, line)
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    check_commas(f"density file {path}", numbered)
    rows = list(csv.DictReader(line for _, line in numbered))
    if not rows:
        raise InputError(f"density file {path} has no rows; it needs a header and one row or more")
    columns: dict[str, list[float]] = {}
    wanted = ("depth", "density") if "density" in rows[0] else ("depth", "temperature", "salinity")
    for name in wanted:
        if name not in rows[0]:
            raise InputError(
                f"density file {path} lacks the column {name!r} (found: {', '.join(rows[0])}); it "
                "needs depth and density, or depth, temperature and salinity"
            )
        try:
            columns[name] = [float(row[name]) for row in rows]
        except (TypeError, ValueError) as error:
            raise InputError(f"density file {path}, column {name!r}: {error}") from error
    if "density" in columns:
        return DensityProfile(depth=columns["depth"], values=columns["density"])  # type: ignore[arg-type]
    return DensityProfile.from_temperature_salinity(
        columns["depth"], columns["temperature"], columns["salinity"]
    )
