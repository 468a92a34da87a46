"""Density: in-situ density of sea water over depth, and the pressure that it makes.

A profile is a table over depth. Compiled to a flat float64 array, it is read by `density_at` in the
native plant; integrated over depth, it gives the pressure at a gauge.
Equation of state: TEOS-10 through `gsw` (McDougall and Barker, 2011).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from twin.compiled import borrowing, jit
from twin.compiled.elementary import exp
from twin.errors import InputError, unknown_name
from twin.numbers import Array, number, numbers
from twin.water.table_file import column_numbers, read_table_file

REFERENCE_DENSITY = 1025.0
"""[kg/m3] Density inside the Sea-Wing's coefficients (Zhang et al., 2013)."""
DENSITY_RANGE = (950.0, 1100.0)
"""[kg/m3] Allowed densities: sea, brackish and fresh water down to the deepest trench."""
GRAVITY_DEPTH_RATE = 2.26e-7
"""[1/m] Relative growth of gravity with depth in TEOS-10."""
PASCAL_PER_DBAR = 1e4
DEFAULT_LONGITUDE = -121.8
"""[deg] Monterey Bay; longitude only enters the small composition anomaly of salinity."""
DEFAULT_LATITUDE = 36.8
"""[deg] Monterey Bay, where the paper's vehicle sailed."""
DEEPEST = 12_000.0
"""[m] Largest depth of a profile; the deepest sea has 10 935 m. Runs tabulate every metre."""
DEFAULT_SPACING = 1.0
"""[m] Grid of a compiled profile whose own depths are not equally spaced."""
SEA_COMPRESSIBILITY = 4.35e-10
"""[1/Pa] Compressibility of sea water, mean over the upper 1000 m at 35 g/kg and 10 degC (TEOS-10).
A hull's is nearly equal. If the water of a log is taken as incompressible, its hull seems rigid."""
STANDARD_OCEAN = (1028.106, 4.7e-3)
"""[kg/m3], [kg/m4] Density of TEOS-10's standard ocean (0 degC, 35 g/kg) at the surface and its
growth with depth, within 0.02 kg/m3 to 1000 m. Vehicles compute depth from pressure with it."""
COLUMN_DEPTH = 6000.0
"""[m] Depth of a column that is given by its surface density alone."""
PROGRAM_HEADER = 2
MAX_PROGRAM_POINTS = 20_000
"""Maximum number of points of a compiled table: 12 000 m at 1 m; more mean a wrong spacing."""


def standard_density(depth: ArrayLike) -> Array:
    """Density [kg/m3] of STANDARD_OCEAN at a depth [m]; at the surface above it."""
    return STANDARD_OCEAN[0] + STANDARD_OCEAN[1] * np.maximum(depth, 0.0)


def gravity(latitude: float, depth: ArrayLike = 0.0) -> Array:
    """Gravity [m/s2] at `latitude` [deg] and `depth` [m]; TEOS-10, as in `gsw.grav`."""
    sin2 = np.sin(np.deg2rad(latitude)) ** 2
    surface = 9.780327 * (1.0 + (5.2792e-3 + 2.32e-5 * sin2) * sin2)
    return np.asarray(surface * (1.0 + GRAVITY_DEPTH_RATE * np.asarray(depth, float)))


@jit
def _decay(depth, mixed_layer_depth, decay_depth):  # type: ignore[no-untyped-def]
    """Surface minus deep value, as a fraction left at each depth, bit-identical everywhere."""
    left = np.empty(depth.size)
    for i in range(depth.size):
        left[i] = exp(-max(depth[i] - mixed_layer_depth, 0.0) / decay_depth)
    return left


@borrowing
def density_at(program, depth):  # type: ignore[no-untyped-def]
    """Density [kg/m3] at `depth` [m] in a compiled profile, clamped at both ends; NaN stays NaN.

    Allocation-free, for other compiled code. `program`: compiled table, (n, dz, n values).
    """
    if depth != depth:
        return depth
    last = min(int(program[0]), program.size - PROGRAM_HEADER) - 1
    if last < 0:
        return math.nan  # an empty profile
    if depth <= 0.0 or last == 0:
        return program[PROGRAM_HEADER]
    x = depth / program[1]
    if not x >= 0.0:
        return math.nan  # a damaged profile: its spacing is not positive
    if x >= last:
        return program[PROGRAM_HEADER + last]
    i = int(x)
    f = x - i
    return (1.0 - f) * program[PROGRAM_HEADER + i] + f * program[PROGRAM_HEADER + i + 1]


