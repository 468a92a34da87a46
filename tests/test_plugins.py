"""Plugins of this project: public faces only, one version, a README of one screen, entry points."""

import ast
import importlib
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from functools import cache
from importlib import metadata

import pytest
from examples import ROOT
from packaging.requirements import Requirement

import twin.lazy
from factory.importing import IMPORTERS, sniff
from factory.importing.formats.base import LOOKS, NeedsPlugin
from twin.control.dm_suite import ALONE, MUJOCO_BELOW
from twin.plugins import OWN_PLUGINS, load_entry_point
from twin.version import __version__

PACKAGES = ("twin", "factory", "learn")
PLUGINS = sorted((ROOT / "plugins").glob("*/pyproject.toml"))
SCREEN = 40
"""Lines of a README"""
every_plugin = pytest.mark.parametrize("plugin", PLUGINS, ids=lambda path: path.parent.name)


def project(plugin):
    """The table [project] of a plugin."""
    found = tomllib.loads(plugin.read_text(encoding="utf-8"))["project"]
    return found


def points(plugin):
    groups = project(plugin).get("entry-points", {})
    return [
        metadata.EntryPoint(name, value, group)
        for group, each in groups.items()
        for name, value in each.items()
    ]


@cache
def face(package):
    """Public names of a package; None for what is no package."""
    module = ROOT / package.replace(".", "/")
    if not (module / "__init__.py").is_file():
        return None
    written = getattr(importlib.import_module(package), "__all__", ())
    tree = ast.parse((module / "__init__.py").read_text(encoding="utf-8"))
    own = {n.name for n in tree.body if isinstance(n, ast.ClassDef | ast.FunctionDef)}
    bound = [target for n in tree.body if isinstance(n, ast.Assign) for target in n.targets]
    bound += [n.target for n in tree.body if isinstance(n, ast.AnnAssign)]
    own |= {t.id for target in bound for t in ast.walk(target) if isinstance(t, ast.Name)}
    shown = {a.asname for n in tree.body if isinstance(n, ast.ImportFrom)
             for a in n.names if a.asname}  # fmt: skip
    names = {*own, *shown, *written, *twin.lazy.places(package), "__version__"}
    return frozenset(n for n in names if not n.startswith("_") or n == "__version__")


def below_the_faces(source):
    """Names that a text imports from below the public faces.

    A module that a face shows is public: `from twin.errors import InputError`.
    """
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [one.name for one in node.names]
            found += [n for n in names if n.split(".")[0] in PACKAGES and n not in PACKAGES]
        elif isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] in PACKAGES:
            module = str(node.module)
            public = face(module)
            package, _, last = module.rpartition(".")
            if public is None and last in (face(package) or ()):
                continue
            found += [f"{module}.{a.name}" for a in node.names if a.name not in (public or ())]
    return found


@every_plugin
def test_a_plugin_imports_public_names_only(plugin):
    files = [p for p in plugin.parent.rglob("*.py") if "tests" not in p.parts]
    assert files
    deep = {path.name: below_the_faces(path.read_text(encoding="utf-8")) for path in files}
    assert {name: found for name, found in deep.items() if found} == {}


def test_what_is_below_a_face_is_noticed():
    text = "from twin.records.reader import MissionStore\nimport twin.facade\nimport twin\n"
    assert below_the_faces(text) == ["twin.records.reader.MissionStore", "twin.facade"]
    assert below_the_faces("from twin.records import nothing") == ["twin.records.nothing"]
    assert below_the_faces("from twin.errors import InputError\nfrom twin import Vehicle") == []


@every_plugin
def test_a_plugin_has_the_version_of_the_core_and_asks_for_what_is_pinned(plugin):
    about = project(plugin)
    name = plugin.parent.name
    assert about["name"] == f"{OWN_PLUGINS}{name}"
    assert about["version"] == metadata.version(about["name"]) == __version__
    pins = dict(
        line.split("==")
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if "==" in line and not line.startswith("#")
    )
    tests = about.get("optional-dependencies", {}).get("test", [])
    for wanted in map(Requirement, [*about["dependencies"], *tests]):
        if wanted.name != "glider-twin":
            assert wanted.specifier.contains(pins[wanted.name]), wanted
    setup = (ROOT / "scripts" / "venv.sh").read_text(encoding="utf-8")
    assert f"--editable plugins/{name}" in setup.replace("'", "")


