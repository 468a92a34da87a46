"""`factory`: glider missions in bulk."""

import sys

from twin.program import Program

PROGRAM = Program(
    name="factory",
    summary="Data factory: randomised glider missions in bulk, in one zarr store.",
    commands=(),
)


def main() -> int:
    """Entry point of the console script."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
