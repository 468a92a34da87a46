"""The command-line machinery: exit codes, messages, --json, and what `--help` may import."""

import dataclasses
import io
import json
import os
import re
import shlex
import subprocess
import sys
import typing
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import tyro

from factory.__main__ import PROGRAM as FACTORY
from learn.__main__ import PROGRAM as LEARN
from twin.__main__ import PROGRAM as TWIN
from twin.cli.console import Console, JsonOption, Progress, format_duration, to_json
from twin.cli.parsing import number_kind, option_names, parse_options
from twin.cli.program import Program, ProgramCommand
from twin.cli.text_table import (
    WIDEST,
    counted,
    format_number,
    format_pairs,
    format_table,
    printable,
)
from twin.errors import InputError, NoSteadyState

PROGRAMS = {program.name: program for program in (TWIN, FACTORY, LEARN)}
every_program = pytest.mark.parametrize("program", PROGRAMS.values(), ids=PROGRAMS)
every_command = pytest.mark.parametrize(
    ("program", "command"),
    [(program, command) for program in PROGRAMS.values() for command in program.commands],
    ids=lambda thing: thing.name,
)
HEAVY = ("numpy", "scipy", "mujoco", "torch", "matplotlib", "xarray", "zarr", "numba", "dm_control")
"""Libraries too slow to import for a help text."""


@dataclass(frozen=True, kw_only=True)
class Water:
    """Where the glide happens."""

    density: float = 1025.0
    """Density [kg/m3]."""


@dataclass(frozen=True, kw_only=True)
class Glide(JsonOption):
    """A command for these tests."""

    net_mass: float
    """Net buoyancy mass [kg]."""

    model: Literal["mujoco", "fossen"] = "mujoco"
    """Which model."""

    water: Water = Water()
    """The water."""

    plot: Path | None = None
    """Where to draw."""

    fail: str = ""
    """How to end."""

    def __post_init__(self) -> None:
        """Check what options can get wrong."""
        if abs(self.net_mass) > 10.0:
            raise InputError(f"net mass {self.net_mass} kg is too large: at most 10 kg")

    def run(self, console: Console) -> int:
        """Print the figures, then end as asked."""
        console.say(f"net mass {self.net_mass} kg")
        print("a library that prints")
        console.answer(net_mass_kg=np.float64(self.net_mass), radius_m=float("inf"))
        ends: dict[str, Callable[[], int]] = {
            "": lambda: 0,
            "failed": lambda: 1,
            "steady": lambda: _raise(NoSteadyState("no steady glide\n  at all")),
            "bug": lambda: _raise(ZeroDivisionError("division by zero")),
            "interrupt": lambda: _raise(KeyboardInterrupt("continue with --resume")),
            "missing": lambda: _raise(FileNotFoundError(2, "No such file or directory", "m.toml")),
            "full": lambda: _raise(OSError(28, "No space left on device", "run.zarr")),
        }
        return ends[self.fail]()


@dataclass(frozen=True, kw_only=True)
class Mute(JsonOption):
    """A command that forgets its answer."""

    def run(self, console: Console) -> int:
        """Say nothing."""
        return 0


def _raise(error: BaseException) -> int:
    raise error


@pytest.fixture
def program(monkeypatch):
    commands = {"glide": Glide, "mute": Mute}
    monkeypatch.setattr(ProgramCommand, "load", lambda self: commands[self.name])
    return Program(
        name="swim",
        summary="A program for these tests.",
        commands=tuple(ProgramCommand(name=n, summary=n, loader="unused") for n in commands),
    )


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("glide --net-mass 0.3", 0, ""),
        ("glide --net-mass -0.3", 0, ""),
        ("glide --net-mass 0.3 --fail failed", 1, ""),
        ("", 2, "swim: error: no command given"),
        ("glid", 2, "unknown command 'glid': did you mean 'glide'?"),
        ("--json", 2, "unknown option '--json' before the command"),
        ("glide", 2, "missing --net-mass (see swim glide --help)"),
        ("glide --net-mas 0.3", 2, "option --net-mas: did you mean --net-mass (Net "),
        ("glide --net-mass=1 --qqq", 2, "unknown option --qqq: allowed: --fail, --json"),
        ("glide --net-mass 1 x", 2, "unexpected argument 'x'"),
        ("glide --net-mass", 2, "--net-mass"),
        ("glide --net-mass much", 2, "needs a number, got 'much': Net buoyancy mass [kg]"),
        ("glide --net-mass 1 --json yes", 2, "--json takes no value: leave 'yes' out"),
        ("render", 2, "swim has no command 'render': it is `twin render`"),
        ("plot", 2, "it is `twin plot` or `factory plot`"),
        ("glide --net-mass 1 --model fosen", 2, "did you mean 'fossen'?"),
        ("glide --net-mass 11", 2, "error: net mass 11.0 kg is too large: at most 10 kg"),
        ("glide --net-mass 1 --fail steady", 1, "error: no steady glide at all"),
        ("glide --net-mass 1 --fail bug", 1, "ZeroDivisionError: division by zero"),
        ("glide --net-mass 1 --fail interrupt", 130, "interrupted: continue with --resume"),
        ("glide --net-mass 1 --fail missing", 2, "m.toml: No such file"),
        ("glide --net-mass 1 --fail full", 1, "run.zarr: No space left"),
    ],
)
def test_exit_code_and_one_line_message(program, capsys, words, code, message):
    assert program.main(words.split()) == code
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert error.count("error:") == bool(message)
    if words and message:
        assert len(error.splitlines()) == 1


