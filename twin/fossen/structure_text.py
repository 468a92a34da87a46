"""Structure text: the equations of a vehicle, written out for the loop over lanes.

The text calls the scalar functions of the scalar model, and reads the vehicle's numbers from the
rows of a block.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from twin.compiled import Compiled
from twin.errors import VehicleError
from twin.fossen import terms
from twin.fossen.lane_block import AT, PART, PARTS_AT, row, rows
from twin.numbers import Array
from twin.vehicle.parts import BatteryHinge
from twin.vehicle.vehicle import Vehicle


class Writer:
    """Text of a structure's function, and the numbers of one vehicle that it reads."""

    def __init__(self, vehicle: Vehicle):
        self.lines: list[str] = []
        self.names: dict[str, Any] = {}
        self.kernels: list[tuple[str, str]] = []
        self.numbers: list[float] = []
        self.first = PARTS_AT + len(PART) * len(vehicle.parts)
        self.add = self.lines.append
        """Add a line of text."""

    def number(self, value: float) -> str:
        """Store a number of the vehicle; returns the text that reads it."""
        self.numbers.append(float(value))
        return row(self.first + len(self.numbers) - 1)

    def vector(self, values: Any) -> str:
        """Store several numbers; returns the text of their tuple."""
        return "(" + "".join(f"{self.number(value)}, " for value in np.ravel(values)) + ")"

    def symmetric(self, matrix: Array) -> str:
        """Store the lower triangle of a symmetric matrix; returns the text of its tuple."""
        return self.vector(matrix[np.tril_indices(len(matrix))])

    def call(self, what: str, name: str, function: Any, arguments: str, results: str) -> None:
        """Write the call of a type's own function, which `what` describes."""
        if not isinstance(function, Compiled):
            raise VehicleError(
                f"{name}: {function!r} is no compiled function; decorate it with twin.compiled.jit"
            )
        self.names[name] = function
        call = f"{results} = {name}({arguments})"
        wanted = arguments.split(", ")
        given = [line for line in self.lines if line.partition(" = ")[0] in wanted]
        given = [line for line in given if not line.startswith(("density", "there"))]
        any_rows = [f"{name} = {row(k)}" for k, name in enumerate(_GIVEN)]
        stored = [f"{row(k)} = {result}" for k, result in enumerate(results.split(", "))]
        self.kernels.append((what, body([*any_rows, *given, call, *stored])))
        self.add(call)


def body(lines: Iterable[str]) -> str:
    """Indent lines as the body of the loop over lanes."""
    return "".join(f"        {line}\n" for line in lines)


_TERMS = (
    "rotation", "rows_times", "columns_times", "quaternion_rate", "with_mass", "hung_mass",
    "mass_matrix", "cross", "balanced", "solved", "restoring", "buoyant_moment", "strain", "added",
)  # fmt: skip


def written(vehicle: Vehicle, volume: float, zeros: Mapping[str, float]) -> Writer:
    """Write the equations of a vehicle.

    Args:
      volume: [m3] neutral. zeros: as in `twin.fossen.structure.structure_of`.

    Raises:
      VehicleError: the law does not fly in lanes, or a type is not compiled.
    """
    w = Writer(vehicle)
    w.names |= {name: getattr(terms, name) for name in _TERMS}
    w.add(f"north, east, depth, e0, e1, e2, e3, u, v, w, wx, wy, wz, hull = {rows('state')}")
    w.add("rot = rotation(e0, e1, e2, e3)")
    w.add("down = (rot[6], rot[7], rot[8])")
    w.add("nu, omega = (u, v, w), (wx, wy, wz)")
    _write_flow(w)
    w.add(f"immersion, lever = {row(AT['immersion'])}, {row(AT['lever'])}")
    for k, part in enumerate(vehicle.parts):
        w.add(f"at{k} = {row(PARTS_AT + k)} + {w.number(zeros.get(part.name, 0.0))}")
    _write_masses(w, vehicle)
    _write_buoyancy(w, vehicle, volume)
    w.add(f"scale = immersion * density / {w.number(vehicle.reference_density)}")
    w.add(f"m_a = {w.symmetric(np.asarray(vehicle.added_mass))}")
    _write_law(w, vehicle)
    for index, part in enumerate(vehicle.parts):
        _write_part(w, vehicle, index, part)
    w.add("push, path = columns_times(rot, water_rate), columns_times(rot, path_rate)")
    w.add("wet = immersion * displaced")
    w.add("push = (wet * push[0], wet * push[1], wet * push[2])")
    coupling = "1.0" if vehicle.added_mass_coupling else "0.0"
    w.add(
        f"fx, fy, fz, fk, fm, fn = balanced(wrench, body, m_a, scale, {coupling}, nu, omega, "
        "(p, q, r), grad, path, push)"
    )
    before = [row(AT["before"] + k) for k in range(6)]
    for axis, name in enumerate(("fk", "fm", "fn")):
        # x = (M + g D)^-1 (F + g D x of the step before)
        w.add(f"d{axis} = g * max(d{axis}, 0.0)")
        w.add(f"{name} += d{axis} * {before[3 + axis]}")
    w.add("m = mass_matrix(body, m_a, scale)")
    w.add(
        "m = (m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9] + d0, m[10], m[11], m[12],"
        " m[13], m[14] + d1, m[15], m[16], m[17], m[18], m[19], m[20] + d2)"
    )
    w.add("x = solved(m, (fx, fy, fz, fk, fm, fn))")
    # leapfrog: a pose advances by the velocity half a step later
    for k, name in enumerate(("u", "v", "w", "wx", "wy", "wz")):
        w.add(f"half_{name} = {name} + g * (x[{k}] - 0.5 * {before[k]})")
    w.add("swing = cross(omega, nu)")
    later = (f"half_{name} + 0.5 * g * swing[{k}]" for k, name in enumerate(("u", "v", "w")))
    w.add(f"ahead = rows_times(rot, ({', '.join(later)}))")
    for k in range(3):
        w.add(f"{row(AT['going'] + k)} = ahead[{k}] + flow[{k}] + 0.5 * g * path_rate[{k}]")
    w.add("turning = quaternion_rate(e0, e1, e2, e3, (half_wx, half_wy, half_wz))")
    lag = w.number(vehicle.hull_thermal_lag)
    outputs = [
        *(f"velocity[{k}]" for k in range(3)),
        *(f"turning[{k}]" for k in range(4)),
        *(f"x[{k}]" for k in range(6)),
        f"(temperature - hull) / {lag}",
    ]
    for k, output in enumerate(outputs):
        w.add(f"{row(AT['rate'] + k)} = {output}")
    for k in range(3):
        w.add(f"{row(AT['current'] + k)} = flow[{k}]")
        w.add(f"{row(AT['path_rate'] + k)} = path_rate[{k}]")
    w.add(f"{row(AT['water'])} = density")
    w.add(f"{row(AT['net_mass'])} = body[0] - displaced")
    return w


