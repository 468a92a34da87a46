"""Campaign: one writer, every operation, every fault; run in a process with the injector.

A prepared process forks one child for each fault. The child writes the new content over the old one
and meets the fault at one operation. Afterwards the old content or the new one is under the name,
and the next child, without a fault, writes the new one and leaves nothing beside it.

The order is a random one that is always the same, so that what a campaign that was stopped has done
is a sample of all. Its journal has a line for each fault; the next start goes on after them.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import random
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.faults.injector import FAULTS, Fault, Injector
from benchmarks.faults.writers import WRITERS, Write, Writer
from twin.errors import TwinError

DONE, TOLD, CRASHED, KILLED = 0, 3, 4, 9
"""Exit codes of a child; 9 is the injector's."""
LONGEST_S = 300
"""[s] that a child may take; then a signal ends it"""


@dataclasses.dataclass
class Outcome:
    """What one writer went through."""

    writer: str
    operations: int
    planned: int
    """faults of the whole campaign"""
    injected: int = 0
    survived: int = 0
    lost: list[str] = dataclasses.field(default_factory=list)
    """what was neither the old content nor the new one, or could not be written afterwards"""


@dataclasses.dataclass(frozen=True)
class Campaign:
    """What is asked of one writer."""

    writer: str
    every: int = 1
    """take every n-th operation"""
    faults: tuple[str, ...] = tuple(fault.name for fault in FAULTS)
    journal: str | None = None
    """file with a line for each fault that was injected, which is not injected again"""
    seconds: float | None = None
    """[s] after which the campaign stops before its end; preparation does not count"""


def run(campaign: Campaign, work: Path) -> Outcome:
    """Inject faults into every n-th operation of a writer."""
    name = campaign.writer
    writer = WRITERS[name]
    inputs, place = work / "inputs", work / "place"
    inputs.mkdir(parents=True)
    write = writer.prepare(inputs)
    injector = Injector()
    target = place / writer.target
    before = work / "before"
    place.mkdir()
    _preload(write, target)
    new, whole = writer.content(target), writer.whole(target)
    shutil.rmtree(place)
    place.mkdir()
    assert _child(lambda: write(target, "old")) == DONE, f"{name} cannot write"
    shutil.copytree(place, before)
    old = writer.content(target)
    assert old != new
    operations = _count(write, target, place, injector)
    planned = [
        (Fault[fault], at)
        for fault in campaign.faults
        for at in range(1, operations + 1, campaign.every)
    ]
    random.Random(operations).shuffle(planned)
    outcome = Outcome(name, operations, len(planned))
    known, begun = _known(campaign, operations), time.monotonic()
    for fault, at in planned:
        if campaign.seconds is not None and time.monotonic() - begun > campaign.seconds:
            break
        if (fault.name, at) in known:
            problem = known[fault.name, at]
        else:
            shutil.rmtree(place)
            shutil.copytree(before, place)
            problem = _inject(writer, write, target, injector, fault, at, old, new)
            if problem is None and writer.whole(target) != whole:
                problem = "the next writing gives other content"
            _note(campaign, [fault.name, at, problem])
        outcome.injected += 1
        if problem is None:
            outcome.survived += 1
        else:
            outcome.lost.append(f"{fault.name} at operation {at}: {problem}")
    return outcome


def _known(campaign: Campaign, operations: int) -> dict[tuple[str, int], str | None]:
    """What went wrong, by fault and operation, of those that the journal has."""
    if campaign.journal is None:
        return {}
    journal = Path(campaign.journal)
    if not journal.exists():
        _note(campaign, [campaign.writer, operations])
    head, *lines = [json.loads(line) for line in journal.read_text().splitlines()]
    if head != [campaign.writer, operations]:
        raise TwinError(
            f"{journal} is of {head}, not of {[campaign.writer, operations]}: the writer has "
            "changed, remove the journal to start again"
        )
    return {(fault, at): problem for fault, at, problem in lines}


def _note(campaign: Campaign, line: list[Any]) -> None:
    """Add a line to the journal."""
    if campaign.journal is not None:
        with Path(campaign.journal).open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")


def _preload(write: Write, target: Path) -> None:
    """Write the new content, and import in this process what that imports, without its threads."""
    loaded = target.with_name("modules.txt")

    def note() -> None:
        write(target, "new")
        loaded.write_text("\n".join(sorted(sys.modules)))

    assert _child(note) == DONE
    for name in loaded.read_text().split():
        with contextlib.suppress(Exception):  # parts of packages that are no modules
            import_module(name)
    loaded.unlink()


def _count(write: Write, target: Path, place: Path, injector: Injector) -> int:
    """Operations of one writing; also makes sure that all of it is synced."""
    reading, writing = os.pipe()

    def count() -> None:
        injector.arm(place, 0, Fault.NOTHING)
        write(target, "new")
        os.write(writing, json.dumps([injector.count, injector.unsynced]).encode())

    assert _child(count) == DONE
    operations, unsynced = json.loads(os.read(reading, 1000))
    os.close(reading)
    os.close(writing)
    assert unsynced == 0, f"{unsynced} files are not synced when the command ends"
    return int(operations)


def _inject(
    writer: Writer, write: Write, target: Path, injector: Injector, fault: Fault, at: int,
    old: str, new: str,
) -> str | None:  # fmt: skip
    """What went wrong; None when nothing was lost."""

    def meet() -> None:
        injector.arm(target.parent, at, fault)
        try:
            write(target, "new")
        finally:
            injector.disarm()

    code = _child(meet)
    found = writer.content(target)
    if code not in (DONE, TOLD, KILLED):
        return "ended with a traceback" if code == CRASHED else f"ended by signal {-code}"
    if found not in (old, new):
        return f"other content ({'nothing' if not target.exists() else 'half'}), exit code {code}"
    if code == DONE and found != new:
        return "said that it is done, and the old content is there"
    if _child(lambda: write(target, "new")) != DONE:
        return "the next writing fails"
    left = sorted(path.name for path in target.parent.iterdir() if path != target)
    return f"left {', '.join(left)}" if left else None


def _child(work: Callable[[], object]) -> int:
    """Exit code of a forked process that does something."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    signal.alarm(LONGEST_S)
    try:
        work()
        os._exit(DONE)
    except TwinError as error:
        os._exit(TOLD if "\n" not in str(error) else CRASHED)
    except BaseException:
        traceback.print_exc()
        os._exit(CRASHED)


if __name__ == "__main__":
    for number, asked in enumerate(json.loads(sys.argv[1])):
        outcome = run(Campaign(**asked), Path(sys.argv[2]) / str(number))
        print(json.dumps(dataclasses.asdict(outcome)), flush=True)
