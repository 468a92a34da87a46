"""Extension points: lazy, checked, open to users' own types; every shipped type is complete."""

import ast
import dataclasses
import importlib
import importlib.metadata
import inspect
import os
import subprocess
import sys

import numpy as np
import pytest
from examples import OWN, ROOT, blocks, needs_docs, own_type, run, script

import factory.seams
import learn.seams
import twin.plugins
import twin.seams
from factory.generation.generated_store import GeneratedStore
from factory.soundness import verify_store
from twin import control
from twin.control.registry import TASKS, check_task
from twin.errors import InputError, UnknownName
from twin.plugins import PLUGINS, imported
from twin.records.schema import HYDROGRAPHY, LOGGED_ONLY, SIMULATED, VARIABLES, WITH_FLOOR, Variable
from twin.records.trajectory import actuator_names
from twin.registry import Registry
from twin.sensors import SENSORS, Attitude, Sensor, SensorSuite
from twin.show.figures.base import FIGURES, FigureKind

TABLES = (twin.seams, factory.seams, learn.seams)
REGISTRIES = [row for table in TABLES for row in vars(table).values() if isinstance(row, Registry)]
every_registry = pytest.mark.parametrize("registry", REGISTRIES, ids=lambda r: r.noun)


# --- every extension point ----------------------------------------------------------------------


@every_registry
def test_every_shipped_kind_is_complete(registry):
    for name in registry.shipped():
        assert registry[name] is registry.check(name, registry[name])
    assert set(registry.shipped()) <= set(registry)
    assert len(registry) == len(list(registry))


@every_registry
def test_a_wrong_name_offers_the_nearest(registry):
    name = next(iter(registry))
    told = rf"unknown {registry.noun} '{name}x': did you mean '{name}'.*{registry.group}$"
    with pytest.raises(UnknownName, match=told):
        registry[name + "x"]
    assert name + "x" not in registry


@every_registry
def test_what_is_no_kind_is_refused(registry):
    with pytest.raises(InputError, match=f"{registry.noun} 'mine' is only half there"):
        registry.register("mine", object())
    assert "mine" not in registry
    for name in registry.shipped()[:1]:
        with pytest.raises(InputError, match="exists already: choose another name"):
            registry.register(name, object())


def test_kinds_are_imported_when_they_are_asked_for():
    code = (
        "import sys; from twin.show.figures.base import FIGURES; "
        "from twin.control.registry import TASKS;"
        "list(FIGURES), list(TASKS); "
        "sys.exit('matplotlib' in sys.modules or 'twin.control.hold' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=ROOT).returncode == 0


def made(**entry_points):
    registry = Registry(
        "toy", group="toys", shipped={"a": "math:pi"}, check=lambda name, kind: kind
    )
    points = {
        name: importlib.metadata.EntryPoint(name, value, "toys")
        for name, value in entry_points.items()
    }
    vars(registry)["_offered"] = points
    return registry


def test_installed_distributions_add_kinds():
    registry = made(b="math:tau", broken="nowhere:x")
    assert list(registry) == ["a", "b", "broken"]
    assert registry["b"] == 2 * registry["a"]
    with pytest.raises(InputError, match=r"the toy 'broken' as nowhere:x.*ModuleNotFoundError"):
        registry["broken"]
    registry.register("c", 3)
    registry.unregister("c")
    with pytest.raises(KeyError, match="registered toy 'a'"):
        registry.unregister("a")


def test_a_distribution_cannot_replace_a_shipped_kind(monkeypatch):
    point = importlib.metadata.EntryPoint("a", "math:tau", "toys")
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: (point,))
    registry = Registry("toy", group="toys", shipped={"a": "math:pi"}, check=lambda n, k: k)
    with pytest.raises(InputError, match="which the package has already"):
        list(registry)


def test_a_kind_needs_a_name_of_its_own():
    registry = made()
    with pytest.raises(InputError, match="cannot be registered as a toy: it has no name"):
        registry.add("spar")
    registry.register("b", 3)
    with pytest.raises(InputError, match="toy 'b' exists already"):
        registry.register("b", 4)


