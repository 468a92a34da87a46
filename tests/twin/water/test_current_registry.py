"""Every kind of current is whole: kernel, text, description, derivatives; functions fly, too."""

import json
import math
import textwrap
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import xarray as xr
from processes import python

import twin
from twin.compiled import generation, jit
from twin.errors import CurrentError, InputError
from twin.seams import CURRENTS
from twin.water.current import (
    Current,
    Ekman,
    Grid,
    Origin,
    Profile,
    Uniform,
    current_from_dict,
    parse_current,
    probe,
    register,
)
from twin.water.current import sampler as layout
from twin.water.current.sampler import sample, sample_gradient

SHIPPED = CURRENTS.shipped()
DURATION = 40_000.0


@pytest.fixture
def files(tmp_path, monkeypatch):
    """FILE.csv and FILE.nc, which the kinds' example texts name."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(4)
    depth = np.arange(0.0, 1000.0, 37.0)
    rows = [f"{d},{n},{e},{w}" for d, (n, e, w) in zip(depth, random.normal(0, 0.1, (28, 3)),
                                                     strict=True)]  # fmt: skip
    Path("FILE.csv").write_text("depth,north,east,down\n" + "\n".join(rows))
    axes = {
        "time": np.datetime64("2000-01-04T12:00", "ns") + np.arange(4) * np.timedelta64(12, "h"),
        "depth": np.array([0.5, 20.0, 90.0, 400.0, 1100.0]),
        "latitude": 48.0 + 0.25 * np.arange(9),
        "longitude": -17.0 + 0.25 * np.arange(9),
    }
    shape = tuple(axis.size for axis in axes.values())
    names = {"uo": "eastward", "vo": "northward", "wo": "upward"}
    data = {
        name: (tuple(axes), random.normal(0, 0.1, shape),
               {"standard_name": f"{way}_sea_water_velocity", "units": "m/s"})
        for name, way in names.items()
    }  # fmt: skip
    xr.Dataset(data, coords=axes).to_netcdf("FILE.nc")


def examples(name: str) -> list[Current]:
    """The kind's own examples."""
    return [parse_current(text) for text in CURRENTS[name].usage]


@pytest.mark.parametrize("name", SHIPPED)
def test_examples_are_rebuilt_from_their_description(name, files):
    for current in examples(name):
        assert current.kind == name
        pinned = current.pinned(DURATION)
        rebuilt = current_from_dict(json.loads(json.dumps(pinned.describe())))
        assert rebuilt == pinned
        assert rebuilt.compile(DURATION).tobytes() == current.compile(DURATION).tobytes()


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_kinds_pass_the_probe_that_kinds_of_ones_own_must_pass(name, files):
    for current in examples(name):
        for record in current.records(DURATION, Origin()):
            probe.check(type(current), record, DURATION)


def test_an_emerged_vehicle_feels_the_surface_current_and_no_shear():
    program = parse_current("geostrophic:surface=0.2,direction=0,scale=100").compile(10.0)
    assert sample(program, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0, -1.0) == (0.2, 0, 0, 0, 0, 0)
    assert sample_gradient(program, 0.0, 0.0, 0.0, -0.5) == (0.2, *(0.0,) * 14)
    assert sample_gradient(program, 0.0, 0.0, 0.0, 1e-9)[8] == pytest.approx(-0.002)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_damaged_program_reads_nothing_outside_itself(name, files):
    """Behind the program lie numbers that nothing in it can make: none may come out."""
    random = np.random.default_rng(3)
    bad = [np.nan, np.inf, -np.inf, -1.0, 0.0, 0.5, 1.5, 3.0, 1e9, 1e300, 2.0**62]
    for current in examples(name):
        whole = current.compile(3600.0)
        room = np.full(3 * whole.size + 64, 1e77)
        head = min(whole.size, 12)
        for _ in range(400):
            at = whole.size
            inner = room[at : at + whole.size]
            inner[:] = whole
            for _ in range(random.integers(1, 4)):
                inner[random.integers(0, head)] = random.choice(bad)
            shown = inner[: random.integers(1, whole.size + 1)] if random.random() < 0.3 else inner
            for values in (
                sample(shown, 10.0, 20.0, 30.0, 40.0, 0.1, 0.1, 0.1),
                sample_gradient(shown, 10.0, 20.0, 30.0, 40.0),
            ):
                finite = np.abs([v for v in values if np.isfinite(v)])
                assert not ((finite > 1e70) & (finite < 1e85)).any()


