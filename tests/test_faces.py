"""The public faces of `twin` and `factory`: light, complete, typed, documented."""

import ast
import dataclasses
import importlib
import inspect
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from examples import ROOT, blocks, needs_docs

import factory
import learn
import twin
from twin.errors import InputError, TwinError, nearest

HEAVY = ("numpy", "mujoco", "numba", "xarray", "torch", "matplotlib", "scipy", "zarr")
FACES = (twin, factory)
every_face = pytest.mark.parametrize("face", FACES, ids=lambda face: face.__name__)
STARTS = 5


def python(code):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT
    )


@every_face
def test_importing_it_loads_nothing_heavy(face):
    done = python(f"import sys, {face.__name__}; print({HEAVY!r} & sys.modules.keys())".replace(
        repr(HEAVY), f"set({HEAVY!r})"))  # fmt: skip
    assert (done.stdout.strip(), done.stderr) == ("set()", "")


def test_importing_it_takes_less_than_a_tenth_of_a_second():
    code = (
        "import time; start = time.process_time(); import twin, factory; "
        "print(time.process_time() - start)"
    )
    assert min(float(python(code).stdout) for _ in range(STARTS)) < 0.1


@every_face
def test_every_name_is_there_documented_and_where_the_types_say(face):
    names = [name for name in dir(face) if not name.startswith("_")]
    assert set(names) == set(face.__all__) - {"__version__"}
    for name in names:
        value = getattr(face, name)
        assert inspect.getdoc(value), name
        if inspect.isclass(value) or inspect.isfunction(value):
            assert not value.__module__.startswith("numba")
    assert _typed(face) == face._PLACES


@pytest.mark.parametrize("name", ["twin", "twin.control", "factory", "learn"])
def test_every_public_name_has_a_docstring_of_its_own(name):
    """Not one that it inherits, nor the list of fields that a dataclass makes up."""
    face = importlib.import_module(name)
    public = {n: getattr(face, n) for n in face.__all__ if not n.startswith("__")}
    assert [n for n, value in public.items() if not own_docstring(value)] == []


def own_docstring(value):
    """What stands below a class or function, or says what an object is."""
    if inspect.isclass(value):
        told = value.__dict__.get("__doc__") or ""
        return "" if told.startswith(f"{value.__name__}(") else told
    return value.__doc__ or ""


def test_a_docstring_that_is_inherited_or_made_up_is_none_of_its_own():
    class Bare(twin.Scenario):
        pass

    @dataclasses.dataclass
    class Made:
        x: int

    assert [own_docstring(one) for one in (Bare, Made, lambda: 0)] == ["", "", ""]
    assert own_docstring(twin.Scenario)


def _typed(face):
    """The places that type checkers see, from the text of the package."""
    block = next(
        node
        for node in ast.parse(Path(face.__file__).read_text()).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    places = {}
    for node in block.body:
        assert isinstance(node, ast.ImportFrom)
        for name in node.names:
            place = ROOT / str(node.module).replace(".", "/") / name.name
            module = place.is_dir() or place.with_suffix(".py").is_file()
            places[name.asname] = f"{node.module}{'.' if module else ':'}{name.name}"
    return places


@pytest.mark.parametrize(
    "order",
    [
        "import twin; twin.simulate; import twin.facade, twin.physics.simulation, twin.control",
        "import twin.facade, twin.physics.simulation; import twin",
        "import twin.commands.simulate; import twin; twin.simulate; import twin.commands.trim",
        "from twin import *",
    ],
)
def test_names_stay_functions_whatever_was_imported_first(order):
    done = python(f"{order}\nimport twin\nprint(callable(twin.simulate), callable(twin.trim))")
    assert (done.stdout.strip(), done.stderr) == ("True True", "")


@every_face
def test_a_wrong_name_is_an_attribute_error_with_the_nearest(face):
    right = next(name for name in face.__all__ if len(name) > 5)
    with pytest.raises(AttributeError, match=f"did you mean '{right}'"):
        getattr(face, right[:-1])
    assert not hasattr(face, "_private")
    with pytest.raises(ImportError):
        importlib.import_module(f"{face.__name__}.nothing")


def test_simulate_takes_plain_values():
    run = twin.simulate(
        mission="spiral-level-spiral", vehicle="glider", current="uniform:0.1,0",
        density="thermocline", duration=30.0, sensors="field", seed=3, bottom_depth=100.0,
    )  # fmt: skip
    assert run["true_current_north"][5] == pytest.approx(0.1)
    assert run.provenance["mission"] == "spiral-level-spiral"
    again = twin.simulate(
        mission="spiral-level-spiral", current=twin.Uniform(north=0.1), density="thermocline",
        duration=30.0, sensors=twin.SensorSuite(), seed=3, bottom_depth=100.0,
    )  # fmt: skip
    assert all((run[n] == again[n])[run[n] == run[n]].all() for n in run)
    other = twin.simulate(current="uniform:0.1,0", duration=30.0, sensors="field", seed=4)
    assert (other["measured_pitch"] != run["measured_pitch"]).any()


def test_simulate_flies_a_controller_and_a_schedule():
    def sink(seen):
        return twin.Command(shift=0.01, rotation=0.0, pump=-100.0)

    run = twin.simulate(controller=sink, duration=30.0)
    assert run["commanded_pump"][-1] == -100.0
    assert run.provenance["mission"] == "controller"
    scenario = twin.Scenario(mission=twin.load_mission(), duration=10.0)
    assert len(twin.simulate(scenario).time) == 21


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"vehicle": "glidr"}, "did you mean 'glider'"),
        ({"mission": "defalt"}, "did you mean 'default'"),
        ({"current": "unifrm:0.1"}, "did you mean 'uniform'"),
        ({"density": "thermoclin"}, "did you mean 'thermocline'"),
        ({"sensors": "feild"}, "did you mean 'field'"),
        ({"sensors": 3}, "sensors is 3"),
        ({"seed": 3}, "give sensors too"),
        ({"hydrodynamics": "coeficients"}, "coefficients"),
        ({"mission": "default", "controller": print}, "not both"),
        ({"scenario": "default"}, "give a Scenario"),
    ],
)
def test_what_simulate_cannot_use_is_explained(arguments, message):
    with pytest.raises(InputError, match=message):
        twin.simulate(**{"duration": 10.0, **arguments} if "scenario" not in arguments else
                      arguments)  # fmt: skip


