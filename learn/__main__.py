"""`learn`: networks for surge and sway, judged by dead reckoning."""

import sys

from twin.cli.program import Program, commands_of
from twin.extras import require_factory, require_learning

PROGRAM = Program(
    name="learn",
    summary="Networks for surge and sway, and the dead reckoning that uses them.",
    needs=require_factory if "velocities" in sys.argv[1:2] else require_learning,
    commands=commands_of(
        "learn.commands",
        {
            "fit": ("Fit", "train both networks, judge them, write runs/NAME/ with a report"),
            "report": (
                "learn.commands.trained:Report",
                "judge a run that was trained without, and draw its page",
            ),
            "evaluate": (
                "Evaluate",
                "dead reckoning of a run on any store, beside floor and baselines",
            ),
            "velocities": (
                "Velocities",
                "surge and sway of any store by the shipped networks, without torch",
            ),
            "adapt": (
                "learn.commands.trained:Adapt",
                "fit a run to a vehicle by its first dives, as a new run",
            ),
            "compare": ("learn.commands.trained:Compare", "one table of runs and baselines"),
            "export": (
                "learn.commands.trained:ExportNetwork",
                "step models for on-board use, ONNX or C99, with a parity check",
            ),
        },
    ),
)


def main() -> int:
    """Entry point of the console script."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
