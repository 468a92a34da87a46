"""Entry point of the program `twin`, the physics of one glider, with the table of its commands."""

import sys

from twin.cli.program import Program, commands_of

ROWS = """\
vehicles trim:Vehicles those that are shipped, how fast they glide, where their numbers are from
trim TrimVehicle steady glide or spiral of fixed actuator positions
simulate Simulate fly one mission: summary, store, plot
serve plugins/protocols one vehicle for ArduPilot's SITL, what speaks its protocol, or ROS 2
check CheckModels MuJoCo against Fossen and against the published figures
identify Identify parameters of a vehicle from its own logs; a new vehicle file
energy flight:AccountEnergy where the counted charge goes: electronics, moves, payload; days left
flight EstimateFlight speed, vertical water velocity, currents and corrected tracks of logs
compile machine:CompileVehicles the code of the shipped vehicles, once for all flights
bench machine:Bench cost of the physics, side by side in one run
render Render picture, video or offline page of a stored mission, without a screen
view ViewMission the same in a window, or in a browser (--web), stored or flown live
plot PlotMission figures of a stored mission: track, section, velocities, sensors, current
version machine:Version versions of this package and of the libraries that can change a result
watch plugins/ops a deployment at sea: new files in, health, forecast and a page out, every day
health plugins/ops is something wrong with the vehicle: which fault, since when, how sure
forecast plugins/ops the next surfacings of a glider: places with ellipses, times, energy
hindcast plugins/ops forecasts of a deployment's surfacings beside where it surfaced
route plugins/ops the best ways to a place through a forecast of the current
markers plugins/vision sheets of markers to print, for a camera that measures a vehicle's velocity
observe plugins/vision video of a stored mission by a camera that sees such markers
""".splitlines()
"""Name, place and summary of each command, in the order of the help; see `commands_of`"""
PROGRAM = Program(
    name="twin",
    summary="Twin of an underwater glider: steady glides, simulated missions, checks.",
    commands=commands_of(
        "twin.commands",
        {name: (place, told) for name, place, told in (row.split(maxsplit=2) for row in ROWS)},
    ),
)


def main() -> int:
    """Run the console script and return its exit code."""
    return PROGRAM.main()


if __name__ == "__main__":
    sys.exit(main())