def test_no_command_shows_the_help_too(program, capsys):
    program.main([])
    assert program.help() in capsys.readouterr().err


@pytest.mark.parametrize("fail", ["", "failed", "steady", "bug", "missing"])
def test_json_is_one_object_alone_on_standard_output(program, capsys, fail):
    code = program.main(["glide", "--net-mass", "0.3", "--json", "--fail", fail])
    captured = capsys.readouterr()
    answer = json.loads(captured.out)
    assert captured.out.count("\n") == 1
    assert answer["net_mass_kg"] == 0.3
    assert answer["radius_m"] is None
    assert ("error" in answer) == (fail not in ("", "failed"))
    assert (code == 0) == (fail == "")
    assert "a library that prints" in captured.err


def test_json_for_bad_options_too(program, capsys):
    assert program.main(["glide", "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"].startswith("missing --net-mass")


def test_without_json_the_figures_are_text(program, capsys):
    program.main(["glide", "--net-mass", "0.3"])
    assert capsys.readouterr().out == "net mass 0.3 kg\na library that prints\n"


def test_a_command_that_forgets_its_answer_is_a_bug(program, capsys):
    assert program.main(["mute"]) == 0
    assert program.main(["mute", "--json"]) == 1
    assert "ended without an answer" in capsys.readouterr().err


def test_traceback_on_request(program, capsys, monkeypatch):
    monkeypatch.setenv("TWIN_TRACEBACK", "1")
    assert program.main(["glide", "--net-mass", "0.3", "--fail", "bug"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_options_become_the_dataclass():
    words = ["--net-mass", "-0.3", "--water.density", "1000", "--plot", "glide.png", "--json"]
    parsed = parse_options(Glide, prog="swim glide", words=words)
    assert parsed == Glide(
        net_mass=-0.3, water=Water(density=1000.0), plot=Path("glide.png"), json=True
    )


def test_help_of_an_option_that_may_be_absent_names_its_kind_only(capsys):
    assert parse_options(Glide, prog="swim glide", words=["--help"]) is None
    help_text = capsys.readouterr().out
    assert re.search(r"--plot PATH +Where to draw\. ", help_text)
    assert "default: None" not in help_text


@pytest.mark.parametrize(
    ("command", "columns"),
    [(c, w) for p in PROGRAMS.values() for c in p.commands for w in ("80", "140")][::3],
    ids=lambda value: value if isinstance(value, str) else value.name,
)
def test_help_is_no_wider_than_the_terminal(command, columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    assert parse_options(command.load(), prog=f"twin {command.name}", words=["--help"]) is None
    text = capsys.readouterr().out
    paragraphs = [line for line in text.splitlines() if line[:1].isalnum()]
    assert paragraphs[0].startswith("usage: ")
    assert max(map(len, paragraphs)) <= min(int(columns), 100)
    assert "\n\n\n" not in text
    assert "[[" not in text.split("\n\n")[0]
    assert "(default: )" not in text


@every_command
def test_help_of_every_command_has_an_example_that_its_parser_takes(program, command, capsys):
    prog = f"{program.name} {command.name}"
    assert parse_options(command.load(), prog=prog, words=["--help"]) is None
    text = capsys.readouterr().out
    examples = re.findall(rf"^    {prog}\b(.*)$", text, re.MULTILINE)
    assert examples
    for words in examples:
        assert len(prog + words) <= WIDEST
        assert parse_options(command.load(), prog=prog, words=shlex.split(words)) is not None
    assert "default: False" not in text  # a switch that is not given is off
    assert "default: None" not in text


def test_help_of_an_option_is_wrapped_to_its_box_and_not_at_the_lines_of_the_source(
    monkeypatch, capsys
):
    monkeypatch.setenv("COLUMNS", "100")
    twin_simulate = next(c for c in TWIN.commands if c.name == "simulate")
    assert parse_options(twin_simulate.load(), prog="twin simulate", words=["--help"]) is None
    lines = [line.strip("│ ") for line in capsys.readouterr().out.splitlines()]
    begin = next(i for i, line in enumerate(lines) if line.startswith("--density"))
    assert lines[begin + 2].startswith("salinity of the current's file), or a CSV file")


@every_program
def test_every_number_is_asked_for_in_plain_words(program, capsys):
    asked = 0
    for command in program.commands:
        chosen = command.load()
        whole = typing.get_type_hints(chosen, include_extras=True)
        hints, fields = typing.get_type_hints(chosen), dataclasses.fields(chosen)
        needed = [
            word
            for field in fields
            if field.default is dataclasses.MISSING
            for word in ([f"--{field.name}", "x"] if field.name in ("to", "out") else ["x"])
        ]
        for field in fields:
            no_option = tyro.conf.Suppress in getattr(whole[field.name], "__metadata__", ())
            if not no_option and number_kind(hints[field.name]) is not None:
                flag = f"--{field.name.replace('_', '-')}"
                assert program.main([command.name, *needed, flag, "1x"]) == 2
                error = capsys.readouterr().err
                assert f"{flag} needs a " in error
                assert "number, got '1x'" in error
                asked += 1
    assert asked >= 6


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("twin simulate --durations 3", "did you mean --duration (time to simulate, such as"),
        ("twin simulate --time-step 3", "did you mean --timestep"),
        ("factory generate --worker 3", "did you mean --workers"),
        ("factory import slocum a --output b", "did you mean --out"),
        ("learn fit --optimizer adam", "did you mean --optimiser"),
    ],
)
def test_a_misspelt_option_leads_to_the_nearest(words, message, capsys):
    name, *rest = words.split()
    assert PROGRAMS[name].main(rest) == 2
    assert message in capsys.readouterr().err


def test_names_that_leave_no_room_are_broken_and_nothing_is_lost():
    row = {f"{letter}_of_a_long_name": f"{letter}_{'x' * 28}_end" for letter in "abcd"}
    lines = format_table([row]).splitlines()
    assert max(map(len, lines)) <= WIDEST
    assert "".join(lines).count("x") == 4 * 28
    assert "".join(lines).count("end") == 4


def test_option_names_include_nested_ones():
    expected = "--json --net-mass --model --water.density --plot --fail"
    assert list(option_names(Glide)) == expected.split()


@every_program
def test_help_imports_nothing_heavy(program):
    """Of the program alone and of each command, one after the other in one process."""
    names = [command.name for command in program.commands]
    (whole, text), *each = _helps(program.name, *names)
    assert not set(whole) & {*HEAVY, "tyro"}
    assert text.startswith(f"usage: {program.name} COMMAND")
    for command, (loaded, said) in zip(program.commands, each, strict=True):
        assert not set(loaded) & set(HEAVY), command.name
        assert said.startswith(f"usage: {program.name} {command.name}")
        first = (command.load().__doc__ or "").split(".")[0].split("\n")[0]
        assert first in " ".join(said.split())
        assert f"  {command.name} " in text
        assert command.summary in text


@every_program
def test_commands_have_unique_names_and_short_summaries(program):
    names = [command.name for command in program.commands]
    assert len(set(names)) == len(names)
    assert all(0 < len(command.summary) <= 80 for command in program.commands)


def process(*words: str, stdout: Any = subprocess.PIPE, stderr: Any = subprocess.PIPE):
    """A process of Python's that ended."""
    return subprocess.run([sys.executable, *words], stdout=stdout, stderr=stderr, text=True)


def test_a_missing_store_of_a_fit_is_said_before_torch_is_imported():
    code = (
        "import sys; from learn.__main__ import main; sys.argv[1:] = ['fit', 'absent.zarr']; "
        "code = main(); assert 'torch' not in sys.modules; sys.exit(code)"
    )
    done = process("-c", code)
    assert done.returncode == 2
    assert "no store at absent.zarr" in done.stderr


@pytest.mark.parametrize("name", PROGRAMS)
def test_python_dash_m_is_the_same_program(name):
    done = process("-m", name, "--version")
    assert (done.returncode, done.stdout.split()[0]) == (0, name)


@pytest.mark.parametrize("words", ["--help", "trim --help", "vehicles"])
def test_a_reader_that_goes_away_is_no_error(words):
    # Nobody holds the reading end when the program writes, as after `| head -0`.
    reading, writing = os.pipe()
    os.close(reading)
    done = process("-m", "twin", *words.split(), stdout=writing)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("words", ["vehicles --json", "vehicles", "--help"])
def test_a_full_disk_is_one_line_and_a_failure(words):
    with Path("/dev/full").open("w") as full:
        done = process("-m", "twin", *words.split(), stdout=full)
    assert (done.returncode, done.stderr) == (1, "twin: error: No space left on device\n")


def test_a_full_disk_for_messages_leaves_the_exit_code():
    with Path("/dev/full").open("w") as full:
        assert process("-m", "twin", "nonsense", stderr=full).returncode == 2


def _helps(program, *commands):
    """Top-level modules after each help of a program, and what it says, in a process of its own."""
    code = (
        f"import contextlib, io, json, sys\nfrom {program}.__main__ import main\n"
        "for words in ([], *([one] for one in sys.argv[1:])):\n"
        "    sys.argv = ['x', *words, '--help']\n"
        "    with contextlib.redirect_stdout(io.StringIO()) as said:\n"
        "        assert main() == 0\n"
        "    loaded = sorted({name.partition('.')[0] for name in sys.modules})\n"
        "    print(json.dumps([loaded, said.getvalue()]))"
    )
    done = process("-c", code, *commands)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_json_has_no_negative_zero_and_no_rounding_noise():
    text = json.dumps(to_json({"roll": -0.0, "sway": -5.4e-48, "track": np.array([-0.0, 1e-10])}))
    assert text == '{"roll": 0.0, "sway": 0.0, "track": [0.0, 1e-10]}'


def test_to_json_knows_numpy_paths_and_dataclasses():
    value = {
        "speed": np.float32(0.5),
        "track": np.array([[1.0, np.nan], [2.0, -np.inf]]),
        "out": Path("demo") / "run.zarr",
        "water": Water(),
        "steps": np.int64(3),
        "ok": np.bool_(True),
        "none": None,
    }
    expected = (
        '{"speed": 0.5, "track": [[1.0, null], [2.0, null]], "out": "demo/run.zarr", '
        '"water": {"density": 1025.0}, "steps": 3, "ok": true, "none": null}'
    )
    assert json.dumps(to_json(value), allow_nan=False) == expected
    with pytest.raises(TypeError, match="no JSON form for object"):
        to_json(object())


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.49021, 4, "0.4902"),
        (-35.5471, 4, "-35.55"),
        (9.99996, 4, "10.00"),
        (123456.7, 4, "123457"),
        (5.3e-6, 2, "5.3e-06"),
        (2.5e8, 3, "2.50e+08"),
        (0.0, 4, "0"),
        (-0.0, 4, "0"),
        (2.4e-57, 4, "0"),
        (-2.4e-10, 2, "-2.4e-10"),
        (float("nan"), 4, "-"),
        (float("inf"), 4, "inf"),
        (None, 4, "-"),
        (12, 4, "12"),
        (np.float64(1.5), 3, "1.50"),
        (True, 4, "yes"),
        ("dive", 4, "dive"),
    ],
)
def test_format_number(value, digits, text):
    assert format_number(value, digits) == text


