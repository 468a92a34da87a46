"""Calls that do not fit a public function: what is said, and that signatures stay."""

from __future__ import annotations

import inspect
import pickle

import numpy as np
import pytest

import factory
import learn
import twin
from twin.errors import ArgumentError, InputError, nearest

CALLABLE = [
    (face, name)
    for face in (twin, factory, learn)
    for name in face.__all__
    if not name.startswith("_")
]


@pytest.mark.parametrize(("face", "name"), CALLABLE, ids=lambda x: getattr(x, "__name__", x))
def test_an_unknown_argument_of_any_public_name_is_named(face, name):
    value = getattr(face, name)
    made = inspect.isclass(value) and not inspect.isabstract(value) and "__init__" in vars(value)
    if not (inspect.isfunction(value) or made):
        pytest.skip("not called")
    try:
        parameters = inspect.signature(value).parameters.values()
    except ValueError:
        pytest.skip("no signature")
    if any(p.kind is p.VAR_KEYWORD for p in parameters) and name not in ("fit", "import_logs"):
        pytest.skip("takes any name")
    first = {"import_logs": ("csv", (), "x.zarr")}.get(name, ())
    with pytest.raises(ArgumentError, match=rf"{name}: unknown argument 'no_such_word'"):
        value(*first, no_such_word=1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: twin.simulate(durations=5), "simulate: unknown argument 'durations': did you mean "
         "'duration'"),
        (lambda: twin.simulate(hours=5), "did you mean 'duration'"),
        (lambda: twin.simulate(plan="default"), "did you mean 'mission'"),
        (lambda: twin.Scenario(plan=None), "twin.Scenario: unknown argument 'plan': did you mean "
         "'mission'"),
        (lambda: twin.Scenario(currents=None), "did you mean 'current'"),
        (lambda: factory.generate("m.zarr", hourz=1), "factory.generate: .*did you mean 'hours'"),
        (lambda: factory.generate("m.zarr", duration=1), "did you mean 'hours'"),
        (lambda: learn.fit("m.zarr", epoch=3), "learn.fit: .*did you mean 'epochs'"),
        (lambda: factory.import_logs("csv", [], "x.zarr", perod=1), "did you mean 'period'"),
        (lambda: twin.Waypoint(max_depth_m=50.0), "twin.Waypoint needs targets"),
        (lambda: twin.resample(), "twin.resample needs series, step"),
        (lambda: twin.simulate(None, "default"), "takes only scenario without a name; by name: v"),
        (lambda: factory.generate("m.zarr", hours="x"), "hours is 'x': give a number or None"),
        (lambda: factory.generate("m.zarr", hours=1, seed="a"), "seed is 'a': give a whole number"),
        (lambda: twin.timeseries("no.zarr", "all"), "missions is 'all': give a list or None"),
        (lambda: factory.import_logs("og1", "og1", "x.zarr"), "files is 'og1': give a list"),
        (lambda: factory.import_logs("og1", [], "x.zarr", period="x"), "period is 'x': give a num"),
        (lambda: learn.fit("m.zarr", features="depth"), "features is 'depth': give a list"),
        (lambda: twin.figure("run.zarr"), "trajectory is 'run.zarr': give a Trajectory"),
        (lambda: twin.simulate_many([], threads="x"), "threads is 'x': give a whole number"),
        (lambda: twin.simulate(duration=3.0, sensors="field", seed="x"), "seed is 'x': give a who"),
    ],
)  # fmt: skip
def test_what_was_meant_is_said(call, message):
    with pytest.raises(ArgumentError, match=message) as told:
        call()
    assert isinstance(told.value, TypeError)  # what Python raises by itself
    assert isinstance(told.value, InputError)


def test_values_that_are_given_as_texts_lead_to_what_reads_them():
    with pytest.raises(InputError, match=r"give twin.load_mission\('default'\)"):
        twin.Scenario(mission="default")
    with pytest.raises(InputError, match=r"give twin.parse_current\('uniform:0.1,0'\)"):
        twin.Scenario(current="uniform:0.1,0")
    with pytest.raises(
        InputError, match=r"mission is 3; give a Mission or a Schedule, as twin\.load"
    ):
        twin.Scenario(mission=3)
    with pytest.raises(InputError, match="--hours -1 must be above 0"):
        factory.generate("m.zarr", hours=-1)
    with pytest.raises(InputError, match="element 0 is a value of type dict, not a Scenario"):
        twin.simulate_many([{"mission": "default"}])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: twin.simulate(seed=-1, sensors="ideal"), "seed -1 must be at least 0"),
        (lambda: twin.simulate(controller="x", duration=5.0), "give a function of an Observation"),
        (lambda: twin.parse_current("0.1,0.2"), "write uniform:0.1,0.2 for a velocity north, east"),
        (lambda: twin.simulate(start={"lat": 49.0}), "did you mean 'latitude'"),
        (lambda: factory.generate("m.nc", hours=1), "is a zarr folder, not a .nc file: name it m"),
        (lambda: factory.generate("m.zarr", changes={"pitch": 3}), "did you mean 'mission.pitch_d"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_value_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_numbers_of_numpy_are_numbers():
    assert twin.simulate(duration=np.float32(5.0)).time[-1] == 5.0


def test_an_error_from_inside_stays_as_it_is():
    def controller(_):
        raise TypeError("mine")

    with pytest.raises(TypeError, match="mine") as told:
        twin.simulate(controller=controller, duration=5.0)
    assert not isinstance(told.value, InputError)


def test_signatures_and_identities_stay():
    from twin.facade import simulate
    from twin.physics.scenario import Scenario

    assert inspect.signature(twin.simulate) == inspect.signature(simulate)
    assert twin.simulate.__doc__ == simulate.__doc__
    assert "mission" in inspect.signature(twin.Scenario).parameters
    assert twin.Scenario is Scenario
    for one in (twin.simulate, twin.Scenario, factory.generate, learn.fit):
        assert pickle.loads(pickle.dumps(one)) is one


def test_the_nearest_is_by_spelling_first_and_then_by_meaning():
    assert nearest("--hours", ["--out", "--duration"]) == "--duration"
    assert nearest("durations", ["hours", "duration"]) == "duration"
    assert nearest("Sample-Period", ["sample_period"]) == "sample_period"
    assert nearest("xyzzy", ["duration"]) is None