def _write_flow(w: Writer) -> None:
    """Write the current, linear about the place of its look-up, and the water's tables."""
    looked, flow = AT["looked"], AT["flow"]
    w.add(f"dn, de = north - {row(looked)}, east - {row(looked + 1)}")
    w.add(f"dd, tau = depth - {row(looked + 2)}, {row(AT['time'])} - {row(looked + 3)}")
    w.add("flow = (" + " ".join(
        f"{row(flow + i)} + tau * {row(flow + 3 + i)} + ({row(flow + 6 + 3 * i)} * dn"
        f" + {row(flow + 7 + 3 * i)} * de + {row(flow + 8 + 3 * i)} * dd),"
        for i in range(3)
    ) + ")")  # fmt: skip
    w.add("g_ned = (" + "".join(f"{row(flow + 6 + k)}, " for k in range(9)) + ")")
    w.add("through = rows_times(rot, nu)")
    w.add("velocity = (through[0] + flow[0], through[1] + flow[1], through[2] + flow[2])")
    w.add("g_path, g_water = rows_times(g_ned, velocity), rows_times(g_ned, flow)")
    for name in ("path", "water"):
        sums = ", ".join(f"{row(flow + 3 + k)} + g_{name}[{k}]" for k in range(3))
        w.add(f"{name}_rate = ({sums})")
    # G = R^T (grad V_c) R, column by column of R
    for k in range(3):
        w.add(
            f"c{k} = columns_times(rot, rows_times(g_ned, (rot[{k}], rot[{3 + k}], rot[{6 + k}])))"
        )
    w.add("grad = (c0[0], c1[0], c2[0], c0[1], c1[1], c2[1], c0[2], c1[2], c2[2])")
    w.add("p, q, r = wx - grad[7], wy + grad[6], wz - grad[3]")
    w.add(f"density = {row(AT['density'])} + {row(AT['density_slope'])} * dd")
    w.add(f"temperature = {row(AT['temperature'])} + {row(AT['temperature_slope'])} * dd")


def _write_masses(w: Writer, vehicle: Vehicle) -> None:
    zero = "(0.0, 0.0, 0.0)"
    still = "(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)"
    w.add(
        f"body = with_mass((0.0, {zero}, {still}), {w.number(vehicle.static_mass)}, "
        f"{w.vector(vehicle.static_cg)}, {w.symmetric(np.asarray(vehicle.static_inertia))})"
    )
    at = {name: f"at{k}" for k, name in enumerate(vehicle.part_names)}
    for mass in vehicle.masses:
        shift = "0.0" if mass.slide is None else at[mass.slide]
        roll = "0.0"
        if mass.hinge is not None:
            hinge = vehicle.part(mass.hinge)
            hung = hinge.neutral if isinstance(hinge, BatteryHinge) else 0.0
            roll = f"{at[mass.hinge]} - {w.number(hung)}"
        w.add(
            f"place, turned = hung_mass({w.number(mass.neutral_x)}, {w.number(mass.eccentricity)}, "
            f"{shift}, {roll}, {w.symmetric(np.asarray(mass.inertia))})"
        )
        w.add(f"body = with_mass(body, {w.number(mass.mass)}, place, turned)")
    for index, part in enumerate(vehicle.parts):
        kernel = type(part).fossen_mass
        if kernel is not None:
            w.add(f"values{index} = {w.vector(part.values())}")
            what = f"fossen_mass of part kind {part.kind!r}"
            w.call(what, f"mass_of_{index}", kernel, f"values{index}, at{index}", "own")
            w.add(f"body = with_mass(body, own, {w.vector(part.position)}, {still})")