def test_table_aligns_numbers_right_and_text_left():
    rows = [
        {"model": "mujoco", "speed m/s": 0.49021, "turn radius m": None},
        {"model": "fossen", "speed m/s": 12.3456, "turn radius m": 78.8},
    ]
    assert format_table(rows) == (
        "model   speed m/s  turn radius m\n"
        "------  ---------  -------------\n"
        "mujoco     0.4902              -\n"
        "fossen      12.35          78.80"
    )
    assert format_pairs({"speed": (0.49021, "m/s"), "samples": 7}) == (
        "speed    0.4902 m/s\nsamples  7"
    )


def test_a_wide_table_folds_its_titles_and_then_its_text_to_100_columns():
    row = {f"figure number {i} [%]": 1.234 * i for i in range(8)}
    table = format_table([{"method": "steady flight model"} | row])
    assert max(map(len, table.splitlines())) <= WIDEST
    assert re.fullmatch(r" +figure( +figure){7}", table.splitlines()[0])
    assert table.splitlines()[-1].startswith("steady flight model ")  # its text had room
    long = {
        "name": "pitch_deg",
        "why": "the range that gliders use at sea " * 5,
        "what": "pitch " * 9,
    }
    lines = format_table([long, long]).splitlines()
    assert 80 < max(map(len, lines)) <= WIDEST
    assert [line.startswith("pitch_deg") for line in lines].count(True) == 2
    assert " ".join("\n".join(lines).split()).count("gliders") == 10
    pairs = format_pairs({"energy": "9.76 kJ, of it " + "pump 8.58 kJ, " * 12, "samples": 7})
    assert max(map(len, pairs.splitlines())) <= WIDEST
    assert pairs.splitlines()[1].startswith("         ")


