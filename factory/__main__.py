"""`factory`: glider missions in bulk."""

import sys

from twin.cli.program import Program, ProgramCommand

PROGRAM = Program(
    name="factory",
    summary="Data factory: randomised glider missions in bulk, in one zarr store.",
    commands=(
        ProgramCommand(
            name="generate",
            summary="fly randomised missions in parallel, into one store",
            loader="factory.commands.generate:Generate",
        ),
        ProgramCommand(
            name="reference",
            summary="make the reference set of 200 h, compare it with its checksums",
            loader="factory.commands.reference:WriteReference",
        ),
        ProgramCommand(
            name="finish",
            summary="complete a store that was made in parts, or list the missing ones",
            loader="factory.commands.finish:Finish",
        ),
        ProgramCommand(
            name="info",
            summary="what a store holds: preset, missions, splits, drawn values, failures",
            loader="factory.commands.info:Info",
        ),
        ProgramCommand(
            name="verify",
            summary="read every chunk; check padding, ranges and kinematics",
            loader="factory.commands.verify:Verify",
        ),
        ProgramCommand(
            name="repair",
            summary="make a damaged store whole again, bit for bit",
            loader="factory.commands.repair:Repair",
        ),
        ProgramCommand(
            name="replay",
            summary="fly stored missions again and compare every byte",
            loader="factory.commands.replay:ReplayMission",
        ),
        ProgramCommand(
            name="export",
            summary="OceanGliders OG1.0 netCDF files or a flat Parquet table",
            loader="factory.commands.export:ExportStore",
        ),
        ProgramCommand(
            name="import",
            summary="logs of real vehicles, dive by dive, in the same kind of store",
            loader="factory.commands.import_logs:ImportLogs",
        ),
        ProgramCommand(
            name="plot",
            summary="a page of tracks, depths, currents and histograms",
            loader="factory.commands.plot:PlotStore",
        ),
        ProgramCommand(
            name="distributions",
            summary="everything that is drawn, with unit and reason",
            loader="factory.commands.distributions:Distributions",
        ),
    ),
)


def main() -> int:
    """Entry point of the console script."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