@borrowing
def density_slope_at(program, depth):  # type: ignore[no-untyped-def]
    """Slope of `density_at` over depth [kg/m4] in the row at `depth`; 0 beyond the ends."""
    last = min(int(program[0]), program.size - PROGRAM_HEADER) - 1
    if not depth > 0.0 or last < 1:
        return 0.0
    x = depth / program[1]
    if not 0.0 <= x < last:
        return 0.0
    i = PROGRAM_HEADER + int(x)
    return (program[i + 1] - program[i]) / program[1]


@jit
def _pressure_kernel(top, values, above, surface_gravity, depth, out):  # type: ignore[no-untyped-def]
    """Write the pressure [dbar] at each depth into `out`, from rows `top` [m] and `above` [Pa]."""
    i = 0
    last = top.shape[0] - 1
    for k in range(depth.shape[0]):
        z = depth[k]
        if z <= 0.0:
            out[k] = 0.0
            continue
        # depth changes little between samples, so the search starts at the last row
        while i > 0 and top[i] > z:
            i -= 1
        while i < last and top[i + 1] <= z:
            i += 1
        rest = z - top[i]
        mean = values[i]
        if i < last:
            mean += 0.5 * rest * (values[i + 1] - values[i]) / (top[i + 1] - top[i])
        gravity_here = surface_gravity * (1.0 + GRAVITY_DEPTH_RATE * 0.5 * (z + top[i]))
        out[k] = (above[i] + mean * rest * gravity_here) / PASCAL_PER_DBAR


