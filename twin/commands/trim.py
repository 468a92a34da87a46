"""Commands `twin vehicles` and `twin trim`: shipped vehicles, and steady motion of fixed parts."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli.console import Console, JsonOption

if TYPE_CHECKING:
    from twin import Vehicle


@dataclass(frozen=True, kw_only=True)
class Vehicles(JsonOption):
    """List the shipped vehicles and their presets: mass, propeller, pump, usual speed, and the
    source of the numbers.

    Examples:

        twin vehicles
        twin vehicles --template > mine.xml
    """

    template: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="[NAME]")] = None
    """print a vehicle file to begin with, from the shipped vehicle NAME (default: glider)"""

    def run(self, console: Console) -> int:
        """Print one line for each vehicle, then a summary and the source of each one's numbers."""
        from dataclasses import asdict

        from twin.mission import shipped_vehicles
        from twin.vehicle import vehicle_template

        if self.template is not None:
            text = vehicle_template(" ".join(self.template) or "glider")
            console.say(text.rstrip("\n"))
            console.answer(template=text)
            return 0
        lines = shipped_vehicles()
        console.table(
            [line.cells() for line in lines],
            title="Shipped vehicles in their usual glide, or at their cruise",
        )
        console.say()
        console.pairs({line.name: line.summary for line in lines})
        console.say()
        console.pairs({line.name: line.source for line in lines}, title="Sources")
        console.answer(vehicles=[asdict(line) for line in lines])
        return 0


@dataclass(frozen=True, kw_only=True)
class TrimVehicle(JsonOption):
    """Solve the steady motion for fixed positions of the parts: speed, angles and turn rate.

    Examples:

        twin trim --net-mass 0.3 --shift 0.02 --rotation 45
        twin trim --vehicle tethys --set propeller=30
    """

    net_mass: float | None = None
    """net buoyancy mass [kg] of a vehicle with a pump, positive is heavy and dives; without any
    option a glider's usual dive is solved"""
    shift: float | None = None
    """battery position forward of neutral [m]"""
    rotation: float = 0.0
    """position of the turning part [deg]: a rudder's deflection, or a battery's rotation, where
    positive puts the mass to port and turns to starboard"""
    positions: Annotated[
        tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(name="set", metavar="PART=VALUE")
    ] = ()
    """position of any part, in the part's own unit (rad, m, cm3, rad/s), such as --set
    propeller=60; may be repeated, or be a list with commas; other parts are at rest"""
    model: Literal["mujoco", "fossen"] = "mujoco"
    """equations to solve: the MuJoCo twin or the independent Fossen model"""
    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file; :PRESET after it selects a preset in it"""
    hydrodynamics: Literal["coefficients", "ellipsoid"] = "coefficients"
    """the vehicle file's own hull law, or MuJoCo's ellipsoid law on the geometry"""

    def run(self, console: Console) -> int:
        """Solve and report the motion; NoSteadyState exits with 1 and the reason."""
        import math

        from twin import load_vehicle
        from twin.cli.options import parse_numbers
        from twin.errors import InputError
        from twin.vehicle import positions_text, trim_positions

        vehicle = load_vehicle(self.vehicle)
        net_mass, shift = self.net_mass, self.shift
        if net_mass is None and shift is None and not self.rotation and not self.positions:
            net_mass, shift = _usual_dive(vehicle)
        net_mass, shift = net_mass or 0.0, shift or 0.0
        for name, value in (("net-mass", net_mass), ("shift", shift), ("rotation", self.rotation)):
            if not math.isfinite(value):
                raise InputError(f"--{name} must be a finite number, not {value}")
        if self.hydrodynamics != "coefficients":
            vehicle = vehicle.with_law(self.hydrodynamics)
        request = (shift, math.radians(self.rotation), net_mass)
        units = "its unit is the part's own: rad, m, cm3, rad/s"
        example = f"a part and its position, such as propeller=60 ({units})"
        given = parse_numbers("set", self.positions, example)
        if self.model == "fossen":
            from twin.fossen import FossenModel

            result = FossenModel(vehicle).trim(*request, positions=given)
        else:
            from twin import trim

            result = trim(vehicle, *request, positions=given)
        if not result.in_identified_range:
            console.warn(
                f"angle of attack {result.angle_of_attack_deg:.1f} deg or sideslip "
                f"{result.sideslip_deg:.1f} deg is outside the identified range of "
                f"{math.degrees(vehicle.law.valid_angle):.0f} deg: trust the trend, not the figures"
            )
        positions = trim_positions(vehicle, *request, positions=given)
        console.answer(
            **asdict(result),
            vehicle=vehicle.name,
            positions=dict(zip(vehicle.part_names, positions.tolist(), strict=True)),
        )
        radius = result.turn_radius_m
        console.pairs(
            {
                "speed through the water": f"{result.speed_m_s:.4f} m/s",
                "angle of attack": f"{result.angle_of_attack_deg:z.3f} deg",
                "sideslip": f"{result.sideslip_deg:z.3f} deg",
                "roll": f"{result.roll_deg:z.3f} deg",
                "pitch": f"{result.pitch_deg:z.3f} deg",
                "turn rate about the vertical": f"{result.turn_rate_rad_s:z.5f} rad/s",
                "turn radius": "straight" if radius is None else f"{radius:.1f} m",
                "vertical speed (down)": f"{result.vertical_speed_m_s:z.4f} m/s",
            },
            title=f"{vehicle.name}, {self.model}: steady motion at "
            f"{positions_text(vehicle, positions)}",
        )
        return 0


def _usual_dive(vehicle: Vehicle) -> tuple[float, float]:
    """Net mass [kg] and shift [m] of the usual dive of a glider that a battery pitches.

    Raises:
      InputError: the vehicle does not glide; the message names the option to give instead.
    """
    from twin.errors import InputError
    from twin.mission import steady_glide
    from twin.vehicle.parts import BatterySlide, Pump

    pitch, net_mass = vehicle.usual_glide
    slides = isinstance(vehicle.steered("pitch"), BatterySlide)
    if not slides or not isinstance(vehicle.steered("buoyancy"), Pump):
        parts = ", ".join(f"{part.name} ({part.low:g} to {part.high:g})" for part in vehicle.parts)
        raise InputError(
            f"vehicle {vehicle.name!r} has no usual dive: say the positions that it holds by --set "
            f"PART=VALUE; its parts: {parts or 'none'}"
        )
    return net_mass, steady_glide(vehicle, -pitch, net_mass).shift
