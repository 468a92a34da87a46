"""`twin`: the physics of one glider."""

import sys

from twin.cli.program import Command, Program

PROGRAM = Program(
    name="twin",
    summary="Twin of an underwater glider: steady glides, simulated missions, checks.",
    commands=(
        Command(
            name="vehicles",
            summary="those that are shipped, how fast they glide, where their numbers are from",
            loader="twin.commands.vehicles:Vehicles",
        ),
        Command(
            name="trim",
            summary="steady glide or spiral of fixed actuator positions",
            loader="twin.commands.trim:Trim",
        ),
        Command(
            name="simulate",
            summary="fly one mission: summary, store, plot",
            loader="twin.commands.simulate:Simulate",
        ),
        Command(
            name="check",
            summary="MuJoCo against Fossen and against the published figures",
            loader="twin.commands.check:Check",
        ),
        Command(
            name="identify",
            summary="parameters of a vehicle from its own logs; a new vehicle file",
            loader="twin.commands.identify:Identify",
        ),
        Command(
            name="flight",
            summary="speed, vertical water velocity, currents and corrected tracks of logs",
            loader="twin.commands.flight:Flight",
        ),
        Command(
            name="hindcast",
            summary="forecasts of a deployment's surfacings beside where it surfaced",
            loader="twin.commands.hindcast:Hindcast",
        ),
        Command(
            name="forecast",
            summary="the next surfacings of a glider: places with ellipses, times, energy",
            loader="twin.commands.forecast:Forecast",
        ),
        Command(
            name="bench",
            summary="cost of the physics, side by side in one run",
            loader="twin.commands.bench:Bench",
        ),
        Command(
            name="render",
            summary="picture, video or offline page of a stored mission, without a screen",
            loader="twin.commands.render:Render",
        ),
        Command(
            name="view",
            summary="the same in a window, or in a browser (--web), stored or flown live",
            loader="twin.commands.view:View",
        ),
        Command(
            name="plot",
            summary="figures of a stored mission: track, section, velocities, sensors, current",
            loader="twin.commands.plot:Plot",
        ),
        Command(
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