@pytest.mark.parametrize(
    "words",
    [
        "twin vehicles",
        "twin trim",
        "factory distributions --preset field",
        "factory distributions --vehicle tethys",
    ],
)
def test_tables_that_commands_print_fit_100_columns(words, capsys):
    name, *rest = words.split()
    assert PROGRAMS[name].main(rest) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 5
    assert [line for line in lines if len(line) > WIDEST] == []


def test_progress_in_a_log_is_a_line_every_thirty_seconds():
    now = [0.0]
    log = io.StringIO()
    progress = Progress(total=100.0, label="generate", unit="h", stream=log, clock=lambda: now[0])
    with progress:
        for _ in range(70):
            now[0] += 1.0
            progress.update(1.0, loss=0.01234)
    lines = log.getvalue().splitlines()
    assert lines == [
        "generate: 30.0 of 100 h (30 %), 1.00 h/s, 1:10 left, loss 0.0123",
        "generate: 60.0 of 100 h (60 %), 1.00 h/s, 0:40 left, loss 0.0123",
        "generate: 70.0 of 100 h (70 %), 1.00 h/s, 0:30 left, loss 0.0123",
    ]


def test_progress_of_a_short_task_says_nothing_in_a_log():
    log = io.StringIO()
    with Progress(total=1.0, label="trim", unit="steps", stream=log) as progress:
        progress.update()
    assert log.getvalue() == ""


