"""The documentation as a site: it builds without a warning, is whole, and needs no other host."""

import importlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr
from examples import ROOT, needs_docs, script
from simulated_logs import simulated_log

import factory
import twin
from factory.importing.dives.dive_rows import NUMBERS
from factory.importing.payload import KNOWN
from twin.logs import write_flight
from twin.records.schema import SIGNALS
from twin.vehicle.presets import shipped_files
from twin.vehicle.vehicle import load_vehicle

pytestmark = needs_docs

OTHER_HOSTS = re.compile(
    r"<(?:script|link|img|iframe|source)\b[^>]*?(?:src|href)=\"?(?:https?:)?//"
)
NAMED_PAGE = re.compile(r"docs/[\w/]+\.(?:md|png)")


@pytest.fixture(scope="module")
def reference():
    """scripts/docs_reference.py"""
    return script("docs_reference")


@pytest.fixture(scope="module")
def hooks():
    """scripts/docs_hooks.py"""
    return script("docs_hooks")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site; a warning ends the build."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


# What `make docs` runs, and a page of its own in place of docs/.
RECIPE = re.compile(r"^docs:.*\n\t@(.*)$", re.MULTILINE)
TINY = """\
INHERIT: {root}/mkdocs.yml
docs_dir: docs
site_dir: site
hooks: []
extra_css: []
theme: {{ name: mkdocs }}
plugins: []
nav: [index.md, other.md]
"""


