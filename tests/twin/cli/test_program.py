"""Programs: how a command is ended from outside, and which commands plugins bring."""

import errno
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from patience import HANG_S

from twin.__main__ import PROGRAM as TWIN
from twin.cli.parsing import SHELLS, completion
from twin.cli.program import Endings, Program, ProgramCommand, commands_of, interruption
from twin.errors import InputError, WriteError
from twin.version import __version__

COMMAND = """
import os, sys, time
from dataclasses import dataclass
from pathlib import Path
from twin.cli.program import ProgramCommand, Program
from twin.records.storage.whole import whole_folder

@dataclass(frozen=True, kw_only=True)
class Write:
    '''Write slowly.'''
    out: Path
    '''folder'''
    def run(self, console):
        with whole_folder(self.out) as folder:
            (folder / "half").touch()
            reading, writing = os.pipe()
            child = os.fork()
            if child == 0:
                os.write(writing, b"x")  # Python drops signals that arrive before
                time.sleep(3600)
            os.read(reading, 1)
            print(child, flush=True)
            time.sleep(3600)
        return 0

command = ProgramCommand(name="write", summary="", loader="__main__:Write")
sys.exit(Program(name="twin", summary="", commands=(command,)).main(sys.argv[1:]))
"""


def started(tmp_path, *before):
    return subprocess.Popen(
        [*before, sys.executable, "-c", COMMAND, "write", "--out", tmp_path / "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_as_in_a_terminal,
    )


def _as_in_a_terminal():
    """Tests that run in the background or under nohup inherit ignored signals."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@pytest.mark.parametrize(
    ("number", "code", "word"),
    [
        (signal.SIGTERM, 143, "ended by SIGTERM"),
        (signal.SIGHUP, 129, "ended by SIGHUP"),
        (signal.SIGINT, 130, "interrupted"),
    ],
)
def test_a_signal_leaves_nothing_half_written_and_says_how_to_go_on(tmp_path, number, code, word):
    process = started(tmp_path)
    child = int(process.stdout.readline())
    os.kill(child, signal.SIGTERM)  # a forked process ends at once and without a word
    process.send_signal(number)
    _, told = process.communicate(timeout=HANG_S)
    assert process.returncode == code
    assert told.startswith(f"twin: error: {word}: nothing half-written is left under ")
    assert told.endswith("give the command again\n")
    assert len(told.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_hang_up_that_is_ignored_stays_so(tmp_path):
    process = started(tmp_path, "nohup")
    child = int(process.stdout.readline())
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.3)
    os.kill(child, signal.SIGKILL)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=HANG_S)
    assert process.returncode == 143


@pytest.fixture
def handled():
    """A handler of somebody else's for SIGTERM, none for SIGHUP."""
    before = {
        signal.SIGTERM: signal.signal(signal.SIGTERM, lambda *_: None),
        signal.SIGHUP: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    }
    yield signal.getsignal(signal.SIGTERM)
    for number, handler in before.items():
        signal.signal(number, handler)


def test_handlers_of_others_are_left_alone(handled):
    with Endings() as endings:
        assert (endings.word, endings.code) == ("interrupted", 130)
        assert signal.getsignal(signal.SIGTERM) is handled
        assert signal.getsignal(signal.SIGHUP) is not signal.SIG_DFL
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL


def raised(first, *later):
    """An error raised from another one, and so on: the last of them."""
    for one in later:
        one.__cause__ = first
        first = one
    return first


RESULT = "<function _filter> returned a result with an exception set"


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (raised(KeyboardInterrupt(), SystemError(RESULT)), 143, "ended by SIGTERM: it came in"),
        (
            raised(KeyboardInterrupt(), SystemError(RESULT), SystemError(RESULT)),
            143,
            "ended by SIGTERM: it came in compiled code; give the command again",
        ),
        (
            raised(KeyboardInterrupt("--resume goes on"), SystemError(RESULT), ValueError("cut")),
            143,
            "ended by SIGTERM: --resume goes on",
        ),
        (raised(KeyboardInterrupt(), WriteError("the disk is full")), 2, "the disk is full"),
        (RuntimeError("invalid MUJOCO_GL: foo"), 2, "invalid MUJOCO_GL: foo; set it to egl, os"),
        (SystemError("of its own"), 1, "SystemError: of its own (this is a bug; "),
    ],
)
def test_an_interruption_in_compiled_code_is_told_as_one(monkeypatch, capsys, error, code, told):
    class Fly:
        def run(self, console):
            with pytest.raises(KeyboardInterrupt):  # the signal itself, which the error hides
                signal.raise_signal(signal.SIGTERM)
            raise error

    monkeypatch.setattr("twin.cli.parsing.parse_options", lambda *_, **__: Fly())
    command = ProgramCommand(name="fly", summary="", loader="builtins:object")
    assert Program(name="twin", summary="", commands=(command,)).main(["fly"]) == code
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"twin: error: {told}")


def test_errors_in_a_circle_hide_no_interruption():
    first, second = SystemError("one"), SystemError("two")
    first.__context__, second.__context__ = second, first
    assert interruption(first) is None


SERVE = ["-m", "twin", "serve", "--port", "0", "--duration", "60"]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 0)])
def test_a_server_that_is_ended_keeps_what_was_flown(tmp_path, number, code):
    out = tmp_path / "flown.zarr"
    process = subprocess.Popen(
        [sys.executable, *SERVE, "--out", out],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_as_in_a_terminal,
    )
    line = process.stderr.readline()
    host, _, port = re.search(r"waits on (\S+);", line)[1].rpartition(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(HANG_S)
        for frame in range(5):
            client.sendto(struct.pack("<HHI16H", 18458, 50, frame, *[1500] * 16), (host, int(port)))
            client.recv(4096)
    process.send_signal(number)
    said, told = process.communicate(timeout=HANG_S)
    assert process.returncode == code
    assert str(out) in said
    assert ("ended by SIGTERM" in told) == (number == signal.SIGTERM)
    assert (out / "zarr.json").is_file()


@pytest.mark.skipif(not Path("/sys/kernel").is_dir(), reason="no place that refuses")
def test_a_place_that_takes_nothing_is_refused_before_anything_is_flown(capsys):
    for words in (
        ["serve", "--out", "/sys/kernel/x.zarr"],
        ["simulate", "--duration", "600000", "--out", "/sys/kernel/x.zarr"],
    ):
        assert TWIN.main(words) == 2
        assert "cannot write /sys/kernel/x.zarr: /sys/kernel" in capsys.readouterr().err


def test_a_read_only_disk_is_bad_input_in_every_command(capsys, monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), "/there/x")

    monkeypatch.setattr("twin.commands.machine.Version.run", refuse)
    assert TWIN.main(["version"]) == 2
    assert capsys.readouterr().err == "twin: error: /there/x: Read-only file system\n"


# --- commands of plugins, and what a shell completes ----------------------------------------------


PROGRAM = Program(
    name="twin",
    summary="A program.",
    commands=commands_of(
        "twin.commands", {"moor": ("plugins/moorings", "keep a vehicle in place")}
    ),
)
MOOR = """
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
    folder: Path, monkeypatch, *, version: str = __version__, entry: str = "twin.moor", code=MOOR
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
