"""Real logs: the twin and the networks beside public methods.

    python -m benchmarks.real_logs FOLDER [--out PAGE] [--json] [--no-networks]

from the root of the repository. FOLDER holds folders of logs, see `benchmarks.real_logs.source`.
"""

import sys

from twin.cli.program import Program, ProgramCommand

PROGRAM = Program(
    name="benchmarks",
    summary="Programs of the repository that judge the packages.",
    commands=(
        ProgramCommand(
            name="real_logs",
            summary="public methods, the twin and networks on real logs with truth",
            loader="benchmarks.real_logs.command:RealLogs",
        ),
    ),
)


def main() -> int:
    """Entry point: the only command, named or not."""
    return PROGRAM.main(["real_logs", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
