"""The rules of docs/project/architecture.md, over the source: imports, folders, names."""

import ast
import importlib
import re
from collections import defaultdict
from functools import cache

import pytest
from examples import ROOT, needs_docs, script

import twin.lazy

PACKAGES = ("twin", "factory", "learn")
TOP_LEVEL = {
    "twin": {
        "__init__", "__main__", "bounded", "errors", "extras", "facade", "frames", "notebook",
        "geodesy", "lazy", "numbers", "plugins", "registry", "seams", "version",
    },
    "factory": {
        "__init__", "__main__", "facade", "logs_page", "missions_page",
        "seams", "soundness", "store_check",
    },
    "learn": {
        "__init__", "__main__", "adaptation", "api", "files", "finishing",
        "run", "run_evaluation", "run_folder", "seams",
    },
}  # fmt: skip
"""Modules beside the folders of each package; everything else goes into a folder."""

FLIPS = {
    "twin.frames": "the constants themselves",
    "twin.vehicle.additions": "vehicle files are MJCF",
    "twin.vehicle.mjcf": "vehicle files are MJCF",
    "twin.vehicle.vehicle": "vehicle files are MJCF",
    "twin.vehicle.laws.ellipsoid": "the law is MuJoCo's, in the axes of its geoms",
    "twin.identify.vehicle_file": "vehicle files are MJCF",
    "twin.physics.mujoco_model": "the model is MuJoCo's",
    "twin.physics.simulation": "the state is MuJoCo's",
    "twin.physics.condition": "model and state are MuJoCo's",
    "twin.physics.settle": "the state is MuJoCo's",
    "twin.physics.true_signals": "the state is MuJoCo's",
    "twin.control.physics": "the state is MuJoCo's",
    "twin.control.many": "the state is MuJoCo's",
    "twin.show.render.camera": "scenes are MuJoCo's",
    "twin.show.render.subject": "scenes are MuJoCo's",
    "twin.show.render.playback": "scenes are MuJoCo's",
    "twin.show.render.shapes": "scenes are MuJoCo's",
    "twin.show.render.stage": "scenes are MuJoCo's",
}
"""Modules outside the native plant that turn z-up axes into north-east-down, and why."""

PLACE = re.compile(rf"(?:{'|'.join(PACKAGES)})(?:\.\w+)+(?::\w+)?$").match
"""A text that names a module of the project, or what stands in one"""
LAZY_BOTH_WAYS = {
    "twin.records <-> twin.show.figures": "`Trajectory.plot`: a record offers figures, undrawn"
}
"""Folders of which one names the other only for when it is asked, and why"""
MOST_DOUBLED_FILES, MOST_DOUBLED_CLASSES = 25, 10
"""File names and public classes that stand at two places are fewer"""
COMPUTED_IMPORTS = {
    "twin.lazy": "public names, by the places of each face",
    "twin.plugins": "kinds, by the places of each registry",
    "twin.cli.program": "commands, by the places of each program",
    "twin.extras": "packages of an extra",
}
"""Modules that import what they are given a name of, and what names they are given"""

ACTUATORS = {"shift", "rotation", "pump", "battery", "rudder", "propeller"}
NAMES_ACTUATORS = {
    "twin.vehicle": "parts are defined and found here",
    "twin.seams": "the table of the parts",
    "twin.mission": "mission files have keys of them, and guidance asks for their kinds",
    "twin.commands.trim": "options of the command",
    "twin.identify": "a glider's pump and battery are what is identified",
    "twin.records": "standard names and limits of signals",
    "twin.sensors": "the deviation that a battery makes in a compass, and its encoders",
    "twin.vehicle.steady_motion": "figures of a steady glide",
    "twin.physics.settle": "the glide that a search starts from",
    "twin.physics.model_block": "the stiff screws of a battery",
    "twin.fossen": "the trim's positions; a rotation matrix",
    "twin.checks": "published positions",
    "twin.control": "energy of pumps and propellers, and a pilot for gliders",
    "twin.faults": "a fault is of one part",
    "twin.physics.condition": "the load of a pump",
    "twin.logs.energy_timeline": "what a pump moves by depth and direction",
    "twin.logs.energy_use": "a pump, drives and a propeller take unlike shares",
    "twin.commands.flight": "the same in words",
    "twin.show.figures.logged_dive": "signals of logs",
    "twin.show.identification": "a battery's and a pump's panels beside a log",
    "factory.importing": "formats of real vehicles' logs",
    "factory.exporting": "names in export formats",
    "factory.samples": "names in the files of real vehicles",
    "factory.sampling": "what is drawn for a glider",
    "factory": "figures of what was drawn",
    "twin.navigation": "a glider's equations of motion; signals that networks see",
    "learn.report.velocity_figures": "signals of a mission",
}  # fmt: skip
"""Packages and modules that may name an actuator, and why; others ask the vehicle for its parts."""
OTHER_MEANINGS = {
    "twin.physics.native": "rotation is a matrix",
    "twin.water.current": "rotation of a grid's axes, shift of its time",
    "twin.show.render.painter": "shift of a mesh",
    "learn.data.stores": "advice on what store to take",
}


