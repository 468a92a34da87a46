"""`factory`: glider missions in bulk."""

import sys

from twin.program import Command, Program

PROGRAM = Program(
    name="factory",
    summary="Data factory: randomised glider missions in bulk, in one zarr store.",
    commands=(
        Command(
            name="generate",
            summary="fly randomised missions in parallel, into one store",
            loader="factory.commands.generate:Generate",
        ),
        Command(
            name="replay",
            summary="fly stored missions again and compare every byte",
            loader="factory.commands.replay:Replay",
        ),
    ),
)


def main() -> int:
    """Entry point of the console script."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
