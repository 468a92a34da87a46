"""Command line program `factory`: randomised glider missions in bulk."""

import sys

from twin.cli.program import Program, commands_of
from twin.extras import require_factory

PROGRAM = Program(
    name="factory",
    summary="Data factory: randomised glider missions in bulk, in one zarr store.",
    needs=require_factory,
    commands=commands_of(
        "factory.commands",
        {
            "generate": ("Generate", "fly randomised missions in parallel, into one store"),
            "reference": (
                "factory.commands.generate:WriteReference",
                "make the reference set of 200 h, compare it with its checksums",
            ),
            "finish": (
                "factory.commands.generate:Finish",
                "complete a store that was made in parts, or list the missing ones",
            ),
            "info": (
                "factory.commands.stored:Info",
                "what a store holds: preset, missions, splits, drawn values, failures",
            ),
            "verify": (
                "factory.commands.stored:Verify",
                "read every chunk; check padding, ranges and kinematics; fly missions again",
            ),
            "export": ("ExportStore", "OceanGliders OG1.0 netCDF files or a flat Parquet table"),
            "import": (
                "factory.commands.import_logs:ImportLogs",
                "logs of real vehicles, dive by dive, in the same kind of store",
            ),
            "plot": (
                "factory.commands.stored:PlotStore",
                "a page of tracks, depths, currents and histograms",
            ),
            "distributions": (
                "factory.commands.generate:Distributions",
                "everything that is drawn, with unit and reason",
            ),
        },
    ),
)


def main() -> int:
    """Entry point of the console script."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