@cache
def modules():
    """Path of every module by its name; a package has the name of its folder."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


@cache
def tree(module):
    return ast.parse(modules()[module].read_text(encoding="utf-8"))


@cache
def nodes(module):
    """All of a module's tree."""
    return list(ast.walk(tree(module)))


def imported(module):
    """Modules of the project that a module imports anywhere, for type checkers too."""
    found = set()
    for node in nodes(module):
        if isinstance(node, ast.Import):
            found |= {known(alias.name) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{module} imports relatively"
            found |= {known(f"{node.module}.{alias.name}") for alias in node.names}
    return found - {"", module}


def known(name):
    """The module of the project that a dotted name begins with, "" where there is none."""
    while name and name not in modules():
        name = name.rpartition(".")[0]
    return name


def named(source):
    """Modules of the project that a module's texts name, as places of lazy imports are written.

    `import_module("twin.show")`, `__import__("twin.show")`, `"twin.show.figures.base:figure"`.
    """
    texts = {
        node.value.partition(":")[0]
        for node in ast.walk(source)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and PLACE(node.value)
    }
    return {known(text) for text in texts} - {""}


def computed_imports(source):
    """Calls of `import_module` and `__import__` whose module is not written out."""
    return [
        ast.unparse(node)
        for node in ast.walk(source)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).rpartition(".")[2] in ("import_module", "__import__")
        and not (node.args and isinstance(node.args[0], ast.Constant))
    ]


@cache
def graph():
    return {module: imported(module) for module in modules()}


def circle(edges):
    """Modules of one circle of imports, empty when there is none."""
    done = set()
    path = []

    def walk(module):
        if module in path:
            return path[path.index(module) :]
        if module in done:
            return []
        path.append(module)
        for other in sorted(edges.get(module, ())):
            if found := walk(other):
                return found
        path.pop()
        done.add(module)
        return []

    for module in edges:
        if found := walk(module):
            return found
    return []


def two_ways(edges, folder):
    """Pairs of folders, neither inside the other, that import each other."""
    between = defaultdict(set)
    for module, others in edges.items():
        for other in others:
            between[folder[module]].add(folder[other])
    return [
        f"{one} <-> {other}"
        for one in sorted(between)
        for other in sorted(between[one])
        if one < other and one in between.get(other, ()) and not other.startswith(f"{one}.")
    ]


