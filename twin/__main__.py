"""`twin`: the physics of one glider."""

import sys

from twin.cli.program import Program, ProgramCommand

PROGRAM = Program(
    name="twin",
    summary="Twin of an underwater glider: steady glides, simulated missions, checks.",
    commands=(
        ProgramCommand(
            name="vehicles",
            summary="those that are shipped, how fast they glide, where their numbers are from",
            loader="twin.commands.vehicles:Vehicles",
        ),
        ProgramCommand(
            name="trim",
            summary="steady glide or spiral of fixed actuator positions",
            loader="twin.commands.trim:TrimVehicle",
        ),
        ProgramCommand(
            name="simulate",
            summary="fly one mission: summary, store, plot",
            loader="twin.commands.simulate:Simulate",
        ),
        ProgramCommand(
            name="check",
            summary="MuJoCo against Fossen and against the published figures",
            loader="twin.commands.check:CheckModels",
        ),
        ProgramCommand(
            name="identify",
            summary="parameters of a vehicle from its own logs; a new vehicle file",
            loader="twin.commands.identify:Identify",
        ),
        ProgramCommand(
            name="energy",
            summary="where the counted charge goes: electronics, moves, payload; days left",
            loader="twin.commands.energy:AccountEnergy",
        ),
        ProgramCommand(
            name="flight",
            summary="speed, vertical water velocity, currents and corrected tracks of logs",
            loader="twin.commands.flight:EstimateFlight",
        ),
        ProgramCommand(
            name="hindcast",
            summary="forecasts of a deployment's surfacings beside where it surfaced",
            loader="twin.commands.hindcast:HindcastSurfacings",
        ),
        ProgramCommand(
            name="forecast",
            summary="the next surfacings of a glider: places with ellipses, times, energy",
            loader="twin.commands.forecast:ForecastSurfacings",
        ),
        ProgramCommand(
            name="bench",
            summary="cost of the physics, side by side in one run",
            loader="twin.commands.bench:Bench",
        ),
        ProgramCommand(
            name="render",
            summary="picture, video or offline page of a stored mission, without a screen",
            loader="twin.commands.render:Render",
        ),
        ProgramCommand(
            name="view",
            summary="the same in a window, or in a browser (--web), stored or flown live",
            loader="twin.commands.view:ViewMission",
        ),
        ProgramCommand(
            name="plot",
            summary="figures of a stored mission: track, section, velocities, sensors, current",
            loader="twin.commands.plot:PlotMission",
        ),
        ProgramCommand(
            name="version",
            summary="versions of this package and of the libraries that can change a result",
            loader="twin.commands.version:Version",
        ),
    ),
)


def main() -> int:
    """Entry point of the console script."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
