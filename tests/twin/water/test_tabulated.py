"""A plain Python function flies as a current, as near as is asked, or is refused."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.errors import CurrentError
from twin.water.current import Current, Profile, Uniform, current_from_dict

DAY = {"time": (0.0, 43_200.0), "depth": (0.0, 200.0), "north": (-5e3, 5e3)}


def jet(t, north, east, depth):
    """Tidal shear over a jet: toward north with depth and time, toward east across the jet."""
    tide = 0.2 * math.exp(-depth / 60.0) * math.cos(2.0 * math.pi * t / 44_700.0)
    return tide, 0.1 * math.exp(-((north / 3e3) ** 2))


@pytest.mark.parametrize("tolerance", [5e-3, 1e-3])
def test_it_is_as_near_as_asked_and_no_nearer_than_needed(tolerance):
    current = Current.from_function(jet, **DAY, tolerance=tolerance)
    random = np.random.default_rng(7)
    t, north, depth = (
        random.uniform(*DAY[name], 400).tolist() for name in ("time", "north", "depth")
    )
    wanted = [[*jet(a, b, 0.0, c), 0.0] for a, b, c in zip(t, north, depth, strict=True)]
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
    table = Current.from_function(jet, **DAY, tolerance=5e-3)
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