def test_files_in_the_environment_run_once(tmp_path, monkeypatch):
    count, plugin = tmp_path / "count.txt", tmp_path / "mine.py"
    plugin.write_text(f"with open({str(count)!r}, 'a') as file:\n    file.write('x')\n")
    monkeypatch.setenv(PLUGINS, str(plugin))
    registry = made()
    assert len(registry) == 1
    assert "a" in registry
    assert count.read_text() == "x"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.py", None, "names .*none.py, which is not a file"),
        ("broken.py", "1 / 0", "broken.py .*fails: ZeroDivisionError"),
        ("notes.txt", "hello", "notes.txt, which is not a Python file"),
    ],
)
def test_a_plugin_that_fails_is_named(tmp_path, monkeypatch, name, text, message):
    if text is not None:
        (tmp_path / name).write_text(text)
    monkeypatch.setenv(PLUGINS, str(tmp_path / name))
    with pytest.raises(InputError, match=message):
        made().names()
    assert str(tmp_path / name) not in twin.plugins._plugins_ran


# --- sensors ----------------------------------------------------------------------------------


def test_every_measured_variable_has_one_sensor_or_is_only_logged():
    # other tests may have declared a vehicle's parts
    own = {*SIMULATED, *HYDROGRAPHY, *LOGGED_ONLY, *WITH_FLOOR}
    parts = actuator_names(own)
    written = [entry.name for s in SENSORS.shipped() for entry in SENSORS[s].writes]
    written += [f"measured_{part}" for part in parts]
    assert len(written) == len(set(written))
    measured = {name for name in own if name.startswith("measured_")}
    assert set(written) == measured - set(LOGGED_ONLY)


@pytest.mark.parametrize("name", SENSORS.shipped())
def test_a_sensor_reads_what_there_is_and_measures_what_it_says(name):
    sensor = SENSORS[name]
    assert set(sensor.reads) <= set(VARIABLES)
    parts = [f"{g}_{p}" for p in ("shift", "pump") for g in ("true", "commanded")]
    signals = {n: np.full(40, 1.0) for n in (*sensor.reads, *parts)}
    drawn = sensor().draw(np.random.default_rng(0))
    out = sensor().measure(signals, dt=0.5, drawn=drawn, rng=np.random.default_rng(1))
    assert set(out) == {entry.name for entry in sensor().channels(signals)}
    assert all(values.shape == (40,) for values in out.values())
    for field in dataclasses.fields(sensor):
        assert f"{field.name}:" in inspect.getsource(sensor)


def turbid(**changes):
    """A complete sensor with attributes replaced; None removes one."""
    attributes = {
        "__module__": __name__,
        "__doc__": "A sensor.",
        "name": "smell",
        "reads": ("true_depth",),
        "writes": (Variable("measured_smell", "1", "smell", limits=(0.0, 1.0)),),
        "draws": {"smell_bias": "1"},
        "ideal": classmethod(lambda cls: cls()),
        "draw": lambda self, rng: {"smell_bias": 0.5},
        "measure": lambda self, signals, **_: {"measured_smell": 0.0 * signals["true_depth"]},
    }
    attributes = {k: v for k, v in (attributes | changes).items() if v is not None}
    kind = type("Smell", (Sensor,), attributes)
    return dataclasses.dataclass(frozen=True, kw_only=True)(kind)


class Unfinished(Sensor):
    name = "smell"


@dataclasses.dataclass(frozen=True)
class NoDefault(Sensor):
    name = "smell"
    reads = ("true_depth",)
    size: float

    def measure(self, signals, **_):
        return {}


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (Attitude(), "must be a class derived from"),
        (turbid(name="smel"), "its `name` is 'smel'"),
        (Unfinished, "frozen dataclass"),
        (NoDefault, "field 'size' needs a default"),
        (turbid(measure=None), "needs a method `measure`"),
        (turbid(reads=None), "`reads` must name the signals"),
        (turbid(reads=("depth",)), "reads 'depth', which must begin with true_"),
        (turbid(writes=None), "`writes` must hold"),
        (turbid(writes=("measured_smell",)), "give twin.records.schema.Variable objects"),
        (turbid(writes=(Variable("smell", "1", "s"),)), "must begin with measured_"),
        (turbid(writes=(Variable("measured_smell", "", "s"),)), "needs units"),
        (turbid(writes=(Variable("measured_smell", "1", "s"),)), "needs limits="),
        (turbid(ideal=None), "needs a classmethod `ideal`"),
        (turbid(ideal=classmethod(lambda cls: 3)), "`ideal` must return a Smell, not 3"),
        (turbid(draws=None), "`draw` gives smell_bias and `draws` names nothing"),
    ],
)
def test_a_sensor_that_is_only_half_there_is_refused(sensor, message):
    with pytest.raises(InputError, match=f"sensor 'smell' is only half there.*{message}"):
        SENSORS.check("smell", sensor)
    assert "smell" not in SENSORS
    assert "measured_smell" not in VARIABLES


