"""`learn`: networks for surge and sway, judged by dead reckoning."""

import sys

from twin.cli.program import Program, ProgramCommand
from twin.extras import require_learning

PROGRAM = Program(
    name="learn",
    summary="Networks for surge and sway, and the dead reckoning that uses them.",
    needs=require_learning,
    commands=(
        ProgramCommand(
            name="fit",
            summary="train both networks, judge them, write runs/NAME/ with a report",
            loader="learn.commands.fit:Fit",
        ),
        ProgramCommand(
            name="evaluate",
            summary="dead reckoning of a run on any store, beside floor and baselines",
            loader="learn.commands.evaluate:Evaluate",
        ),
        ProgramCommand(
            name="compare",
            summary="one table of runs and baselines",
            loader="learn.commands.compare:Compare",
        ),
        ProgramCommand(
            name="export",
            summary="step models for on-board use, ONNX or C99, with a parity check",
            loader="learn.commands.export:ExportNetwork",
        ),
    ),
)


def main() -> int:
    """Entry point of the console script."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
