"""`twin trim`: the steady glide or spiral of fixed actuator positions."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from twin.cli.console import Console, JsonOption


@dataclass(frozen=True, kw_only=True)
class Trim(JsonOption):
    """Steady state of these actuator positions: speed, angles, turn, through the water."""

    net_mass: float
    """net buoyancy mass [kg], positive is heavy and dives"""
    shift: float
    """battery position forward of neutral [m]"""
    rotation: float = 0.0
    """battery rotation [deg]; positive puts the mass to port and turns to starboard"""
    model: Literal["mujoco", "fossen"] = "mujoco"
    """equations to solve: the MuJoCo twin or the independent Fossen model"""
    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file"""
    hydrodynamics: Literal["coefficients", "ellipsoid"] = "coefficients"
    """water law of the MuJoCo model"""

    def run(self, console: Console) -> int:
        """Solve and print; NoSteadyState exits 1 with the reason."""
        import math

        from twin.errors import InputError
        from twin.vehicle.vehicle import load_vehicle

        for name, value in (
            ("net-mass", self.net_mass),
            ("shift", self.shift),
            ("rotation", self.rotation),
        ):
            if not math.isfinite(value):
                raise InputError(f"--{name} must be a finite number, not {value}")
        vehicle = load_vehicle(self.vehicle)
        rotation = math.radians(self.rotation)
        if self.model == "fossen":
            if self.hydrodynamics != "coefficients":
                raise InputError("--model fossen has only --hydrodynamics coefficients")
            from twin.fossen import FossenModel

            result = FossenModel(vehicle).trim(self.shift, rotation, self.net_mass)
        else:
            from twin.physics.settle import trim

            result = trim(
                vehicle, self.shift, rotation, self.net_mass, hydrodynamics=self.hydrodynamics
            )
        figures = asdict(result)
        if not result.in_identified_range:
            console.warn(
                f"angle of attack {result.angle_of_attack_deg:.1f} deg or sideslip "
                f"{result.sideslip_deg:.1f} deg is outside the identified range of "
                f"{math.degrees(vehicle.law.valid_angle):.0f} deg: trust the trend, not the figures"
            )
        console.answer(**figures)
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
            title=f"{vehicle.name}, {self.model}: steady motion",
        )
        return 0
