"""`python -m twin.control`: a task in the dm_control viewer."""

import sys

from twin.cli.program import Program, ProgramCommand

_VIEW = "view"
PROGRAM = Program(
    name="python -m twin.control",
    summary="Control tasks for a glider, in the dm_control viewer.",
    commands=(
        ProgramCommand(
            name=_VIEW,
            summary="watch a policy fly a task (the default command)",
            loader="twin.control.viewer:View",
        ),
    ),
)


def main() -> int:
    """Entry point; options without a command, and nothing at all, go to `view`."""
    words = sys.argv[1:]
    if not words or (words[0].startswith("-") and words[0] not in ("-h", "--help", "--version")):
        words = [_VIEW, *words]
    return PROGRAM.main(words)


if __name__ == "__main__":
    sys.exit(main())