def test_progress_on_a_terminal_is_a_bar():
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    with Progress(total=2.0, label="generate", unit="h", stream=terminal) as progress:
        progress.update(2.0, missions=3)
    assert "generate: 100%" in terminal.getvalue()
    assert "missions=3" in terminal.getvalue()


def test_durations():
    assert [format_duration(s) for s in (7, 65, 3725)] == ["0:07", "1:05", "1:02:05"]


def test_the_name_of_a_value_that_has_none_is_no_option(capsys):
    assert TWIN.main(["simulate", "--mission", "mine.toml"]) == 2
    assert "--mission is not an option: give its value alone" in capsys.readouterr().err


def test_a_single_thing_has_no_plural():
    told = [counted(count, "mission") for count in (0, 1, 2)]
    assert told == ["0 missions", "1 mission", "2 missions"]


HOSTILE = "a\x1b]0;title\x07b\x9b31mc\u202ed\u200fe\u2028f\x00g\x7fh\udcffi\r"
SHOWN = "a\\x1b]0;title\\x07b\\x9b31mc\\u202ed\\u200fe\\u2028f\\x00g\\x7fh\\udcffi\\r"


def test_nothing_that_is_printed_moves_the_cursor(capsys):
    console = Console("twin")
    console.say(HOSTILE)
    console.table([{HOSTILE: HOSTILE}], title=HOSTILE)
    console.pairs({HOSTILE: HOSTILE}, title=HOSTILE)
    console.item(HOSTILE)
    console.note(HOSTILE)
    console.warn(HOSTILE)
    console.error(HOSTILE)
    said = capsys.readouterr()
    assert said.out.startswith(SHOWN + "\n")
    assert said.err.startswith(SHOWN + "\n")
    for text in (said.out, said.err):
        assert all(one.isprintable() or one == "\n" for one in text)
        assert "\\x1b]0;title\\x07b" in text
        assert "\\u202e" in text


def test_what_people_write_is_printed_as_it_is(capsys):
    text = "Ærø 8 °C, 2×3\t— „süd“ 海 🌊\n"
    Console("twin").say(text)
    assert capsys.readouterr().out == f"{text}\n"
    assert printable(text) == text