WHOLE = parse_current("ekman:tau=0.1,direction=90").compile(10.0)
UNKNOWN = np.array([1.0, 99.0, 1.0, 0.0])


@pytest.mark.parametrize("program", [*(WHOLE[:length] for length in range(1, 6)), UNKNOWN])
def test_a_program_that_was_cut_off_or_is_of_no_kind_gives_nan(program):
    assert np.isnan(sample(program, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0)).all()
    assert np.isnan(sample_gradient(program, 0.0, 0.0, 0.0, 5.0)).all()


# --- kinds from outside the package ---------------------------------------------------------------


@jit
def jet(program, start, size, t, north, east, depth):
    """Speed, half-width: an eastward jet along north 0."""
    speed, width = program[start], program[start + 1]
    v = speed * np.exp(-((north / width) ** 2))
    return 0, v, 0, 0, 0, 0, 0, 0, 0, -2.0 * v * north / width**2, 0, 0, 0, 0, 0


def jet_class(**changes) -> type[Current]:
    @dataclass(frozen=True, kw_only=True)
    class Jet(Current):
        kind: ClassVar[str] = "jet"
        payload_size: ClassVar[int] = 2
        kernel: ClassVar[Any] = jet
        usage: ClassVar[dict[str, str]] = {"jet:speed=0.3,width=5000": "an eastward jet"}

        speed: float
        width: float = 1e4

        def records(self, duration_s, origin):
            return [self.record(self.speed, self.width)]

    for name, value in changes.items():
        setattr(Jet, name, value)
    return Jet


@pytest.fixture
def own_kind():
    yield register(jet_class())
    CURRENTS.unregister("jet")


def test_a_kind_of_ones_own_is_parsed_described_sampled_and_flown(own_kind):
    from twin.mission.controller import Schedule
    from twin.physics.scenario import Scenario
    from twin.physics.simulation import simulate

    current = parse_current("jet:speed=0.3,width=5000+uniform:0.01,0")
    assert current_from_dict(current.describe()) == current
    v = sample_gradient(current.compile(60.0), 0.0, 2500.0, 0.0, 10.0)
    speed = 0.3 * np.exp(-0.25)
    np.testing.assert_allclose(v[:3], [0.01, speed, 0.0], rtol=1e-14)
    assert v[9] == pytest.approx(-2.0 * speed * 2500.0 / 5000.0**2)

    flown = simulate(
        Scenario(
            mission=Schedule(times=[0.0], commands=[(0.0, 0.0, 0.0)]),
            duration=30.0,
            current=current,
        )
    )
    np.testing.assert_allclose(flown["true_current_east"], 0.3, rtol=1e-6)


def test_what_is_registered_or_removed_reaches_what_was_compiled_before():
    with pytest.raises(CurrentError, match="unknown current 'jet'"):
        parse_current("jet:speed=0.3")
    before = generation()
    program = register(jet_class())(speed=0.3).compile(10.0)
    assert generation() > before
    assert sample(program, 0, 0, 0, 0, 0, 0, 0)[1] == 0.3
    CURRENTS.unregister("jet")
    assert np.isnan(sample(program, 0, 0, 0, 0, 0, 0, 0)).all()