def _write_buoyancy(w: Writer, vehicle: Vehicle, neutral: float) -> None:
    w.add("volume, lx, ly, lz = 0.0, 0.0, 0.0, 0.0")
    for index, part in enumerate(vehicle.parts):
        kernel = type(part).fossen_volume
        if kernel is None:
            continue
        w.add(f"values{index} = {w.vector(part.values())}")
        what = f"fossen_volume of part kind {part.kind!r}"
        w.call(what, f"volume_of_{index}", kernel, f"values{index}, at{index}", "own")
        x, y, z = (w.number(value) for value in part.position)
        w.add("volume += own")
        w.add(f"lx, ly, lz = lx + own * {x}, ly + own * {y}, lz + own * {z}")
    gravity = w.number(vehicle.gravity)
    reference = w.number(vehicle.hull_reference_temperature)
    w.add(
        f"stretch = strain({w.number(vehicle.hull_compressibility)}, "
        f"{w.number(vehicle.reference_density)} * {gravity} * max(depth, 0.0), "
        f"{w.number(vehicle.hull_thermal_expansion)}, hull - {reference})"
    )
    w.add(f"displaced = density * ({w.number(neutral)} + 1e-6 * volume) * stretch")
    w.add(f"wrench = restoring({gravity}, displaced, immersion, lever, body, down)")
    # buoyancy of pumped volume acts at the pump's place
    w.add("pumped = immersion * density * stretch * 1e-6")
    w.add(f"raised = buoyant_moment({gravity}, pumped, (lx, ly, lz), down)")
    w.add("wrench = (wrench[0], (wrench[1][0] + raised[0], wrench[1][1] + raised[1],"
          " wrench[1][2] + raised[2]))")  # fmt: skip


_LAW = ("fx", "fy", "fz", "fk", "fm", "fn", "d0", "d1", "d2")
_MOTION = "density, u, v, w, p, q, r"
_GIVEN = ("u", "v", "w", "p", "q", "r", "density", "there")
"""Arguments of a type's function besides its own numbers."""


def _write_law(w: Writer, vehicle: Vehicle) -> None:
    law, kind = vehicle.law, type(vehicle.law)
    if kind.not_in_lanes:
        raise VehicleError(
            f"vehicle {vehicle.name!r}: hull law {law.kind!r} does not fly in lanes, "
            f"{kind.not_in_lanes}; fly it with engine='mujoco'"
        )
    w.add(f"c = {w.vector(law.values())}")
    unrolled = law.fossen_unrolled()
    if unrolled is not None:
        expressions, names = unrolled
        w.names |= names
        for name, expression in zip(_LAW, expressions, strict=True):
            w.add(f"{name} = {expression}")
    else:
        what = f"fossen_wrench of hull law {law.kind!r}"
        w.call(what, "law", kind.fossen_wrench, f"c, {_MOTION}", ", ".join(_LAW[:6]))
        if kind.fossen_rate_damping is not None:
            what = f"fossen_rate_damping of hull law {law.kind!r}"
            called = f"c, {_MOTION}"
            w.call(what, "law_damping", kind.fossen_rate_damping, called, "d0, d1, d2")
        else:
            for axis, name in enumerate(("p", "q", "r")):
                motion = _MOTION.replace(name, f"{name} + {RATE}")
                moment = ("fk", "fm", "fn")[axis]
                w.add(f"d{axis} = ({moment} - law(c, {motion})[{3 + axis}]) / {RATE}")
    scaled = "scale" if law.density_in_coefficients else "immersion"
    for axis in range(3):
        w.add(f"d{axis} *= {scaled}")
    w.add(
        f"wrench = added(wrench, (({scaled} * fx, {scaled} * fy, {scaled} * fz),"
        f" ({scaled} * fk, {scaled} * fm, {scaled} * fn)))"
    )


RATE = 1e-4
"""[rad/s] Step of the differences that replace a missing `fossen_rate_damping`."""


def _write_part(w: Writer, vehicle: Vehicle, index: int, part: Any) -> None:
    kernel = type(part).fossen_wrench
    if kernel is None:
        return
    w.add(f"values{index} = {w.vector(part.values())}")
    w.add(f"place = {w.vector(part.position)}")
    w.add("there = depth + place[0] * down[0] + place[1] * down[1] + place[2] * down[2]")
    arguments = f"values{index}, place, at{index}, u, v, w, p, q, r, density, there"
    what = f"fossen_wrench of part kind {part.kind!r}"
    w.call(what, f"wrench_of_{index}", kernel, arguments, ", ".join(_LAW[:6]))
    w.add("wrench = added(wrench, ((fx, fy, fz), (fk, fm, fn)))")
