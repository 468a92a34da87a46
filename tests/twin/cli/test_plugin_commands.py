"""Commands of plugins: named by `--help`, found by entry points, refused with the way out."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.cli.program import Program, commands_of
from twin.version import __version__

PROGRAM = Program(
    name="twin",
    summary="A program.",
    commands=commands_of(
        "twin.commands", {"moor": ("plugins/moorings", "keep a vehicle in place")}
    ),
)
COMMAND = """
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Moor:
    \"\"\"Keep a vehicle in place.\"\"\"

    depth: float = 10.0
    \"\"\"[m] Depth of the place.\"\"\"

    def run(self, console):
        console.say(f"moored at {self.depth:g} m")
        return 0
"""


def install(
    folder: Path, monkeypatch, *, version: str = __version__, entry: str = "twin.moor", code=COMMAND
) -> None:
    """Put a distribution with one command on the path, as pip would."""
    (folder / "moorings_plugin.py").write_text(code)
    meta = folder / f"glider_twin_moorings-{version}.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text(f"Name: glider-twin-moorings\nVersion: {version}\n")
    lines = f"[glider_twin.commands]\n{entry} = moorings_plugin:Moor\n"
    (meta / "entry_points.txt").write_text(lines)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(__import__("sys").modules, "moorings_plugin", raising=False)


def answer(capsys, *words: str) -> tuple[int, str, str]:
    code = PROGRAM.main(list(words))
    out = capsys.readouterr()
    return code, out.out, out.err


def test_help_names_a_command_and_its_plugin_where_it_is_not_installed(capsys):
    code, out, _ = answer(capsys, "--help")
    assert code == 0
    assert "commands of plugins/moorings:\n  moor  keep a vehicle in place\n" in out


def test_a_command_without_its_plugin_says_how_to_install_it(capsys):
    code, out, error = answer(capsys, "moor", "--help")
    assert (code, out) == (2, "")
    assert "pip install ./plugins/moorings" in error


def test_an_installed_plugin_brings_its_command(capsys, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch)
    assert answer(capsys, "moor", "--depth", "25") == (0, "moored at 25 m\n", "")


def test_a_plugin_of_another_version_is_refused_in_one_line(capsys, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, version="0.0.1")
    code, out, error = answer(capsys, "moor")
    assert (code, out) == (2, "")
    assert "glider-twin-moorings 0.0.1" in error
    assert f"glider-twin is {__version__}" in error
    assert len(error.strip().splitlines()) == 1


def test_a_plugin_that_cannot_be_imported_names_itself(capsys, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, code="import no_such_library\n")
    code, _, error = answer(capsys, "moor")
    assert code == 2
    assert "glider-twin-moorings" in error
    assert "no_such_library" in error


def test_a_stranger_s_command_is_found_though_no_table_names_it(capsys, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, entry="twin.anchor")
    assert answer(capsys, "anchor")[:2] == (0, "moored at 10 m\n")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_leaves_out_what_is_not_installed(capsys, shell):
    own = {
        "trim": ("TrimVehicle", "a steady glide"),
        "version": ("twin.commands.machine:Version", "versions"),
    }
    moor = {"moor": ("plugins/moorings", "keep a vehicle in place")}
    program = Program(name="twin", summary="", commands=commands_of("twin.commands", own | moor))
    assert program.main(["--completion", shell]) == 0
    out = capsys.readouterr().out
    assert "version" in out
    assert "moor" not in out