def test_one_new_file_outside_the_package_flies_from_its_entry_point(tmp_path):
    """In a process of its own: the plant was compiled and installed before the kind is named."""
    (tmp_path / "my_jet.py").write_text(
        textwrap.dedent(
            """
            from dataclasses import dataclass
            from typing import Any, ClassVar
            from twin.compiled import jit
            from twin.water.current import Current, register

            @jit
            def steady(program, start, size, t, north, east, depth):
                z = 0.0
                return program[start], z, z, z, z, z, z, z, z, z, z, z, z, z, z

            @register
            @dataclass(frozen=True, kw_only=True)
            class Mine(Current):
                kind: ClassVar[str] = "mine"
                payload_size: ClassVar[int] = 1
                kernel: ClassVar[Any] = steady
                usage: ClassVar[dict] = {"mine:north=0.2": "north and steady"}
                north: float
                def records(self, duration_s, origin):
                    return [self.record(self.north)]
            """
        )
    )
    meta = tmp_path / "my_jet-1.0.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text("Metadata-Version: 2.1\nName: my-jet\nVersion: 1.0\n")
    (meta / "entry_points.txt").write_text("[glider_twin.currents]\nmine = my_jet:Mine\n")
    code = """
from twin.mission.controller import Schedule
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.water.current import parse_current
plan = Schedule(times=[0.0], commands=[(0.0, 0.0, 0.0)])
for text in ("uniform:0.1,0", "mine:north=0.2"):
    flown = simulate(Scenario(mission=plan, duration=5.0, current=parse_current(text)))
    print(flown["true_current_north"][-1])
"""
    out = python("-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{code}")
    assert out.stdout.split() == ["0.1", "0.2"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"kernel": None},
            "current 'jet' .* it needs one of kernel and directional, it has neither",
        ),
        ({"directional": jet}, "directional takes 7 arguments, it must take 11"),
        ({"kernel": lambda *a: 0.0}, "decorate it with twin.compiled.jit"),
        ({"usage": {}}, "needs usage"),
        ({"usage": {"yet:1": "?"}}, "texts that begin with jet:"),
        ({"settings": {"speed": "spede"}}, "unknown field in settings 'spede': did you mean"),
        ({"kind": "Jet"}, "kind must be lower-case"),
        ({"kind": "none"}, "kind must be lower-case"),
        ({"kind": "ekman"}, "current 'ekman' exists already: choose another name"),
        ({"code": 3}, "has the code 3 of 'ekman'"),
    ],
)
def test_a_kind_that_is_half_there_is_refused(changes, message):
    if "usage" not in changes and "kind" in changes:
        changes = {**changes, "usage": {f"{changes['kind']}:speed=1": "?"}}
    with pytest.raises(CurrentError, match=message):
        register(jet_class(**changes))
    assert "jet" not in CURRENTS


def spoiled(kernel, number, factor):
    """The kernel with one of its numbers multiplied."""
    plain = kernel.py_func

    def wrong(program, start, size, t, north, east, depth):
        found = list(plain(program, start, size, t, north, east, depth))
        found[number - 1] *= factor
        return tuple(found)

    return jit(wrong)


@jit
def moving(program, start, size, t, north, east, depth):
    """The jet, its axis moving north at a speed that its example may leave at 0."""
    speed, width, drift = program[start], program[start + 1], program[start + 2]
    x = (north - drift * t) / width
    v = speed * np.exp(-(x**2))
    slope = -2.0 * v * x / width
    return 0, v, 0, 0, drift * slope, 0, 0, 0, 0, slope, 0, 0, 0, 0, 0  # -drift is right


@jit
def bent(program, start, size, t, north, east, depth):
    """A table in depth: linear to the width, constant below it; not known beyond 5 km."""
    speed, width = program[start], program[start + 1]
    slope = speed / width if depth < width else 0.0
    v = speed * min(depth / width, 1.0)
    if north * north + east * east > 25e6:
        v = np.nan
    return 0, v, 0, 0, 0, 0, 0, 0, 0, 0, 0, slope, 0, 0, 0


@jit
def nowhere(program, start, size, t, north, east, depth):
    return (np.nan,) * 15


@jit
def short(program, start, size, t, north, east, depth):
    return 0.0, 0.1, 0.0


@jit
def noisy(program, start, size, t, north, east, depth):
    v = np.random.normal(0.0, program[start])  # noqa: NPY002
    return 0, v, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0


@jit
def slanted(program, start, size, t, north, east, depth, r_t, r_north, r_east, r_depth):
    speed, width = program[start], program[start + 1]
    return 0, speed * depth / width, 0, 0, speed / width * r_depth, 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kernel": spoiled(jet, 10, -1.0)}, r"current 'jet' \(.*Jet\): dVe/dn, how its east "
         r"velocity changes with north, is -?\S+ 1/s at t .* m deep, and differences of that "
         r"velocity give -?[\d.e-]+: turn the sign of number 10 of the 15 that its kernel returns"),
        ({"kernel": spoiled(jet, 10, 0.98)}, "correct number 10 of the 15"),
        ({"kernel": nowhere}, "not a finite number anywhere within 30000 m"),
        ({"kernel": short}, "returns 3 numbers, it must return 15"),
        ({"kernel": noisy}, "gives another answer .* draw what is random in records"),
        ({"kernel": None, "directional": slanted, "depends_on": ("time", "north")},
         "dVe/dd.*: name 'depth' in its depends_on"),
    ],
)  # fmt: skip
def test_derivatives_that_are_not_the_velocitys_are_refused_at_registering(changes, message):
    with pytest.raises(CurrentError, match=message):
        register(jet_class(**changes))
    assert "jet" not in CURRENTS


