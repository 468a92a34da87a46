"""Programs `twin`, `factory` and `learn`: dispatch of subcommands, exit codes, errors, signals.

A subcommand is a frozen dataclass in a light module of its own, whose fields are the options and
whose `run(console)` imports what it needs and returns the exit code:

    @dataclass(frozen=True, kw_only=True)
    class Trim(JsonOption):
        \"\"\"Steady glide of given actuator positions.\"\"\"

        net_mass: float
        \"\"\"Net buoyancy mass [kg], + = heavy.\"\"\"

        def run(self, console: Console) -> int: ...

A subcommand is registered by name, summary and import place, so that `--help` of the program
imports no subcommand, and `--help` of a subcommand only its own module.

A plugin brings subcommands by entry points of the group `glider_twin.commands`, such as
`twin.serve`. A program's table also names the subcommands of this project's own plugins: `--help`
needs no lookup, and a user without the plugin reads how to install it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from twin.cli.console import Console, Runnable, discard, one_line
from twin.errors import InputError, OddFile, TwinError, shortened, unknown_name
from twin.plugins import (
    PLUGIN_FOLDER,
    entry_point,
    imported,
    installation,
    load_entry_point,
)
from twin.version import __version__

EXIT_OK, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2

COMMANDS = "glider_twin.commands"  # group of the entry points that bring subcommands

TRACEBACK_VARIABLE = "TWIN_TRACEBACK"
"""Environment variable that, when set to 1, adds the traceback to every error."""
PROGRAMS = ("twin", "factory", "learn")
"""Programs of the installation: packages, each with a `PROGRAM` in `__main__`"""
NAMED_WRONGLY = (
    *(FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError),
    *(PermissionError, OddFile),
)
NO_PLACES = (errno.ENAMETOOLONG, errno.ELOOP, errno.EROFS)
"""Numbers of errors that mean a wrong path, so bad input; others, as a full disk, are failures"""
WORDS = {
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "ended by SIGTERM",
    signal.SIGHUP: "ended by SIGHUP",
}


@dataclass(frozen=True, kw_only=True)
class ProgramCommand:
    """A subcommand, whose module is imported only when it is called."""

    name: str
    """Word that the user types."""
    summary: str
    """One line for the program's help."""
    loader: str
    """Place of its dataclass: `package.module:Class`, or a plugin's entry point, `twin.serve`."""
    plugin: str = ""
    """Folder below `plugins/` that brings the subcommand; empty for one of the package."""

    def load(self) -> type[Runnable]:
        """Import the subcommand's dataclass.

        Raises:
          InputError: its plugin is not installed, has another version or cannot be imported.
        """
        typed, point = self.loader.replace(".", " "), None
        if self.plugin and (point := entry_point(COMMANDS, self.loader)) is None:
            raise InputError(
                f"`{typed}` comes with a plugin that is not installed: "
                f"{installation(PLUGIN_FOLDER + self.plugin)}"
            )
        command: type[Runnable] = (
            load_entry_point(point, f"command `{typed}`") if point else imported(self.loader)
        )
        return command

    @property
    def installed(self) -> bool:
        """True if the subcommand's plugin is installed, or it needs none."""
        return not self.plugin or entry_point(COMMANDS, self.loader) is not None