@every_plugin
def test_a_readme_is_one_screen_with_the_install_and_three_commands(plugin):
    text = (plugin.parent / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= SCREEN
    install, *commands = re.findall(r"^ {4}(\S.*)$", text, re.MULTILINE)
    assert install == f"pip install ./plugins/{plugin.parent.name}"
    assert len(commands) == 3


@every_plugin
def test_every_entry_point_is_installed_and_loads(plugin):
    for point in points(plugin):
        (found,) = metadata.entry_points(group=point.group, name=point.name)
        assert found.value == point.value
        assert load_entry_point(found, point.name) is not None


@every_plugin
def test_its_wheel_holds_the_package_alone(plugin, tmp_path):
    source = tmp_path / "source"
    shutil.copytree(plugin.parent, source, ignore=shutil.ignore_patterns("tests", "__pycache__"))
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=source, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    package = f"glider_twin_{plugin.parent.name}"
    assert f"{package}/__init__.py" in names
    assert all(name.startswith((f"{package}/", f"{package}-{__version__}")) for name in names)


def test_looks_are_those_of_the_readers_of_plugins():
    for kind, looks in LOOKS.items():
        importer = IMPORTERS[kind]
        assert set(looks) <= {*importer.first_bytes, *importer.marks}
        assert importer.marks <= set(looks)
        assert kind not in IMPORTERS.shipped()


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("run.mcap", b"\x89MCAP0\r\n", "mcap"),
        ("log.csv", b"EpochSeconds,depth\n1,2\n3,4\n", "lrauv"),
    ],
)
def test_a_file_whose_plugin_is_not_installed_names_it(name, content, kind, tmp_path, monkeypatch):
    others = {n: point for n, point in IMPORTERS._offered.items() if n not in LOOKS}
    monkeypatch.setitem(vars(IMPORTERS), "_offered", others)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(NeedsPlugin, match=rf"looks like {kind}.*pip install ./plugins/protocols"):
        sniff(tmp_path / name)


# --- Dependencies: what is imported is declared, and dm-control's are ours where it goes in alone


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PYTHON_313 = {"python_version": "3.13", "extra": ""}


def plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def declared():
    """Every requirement of users: the tests' and the linters' do not count."""
    extras = PROJECT["optional-dependencies"]
    users = [r for name, extra in extras.items() if name not in ("test", "lint") for r in extra]
    return [Requirement(text) for text in [*PROJECT["dependencies"], *users]]


def imported():
    """Top modules that the three packages import from elsewhere."""
    found = set()
    for path in (path for name in PACKAGES for path in (ROOT / name).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - set(PACKAGES) - sys.stdlib_module_names


def test_every_import_is_declared():
    names = {plain(requirement.name) for requirement in declared()}
    distributions = metadata.packages_distributions()
    for module in sorted(imported()):
        sources = {plain(name) for name in distributions.get(module, [module])}
        assert sources & names, f"{module} comes from {sources}, which pyproject.toml does not name"


def test_all_brings_every_extra_of_a_user():
    extras = PROJECT["optional-dependencies"]
    (everything,), (dev,) = (map(Requirement, extras[name]) for name in ("all", "dev"))
    # boto3 and the pinned dateutil exclude each other; the others are for who works on the project
    assert everything.extras == set(extras) - {"all", "dev", "docs", "test", "lint", "aws"}
    assert dev.extras == {"all", "docs", "test", "lint"}


def test_python_3_13_has_all_that_dm_control_needs_but_labmaze():
    needed = [Requirement(text) for text in metadata.requires("dm-control") or ()]
    wanted = {plain(r.name) for r in needed if not r.marker or r.marker.evaluate(PYTHON_313)}
    named = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["suite"]]
    ours = [Requirement(text) for text in named]
    there = {plain(r.name) for r in ours if not r.marker or r.marker.evaluate(PYTHON_313)}
    assert wanted - there == {"labmaze"}
    assert "dm-control" not in there


def test_the_suite_names_the_range_of_dm_control():
    suite = PROJECT["optional-dependencies"]["suite"]
    (range_,) = [Requirement(text) for text in suite if text.startswith("dm-control")]
    asked = Requirement(ALONE.split('"')[1])
    assert (asked.name, asked.specifier) == (range_.name, range_.specifier)


def test_the_suite_carries_the_mujoco_that_its_code_accepts():
    """The tasks of dm_control alone need an older one: everything else takes the newer too."""
    (ours,) = [Requirement(r) for r in PROJECT["dependencies"] if r.startswith("mujoco")]
    suite = PROJECT["optional-dependencies"]["suite"]
    (theirs,) = [Requirement(r) for r in suite if r.startswith("mujoco")]
    newer = f"{MUJOCO_BELOW}.0.0"
    assert newer in ours.specifier
    assert newer not in theirs.specifier
    least = {spec.version for spec in ours.specifier if spec.operator == ">="}
    assert least == {spec.version for spec in theirs.specifier if spec.operator == ">="}
    assert all(version in theirs.specifier for version in least)
