"""The compiled sampler: its rate is the exact derivative of what it interpolates."""

import numpy as np
import pytest
from numba import carray, cfunc
from processes import python

from twin.water.current import GaussMarkov, Grid, Profile, parse_current
from twin.water.current import sampler as layout
from twin.water.current.sampler import kinds, sample, sample_gradient, sample_track


def table_program() -> np.ndarray:
    random = np.random.default_rng(20)
    depth = np.cumsum(random.uniform(5.0, 60.0, 30))
    return layout.program([Profile.record(30, depth, random.normal(0, 0.1, (30, 3)))])


def series_program() -> np.ndarray:
    random = np.random.default_rng(21)
    return layout.program([GaussMarkov.record(80.0, random.normal(0, 0.1, (500, 3)))])


def grid_program(components: int = 3, curvature: float = 1.8e-7) -> np.ndarray:
    random = np.random.default_rng(22)
    axes = [
        np.array([-3600.0, 0.0, 9000.0, 20_000.0, 60_000.0]),
        np.array([0.5, 3.0, 10.0, 40.0, 150.0, 400.0, 1100.0]),
        np.linspace(-30_000.0, 30_000.0, 9),
        np.sort(random.uniform(-30_000.0, 30_000.0, 8)),
    ]
    shape = (*(a.size for a in axes), components)
    record = Grid.box_record(*axes, random.normal(0, 0.1, shape), curvature)
    return layout.program([record])


PROGRAMS = {
    "uniform": lambda: parse_current("uniform:0.1,-0.2,0.01").compile(4e4),
    "profile": table_program,
    "ekman": lambda: parse_current("ekman:tau=0.1,direction=40,viscosity=0.5").compile(4e4),
    "ekman south": lambda: parse_current("ekman:tau=0.1,direction=40,lat=-50").compile(4e4),
    "geostrophic": lambda: parse_current(
        "geostrophic:surface=0.3,direction=20,scale=400,barotropic=0.1").compile(4e4),
    "tide": lambda: parse_current(
        "tide:m2=0.3,m2_minor=0.1,m2_phase=40,k1=0.2,k1_minor=-0.1,direction=15").compile(4e4),
    "inertial": lambda: parse_current("inertial:speed=0.1,layer=300,decay=200").compile(4e4),
    "log layer": lambda: parse_current(
        "log-layer:friction=0.02,direction=70,bottom=1000,thickness=900").compile(4e4),
    "series": series_program,
    "series of values": lambda: parse_current(
        "series:interval=9000,north=0.1/0.3/-0.2/0.1/0.4,east=0/0/0.4/0.2/0.1").compile(4e4),
    "gauss-markov": lambda: parse_current(
        "gauss-markov:speed=0.3,std=0.1,direction=0,direction_std=30").compile(4e4),
    "grid": grid_program,
    "grid without w": lambda: grid_program(2, 0.0),
    "sum": lambda: parse_current(
        "uniform:0.1,0+geostrophic:surface=0.3,direction=20+tide:m2=0.3").compile(4e4),
}  # fmt: skip


def random_points(n: int) -> tuple[np.ndarray, np.ndarray]:
    """t, north, east, down (n, 4) and over-ground velocity (n, 3), seeded."""
    random = np.random.default_rng(5)
    low, high = [100.0, -2e4, -2e4, 1.0], [3.9e4, 2e4, 2e4, 990.0]
    return random.uniform(low, high, (n, 4)), random.uniform(-0.6, 0.6, (n, 3))


def test_every_kind_has_a_program_here():
    assert {program()[1] for program in PROGRAMS.values()} == {kind.number() for kind in kinds()}


@pytest.mark.parametrize("name", PROGRAMS)
def test_local_rate_and_gradient_are_the_derivatives(name):
    """Central differences in t, north, east and depth; steps too short to meet a kink."""
    program = PROGRAMS[name]()
    points, _ = random_points(400)
    rest = np.zeros(len(points))
    found = np.array([sample_gradient(program, *point) for point in points])

    def velocity(offset):
        columns = np.ascontiguousarray((points + offset).T)
        return sample_track(program, *columns, rest, rest, rest)[:, :3]

    np.testing.assert_array_equal(found[:, :3], velocity(np.zeros(4)))
    for axis, columns in enumerate([[3, 4, 5], [6, 9, 12], [7, 10, 13], [8, 11, 14]]):
        step = 1e-3 * np.eye(4)[axis]
        change = (velocity(step) - velocity(-step)) / 2e-3
        np.testing.assert_allclose(found[:, columns], change, rtol=1e-6, atol=3e-12)
    assert (np.abs(found[:, 3:]).max() > 0.0) == (name != "uniform")


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_rate_along_a_path_is_local_rate_plus_gradient_times_velocity(name):
    program = PROGRAMS[name]()
    for point, v in zip(*random_points(50), strict=True):
        k = np.array(sample_gradient(program, *point))
        expected = k[3:6] + k[6:].reshape(3, 3) @ v
        np.testing.assert_allclose(sample(program, *point, *v)[3:], expected, atol=1e-15)