def _check_table(depth: Array, values: Array, name: str) -> None:
    if depth.ndim != 1 or values.shape != depth.shape or depth.size == 0:
        raise InputError(
            f"density profile: depth has shape {depth.shape} and {name} {values.shape}; "
            "give two vectors of one length"
        )
    for label, array in (("depth", depth), (name, values)):
        if not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array))[0])
            raise InputError(
                f"density profile: {label} is {array[row]} in row {row}; drop that row"
            )
    if depth.max() > DEEPEST:
        raise InputError(
            f"density profile: depth is {depth.max():g} m; no sea is deeper than {DEEPEST:g} m"
        )
    if depth[0] < 0.0:
        raise InputError(
            f"density profile: depth {depth[0]:g} m is negative; depth counts positive downwards"
        )
    if np.any(np.diff(depth) <= 0.0):
        row = int(np.flatnonzero(np.diff(depth) <= 0.0)[0]) + 1
        raise InputError(
            f"density profile: depth {depth[row]:g} m in row {row} does not exceed the row above; "
            "sort the rows by depth and drop duplicates"
        )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DensityProfile:
    """In-situ density over depth, linear between the rows and constant beyond them."""

    depth: Array
    """[m] Depths, shape (n,), positive down, increasing."""
    values: Array
    """[kg/m3] In-situ densities, shape (n,)."""
    temperature: Array | None = None
    """[degree_Celsius] In-situ temperatures, shape (n,); None: unknown."""
    salinity: Array | None = None
    """[1] Practical salinities (PSS-78), shape (n,); None: unknown."""

    def __post_init__(self) -> None:
        depth = numbers(self.depth, "density profile: depth")
        values = numbers(self.values, "density profile: values")
        _check_table(depth, values, "density")
        low, high = DENSITY_RANGE
        if values.min() < low or values.max() > high:
            worst = values.min() if values.min() < low else values.max()
            raise InputError(
                f"density profile: {worst:g} kg/m3 is not in-situ density of sea water "
                f"({low:g} to {high:g}); sigma values need 1000 added"
            )
        if (self.temperature is None) != (self.salinity is None):
            raise InputError("density profile: give both temperature and salinity, or neither")
        columns = {"depth": depth, "values": values}
        for name in ("temperature", "salinity"):
            given = getattr(self, name)
            if given is not None:
                columns[name] = numbers(given, f"density profile: {name}")
                _check_table(depth, columns[name], name)
        for name, column in columns.items():
            column.flags.writeable = False
            object.__setattr__(self, name, column)

    @classmethod
    def constant(cls, density: float = REFERENCE_DENSITY) -> DensityProfile:
        """Make a profile of one density [kg/m3] at every depth."""
        return cls(depth=np.zeros(1), values=np.array([density]))

    @classmethod
    def compressed(cls, surface: float = REFERENCE_DENSITY) -> DensityProfile:
        """Make water of `surface` [kg/m3] at the top, compressed by SEA_COMPRESSIBILITY below."""
        depth = np.array([0.0, COLUMN_DEPTH])
        pressure = surface * float(gravity(DEFAULT_LATITUDE)) * depth
        return cls(depth=depth, values=surface * (1.0 + SEA_COMPRESSIBILITY * pressure))

    @classmethod
    def from_temperature_salinity(
        cls,
        depth: ArrayLike,
        temperature: ArrayLike,
        salinity: ArrayLike,
        *,
        latitude: float = DEFAULT_LATITUDE,
        longitude: float = DEFAULT_LONGITUDE,
    ) -> DensityProfile:
        """Make a profile from a cast: depth [m], in-situ temperature [degC], practical salinity.

        Each of shape (n,) or, for temperature and salinity, a number. latitude, longitude [deg].
        Raises InputError for NaN, negative or unsorted depth.
        """
        import gsw

        z = np.asarray(depth, float)
        t = np.broadcast_to(np.asarray(temperature, float), z.shape)
        sp = np.broadcast_to(np.asarray(salinity, float), z.shape)
        _check_table(z, t, "temperature")
        _check_table(z, sp, "salinity")
        if not -90.0 <= latitude <= 90.0:
            raise InputError(f"density profile: latitude {latitude:g} deg is outside -90..90")
        pressure = gsw.p_from_z(-z, latitude)
        absolute = gsw.SA_from_SP(sp, pressure, longitude, latitude)
        conservative = gsw.CT_from_t(absolute, t, pressure)
        density = gsw.rho(absolute, conservative, pressure)
        return cls(depth=z, values=density, temperature=t, salinity=sp)

    @classmethod
    def thermocline(
        cls,
        *,
        surface_temperature: float = 16.0,
        deep_temperature: float = 4.0,
        surface_salinity: float = 33.4,
        deep_salinity: float = 34.4,
        mixed_layer_depth: float = 30.0,
        decay_depth: float = 200.0,
        max_depth: float = 1000.0,
        latitude: float = DEFAULT_LATITUDE,
        longitude: float = DEFAULT_LONGITUDE,
    ) -> DensityProfile:
        """Make a climatology-like profile: a mixed layer over an exponential thermocline.

        Temperature [degC] and practical salinity relax from their surface to their deep values
        as exp(-(z - mixed_layer_depth) / decay_depth) [m]. The defaults resemble Monterey Bay.
        """
        for name, value in (
            ("mixed_layer_depth", mixed_layer_depth),
            ("decay_depth", decay_depth),
            ("max_depth", max_depth),
        ):
            value = number(value, f"density profile: {name}")
            low_ok = value >= 0.0 if name == "mixed_layer_depth" else value > 0.0
            if not (value <= DEEPEST and low_ok):
                raise InputError(
                    f"density profile: {name} is {value:g} m; give a positive depth of at most "
                    f"{DEEPEST:g} m"
                )
        z = np.linspace(0.0, max_depth, max(2, int(np.ceil(max_depth / DEFAULT_SPACING)) + 1))
        decay = _decay(z, float(mixed_layer_depth), float(decay_depth))
        temperature = deep_temperature + (surface_temperature - deep_temperature) * decay
        salinity = deep_salinity + (surface_salinity - deep_salinity) * decay
        return cls.from_temperature_salinity(
            z, temperature, salinity, latitude=latitude, longitude=longitude
        )

    def density(self, depth: ArrayLike) -> Array:
        """Density [kg/m3] at `depth` [m], any shape; constant beyond the first and last row."""
        return np.asarray(np.interp(np.asarray(depth, float), self.depth, self.values))

    def temperature_salinity(self, depth: ArrayLike) -> tuple[Array, Array] | None:
        """In-situ temperature [degree_Celsius] and practical salinity at `depth` [m], any shape.

        None: the profile holds density alone.
        """
        if self.temperature is None or self.salinity is None:
            return None
        z = np.asarray(depth, float)
        columns = (self.temperature, self.salinity)
        temperature, salinity = (np.asarray(np.interp(z, self.depth, one)) for one in columns)
        return temperature, salinity

    def pressure(self, depth: ArrayLike, *, latitude: float) -> Array:
        """Gauge pressure [dbar] at `depth` [m], any shape: the integral of rho g dz; 0 in air.

        Exact for the table's straight segments with gravity at the segment's mean depth.
        """
        return self.pressure_integral(latitude)(depth)

    def pressure_integral(self, latitude: float) -> Callable[[ArrayLike], Array]:
        """Prepare `pressure` once; returns a function of depth for repeated calls."""
        # a row at the surface turns the constant density above the first row into a segment
        top = np.concatenate([[0.0], self.depth[self.depth > 0.0]])
        values = self.density(top)
        surface = float(gravity(latitude))
        slab = 0.5 * (values[1:] + values[:-1]) * np.diff(top)
        slab *= surface * (1.0 + GRAVITY_DEPTH_RATE * 0.5 * (top[1:] + top[:-1]))
        above = np.concatenate([[0.0], np.cumsum(slab)])

        def pressure(depth: ArrayLike) -> Array:
            z = np.ascontiguousarray(depth, dtype=np.float64)
            out = np.empty(z.size)
            _pressure_kernel(top, values, above, surface, z.ravel(), out)
            return out.reshape(np.shape(depth))

        return pressure

    def describe(self) -> dict[str, list[float]]:
        """Return the profile as JSON values; `DensityProfile(**values)` is equal."""
        columns = (field.name for field in dataclasses.fields(self))
        given = ((name, getattr(self, name)) for name in columns)
        return {name: column.tolist() for name, column in given if column is not None}

    def compile(self, *, spacing: float | None = None) -> Array:
        """Compile to a flat float64 array for `density_at`: n, dz [m], n densities from 0 m.

        Without `spacing` [m], a table equally spaced from the surface keeps its own spacing; any
        other is interpolated every DEFAULT_SPACING.
        """
        return self._compiled(self.values, spacing)

    def compile_temperature(self, *, spacing: float | None = None) -> Array:
        """Compile in-situ temperature [degree_Celsius] as `compile`; empty if unknown."""
        if self.temperature is None:
            return np.zeros(0)
        return self._compiled(self.temperature, spacing)

    def _compiled(self, values: Array, spacing: float | None) -> Array:
        if self.depth.size == 1:
            return np.array([1.0, DEFAULT_SPACING, values[0]])
        steps = np.diff(self.depth)
        uniform = self.depth[0] == 0.0 and np.allclose(steps, steps[0], rtol=1e-9, atol=0.0)
        if spacing is None:
            spacing = float(steps[0]) if uniform else DEFAULT_SPACING
        if not (np.isfinite(spacing) and spacing > 0.0):
            raise InputError(f"density profile: spacing {spacing:g} m must be positive")
        n = int(np.ceil(self.depth[-1] / spacing * (1.0 - 1e-12))) + 1
        if n > MAX_PROGRAM_POINTS:
            raise InputError(
                f"density profile: {n} points of {spacing:g} m exceed {MAX_PROGRAM_POINTS}; "
                "compile with a larger spacing"
            )
        return np.concatenate([[n, spacing], np.interp(np.arange(n) * spacing, self.depth, values)])