def test_records_that_differ_from_call_to_call_are_refused():
    def records(self, duration_s, origin):
        return [self.record(np.random.default_rng().normal(), self.width)]

    with pytest.raises(CurrentError, match=r"records\(\) of 'jet:speed=0\.3,width=5000' differ"):
        register(jet_class(records=records))


def test_what_no_example_shows_is_compared_when_it_is_compiled():
    """The example leaves the drift at 0, where the wrong rate is 0 too."""

    def records(self, duration_s, origin):
        return [self.record(self.speed, self.width, 0.02 if self.width < 1e3 else 0.0)]

    kind = register(jet_class(kernel=moving, records=records, payload_size=3))
    try:
        kind(speed=0.3).compile(3600.0)
        with pytest.raises(CurrentError, match=r"dVe/dt.* m/s2 .*turn the sign of number 5 of"):
            (Uniform(north=0.1) + kind(speed=0.3, width=500.0)).compile(3600.0)
    finally:
        CURRENTS.unregister("jet")


@pytest.mark.parametrize(
    "changes",
    [{"kernel": bent}, {"kernel": None, "directional": slanted, "depends_on": ("time", "depth")}],
)
def test_kinks_and_places_outside_of_the_domain_are_no_fault(changes):
    register(jet_class(**changes))
    CURRENTS.unregister("jet")


def test_a_class_that_only_overrides_velocity_is_refused():
    for base in (Current, Uniform):
        told = r"Mine overrides velocity\(\), which nothing flies.*Current\.from_function"
        with pytest.raises(CurrentError, match=told):
            type("Mine", (base,), {"velocity": lambda self, *a: 0.0, "__qualname__": "Mine"})


def test_a_kind_without_records_is_refused():
    cls = dataclass(frozen=True, kw_only=True)(
        type("Mine", (Current,), {"kind": "mine", "kernel": jet, "usage": {"mine:": ""}})
    )
    with pytest.raises(CurrentError, match="lacks the method `records`"):
        register(cls)


def test_a_class_that_is_not_registered_is_refused_when_compiled(own_kind):
    with pytest.raises(CurrentError, match="Other is not a registered kind of current"):
        type("Other", (Uniform,), {"__qualname__": "Other"})().compile(10.0)
    with pytest.raises(CurrentError, match="Other is not a registered kind of current"):
        (Uniform() + type("Other", (own_kind,), {"__qualname__": "Other"})(speed=1)).compile(10.0)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("no_such_module:X", "storm.*cannot be loaded: ModuleNotFoundError"),
        ("twin.errors:InputError", "'storm' is only half there: .* must be a class derived from"),
    ],
)
def test_an_entry_point_that_brings_nothing_is_named(monkeypatch, value, message):
    point = EntryPoint(name="storm", value=value, group=CURRENTS.group)
    monkeypatch.setitem(vars(CURRENTS), "_offered", {"storm": point})
    with pytest.raises(InputError, match=message):
        parse_current("storm:speed=1")
    assert "storm" in CURRENTS.names()


def test_records_of_a_grid_must_have_the_shape_of_their_axes():
    axis = np.arange(2.0)
    with pytest.raises(ValueError, match=r"velocity has shape \(2, 2, 2, 3, 2\)"):
        Grid.box_record(axis, axis, axis, axis, np.zeros((2, 2, 2, 3, 2)))


def test_codes_of_shipped_kinds_are_frozen():
    """They stand in compiled programs."""
    codes = {name: CURRENTS[name].number() for name in SHIPPED}
    assert codes == {"uniform": 1, "profile": 2, "ekman": 3, "geostrophic": 4, "tide": 5,
                     "inertial": 6, "log-layer": 7, "gauss-markov": 8, "grid": 9,
                     "series": 10}  # fmt: skip
    assert layout.program([Ekman.record(1, 2, 3, 4)]).tolist() == [1, 3, 4, 1, 2, 3, 4]


# --- plain Python functions -----------------------------------------------------------------------


DAY = {"time": (0.0, 43_200.0), "depth": (0.0, 200.0), "north": (-5e3, 5e3)}


def tidal_jet(t, north, east, depth):
    """Tidal shear over a jet: toward north with depth and time, toward east across the jet."""
    tide = 0.2 * math.exp(-depth / 60.0) * math.cos(2.0 * math.pi * t / 44_700.0)
    return tide, 0.1 * math.exp(-((north / 3e3) ** 2))