@pytest.mark.parametrize("name", PROGRAMS)
def test_integrated_rate_is_the_change_of_velocity_through_all_kinks(name):
    """The fundamental theorem along a glide that crosses many cells."""
    program = PROGRAMS[name]()
    n = 40_001
    t = np.linspace(0.0, 3000.0, n)
    north, east, down = 0.4 * t - 5e3, -0.3 * t, 20.0 + 0.2 * t
    ones = np.ones(n)
    out = sample_track(program, t, north, east, down, 0.4 * ones, -0.3 * ones, 0.2 * ones)
    change = np.trapezoid(out[:, 3:], t, axis=0)
    # The trapezoid rule misplaces each kink by at most half a step: 0.075 s of a slope's jump.
    np.testing.assert_allclose(change, out[-1, :3] - out[0, :3], atol=5e-4)


def test_grid_reproduces_scipy_and_multilinear_fields():
    from scipy.interpolate import RegularGridInterpolator

    axes = [np.array([0.0, 5e3, 4e4]), np.array([0.0, 30.0, 100.0, 1000.0]),
            np.linspace(-2.5e4, 2.5e4, 6), np.linspace(-2.5e4, 2.5e4, 5)]  # fmt: skip
    values = np.random.default_rng(23).normal(0, 0.1, (3, 4, 6, 5, 3))
    program = layout.program([Grid.box_record(*axes, values)])
    point, velocity = random_points(500)
    out = sample_track(program, *np.ascontiguousarray(point.T), *np.ascontiguousarray(velocity.T))
    order = point[:, [0, 3, 1, 2]]
    judge = RegularGridInterpolator(axes, values)(order)
    np.testing.assert_allclose(out[:, :3], judge, atol=1e-14)


def test_outside_everything_the_edge_is_held_and_the_rate_is_zero():
    program = grid_program(curvature=0.0)
    inside = sample(program, 6e4, 3e4, 3e4, 1100.0, 0.3, 0.3, 0.1)
    outside = sample(program, 9e9, 9e9, 9e9, 9e9, 0.3, 0.3, 0.1)
    assert outside == inside
    assert outside[3:] == (0.0, 0.0, 0.0)
    low = sample(program, -9e9, -9e9, -9e9, 0.5, 0.3, 0.3, 0.1)
    assert sample(program, -9e9, -9e9, -9e9, -3.0, 0.3, 0.3, 0.1)[:3] == low[:3]


@pytest.mark.parametrize("name", ["profile", "series", "grid", "gauss-markov"])
def test_a_nan_position_reads_no_memory_outside_the_program(name):
    program = PROGRAMS[name]()
    limit = np.abs(program[np.isfinite(program)]).max()
    for bad in (np.nan, np.inf, -np.inf):
        for i in range(4):
            point = [10.0, 20.0, 30.0, 40.0]
            point[i] = bad
            out = np.array(sample(program, *point, 0.1, 0.1, 0.1))
            assert (np.isnan(out[:3]) | (np.abs(out[:3]) <= limit)).all()


def test_it_runs_inside_a_c_callback():
    signature = "float64(CPointer(float64), int64, float64)"

    @cfunc(signature)
    def callback(pointer, size, depth):
        return sample(carray(pointer, (size,)), 0.0, 0.0, 0.0, depth, 0.0, 0.0, 1.0)[0]

    program = table_program()
    direct = sample(program, 0.0, 0.0, 0.0, 100.0, 0.0, 0.0, 1.0)[0]
    assert callback.ctypes(program.ctypes.data_as(callback.ctypes.argtypes[0]), program.size,
                           100.0) == direct  # fmt: skip


def test_importing_currents_loads_neither_numba_nor_xarray():
    code = (
        "import sys, twin.water.current as c; c.parse_current('uniform:0.1,0');"
        "print([m for m in ('numba', 'xarray', 'netCDF4', 'zarr', 'scipy') if m in sys.modules])"
    )
    out = python("-c", code)
    assert out.stdout.strip() == "[]"
