"""Every code block of every page runs, here or in the test that is named, as it stands there.

Tutorials run in test_front_page.py, all of them and whole. A block that nothing can run has a mark.
"""

import contextlib
import io
import re
import shlex
import shutil
import sys

import pytest
from examples import OWN, ROOT, blocks, needs_docs, script
from navigation import write_flown_store

from factory.__main__ import PROGRAM as FACTORY
from factory.exporting.metadata import parse_metadata
from factory.samples import Flight
from factory.samples.gliders import write_dbd, write_slocum
from factory.sampling.parameters import parameter_table
from factory.sampling.presets import read_changes
from factory.sampling.recipe import make_recipe
from learn.__main__ import PROGRAM as LEARN
from twin.vehicle.presets import assets_folder
from twin.vehicle.vehicle import load_vehicle

pytestmark = needs_docs

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if page.parent.name != "tutorials"),
]
HERE = "tests/docs/test_blocks.py"
RUN = {
    "README.md": {"tests/test_faces.py": 1},
    "docs/gallery.md": {"tests/twin/show/render/test_gallery.py": 7},
    "docs/howto/camera.md": {"plugins/vision/tests/test_vision.py": 1},
    "docs/howto/cluster.md": {"tests/docs/test_cluster.py": 13},
    "docs/howto/dm_control.md": {
        "tests/twin/control/test_control_tasks.py": 2,
        "tests/twin/control/test_glider_env.py": 4,
    },
    "docs/howto/erddap.md": {"tests/factory/exporting/test_erddap_export.py": 1},
    "docs/howto/extending.md": {"tests/docs/test_extending.py": 6},
    "docs/howto/flight.md": {HERE: 2},
    "docs/howto/forecast.md": {"tests/docs/test_front_page.py": 3},
    "docs/howto/identify.md": {HERE: 1},
    "docs/howto/import_logs.md": {HERE: 1},
    "docs/howto/import_messages.md": {
        "plugins/protocols/tests/test_dorado.py": 1,
        "plugins/protocols/tests/test_messages.py": 1,
    },
    "docs/howto/import_tables.md": {
        "tests/factory/importing/test_csv.py": 1,
    },
    "docs/howto/index.md": {"tests/test_faces.py": 1},
    "docs/howto/navigation.md": {HERE: 4},
    "docs/howto/on_board.md": {
        HERE: 1,
        "tests/docs/test_front_page.py": 1,
    },
    "docs/howto/pipelines.md": {"plugins/pipelines/tests/test_pipelines.py": 1},
    "docs/howto/plain_mujoco.md": {"tests/twin/vehicle/test_plain.py": 1},
    "docs/howto/render.md": {
        "tests/twin/show/render/test_gallery.py": 2,
    },
    "docs/howto/serve.md": {"plugins/protocols/tests/test_serve.py": 2},
    "docs/howto/xarray.md": {"plugins/pipelines/tests/test_accessor.py": 1},
    "docs/howto/train.md": {HERE: 1},
    "docs/index.md": {"tests/docs/test_front_page.py": 3, HERE: 1},
    "docs/reference/currents.md": {
        "tests/twin/water/test_current_docs.py": 1,
        "tests/twin/water/test_current_registry.py": 1,
    },
    "docs/reference/factory.md": {
        HERE: 4,
        "tests/factory/test_windows.py": 2,
    },
    "docs/reference/import.md": {HERE: 1},
    "docs/reference/missions.md": {"tests/twin/mission/test_mission.py": 6},
    "docs/reference/sensors.md": {"tests/test_registry.py": 2},
    "docs/howto/watch.md": {"plugins/ops/tests/watching/test_sources.py": 1},
}
"""The tests that run the blocks of a page, and how many each runs"""

FENCE = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?<=\n\n)(?: {4}.*\n|\n(?= {4}))+")
PROGRAM_TEXT = re.compile(r"^ {4}(?:import|from|def|class) |^ {4}# \w+\.(?:py|toml)$", re.MULTILINE)
SHOWN = "text"
"""The language of blocks that show what is printed or lies in a folder"""


def runnable(page):
    """How many blocks of a page a reader could run: fenced ones, and indented programs."""
    text = page.read_text(encoding="utf-8")
    fenced = [language for language, _, _ in FENCE.findall(text) if language != SHOWN]
    rest = FENCE.sub("", text)
    return len(fenced) + sum(bool(PROGRAM_TEXT.search(one)) for one in INDENTED.findall(rest))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_some_test_runs_every_block(page):
    """After a new block: run it in a test, and count it in RUN."""
    tests = RUN.get(page.relative_to(ROOT).as_posix(), {})
    assert runnable(page) == sum(tests.values())
    for test in tests:
        assert page.stem in (ROOT / test).read_text(encoding="utf-8"), test


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with what the pages name: a log, its store, a vehicle's own file."""
    folder = tmp_path_factory.mktemp("pages")
    for name in ("unit334", "offload"):
        (folder / name).mkdir()
    flight = Flight(dives=4)
    write_slocum(folder / "unit334", flight, m_speed=flight.state(flight.time)["depth"])
    (log, *_) = [path for path in write_dbd(folder, Flight(dives=1)) if path.suffix == ".dbd"]
    log.rename(folder / "offload" / "unit_334.dbd")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert FACTORY.main(["import", "slocum", "unit334", "--out", "real.zarr"]) == 0
    shutil.copy(OWN / "two_thirds.py", folder)
    for name in ("mine.xml", "my_slocum.xml"):
        shutil.copy(assets_folder() / "slocum-200.xml", folder / name)
    return folder


