"""The distribution: the wheel works on its own, names and versions agree, documents are true."""

import doctest
import importlib
import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from examples import script
from packaging.requirements import Requirement
from trees import keep_compiled

import factory
from factory.__main__ import PROGRAM as FACTORY
from learn.__main__ import PROGRAM as LEARN
from twin.__main__ import PROGRAM as TWIN
from twin.errors import InputError
from twin.vehicle.presets import asset_path, assets_folder
from twin.version import __version__

ROOT = Path(__file__).resolve().parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PACKAGES = ("twin", "factory", "learn")
SAFE = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
"""Python 3.11 has it from 3.11.4 on"""
PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check"]


def _ended(command, cwd, code):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def _run(command, cwd):
    return _ended(command, cwd, 0).stdout


def _tracked(*names):
    """The files that git tracks under names, or all, that are there."""
    if not (ROOT / ".git").exists():
        pytest.skip("what is compared with git's list of files needs a checkout")
    # not quoted: git writes names with odd letters in octal otherwise
    listed = _run(["git", "ls-files", "-z", *names], cwd=ROOT).split("\0")
    return {name for name in listed if name and (ROOT / name).exists()}


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """The source distribution."""
    folder = tmp_path_factory.mktemp("source")
    _run([sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder], cwd=ROOT)
    (made,) = folder.glob("*.tar.gz")
    return made


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory):
    """The wheel, made from the source distribution as an installer without wheels would."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [*PIP, "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", folder, source]
    _run(build, cwd=folder)
    (made,) = folder.glob("*.whl")
    return made


def test_source_distribution_holds_every_tracked_file_and_its_tests_can_be_collected(
    source, tmp_path
):
    with tarfile.open(source) as archive:
        archive.extractall(tmp_path, **SAFE)
    unpacked = tmp_path / f"glider_twin-{__version__}"
    # The tests that read what is no package: documents, examples, scripts, the recipe, the paper.
    beside = ["tests/docs", *(str(path.relative_to(ROOT)) for path in ROOT.glob("tests/test_*.py"))]
    collect = [
        sys.executable,
        "-m",
        "pytest",
        "--collect-only",
        "-q",
        "-n0",
        "-p",
        "no:cacheprovider",
    ]
    said = _run([*collect, *beside], cwd=unpacked)
    assert re.search(r"^\d{2,} tests collected", said, re.MULTILINE)
    markdown = script("docs_markdown")
    assert [one for page in unpacked.glob("*.md") for one in markdown.dead_links(page)] == []
    made = {name for name in _files(unpacked) if "__pycache__" not in name}
    assert made == {*_tracked(), "PKG-INFO"}


def test_the_wheel_has_the_same_bytes_wherever_and_whenever_it_is_built(source, wheel, tmp_path):
    with tarfile.open(source) as archive:
        archive.extractall(tmp_path, **SAFE)
    unpacked = tmp_path / f"glider_twin-{__version__}"
    for k, path in enumerate(sorted(unpacked.rglob("*.py"))):
        path.chmod(0o600)
        os.utime(path, (1e9 + k, 1e9 + k))
    _run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path], cwd=unpacked)
    (again,) = tmp_path.glob("*.whl")
    assert again.read_bytes() == wheel.read_bytes()


def test_wheel_holds_every_file_of_the_packages_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        shipped = {name for name in archive.namelist() if ".dist-info/" not in name}
    present = _tracked(*PACKAGES, "assets")
    assert shipped == {f"twin/{n}" if n.startswith("assets/") else n for n in present}
    # what is read from beside the code, by kind
    for name in (
        "twin/show/figures/coast.npz",
        "twin/assets/glider.xml",
        "twin/show/web/page.html",
    ):
        assert name in shipped


def _needed(requirements):
    """Names of the distributions that these ask for here without extras, and those they ask for."""
    found = set()
    waiting = list(requirements)
    while waiting:
        requirement = Requirement(waiting.pop())
        asked = not requirement.marker or requirement.marker.evaluate({"extra": ""})
        if asked and requirement.name not in found:
            found.add(requirement.name)
            waiting += metadata.requires(requirement.name) or ()
    return found


@pytest.fixture(scope="module")
def bare(wheel, tmp_path_factory):
    """The commands of an environment with the wheel and what it requires without extras.

    The dependencies are links into the environment that runs the tests.
    """
    folder = tmp_path_factory.mktemp("bare")
    environment = folder / "environment"
    _run([sys.executable, "-m", "venv", "--without-pip", environment], cwd=folder)
    (packages,) = environment.glob("lib/python*/site-packages")
    for name in _needed(PYPROJECT["project"]["dependencies"]):
        distribution = metadata.distribution(name)
        for top in {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}:
            if not (packages / top).exists():
                (packages / top).symlink_to(str(distribution.locate_file(top)))
    install = [*PIP, "--python", environment / "bin" / "python", "install", "--no-deps"]
    _run([*install, "--quiet", "--no-index", wheel], cwd=folder)
    keep_compiled(packages / "twin")
    return environment / "bin"


TABLE_MAPPING = """
vehicle = "my AUV"
deployment = "file"
rows = "file"
period_s = 1
[time]
column = "t"
unit = "s"
start = 2022-06-25T08:00:00Z
[signals]
measured_depth = { column = "z", unit = "m" }
measured_pitch = { column = "theta", unit = "deg" }
"""


def test_the_wheel_without_extras_flies_generates_imports_and_draws(bare, tmp_path):
    python = bare / "python"
    missing = "import importlib.util as u; print([u.find_spec(n) for n in ('torch', 'dm_control')])"
    assert _run([python, "-c", missing], tmp_path) == "[None, None]\n"
    for name in PACKAGES:
        assert _run([bare / name, "--version"], tmp_path) == f"{name} {__version__}\n"
    code = "import twin.vehicle.presets as a; print(a.asset_path('glider.xml'))"
    shipped = Path(_run([python, "-c", code], tmp_path).strip())
    assert shipped.is_relative_to(bare.parent)
    assert _files(shipped.parent) == _files(ROOT / "assets")
    fly = [bare / "twin", "simulate", "--duration", "600", "--out", "run.zarr"]
    said = json.loads(_run([*fly, "--plot", "run.png", "--json"], tmp_path))
    assert said["duration_s"] == 600.0
    assert (tmp_path / "run.png").stat().st_size > 10_000
    generate = [bare / "factory", "generate", "--hours", "0.2", "--out", "many.zarr", "--json"]
    assert json.loads(_run(generate, tmp_path))["flown"] > 2
    rows = "".join(f"{t},{10 + 0.1 * t},{-20}\n" for t in range(300))
    (tmp_path / "log.csv").write_text("t,z,theta\n" + rows)
    (tmp_path / "mine.toml").write_text(TABLE_MAPPING)
    read = [bare / "factory", "import", "csv", "log.csv", "--mapping", "mine.toml"]
    _run([*read, "--out", "log.zarr"], tmp_path)
    _run([bare / "twin", "plot", "run.zarr", "--out", "figure.png"], tmp_path)
    shipped = ["--navigate", "network", "--duration", "300", "--out", "shipped.zarr"]
    _run([bare / "twin", "simulate", *shipped], tmp_path)
    assert "usage: twin identify" in _run([bare / "twin", "identify", "--help"], tmp_path)


@pytest.mark.parametrize(
    "words",
    [
        ("learn", "fit", "many.zarr"),
        ("learn", "evaluate"),
        ("learn", "compare"),
        ("learn", "export"),
        ("python", "-m", "learn", "fit"),
    ],
)
def test_without_the_extra_learn_the_line_that_installs_it(words, bare, tmp_path):
    done = _ended([bare / words[0], *words[1:]], tmp_path, 2)
    assert done.stdout == ""
    assert "learn needs the package torch" in done.stderr
    assert done.stderr.endswith('pip install "glider-twin[learn]"\n')
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_import_learn_names_its_extra(bare, tmp_path):
    # the shipped networks run without PyTorch, a training does not
    _ended([bare / "python", "-c", "import learn, learn.data.dataset"], tmp_path, 0)
    done = _ended([bare / "python", "-c", "import learn; learn.fit"], tmp_path, 1)
    assert done.stderr.endswith('pip install "glider-twin[learn]"\n')


def test_the_tasks_without_the_extra_suite_name_the_line_that_installs_it(bare, tmp_path):
    code = "from twin import control; print(*control.ALL_TASKS); control.load('hold')"
    done = _ended([bare / "python", "-c", code], tmp_path, 1)
    assert done.stdout == "hold depth waypoints energy reach station path\n"
    last = done.stderr.splitlines()[-1]
    assert "a task of dm_control needs the package dm_control" in last
    assert 'pip install "glider-twin[suite]"' in last
    done = _ended([bare / "python", "-m", "twin.control", "--task", "hold"], tmp_path, 2)
    assert done.stderr.count("\n") == 1
    assert 'pip install "glider-twin[suite]"' in done.stderr


def _like_factory_boy(folder):
    """A wheel of that name with a package `factory`, for where there is no network."""
    about = "factory_boy-3.3.3.dist-info"
    files = {
        "factory/__init__.py": "from .base import Factory\n",
        "factory/base.py": "class Factory:\n    pass\n",
        f"{about}/METADATA": "Metadata-Version: 2.1\nName: factory_boy\nVersion: 3.3.3\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    files[f"{about}/RECORD"] = "".join(f"{name},,\n" for name in (*files, f"{about}/RECORD"))
    made = folder / "factory_boy-3.3.3-py3-none-any.whl"
    with zipfile.ZipFile(made, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return made


@pytest.mark.parametrize("source_of", ["a wheel like it", "the network"])
def test_factory_boy_in_the_same_environment_is_named(wheel, tmp_path, source_of):
    environment = tmp_path / "environment"
    _run([sys.executable, "-m", "venv", environment], cwd=tmp_path)
    (packages,) = environment.glob("lib/python*/site-packages")
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    pip = [environment / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "--quiet"]
    ours = [*pip, "install", "--no-index", "--no-deps", "--force-reinstall", wheel]
    _run(ours, cwd=tmp_path)
    theirs = [*pip, "--retries", "0", "install", "factory_boy"]
    if source_of == "a wheel like it":
        theirs = [*pip, "install", "--no-index", "--no-deps", _like_factory_boy(tmp_path)]
    if subprocess.run(theirs, capture_output=True).returncode:
        pytest.skip(f"pip cannot install factory_boy from {source_of}")

    def told(*words):
        said = _ended([environment / "bin" / words[0], *words[1:]], tmp_path, 2).stderr
        assert said.count("\n") == 1
        return said

    again = "pip install --force-reinstall --no-deps glider-twin"
    for words in (
        ("factory", "distributions"),
        ("learn", "fit"),
        ("python", "-m", "factory", "info"),
    ):
        assert "belongs to factory_boy" in (said := told(*words))
        assert f"pip uninstall factory_boy, then {again}" in said
    _run([*pip, "uninstall", "--yes", "factory_boy"], cwd=tmp_path)
    said = told("factory", "info")
    assert "has no __init__.py, as after pip uninstall factory_boy" in said
    assert said.endswith(f"{again}\n")
    _run(ours, cwd=tmp_path)
    assert "mission.duration_h" in _run(
        [environment / "bin" / "factory", "distributions"], tmp_path
    )


def _files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_assets_are_found_and_a_wrong_name_is_explained():
    assert asset_path("glider.xml").is_file()
    assert assets_folder().name == "assets"
    with pytest.raises(InputError, match=r"unknown asset 'glidr\.xml': did you mean 'glider\.xml'"):
        asset_path("glidr.xml")


def test_versions_agree():
    assert metadata.version("glider-twin") == __version__
    changes = (ROOT / "CHANGELOG.md").read_text()
    newest = re.search(r"^## \[(\d[^\]]*)\] - (\S+)$", changes, re.MULTILINE)
    assert newest is not None
    assert newest[1] == __version__
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (cited["version"], str(cited["date-released"])) == newest.groups()


def test_import_factory_is_this_package():
    # factory_boy installs a package of the same name.
    assert Path(factory.__file__).resolve().parent == ROOT / "factory"
    names = {_name(dist.metadata["Name"]) for dist in metadata.distributions()}
    assert "factory-boy" not in names
    assert "pytest-factoryboy" not in names


def test_lightning_is_not_installed():
    # Releases of it on PyPI were compromised in 2026.
    names = {_name(dist.metadata["Name"]) for dist in metadata.distributions()}
    assert not names & {"lightning", "pytorch-lightning"}


def test_every_dependency_is_pinned_within_its_range():
    pins = {}
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            name, _, version = line.partition("==")
            pins[_name(name)] = version
    project = PYPROJECT["project"]
    extras = project["optional-dependencies"]
    # boto3 needs an older python-dateutil than what is pinned: its tests have their own environment
    pinned = [requirements for name, requirements in extras.items() if name != "aws"]
    wanted = project["dependencies"] + [r for extra in pinned for r in extra]
    for text in wanted:
        requirement = Requirement(text)
        if _name(requirement.name) != "glider-twin":
            assert requirement.specifier.contains(pins[_name(requirement.name)]), text


CONDA_NAMES = {"mujoco": "mujoco-python", "glfw": "pyglfw", "matplotlib": "matplotlib-base"}
"""What conda-forge calls packages differently."""


def test_the_conda_recipe_asks_for_what_the_wheel_asks_for():
    recipe = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text())
    assert recipe["context"]["version"] == __version__
    python, *run = recipe["requirements"]["run"]
    assert python == f"python {PYPROJECT['project']['requires-python']}"
    wanted = {}
    for text in PYPROJECT["project"]["dependencies"]:
        requirement = Requirement(text)
        name = _name(requirement.name)
        wanted[CONDA_NAMES.get(name, name)] = set(str(requirement.specifier).split(","))
    assert {name: set(spec.split(",")) for name, spec in map(str.split, run)} == wanted
    entries = recipe["build"]["python"]["entry_points"]
    scripts = PYPROJECT["project"]["scripts"]
    assert entries == [f"{name} = {target}" for name, target in scripts.items()]
    assert recipe["requirements"]["host"][-1].split()[0] == "hatchling"


def test_every_way_to_check_runs_the_same_commands():
    script = (ROOT / ".ci" / "run").read_text()
    wanted = re.findall(r"^make [\w-]+$", script, re.MULTILINE)
    assert wanted.pop(0) == "make setup"
    assert wanted == ["make lint", "make test-docs", "make test-release", "make test"]
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
    jobs = workflow["jobs"].values()
    assert [step["run"] for job in jobs for step in job["steps"] if "run" in step] == wanted
    (check,) = re.findall(r"^check: ([\w -]+?) +##", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert {f"make {word}" for word in check.split()} == set(wanted)
    versions = workflow["jobs"]["test"]["strategy"]["matrix"]["python"]
    classified = [
        line.rpartition(" ")[2]
        for line in PYPROJECT["project"]["classifiers"]
        if re.search(r"Python :: 3\.\d", line)
    ]
    assert versions == classified
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    assert [hook["entry"] for hook in hooks] == ["make lint"]


@pytest.mark.parametrize("fails", ["setup", "lint", "test-docs", "test-release", "test", "nothing"])
def test_the_run_of_all_gates_fails_with_each_of_them(tmp_path, fails):
    script = tmp_path / ".ci" / "run"
    script.parent.mkdir()
    script.write_bytes((ROOT / ".ci" / "run").read_bytes())
    make = tmp_path / "make"
    make.write_text(f'#!/bin/sh\necho "said by $1"\n[ "$1" != "{fails}" ]\n')
    make.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    ran = subprocess.run(
        ["bash", script], env={**os.environ, "PATH": path}, capture_output=True, text=True
    )
    assert (ran.returncode == 0) == (fails == "nothing")
    lines = ran.stdout.splitlines()
    if fails in ("test", "nothing"):
        assert lines == [
            f"said by {g}" for g in ("setup", "lint", "test-docs", "test-release", "test")
        ]
    else:
        assert f"said by {fails}" in lines
        assert "said by test" not in lines
        assert (f"failed: make {fails}" in lines) == (fails != "setup")


def test_console_scripts_are_the_three_programs():
    scripts = PYPROJECT["project"]["scripts"]
    assert scripts == {name: f"{name}.__main__:main" for name in PACKAGES}
    for target in scripts.values():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function))


def test_dm_control_loads_a_model_under_this_mujoco():
    # dm-control 1.0.50 cannot do this under mujoco 4.
    from dm_control import mujoco

    physics = mujoco.Physics.from_xml_string(
        "<mujoco><worldbody><body name='hull'><freejoint/><geom size='0.1'/></body></worldbody>"
        "</mujoco>"
    )
    start = physics.named.data.qpos.copy()
    physics.step(10)
    assert physics.named.data.xpos["hull", "z"] < start[2]
    physics.free()


def test_commands_in_the_documents_exist():
    programs = {program.name: program for program in (TWIN, FACTORY, LEARN)}
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    shown = 0
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]:
        for program, command in re.findall(
            r"^(?: {4}|\$ )?(twin|factory|learn|make) ([a-z0-9-]+)", _code(page.read_text()), re.M
        ):
            shown += 1
            if program == "make":
                assert command in targets, f"{page.name}: make {command}"
            elif not command.startswith("-"):
                names = [known.name for known in programs[program].commands]
                assert command in names, f"{page.name}: {program} {command}"
    assert shown > 0


def test_make_help_has_a_line_for_every_target():
    makefile = (ROOT / "Makefile").read_text()
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony is not None
    done = subprocess.run(
        ["make", "--no-print-directory", "help"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    told = dict(re.findall(r"^make (\S+) +(\S.*)$", done.stdout, re.MULTILINE))
    assert sorted(told) == sorted(phony[1].split())


def _modules_with_examples():
    files = (path for name in PACKAGES for path in (ROOT / name).rglob("*.py"))
    return sorted(
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in files
        if ">>> " in path.read_text()
    )


@pytest.mark.parametrize("module", _modules_with_examples())
def test_examples_in_docstrings_are_true(module):
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0


def _code(page):
    """The code blocks of a Markdown text, fenced or indented."""
    fenced = re.findall(r"^```[^\n]*\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    indented = re.findall(r"^ {4}.*$", page, re.MULTILINE)
    return "\n".join([*fenced, *indented])


def _name(distribution):
    return re.sub(r"[-_.]+", "-", distribution).lower()
