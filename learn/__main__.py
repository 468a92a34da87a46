"""`learn`: networks for surge and sway, judged by dead reckoning."""

import sys

from twin.program import Program

PROGRAM = Program(
    name="learn",
    summary="Networks for surge and sway, and the dead reckoning that uses them.",
    commands=(),
)


def main() -> int:
    """Entry point of the console script."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
