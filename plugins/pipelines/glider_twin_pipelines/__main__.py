"""Command `python -m glider_twin_pipelines`: add a flight model's results, as a pipeline's step."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from glider_twin_pipelines import add_flights
from twin.errors import TwinError

PROGRAM = "python -m glider_twin_pipelines"


def main(words: Sequence[str] | None = None) -> int:
    """Add a flight model's results to the named files; a failure exits with 1 and a reason."""
    parser = argparse.ArgumentParser(prog=PROGRAM, description=main.__doc__)
    add = parser.add_argument
    add("files", nargs="+", type=Path, help="dives of basestation3 together, or one time series of "
        "pyglider")  # fmt: skip
    add("--vehicle", help="what `twin identify` wrote, or a shipped vehicle's name [default: the "
        "shipped one of the log's type]")  # fmt: skip
    add("--write", nargs="+", type=Path, help="only these are added to; the others are read for "
        "their fixes [default: all]")  # fmt: skip
    given = parser.parse_args(words)
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", UserWarning)
            changed = add_flights(given.files, given.vehicle, given.write)
    except (TwinError, OSError) as error:
        sys.stderr.write(f"{PROGRAM}: {error}\n")
        return 1
    for one in told:
        sys.stderr.write(f"{PROGRAM}: warning: {one.message}\n")
    sys.stdout.write(f"{len(changed)} of {len(given.write or given.files)} files changed\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