def test_two_sensors_do_not_share_a_name():
    taken = turbid(draws={"dvl_scale": "1"}, draw=lambda self, rng: {"dvl_scale": 0.0})
    with pytest.raises(InputError, match="'dvl_scale', which sensor 'dvl' has too"):
        SENSORS.check("smell", taken)
    taken = turbid(writes=(VARIABLES["measured_roll"],))
    with pytest.raises(InputError, match="'measured_roll', which sensor 'attitude' has too"):
        SENSORS.check("smell", taken)


@pytest.mark.parametrize(
    ("result", "message"),
    [
        ({"measured_odour": 0}, "measured measured_odour: it must return a dict of measured_smell"),
        (None, "measured None: it must"),
        ({"measured_smell": 0.0}, r"gave measured_smell of shape \(\): one value for each of the"),
        (np.nan, r"gave NaN in measured_smell at sample 0: .*declare it Variable\(.*gaps=True\)"),
    ],
)
def test_what_a_sensor_returns_is_checked(result, message, monkeypatch):
    def measure(self, signals, **_):
        everywhere = {"measured_smell": np.full(len(signals["true_depth"]), np.nan)}
        return everywhere if isinstance(result, float) else result

    smell = turbid(measure=measure)
    monkeypatch.setitem(VARIABLES, "measured_smell", smell.writes[0])
    SENSORS.register("smell", smell)
    try:
        with pytest.raises(InputError, match=message):
            twin.simulate(duration=10.0, sensors=SensorSuite(smell=smell()))
    finally:
        SENSORS.unregister("smell")


def test_a_sensor_with_gaps_makes_a_sound_store_and_a_figure(tmp_path):
    """NaN where it says nothing; drawn without a truth, and without the sensor at hand."""

    def measure(self, signals, **_):
        return {"measured_smell": np.where(signals["true_depth"] > 2.0, 0.5, np.nan)}

    written = (Variable("measured_smell", "1", "smell", limits=(0.0, 1.0), gaps=True),)
    smell = turbid(measure=measure, writes=written)
    SENSORS.register("smell", smell)
    out = tmp_path / "smell.zarr"
    try:
        changes = {"mission.duration_h": "uniform(0.03, 0.06)"}
        factory.generate(
            out, hours=0.2, sensors=SensorSuite(smell=smell()), workers=1, changes=changes
        )
        report = verify_store(GeneratedStore(out))
        assert report.ok, [check.problems for check in report.checks]
    finally:
        SENSORS.unregister("smell")
    VARIABLES.pop("measured_smell")
    flown = twin.open_trajectory(out)
    assert VARIABLES["measured_smell"].gaps
    shown = [axes.get_title(loc="left") for axes in flown.plot("sensor").axes]
    assert "smell" in shown
    assert "measured − true: no true signal" in shown


def test_a_sensor_that_reads_what_nobody_measures_is_refused(monkeypatch):
    smell = turbid(reads=("measured_taste",))
    monkeypatch.setitem(VARIABLES, "measured_smell", smell.writes[0])
    SENSORS.register("smell", smell)
    try:
        with pytest.raises(InputError, match="'smell' reads measured_taste, which no other sensor"):
            SensorSuite(smell=smell())
    finally:
        SENSORS.unregister("smell")


@needs_docs
def test_the_table_of_sensors_is_the_registry_s():
    made = script("docs_settings").sections_by_name()["sensors"]
    page = (ROOT / "docs/reference/sensors.md").read_text()
    for name in SENSORS.shipped():
        assert f"| `{name}` | `measured_" in made
        assert f"`{name}`" in page