@pytest.fixture
def lesson(folder):
    """One run of scripts/tutorials.py in that folder."""
    before = list(sys.path)
    yield script("tutorials").Lesson(folder)
    sys.path[:] = before


def text_of(page, heading=""):
    """A page, or one of its sections."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return text.partition(f"# {heading}\n")[2].partition("\n#")[0] if heading else text


@pytest.mark.parametrize(
    "page", ["howto/flight.md", "howto/identify.md", "howto/import_logs.md", "reference/import.md"]
)
def test_pages_about_logs_run(lesson, page, capsys):
    lesson.run(text_of(page))
    if page == "howto/import_logs.md":
        assert lesson.said == "slocum\n"
    assert capsys.readouterr().out


def test_navigation_runs(lesson):
    lesson.run(text_of("howto/navigation.md"))
    assert lesson.session["run"].complete
    assert lesson.session["ahead"].current.shape == (2, 2)


def test_a_log_as_a_time_series_runs(lesson):
    lesson.run(text_of("reference/factory.md", "As a time series"))
    assert lesson.session["series"].sizes["time"] > 1000


def test_files_of_the_factory_are_read(folder):
    text = text_of("reference/factory.md")
    found = {language: block for language, _, block in FENCE.findall(text) if language != "python"}
    (folder / "spread.toml").write_text(found["toml"])
    recipe = make_recipe(changes=read_changes(folder / "spread.toml"))
    assert len(recipe.changes) == 4
    vehicle = (folder / "mine.xml").read_text()
    (folder / "spread.xml").write_text(vehicle.replace("</custom>", f"{found['xml']}</custom>"))
    table = parameter_table(load_vehicle(folder / "spread.xml"))
    assert table["mission.net_mass_kg"].field == "uniform(0.25, 0.45)"
    assert parse_metadata(found["yaml"], "m.yml").attributes["license"] == "CC-BY-4.0"


def test_the_first_command_runs(lesson):
    install, *commands = FENCE.findall(text_of("index.md"))[0][2].splitlines()
    assert install == "pip install ."
    lesson.shell("\n".join(commands))
    assert (lesson.folder / "run.png").is_file()


def test_programs_about_networks_run(tmp_path, monkeypatch, capsys):
    """On a small store and a run that was exported, in one folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    write_flown_store(tmp_path / "data" / "missions.zarr")
    small = "--epochs 1 --hidden 6 --layers 1 --members 1 --workers 1 --name first"
    assert LEARN.main(["fit", "data/missions.zarr", *small.split()]) == 0
    assert LEARN.main(["export"]) == 0
    capsys.readouterr()
    for page in ("docs/howto/on_board.md", "docs/howto/train.md"):
        for _, text in blocks(page):
            exec(text, {})
    assert float(capsys.readouterr().out.split()[0]) >= 0.0


SHOWN_COMMAND = re.compile(
    r"^(?: {4}|\$ )?(?:[A-Z_]+=\S+ )?((?:twin|factory|learn) [a-z][^\n]*)", re.MULTILINE
)
"""A command of a code block; a synopsis has what may be left out in brackets"""


def test_every_command_of_a_page_is_one_that_its_parser_takes():
    """With all its words, as the program itself reads them."""
    reference = script("docs_reference")
    parsers = {
        f"{name} {command.name}": reference.parser_of(name, command)
        for name in reference.PROGRAMS
        for command in reference.program(name).commands
    }
    wrong, shown = [], 0
    for page in [*PAGES, *(ROOT / "docs" / "tutorials").glob("*.md")]:
        for line in SHOWN_COMMAND.findall(page.read_text(encoding="utf-8").replace("\\\n", " ")):
            parser = parsers.get(" ".join(line.split()[:2]))
            if parser is None:
                continue  # prose that begins with a program's name
            shown += 1
            words = [word for word in shlex.split(line, comments=True) if word != "..."]
            try:
                with contextlib.redirect_stderr(io.StringIO()) as told:
                    parser.parse_args([word.strip("[]") for word in words[2:]])
            except SystemExit:
                wrong.append(f"{page.name}: {line}: {told.getvalue()[-300:]}")
    assert shown > 150
    assert not wrong


def test_every_benchmark_of_a_page_has_its_options():
    wrong, shown = [], 0
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for name, words in re.findall(r"python -m (benchmarks[.\w]+)([^`\n]*)", text):
            shown += 1
            place = ROOT / name.replace(".", "/")
            files = [*place.glob("*.py")] if place.is_dir() else [place.with_suffix(".py")]
            code = "".join(one.read_text(encoding="utf-8") for one in files if one.is_file())
            # a benchmark may take the options of another, whose class it names
            if taken := re.search(r"from (benchmarks\.\w+) import Asked", code):
                other = (ROOT / taken[1].replace(".", "/")).with_suffix(".py")
                code += other.read_text(encoding="utf-8")
            options = re.findall(r"--[a-z-]+", words.partition("#")[0])
            given = "".join(re.findall(r"def main\((.*?)\) ->", code, re.DOTALL))
            for option in options:
                field = f"{option[2:].replace('-', '_')}: "
                told = f'"{option}"' in code or f"    {field}" in code  # a field of a dataclass
                if not told and not re.search(rf"\b{field}", given):
                    wrong.append(f"{page.name}: {name} {option}")
            wrong += [f"{page.name}: {name}"] if not code else []
    assert shown > 40
    assert not wrong
