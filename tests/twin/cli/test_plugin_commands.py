"""Commands of plugins: named by `--help`, found by entry points; what a shell completes of all."""

import shutil
import subprocess
from pathlib import Path

import pytest

from twin.__main__ import PROGRAM as TWIN
from twin.cli.parsing import SHELLS, completion
from twin.cli.program import Program, commands_of
from twin.errors import InputError
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


@pytest.mark.parametrize("shell", SHELLS)
def test_completion_leaves_out_what_is_not_installed(capsys, shell):
    own = {"trim": ("TrimVehicle", "a steady glide"), "version": ("machine:Version", "versions")}
    moor = {"moor": ("plugins/moorings", "keep a vehicle in place")}
    program = Program(name="twin", summary="", commands=commands_of("twin.commands", own | moor))
    assert program.main(["--completion", shell]) == 0
    out = capsys.readouterr().out
    assert "version" in out
    assert "moor" not in out


# --- completion ---------------------------------------------------------------------------------


INSTALLED = [one for one in TWIN.commands if one.installed]


def script_of(shell: str) -> str:
    commands = ((one.name, one.summary, one.load()) for one in INSTALLED)
    return completion(TWIN.name, TWIN.summary, commands, shell)


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["twin", "simu"], {"simulate"}),
        (["twin", "simulate", "--engine", ""], {"mujoco", "lanes"}),
        (["twin", "simulate", "--dur"], {"--duration"}),
        (["twin", "identify", "--exp"], {"--export"}),
    ],
)
def test_bash_completes(words, expected, tmp_path):
    script = tmp_path / "twin.bash"
    script.write_text(script_of("bash"))
    quoted = " ".join(f"'{word}'" for word in words)
    done = subprocess.run(
        ["bash", "-c", f"source {script}; COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; "
         '_tyro_twin; echo "${COMPREPLY[@]}"'],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert set(done.stdout.split()) == expected
    assert done.stderr == ""


@pytest.mark.parametrize("shell", SHELLS)
def test_every_command_is_in_the_script(shell, tmp_path):
    script = script_of(shell)
    assert all(command.name in script for command in INSTALLED)
    if shutil.which(shell) is None:
        return
    (tmp_path / "script").write_text(script)
    subprocess.run([shell, "-n", str(tmp_path / "script")], check=True)


def test_another_shell_is_refused(capsys):
    with pytest.raises(InputError, match="unknown shell 'csh'"):
        script_of("csh")
    assert TWIN.main(["--completion"]) == 2
    assert "--completion takes a shell: bash, zsh, fish" in capsys.readouterr().err
    assert TWIN.main(["--completion", "bash"]) == 0
    assert "_tyro_twin" in capsys.readouterr().out
