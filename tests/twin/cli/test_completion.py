"""Completion: what a shell completes after it has sourced the script of a program."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from twin.__main__ import PROGRAM
from twin.cli.parsing import SHELLS, completion
from twin.errors import InputError

INSTALLED = [one for one in PROGRAM.commands if one.installed]


def script_of(shell: str) -> str:
    commands = ((one.name, one.summary, one.load()) for one in INSTALLED)
    return completion(PROGRAM.name, PROGRAM.summary, commands, shell)


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
def test_bash_completes(words: list[str], expected: set[str], tmp_path: Path) -> None:
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
def test_every_command_is_in_the_script(shell: str, tmp_path: Path) -> None:
    script = script_of(shell)
    assert all(command.name in script for command in INSTALLED)
    if shutil.which(shell) is None:
        return
    (tmp_path / "script").write_text(script)
    subprocess.run([shell, "-n", str(tmp_path / "script")], check=True)


def test_another_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="unknown shell 'csh'"):
        script_of("csh")
    assert PROGRAM.main(["--completion"]) == 2
    assert "--completion takes a shell: bash, zsh, fish" in capsys.readouterr().err
    assert PROGRAM.main(["--completion", "bash"]) == 0
    assert "_tyro_twin" in capsys.readouterr().out