def words(module):
    """Parts of every name and text in a module's code; docstrings are not code."""
    texts = {
        id(node.value)
        for node in nodes(module)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    names = []
    for node in nodes(module):
        for field in ("id", "attr", "arg", "name"):
            if isinstance(value := getattr(node, field, None), str):
                names.append(value)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in texts:
            names += re.findall(r"\w+", node.value)
    return {word for name in names for word in name.lower().split("_")}


def within(module, places):
    return any(module == place or module.startswith(f"{place}.") for place in places)


def test_learn_uses_factory_and_factory_uses_twin():
    for module, others in graph().items():
        rank = PACKAGES.index(module.partition(".")[0])
        for other in others:
            assert PACKAGES.index(other.partition(".")[0]) <= rank, f"{module} imports {other}"


def test_no_circle_of_files():
    assert circle(graph()) == []
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c"]


def folders():
    """The folder of each module."""
    return {
        name: name if path.name == "__init__.py" else name.rpartition(".")[0]
        for name, path in modules().items()
    }


def test_no_two_folders_import_each_other():
    assert two_ways(graph(), folders()) == []
    edges = {"a.x": {"b.y"}, "b.z": {"a.x"}}
    assert two_ways(edges, {"a.x": "a", "b.y": "b", "b.z": "b"}) == ["a <-> b"]


def test_nor_by_the_names_of_lazy_imports():
    edges = {module: graph()[module] | named(tree(module)) - {module} for module in modules()}
    assert two_ways(edges, folders()) == list(LAZY_BOTH_WAYS)
    for text in (
        "import importlib; importlib.import_module('twin.show.style')",
        "__import__('twin.show.style')",
        "attach(__name__, {'style': 'twin.show.style:styled'})",
    ):
        assert named(ast.parse(text)) == {"twin.show.style"}
        edges["twin.water.sound"] = named(ast.parse(text))
        edges["twin.show.style"] |= {"twin.water.sound"}
        places = {**folders(), "twin.water.sound": "twin.water"}
        assert "twin.show <-> twin.water" in two_ways(edges, places)


def test_what_is_imported_by_a_computed_name_is_where_kinds_and_commands_are_looked_up():
    computed = {module for module in modules() if computed_imports(tree(module))}
    assert computed == set(COMPUTED_IMPORTS)
    assert computed_imports(ast.parse("importlib.import_module('tw' + 'in')"))
    assert not computed_imports(ast.parse("importlib.import_module('twin')"))


def below_the_faces(module):
    """What a command imports that is below a public face.

    Not below one are what all commands share and what stands beside the face of its own package,
    `TOP_LEVEL`. No command imports another one.
    """
    package = module.partition(".")[0]
    own = {f"{package}.{name}" for name in TOP_LEVEL[package]}
    return sorted(
        other
        for other in imported(module)
        if modules()[other].name != "__init__.py"
        and other not in ("twin.errors", "twin.version", *own)
        and not other.startswith("twin.cli.")
    )


@pytest.mark.parametrize("package", PACKAGES)
def test_commands_call_public_faces_and_nothing_below(package):
    commands = [module for module in modules() if module.startswith(f"{package}.commands.")]
    assert commands
    assert {module: found for module in commands if (found := below_the_faces(module))} == {}


def test_what_is_below_a_face_is_noticed():
    assert below_the_faces("twin.show.identification")
    assert "factory.generation.executors" in below_the_faces("factory.store_check")


def doubled(places):
    """Names that stand at more than one place, from pairs of both."""
    found = defaultdict(list)
    for name, place in places:
        found[name].append(place)
    return {name: each for name, each in found.items() if len(each) > 1}


def test_few_files_share_a_name():
    """A type's name in two extension points, a base, a command named as its function; few more."""
    files = [(path.name, module) for module, path in modules().items()]
    found = doubled(one for one in files if one[0] not in ("__init__.py", "__main__.py"))
    assert len(found) < MOST_DOUBLED_FILES, found
    assert "base.py" in found


def test_few_public_classes_share_a_name():
    """A reader who meets one must not take it for the other."""
    classes = [
        (node.name, module)
        for module in modules()
        for node in tree(module).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    found = doubled(classes)
    assert len(found) < MOST_DOUBLED_CLASSES, found
    assert doubled([("Hold", "a"), ("Dvl", "b"), ("Hold", "c")]) == {"Hold": ["a", "c"]}


def test_a_lazy_face_shows_no_name_of_a_module_beside_it():
    """`from twin.records import store` would give the name or the module, by what came before;
    and `twin.simulate` must stay the function."""
    lazy = {p for p, path in modules().items() if "attach(__name__" in path.read_text("utf-8")}
    assert set(PACKAGES) < lazy
    for package in lazy:
        beside = {each.stem for each in modules()[package].parent.iterdir()}
        assert not beside & shown(importlib.import_module(package).__name__), package


def shown(package):
    """Public names of a lazy face that are no modules: a module that is shown is itself."""
    return {name for name, place in twin.lazy.places(package).items() if ":" in place}


@pytest.mark.parametrize("package", PACKAGES)
def test_top_levels_hold_folders_and_little_else(package):
    assert {path.stem for path in (ROOT / package).glob("*.py")} == TOP_LEVEL[package]


def test_axes_flip_in_known_places():
    flips = {
        module
        for module in modules()
        if {"FLIP", "flip"} & {n.partition("_")[0] for n in _names(module)}
        and not module.startswith("twin.physics.native")
    }
    assert flips <= set(FLIPS)


def _names(module):
    return {
        alias.name
        for node in nodes(module)
        if isinstance(node, ast.ImportFrom) and node.module == "twin.frames"
        for alias in node.names
    }


def test_actuators_are_named_where_they_belong():
    """Everything else asks a vehicle or a trajectory for its parts."""
    for module in modules():
        if not within(module, NAMES_ACTUATORS) and not within(module, OTHER_MEANINGS):
            assert not words(module) & ACTUATORS, module


def test_every_place_that_may_name_an_actuator_exists():
    for place in (*NAMES_ACTUATORS, *OTHER_MEANINGS, *FLIPS):
        assert place in modules(), place


# --- the page ---------------------------------------------------------------------------------


def page():
    return (ROOT / "docs" / "project" / "architecture.md").read_text(encoding="utf-8")


@needs_docs
def test_the_table_of_seams_is_that_of_the_registries():
    table = script("architecture").seam_table()
    assert table in script("docs_settings").settings_page()
    assert table.count("\n") > 15


@needs_docs
def test_the_tree_of_the_page_has_every_folder():
    folders = {
        f"{package}/{path.name}/"
        for package in PACKAGES
        for path in (ROOT / package).iterdir()
        if (path / "__init__.py").is_file()
    }
    assert set(re.findall(r"^    (\w+/\w+/)", page(), re.MULTILINE)) == folders


@needs_docs
@pytest.mark.parametrize("name", ["project/architecture.md", "howto/extending.md"])
def test_tests_and_pages_that_a_page_names_exist(name):
    path = ROOT / "docs" / name
    text = path.read_text(encoding="utf-8")
    for place in re.findall(r"`(tests/[\w/.]+)`", text):
        assert (ROOT / place).exists(), place
    for link in re.findall(r"\]\((\w[\w./-]*?)(#[\w-]+)?\)", text):
        target = path.parent / link[0]
        assert target.exists(), link
        if link[1]:
            heads = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            anchors = {re.sub(r"[^\w\- ]", "", h).strip().lower().replace(" ", "-") for h in heads}
            assert link[1][1:] in anchors, link