@needs_docs
def test_a_sensor_of_one_s_own_flies_in_one_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with own_type("turbidity"):
        try:
            names = run("docs/reference/sensors.md")
            stored = names["store"]
            _check_turbidity(stored)
            flown = twin.simulate(duration=60.0, sensors="field+turbidity", seed=1)
            plain = twin.simulate(duration=60.0, sensors="field", seed=1)
            for name in plain:  # another sensor changes no bit of the others
                assert np.array_equal(plain[name], flown[name], equal_nan=True), name
            assert flown.plot("sensor")
        finally:
            SENSORS.unregister("turbidity")
    VARIABLES.pop("measured_turbidity")
    again = factory.open("own.zarr")  # without the sensor: the signal is read as the store says
    assert "measured_turbidity" in again.signals()
    assert VARIABLES["measured_turbidity"].limits == (-5.0, 1000.0)
    assert "measured_turbidity" in twin.open_trajectory("own.zarr")
    with pytest.raises(InputError, match=r"unknown sensor 'turbidity'.*import the module"):
        _ = again.suite


@needs_docs
def test_an_installed_sensor_needs_no_import(tmp_path):
    """As a distribution brings it: the command line takes it, verifies and replays its store."""
    installed = tmp_path / "turbidity-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: turbidity\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text(
        "[glider_twin.sensors]\nturbidity = turbidity:Turbidity\n"
    )
    with own_type("turbidity"):
        code = (
            "from factory.__main__ import PROGRAM; made = PROGRAM.main("
            "'generate --hours 0.2 --sensors field+turbidity --workers 1 --out m.zarr'.split());"
            "raise SystemExit(made or PROGRAM.main('verify m.zarr --replay 1'.split()))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (ROOT, tmp_path, OWN)))},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    data = twin.open_store(tmp_path / "m.zarr")
    assert data["measured_turbidity"].attrs["valid_max"] == 1000.0
    assert data.attrs["sensors"] == "field+turbidity"


def _check_turbidity(stored):
    data = stored.dataset
    assert data["measured_turbidity"].attrs["units"] == "NTU"
    assert data["measured_turbidity"].attrs["long_name"] == "turbidity"
    assert data["sensor_turbidity_offset"].attrs["units"] == "NTU"
    assert len(set(data["sensor_turbidity_offset"].values)) == data.sizes["mission"]
    clear = 4.0 * np.exp(-data["true_depth"][0] / 20.0) + data["sensor_turbidity_offset"][0]
    error = data["measured_turbidity"][0] - clear
    assert float(error.std()) == pytest.approx(0.1, rel=0.1)
    assert stored.suite.turbidity.noise == 0.1


# --- figures ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "b"}, "its `name` is 'b'"),
        ({"summary": ""}, "it lacks `summary`"),
        ({"draw": 3}, "must be a function"),
        ({"draw": lambda t, n: None}, "options of `draw` beside 't' need defaults"),
        ({"takes_tracks": True}, "`takes_tracks` must say"),
    ],
)
def test_a_figure_that_is_only_half_there_is_refused(changes, message):
    whole = FigureKind(name="a", summary="all", draw=lambda trajectory: None)
    with pytest.raises(InputError, match=f"figure 'a' is only half there.*{message}"):
        FIGURES.register("a", dataclasses.replace(whole, **changes))


@needs_docs
def test_the_table_of_figures_is_the_registry_s():
    made = script("docs_settings").sections_by_name()["figures"]
    page = (ROOT / "docs/howto/render.md").read_text()
    for name in FIGURES.shipped():
        assert f"| `{name}` | {FIGURES[name].summary} |" in made
        assert f"`{name}`" in page


@needs_docs
def test_a_figure_of_one_s_own_is_drawn_by_name():
    flown = twin.simulate(duration=60.0)
    with own_type("speed_histogram"):
        try:
            importlib.import_module("speed_histogram")
            figure = flown.plot("speed_histogram", bins=7)
            assert len(figure.axes[0].patches) == 7
            assert "speed_histogram" in twin.figure_names()
        finally:
            FIGURES.unregister("speed_histogram")


# --- tasks ------------------------------------------------------------------------------------


def idle(vehicle="glider", *, random=None, environment_kwargs=None):
    """Nothing to do."""
    return 3