@pytest.mark.parametrize("tolerance", [5e-3, 1e-3])
def test_it_is_as_near_as_asked_and_no_nearer_than_needed(tolerance):
    current = Current.from_function(tidal_jet, **DAY, tolerance=tolerance)
    random = np.random.default_rng(7)
    t, north, depth = (
        random.uniform(*DAY[name], 400).tolist() for name in ("time", "north", "depth")
    )
    wanted = [[*tidal_jet(a, b, 0.0, c), 0.0] for a, b, c in zip(t, north, depth, strict=True)]
    off = np.abs(current.velocity(t, north, 123.0, depth) - wanted).max()
    assert off < 2.0 * tolerance
    assert math.prod(current.shape) < 20_000
    assert current.shape[3] == 1, "it does not vary with east"


def test_axes_and_signs_are_the_function_s():
    current = Current.from_function(
        lambda t, north, east, depth: (1e-6 * t, 1e-5 * north, 1e-4 * depth + 1e-5 * east),
        time=(0.0, 1e4), north=(-1e4, 1e4), east=(-1e3, 1e3), depth=(0.0, 100.0),
    )  # fmt: skip
    found = current.velocity(5e3, 2e3, -300.0, 40.0)
    np.testing.assert_allclose(found, [5e-3, 2e-2, 4e-3 - 3e-3], atol=1e-12)


def test_a_vehicle_flies_in_it_as_in_the_shipped_kinds_of_the_same_water():
    flat = Current.from_function(lambda t, north, east, depth: (0.1, -0.05))
    sheared = Current.from_function(lambda t, n, e, d: (0.2 - 1e-3 * d, 0.0), depth=(0.0, 200.0))
    profile = Profile(depth=(0.0, 200.0), north=(0.2, 0.0), east=(0.0, 0.0))
    for mine, shipped in ((flat, Uniform(north=0.1, east=-0.05)), (sheared, profile)):
        for engine in ("mujoco", "lanes"):
            a, b = (
                twin.simulate(current=c, duration=120.0, engine=engine) for c in (mine, shipped)
            )
            for name in ("true_north", "true_east", "true_depth"):
                np.testing.assert_allclose(a[name], b[name], atol=1e-6)


def test_it_is_rebuilt_from_its_description_and_adds_to_others():
    table = Current.from_function(tidal_jet, **DAY, tolerance=5e-3)
    again = current_from_dict(json.loads(json.dumps((table + Uniform(north=0.1)).describe())))
    np.testing.assert_array_equal(again.compile(60.0), (table + Uniform(north=0.1)).compile(60.0))


@pytest.mark.parametrize(
    ("function", "ranges", "message"),
    [
        (lambda t, n, e, d: (1e-3 * d, 0.0), {}, r"varies with depth.*depth=\(low, high\)"),
        (lambda t, n, e, d: (0.0, 1e-6 * t), {"depth": (0, 9)}, "varies with time"),
        (lambda t, n, e, d: 0.1, {}, "fails at t=0 s.*returns north, east"),
        (lambda t, n, e, d: (0.1,), {}, "gives 1 numbers"),
        (lambda t, n, e, d: (50.0, 0.0), {}, "beyond 10 m/s"),
        (lambda t, n, e, d: (math.nan, 0.0), {}, "finite number"),
        (lambda t, n, e, d: (0.3 * (33 < d < 34), 0.0), {"depth": (0, 100)}, "narrower"),
        (lambda t, n, e, d: (math.sin(n), 0.0), {"north": (0, 1e6)}, "more than 20000"),
        (lambda t, n, e, d: (0.0, 0.0), {"depth": (100, 0)}, r"must be \(low, high\)"),
        (lambda t, n, e, d: (0.0, 0.0), {"tolerance": 0.0}, "tolerance"),
    ],
)  # fmt: skip
def test_what_cannot_be_tabulated_is_refused(function, ranges, message):
    with pytest.raises(CurrentError, match=message):
        Current.from_function(function, **ranges)


def test_the_page_s_function_flies():
    page = (Path(__file__).parents[3] / "docs" / "reference" / "currents.md").read_text()
    block = page.split("## A function of your own")[1].split("```python\n")[1].split("```")[0]
    names: dict[str, object] = {}
    exec(compile(block, "currents.md", "exec"), names)
    assert names["run"]["true_east"][-1] > 50.0