def test_nothing_is_given_beside_a_scenario_and_ignored():
    scenario = twin.Scenario(mission=twin.load_mission(), duration=10.0)
    with pytest.raises(InputError, match=r"current is part of the scenario: use dataclasses\.repl"):
        twin.simulate(scenario, current="uniform:0.1,0")


def test_factory_generates_and_opens(tmp_path):
    out = tmp_path / "m.zarr"
    summary = factory.generate(out, hours=0.2, seed=4, workers=1)
    assert summary.missions == len(factory.open(out))
    with pytest.raises(TwinError, match="already exists"):
        factory.generate(out, hours=0.2, workers=1)
    with pytest.raises(InputError, match="did you mean 'field'"):
        factory.generate(out, preset="feld")
    with pytest.raises(InputError, match="did you mean 'slocum'"):
        factory.import_logs("slocm", [], tmp_path / "r.zarr")


@needs_docs
def test_the_examples_of_the_first_pages_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (first,) = [text for _, text in blocks("README.md")]
    assert len([line for line in first.splitlines() if line]) == 6
    (scenario,) = [text for _, text in blocks("docs/howto/index.md")]
    for text in (first, scenario):
        exec(compile(text, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("<Trajectory: glider on 'default'")
    assert (tmp_path / "run.png").stat().st_size > 20_000
    assert "measured_pitch" in twin.open_trajectory("run.zarr")


@needs_docs
def test_the_readme_is_short():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 100
    readers = text.split("\n## Three commands for you\n")[1].split("\n## ")[0]
    shown = re.findall(r"^ {4}(twin|factory|learn) ", readers, re.MULTILINE)
    assert len(shown) == 9


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: twin.Scenario(mission="default"), r"give twin.load_mission\('default'\)"),
        (lambda: twin.Scenario(current="uniform:0.1,0"),
         r"give twin.parse_current\('uniform:0.1,0'\)"),
        (lambda: twin.Scenario(mission=3),
         r"mission is 3; give a Mission or a Schedule, as twin\.load"),
        (lambda: factory.generate("m.zarr", hours=-1), "--hours -1 must be above 0"),
        (lambda: twin.simulate_many([{"mission": "default"}]),
         "element 0 is a value of type dict, not a Scenario"),
        (lambda: twin.simulate(seed=-1, sensors="ideal"), "seed -1 must be at least 0"),
        (lambda: twin.simulate(controller="x", duration=5.0), "give a function of an Observation"),
        (lambda: twin.parse_current("0.1,0.2"), "write uniform:0.1,0.2 for a velocity north, east"),
        (lambda: twin.simulate(start={"lattude": 49.0}), "did you mean 'latitude'"),
        (lambda: factory.generate("m.nc", hours=1), "is a zarr folder, not a .nc file: name it m"),
        (lambda: factory.generate("m.zarr", changes={"pitch": 3}), "did you mean 'mission.pitch_d"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_value_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_numbers_of_numpy_are_numbers():
    assert twin.simulate(duration=np.float32(5.0)).time[-1] == 5.0


def test_public_names_are_pickled():
    for one in (twin.simulate, twin.Scenario, factory.generate, learn.fit):
        assert pickle.loads(pickle.dumps(one)) is one


@pytest.mark.parametrize(
    ("given", "names", "wanted"),
    [
        ("durations", ["hours", "duration"], "duration"),
        ("Sample-Period", ["sample_period"], "sample_period"),
        ("xyzzy", ["duration"], None),
        ("pitch", ["mission.pitch_deg", "mission.depth"], "mission.pitch_deg"),
    ],
)
def test_the_nearest_name_is_by_spelling(given, names, wanted):
    assert nearest(given, names) == wanted