NAMES = ("usual", "constant", "thermocline")
GRID = "grid"
"""Name for the water column of a gridded current's file, which `twin.facade` reads."""
ALLOWED = (*NAMES, GRID, "a CSV file with columns depth,density")


def parse_density(
    text: str, *, latitude: float = DEFAULT_LATITUDE, longitude: float = DEFAULT_LONGITUDE
) -> DensityProfile | None:
    """Make the profile named "usual", "constant" or "thermocline", or read a CSV file.

    "usual" returns None: scenarios without a density choose one. "constant" is the reference
    density at every depth, unlike any sea: there a compressible hull sinks ever faster.

    The file has a header with `depth` [m] and either `density` [kg/m3] or `temperature` [degC]
    and `salinity` (practical). Lines that start with # are comments.

    Args:
      text: one of these names, or a path.
      latitude: [degree] north, for densities that TEOS-10 gives.
      longitude: [degree] east, likewise.

    Raises:
      InputError: unknown name, unreadable file, missing column or bad row (named).
    """
    if text == "usual":
        return None
    if text == "constant":
        return DensityProfile.constant()
    if text == "thermocline":
        return DensityProfile.thermocline(latitude=latitude, longitude=longitude)
    if text == GRID:
        raise InputError(
            "density 'grid' is made of a current's file: `twin simulate --density grid`, or "
            'twin.simulate(density="grid", current=...)'
        )
    path = Path(text)
    if path.suffix.lower() != ".csv":
        raise InputError(unknown_name("density", text, ALLOWED))
    return read_density_csv(path, latitude=latitude, longitude=longitude)


def read_density_csv(
    path: Path, *, latitude: float = DEFAULT_LATITUDE, longitude: float = DEFAULT_LONGITUDE
) -> DensityProfile:
    """Read a profile from CSV; see `parse_density`."""
    frame = read_table_file(path, "density file")
    names = [str(name) for name in frame.columns]
    if not len(frame):
        raise InputError(f"density file {path} has no rows; it needs a header and one row or more")
    columns: dict[str, list[float]] = {}
    for name in (
        ("depth", "density") if "density" in names else ("depth", "temperature", "salinity")
    ):
        if names.count(name) != 1:
            lacks = "lacks the column" if name not in names else "has more than one column"
            raise InputError(
                f"density file {path} {lacks} {name!r} (found: {', '.join(names)}); it needs depth "
                "and density, or depth, temperature and salinity"
            )
        columns[name] = column_numbers(frame, name, f"density file {path}")
    if "density" in columns:
        return DensityProfile(depth=columns["depth"], values=columns["density"])  # type: ignore[arg-type]
    return DensityProfile.from_temperature_salinity(
        **columns, latitude=latitude, longitude=longitude
    )