@pytest.mark.parametrize(
    ("link", "told"),
    [("other.md#a-heading", ""), ("other.md#no-heading", "no-heading"), ("gone.md", "gone.md")],
)
def test_make_docs_fails_for_a_dead_link_and_a_dead_anchor(tmp_path, link, told):
    """With the words of the Makefile: `--quiet` would hide the warnings that `--strict` counts."""
    recipe = RECIPE.search((ROOT / "Makefile").read_text(encoding="utf-8"))
    assert recipe is not None
    words = shlex.split(recipe[1].replace("$(BIN)/python", shlex.quote(sys.executable)))
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text(f"# Home\n\n[there]({link})\n")
    (tmp_path / "docs" / "other.md").write_text("# Other\n\n## A heading\n")
    (tmp_path / "mkdocs.yml").write_text(TINY.format(root=ROOT))
    done = subprocess.run(
        ["env", *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode != 0) == bool(told), done.stderr
    assert told in done.stderr


def test_pages_of_the_repository_lead_somewhere(hooks):
    """README, CONTRIBUTING, CHANGELOG and those beside them: files and headings."""
    pages = hooks.repository_pages(ROOT)
    assert {"README.md", "CONTRIBUTING.md", "CHANGELOG.md"} <= {page.name for page in pages}
    dead = {page: hooks.dead_links(page) for page in pages}  # two are named README.md
    assert {page: links for page, links in dead.items() if links} == {}


def test_a_dead_link_of_the_readme_ends_the_build(hooks, tmp_path, caplog, monkeypatch):
    """It is a warning of mkdocs, which a strict build counts."""
    (tmp_path / "other.md").write_text("# One\n\n## Two, and `three`\n\n## Two, and `three`\n")
    page = tmp_path / "README.md"
    page.write_text(
        "# Home\n[a](other.md) [b](other.md#two-and-three-1 'said') [c](#home) <a href=\"#at\">"
        "\n`[d](code.md)`\n```sh\n# [e](code.md)\n```\n![f](gone.png) [g](other.md#four) "
        '<a id="at"></a> [h]\n\n[h]: gone.md\n'
    )
    assert hooks.dead_links(page) == ["gone.png", "other.md#four", "gone.md"]
    monkeypatch.setattr(hooks, "ROOT", tmp_path)
    hooks.on_pre_build()
    warned = [record for record in caplog.records if record.levelname == "WARNING"]
    assert len(warned) == 3
    assert all(record.name.startswith("mkdocs.") for record in warned)
    assert "README.md: dead link gone.png" in caplog.text


def test_every_page_is_built(site, reference):
    pages = [path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")]
    pages += [Path(place) for place in reference.generated_pages()]
    missing = [page for page in pages if not (site / page.with_suffix(".html")).is_file()]
    assert not missing


def test_pages_that_scripts_make_are_not_in_a_checkout_and_not_linked_there(reference, hooks):
    """A forge shows the pages of docs/ as they are: none of their links leads nowhere."""
    made = reference.generated_pages()
    assert [place for place in made if (ROOT / "docs" / place).exists()] == []
    pages = sorted((ROOT / "docs").rglob("*.md"))
    dead = {page.name: links for page in pages if (links := hooks.dead_links(page))}
    assert dead == {}
    index = (ROOT / "docs" / "reference" / "index.md").read_text(encoding="utf-8")
    assert "`make docs`" in index


def test_nothing_is_asked_of_another_host(site):
    asking = [page.name for page in site.rglob("*.html") if OTHER_HOSTS.search(page.read_text())]
    assert not asking
    styles = "".join(path.read_text() for path in site.rglob("*.css"))
    assert not re.search(r"(url\(|@import )[\"']?(https?:)?//", styles)


def test_every_link_leads_to_a_file_of_the_site(site):
    """From a folder, without a server: nothing begins at the root of one."""
    dead = []
    for page in site.rglob("*.html"):
        for link in re.findall(
            r"<(?:a|link|script|img)\b[^>]*?(?:href|src)=\"?([^\s\">#?]+)", page.read_text()
        ):
            if not re.match(r"[a-z]+:", link) and not (page.parent / link).is_file():
                dead.append(f"{page.relative_to(site)}: {link}")
    assert not dead


def test_code_is_shown_as_code(site):
    """A fence that is not understood would stand in the text with its marks."""
    for page in site.rglob("*.html"):
        text = re.sub(r"<(pre|code)\b.*?</\1>", "", page.read_text(), flags=re.DOTALL)
        assert "```" not in text, page.name


def test_formulas_are_set(site):
    """As MathML: no script, no dollar signs in the text."""
    for page in ("physics/equations", "howto/flight", "reference/sensors", "reference/networks"):
        assert "<math" in (site / f"{page}.html").read_text(), page
    for page in site.rglob("*.html"):
        text = re.sub(r"<(pre|code|script)\b.*?</\1>", "", page.read_text(), flags=re.DOTALL)
        assert "arithmatex" not in text, page.name
        assert not re.search(r"\$\$|\\[(\[]|\$[^$<\n]+\$", text), page.name


LATEX = re.compile(r"\$\$(.+?)\$\$|(?<![\w$`])\$(?! )([^$`\n]+?)\$(?!\w)")
"""A formula of a page: on lines of its own, or within a sentence"""


def test_formulas_are_read_by_other_viewers():
    """Markdown of a forge eats a backslash before punctuation, pairs asterisks, ends cells at |."""
    found = 0
    code = re.compile(r"^```.*?^```|^ {4}.*?$|`[^`\n]*`", flags=re.DOTALL | re.MULTILINE)
    for page in sorted((ROOT / "docs").rglob("*.md")):
        text = code.sub("", page.read_text(encoding="utf-8"))
        for formula in (own or within for own, within in LATEX.findall(text)):
            found += 1
            assert not re.search(r"\\[^A-Za-z]|[*|]", formula), f"{page.name}: {formula}"
    assert found > 200


@pytest.mark.parametrize("latex", [r"\fraction{1}{2}", r"\left( x", "x^"])
def test_a_wrong_formula_ends_the_build(hooks, latex):
    """With the formula named; a right one becomes MathML, of its own line or within a sentence."""
    assert "<mfrac" in hooks.with_formulas(r'<div class="arithmatex">\[\frac{1}{2}\]</div>')
    found = hooks.with_formulas(r'<span class="arithmatex">\(a &lt; b\)</span>')
    assert found.startswith('<span class="formula"><math>')
    assert "&lt;" in found
    with pytest.raises(hooks.LatexError, match=re.escape(repr(latex))):
        hooks.with_formulas(rf'<span class="arithmatex">\({latex}\)</span>')


def test_the_pages_of_commands_have_every_option(reference, capsys):
    """Each command has its section, with every option that its --help prints, and no other."""
    for name in reference.PROGRAMS:
        program = reference.program(name)
        page = reference.command_page(name)
        for command in program.commands:
            assert program.main([command.name, "--help"]) == 0
            printed = set(re.findall(r"^\W (--[\w.-]+)", capsys.readouterr().out, re.MULTILINE))
            (section,) = re.findall(
                rf"^## {name} {command.name}$(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL
            )
            assert set(re.findall(r"^`(--[\w.-]+)", section, re.MULTILINE)) == printed, command.name


@pytest.mark.parametrize("page", ["twin", "control", "factory", "learn"])
def test_the_pages_of_python_have_every_public_name(site, reference, page):
    face = reference.FACES[page]
    names = [name for name in importlib.import_module(face).__all__ if not name.startswith("__")]
    assert set(names) == set(reference.public_names(face))
    text = (site / "reference" / "python" / f"{page}.html").read_text()
    assert [name for name in names if f"{face}.{name}" not in text] == []


def test_pages_that_are_named_exist(reference):
    """In code, messages, tests and pages: nothing names a page that has moved."""
    made = {f"docs/{place}" for place in reference.generated_pages()}
    gone = set()
    for folder in ("twin", "factory", "learn", "assets", "benchmarks", "scripts", "tests", "docs"):
        for path in (ROOT / folder).rglob("*"):
            if path.suffix not in (".py", ".md", ".xml", ".toml", ".sh"):
                continue
            for place in NAMED_PAGE.findall(path.read_text(encoding="utf-8")):
                if place not in made and not (ROOT / place).is_file():
                    gone.add(f"{path.relative_to(ROOT)}: {place}")
    assert not gone


def test_the_tables_of_the_validation_are_what_is_computed():
    validation = script("docs_validation")
    page = validation.PAGE.read_text(encoding="utf-8")
    assert page.count("| MuJoCo | Fossen |") == 1
    assert validation.written(page) == page, "run python scripts/docs_validation.py --write"


SHOWN = re.compile(r"(?:^ {4}|^\$ |^|`)((?:twin|factory|learn) [a-z][^`\n]*)", re.MULTILINE)
"""A command in a code block or between backticks"""


def test_options_that_pages_show_exist(reference):
    """Of every command in the README and in docs/."""
    known = {
        f"{name} {command.name}": {
            flag
            for action in reference.parser_of(name, command)._actions
            for flag in action.option_strings
        }
        for name in reference.PROGRAMS
        for command in reference.program(name).commands
    }
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    shown, wrong = 0, []
    for page in pages:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in SHOWN.findall(text):
            words = line.split("#")[0].split()
            options = {word.split("=")[0] for word in words if re.match(r"--[a-z]", word)}
            flags = known.get(" ".join(words[:2]))
            if flags is None:  # prose that begins with one of the names
                continue
            shown += 1
            strip = {option.rstrip("].,;:)") for option in options}
            wrong += [f"{page.name}: {line}" for option in strip if option not in flags]
    assert shown > 150
    assert not wrong


# --- The data dictionary: every variable that stores, logs and flights hold is on its page


ROW = re.compile(r"^\| `(\w+)` \| (.*) \|$", re.MULTILINE)


@pytest.fixture(scope="module")
def dictionary():
    """scripts/docs_dictionary.py"""
    return script("docs_dictionary")


@pytest.fixture(scope="module")
def page(dictionary):
    """Markdown of the page."""
    return str(dictionary.dictionary_page())


@pytest.fixture(scope="module")
def rows(page):
    """The rows of each variable, without its name."""
    found = {}
    for name, rest in ROW.findall(page):
        found.setdefault(name, []).append(rest)
    return found


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A store of logs."""
    return simulated_log(tmp_path_factory.mktemp("log"), load_vehicle("slocum-200"))


def check(rows, dataset):
    """Every variable of the dataset has a row with its unit and its long name."""
    wrong = []
    for name, variable in dataset.variables.items():
        said = {**variable.encoding, **variable.attrs}  # xarray has units of moments there
        words = [str(said.get("long_name"))]
        if "units" in said:
            moment = " since " in said["units"]  # xarray may choose other units for these
            words.append(" since 1970-01-01" if moment else f"| {said['units']} |")
        elif "flag_meanings" in said:
            words.append("| flag |")
        texts = [f"| {text} |".replace("\\", "") for text in rows.get(str(name), [])]
        if not any(all(word in text for word in words) for text in texts):
            wrong.append((name, words, texts))
    assert not wrong
    assert len(dataset.variables) > 20


@pytest.mark.parametrize("vehicle", ["glider", "tethys"])
def test_every_variable_of_a_generated_store(rows, tmp_path, vehicle):
    report = factory.generate(
        tmp_path / "field.zarr", preset="field", vehicle=vehicle, hours=0.3, workers=1
    )
    with xr.open_zarr(tmp_path / "field.zarr") as dataset:
        assert any(str(name).startswith("sensor_") for name in dataset), report
        check(rows, dataset)


def test_every_variable_of_a_simulated_mission(rows, tmp_path):
    run = twin.simulate(vehicle="tethys", duration=60.0, sensors="field", floor="depth:60")
    with xr.open_zarr(run.save(tmp_path / "run.zarr")) as dataset:
        assert {"measured_propeller", "true_energy_elevator", "simulation_state"} <= set(dataset)
        check(rows, dataset)


def test_every_variable_of_a_log_and_of_its_flight(rows, log, tmp_path):
    with xr.open_zarr(log) as dataset:
        assert {"end_latitude", "displacement_north", "position_method"} <= set(dataset)
        check(rows, dataset)
    assert {one.signal for one in KNOWN} | set(NUMBERS) <= set(rows)
    write_flight(twin.estimate_flight(log), tmp_path / "flight.nc")
    with xr.open_dataset(tmp_path / "flight.nc") as dataset:
        check(rows, dataset)


def test_every_part_of_every_shipped_vehicle(rows, page):
    for name in shipped_files():
        for part in load_vehicle(name).part_names:
            wanted = {f"{of}_{part}" for of in ("true", "commanded", "measured", "true_energy")}
            assert wanted <= set(rows), name
    for pattern in ("true_PART", "commanded_PART", "measured_PART", "true_energy_PART"):
        assert f"`{pattern}`" in page


def test_signals_have_limits_frames_and_presence(dictionary, rows, page):
    for entry in SIGNALS:
        assert any(f"| {dictionary.limits(entry.name)} |" in row for row in rows[entry.name])
    assert re.search(r"`true_surge` .* \| body \|", page)
    assert re.search(r"`true_current_north` .* \| NED \|", page)
    assert re.search(r"`measured_phase` .* \| 0 to 3 \| logs \|", page)
    assert re.search(r"`true_sway` .* \| ±10; simulated ±5 \| all \|", page)
    assert re.search(r"`measured_gps_east` .* \| all; may be NaN \|", page)


def test_parameters_say_whose_they_are(rows):
    assert any(row.endswith("| with a propeller") for row in rows["floor_depth_m"])
    assert any(row.endswith("| gliders") for row in rows["water_bottom_below_m"])
    assert any(row.endswith("| all") for row in rows["current_speed"])
