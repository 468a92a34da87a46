"""What ends a command from outside: it tidies up, says how to go on, and has its own exit code."""

import errno
import os
import re
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from patience import HANG_S

from twin.__main__ import PROGRAM as TWIN
from twin.cli.program import Endings, Program, ProgramCommand, interruption
from twin.errors import WriteError

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