def test_a_task_of_one_s_own_must_make_an_environment():
    control.register(idle)
    try:
        with pytest.raises(InputError, match="task 'idle' made 3: return"):
            control.load("idle")
    finally:
        TASKS.unregister("idle")


def test_a_task_that_is_only_half_there_is_refused():
    def bare(vehicle="glider"):
        pass

    with pytest.raises(InputError, match="docstring must say"):
        check_task("bare", bare)
    bare.__doc__ = "Nothing."
    with pytest.raises(InputError, match="needs the arguments random, environment_kwargs"):
        check_task("bare", bare)


@needs_docs
def test_every_task_is_on_its_page():
    page = (ROOT / "docs/howto/dm_control.md").read_text()
    for name in TASKS.shipped():
        assert f"| `{name}` |" in page
    assert blocks("docs/howto/dm_control.md")


# --- Every type in the folder of an extension point is in its row, or nobody could name the type


NO_KINDS = {
    "twin.water.current.base:CurrentSum": "a sum of kinds, which the sampler adds up",
    "twin.water.current.tabulated:Tabulated": "a function's table, which flies as a grid",
}
"""Classes derived from the base of an extension point that are no types, and why"""
SEAMS = script("architecture").seams()


def base_of(seam):
    """The class or protocol that all types of an extension point share."""
    return imported(":".join(seam.base.rsplit(".", 1)))


def unregistered(modules, base, table):
    """Kinds that modules define and a table lacks, as `module:Name`.

    A kind is an object of the base, or a class derived from it that nothing else in the folder
    derives from. Where the table holds functions that make kinds, one of the class's own module and
    name, in lower case, stands for it.
    """
    classes, objects = {}, {}
    for module in modules:
        for name, value in vars(module).items():
            own = isinstance(value, type) and value.__module__ == module.__name__
            if own and value is not base and issubclass(value, base):
                classes[f"{module.__name__}:{name}"] = value
            elif not isinstance(value, type) and isinstance(value, base):
                objects[f"{module.__name__}:{name}"] = value
    functions = [kind for kind in table if inspect.isfunction(kind)]
    listed = [kind for kind in table if isinstance(kind, type)]
    makers = {f"{kind.__module__}:{kind.__name__}" for kind in functions}
    known = {kind if isinstance(kind, type) else type(kind) for kind in table}
    inherited = {parent for value in classes.values() for parent in value.__mro__[1:]}
    lacking = [
        place
        for place, value in classes.items()
        if value not in known | inherited and place.lower() not in makers
    ]
    return lacking + [
        place
        for place, value in objects.items()
        if not any(value is kind for kind in table) and type(value) not in listed
    ]


def modules_of(folder):
    """The modules of an extension point's folder and of the folders in it."""
    files = sorted((ROOT / folder).rglob("*.py"))
    names = (".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files)
    wanted = (name.removesuffix(".__init__") for name in names if not name.endswith("__main__"))
    return [importlib.import_module(name) for name in wanted]


def test_registries_are_made_in_the_tables_of_seams_alone():
    made = {
        str(path.relative_to(ROOT))
        for package in ("twin", "factory", "learn")
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Registry")
    }
    assert made == {"twin/seams.py", "factory/seams.py", "learn/seams.py"}


@pytest.mark.parametrize("seam", SEAMS, ids=lambda seam: seam.what)
def test_every_kind_in_a_seam_s_folder_is_in_its_table(seam):
    base = base_of(seam)
    if getattr(base, "_is_protocol", False):
        pytest.skip("its kinds are functions of other packages: no file of the folder is one")
    lacking = unregistered(modules_of(seam.folder), base, seam.kinds)
    assert [place for place in lacking if place not in NO_KINDS] == []


@pytest.mark.parametrize("seam", SEAMS, ids=lambda seam: seam.what)
def test_a_kind_that_is_taken_out_of_a_table_is_missed(seam):
    """A table without its last kind: that kind is the one that is named."""
    base = base_of(seam)
    if getattr(base, "_is_protocol", False):
        pytest.skip("as above")
    *others, last = seam.kinds
    lacking = unregistered(modules_of(seam.folder), base, others)
    module = last.__module__ if hasattr(last, "__qualname__") else None
    found = [place for place in lacking if place not in NO_KINDS]
    assert found
    assert module is None or all(place.startswith(f"{module}:") for place in found)