def commands_of(package: str, table: Mapping[str, tuple[str, str]]) -> tuple[ProgramCommand, ...]:
    """Make subcommands from a table: name to class and summary.

    The class is in the package's module of the subcommand's name. A class elsewhere is given as
    `module:Class` of the package, or as `package.module:Class`; `plugins/NAME` means a plugin.
    """
    program = package.partition(".")[0]
    found = []
    for name, (place, summary) in table.items():
        loader = place if ":" in place else f"{name}:{place}"
        loader = loader if "." in loader else f"{package}.{loader}"
        plugin = place.removeprefix(PLUGIN_FOLDER) if place.startswith(PLUGIN_FOLDER) else ""
        if plugin:
            loader = f"{program}.{name}"
        found.append(ProgramCommand(name=name, summary=summary, loader=loader, plugin=plugin))
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Program:
    """One of the three programs."""

    name: str
    """Word that the user types."""
    summary: str
    """Purpose of the program, one line."""
    commands: tuple[ProgramCommand, ...]
    """Subcommands, in the order of the help."""
    needs: Callable[[], None] = lambda: None
    """Check that runs before a command is imported; raises when a package is not installed."""

    def help(self) -> str:
        """Text of `--help`."""
        width = max((len(command.name) for command in self.commands), default=0)
        listing = ""
        for plugin in dict.fromkeys(command.plugin for command in self.commands):
            listing += f"commands of {PLUGIN_FOLDER}{plugin}:\n" if plugin else "commands:\n"
            for command in self.commands:
                if command.plugin == plugin:
                    listing += f"  {command.name:<{width}}  {command.summary}\n"
            listing += "\n"
        return (
            f"usage: {self.name} COMMAND [OPTIONS]\n\n{self.summary}\n\n{listing}"
            f"options:\n"
            f"  -h, --help  this text; `{self.name} COMMAND --help` explains one command\n"
            f"  --version   the version\n"
            f"  --completion SHELL  what bash, zsh or fish source to complete words\n\n"
            f"Exit codes: 0 done, 1 failed, 2 bad input, 130 interrupted, 143 ended by SIGTERM, "
            f"129 by SIGHUP.\n{TRACEBACK_VARIABLE}=1 adds tracebacks to errors.\n"
        )

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Run the command line (default: the process's own) and return the exit code."""
        words = list(sys.argv[1:] if arguments is None else arguments)
        # numpy and torch read this at import. Matrices here are small and each network trains in
        # one thread; more threads would wait for each other and cost more than they gain.
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        for name in ("stdout", "stderr"):  # a closed stream (`twin ... >&-`) discards all output
            if getattr(sys, name) is None:
                stream = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - stays open
                setattr(sys, name, stream)
        # Errors in options are reported before parsing ends, so --json is sought in the raw words.
        console = Console(self.name, json="--json" in words)
        with Endings() as endings:
            try:
                code = self._dispatch(words, console)
                if code is None:
                    return EXIT_OK
                console.finish()
                return code
            except (KeyboardInterrupt, Exception) as error:
                if (interrupt := interruption(error)) is None:
                    return _fail(console, error, *describe_error(error))
                # the store library leaves a coroutine behind, of which Python would warn
                warnings.filterwarnings("ignore", "coroutine .* was never awaited", RuntimeWarning)
                compiled = interrupt is not error  # raised in compiled code, without a text
                state = "it came in compiled code" if compiled else "nothing half-written is left"
                text = str(interrupt) or f"{state}; give the command again"
                return _fail(console, interrupt, f"{endings.word}: {text}", endings.code)

    def _dispatch(self, words: list[str], console: Console) -> int | None:
        """Exit code of the subcommand, or None when a text was printed instead of running one."""
        if not words:
            sys.stderr.write(self.help())
            raise InputError("no command given")
        first, *rest = words
        if first in ("-h", "--help"):
            _print(self.help())
            return None
        if first == "--version":
            _print(f"{self.name} {__version__}")
            return None
        if first == "--completion":
            from twin.cli.parsing import SHELLS, completion

            if len(rest) != 1:
                raise InputError(f"--completion takes a shell: {', '.join(SHELLS)}")
            self.needs()
            commands = (
                (one.name, one.summary, one.load()) for one in self.commands if one.installed
            )
            _print(completion(self.name, self.summary, commands, rest[0]))
            return None
        if first.startswith("-"):
            raise InputError(
                f"unknown option {first!r} before the command: options of a command come after "
                f"its name, as in {self.name} COMMAND {first}"
            )
        by_name = {command.name: command for command in self.commands}
        entry = f"{self.name}.{first}"
        if first not in by_name and entry_point(COMMANDS, entry) is not None:
            by_name[first] = ProgramCommand(name=first, summary="", loader=entry, plugin=first)
        if first not in by_name:
            if others := _programs_with(first):
                ways = " or ".join(f"`{name} {first}`" for name in others)
                raise InputError(f"{self.name} has no command {first!r}: it is {ways}")
            raise InputError(unknown_name("command", first, by_name))
        from twin.cli.parsing import parse_options

        self.needs()
        chosen = by_name[first].load()
        try:
            options = parse_options(chosen, prog=f"{self.name} {first}", words=rest)
        except BrokenPipeError:  # the help text's reader, such as `| head`, has closed the pipe
            discard(sys.stdout)
            return None
        if options is None:
            Console("").finish()
            return None
        console.json = bool(getattr(options, "json", False))
        # With --json only the answer may go to standard output, not a library's prints.
        aside = contextlib.redirect_stdout(sys.stderr) if console.json else contextlib.nullcontext()
        with aside, warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: console.warn(str(message))
            return options.run(console)


def _programs_with(command: str) -> list[str]:
    """Names of the programs that have a command of that name."""
    from importlib import import_module

    found = []
    for name in PROGRAMS:
        with contextlib.suppress(ImportError, InputError):  # `learn` without its extra
            program: Program = import_module(f"{name}.__main__").PROGRAM
            found += [name] * any(command == one.name for one in program.commands)
    return found


def _print(text: str) -> None:
    # Through a console, because `twin --help | head` must end quietly too.
    console = Console("")
    console.say(text.rstrip("\n"))
    console.finish()


def _fail(console: Console, error: BaseException, text: str, code: int) -> int:
    if os.environ.get(TRACEBACK_VARIABLE) == "1":
        import traceback

        traceback.print_exception(error)
    console.error(text := shortened(text))
    console.finish({"error": one_line(text), "error_kind": type(error).__name__})
    return code


def describe_error(error: BaseException) -> tuple[str, int]:
    """Message of one line and exit code for an error, in place of a traceback."""
    if isinstance(error, TwinError):
        return str(error), error.exit_code
    if isinstance(error, OSError):
        reason = error.strerror or str(error)
        text = f"{error.filename}: {reason}" if error.filename is not None else reason
        wrong = isinstance(error, NAMED_WRONGLY) or error.errno in NO_PLACES
        return text, EXIT_BAD_INPUT if wrong else EXIT_FAILED
    if isinstance(error, RuntimeError) and "MUJOCO_GL" in str(error):  # raised when mujoco loads
        return f"{error}; set it to egl, osmesa or glfw, or unset it", EXIT_BAD_INPUT
    hint = f"this is a bug; set {TRACEBACK_VARIABLE}=1 for the traceback and report it"
    return f"{type(error).__name__}: {error} ({hint})", EXIT_FAILED


def interruption(error: BaseException) -> KeyboardInterrupt | None:
    """Find the interruption (such as Ctrl-C) that an error hides; None if there is none.

    If a signal arrives while compiled code calls Python, the call returns a result and leaves an
    exception set. Python then raises a SystemError with the interruption as its cause, and another
    SystemError at each compiled caller.

    Args:
      error: exception that ended a command. An interruption counts only if it is `error` itself or
        the cause of a SystemError. Any other error, such as one of cleaning up, is reported.
    """
    one: BaseException | None = error
    compiled = False
    seen: set[int] = set()
    while one is not None and id(one) not in seen:
        if isinstance(one, KeyboardInterrupt):
            return one if compiled or one is error else None
        seen.add(id(one))
        compiled = compiled or isinstance(one, SystemError)
        one = one.__cause__ or one.__context__
    return None


class Ended(KeyboardInterrupt):
    """A signal other than Ctrl-C's ended the program."""


class Endings:
    """Context in which SIGTERM and SIGHUP end the program as Ctrl-C does.

    A signal that is ignored (SIGHUP under nohup) or has another handler already is left alone.
    Forked child processes end at once by these signals, as they would without this context.
    """

    def __init__(self) -> None:
        self._signal = signal.SIGINT
        self._process = os.getpid()
        self._taken: list[signal.Signals] = []

    @property
    def word(self) -> str:
        """Words for the ending in the error message."""
        return WORDS[self._signal]

    @property
    def code(self) -> int:
        """Exit code as shells report the signal."""
        return 128 + self._signal

    def __enter__(self) -> Endings:
        if threading.current_thread() is threading.main_thread():
            for one in (signal.SIGTERM, signal.SIGHUP):
                if signal.getsignal(one) is signal.SIG_DFL:
                    signal.signal(one, self._end)
                    self._taken.append(one)
        return self

    def __exit__(self, *_: object) -> None:
        for one in self._taken:
            signal.signal(one, signal.SIG_DFL)

    def _end(self, number: int, frame: FrameType | None) -> None:
        if os.getpid() != self._process:  # a forked process ends by the signal, without a message
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        self._signal = signal.Signals(number)
        raise Ended
