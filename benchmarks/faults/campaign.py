"""Campaign: one writer, every operation, every fault; run in a process with the injector.

A prepared process forks one child for each fault. The child writes the new content over the old one
and meets the fault at one operation. Afterwards the old content or the new one is under the name,
and the next child, without a fault, writes the new one and leaves nothing beside it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import shutil
import sys
import traceback
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from benchmarks.faults.injector import FAULTS, Fault, Injector
from benchmarks.faults.writers import WRITERS, Write, Writer, digest
from twin.errors import TwinError

DONE, TOLD, CRASHED, KILLED = 0, 3, 4, 9
"""Exit codes of a child; 9 is the injector's."""


@dataclasses.dataclass
class Outcome:
    """What one writer went through."""

    writer: str
    operations: int
    injected: int = 0
    survived: int = 0
    lost: list[str] = dataclasses.field(default_factory=list)
    """what was neither the old content nor the new one, or could not be written afterwards"""


def run(name: str, work: Path, every: int = 1, faults: tuple[Fault, ...] = FAULTS) -> Outcome:
    """Inject faults into every n-th operation of a writer."""
    writer = WRITERS[name]
    inputs, place = work / "inputs", work / "place"
    inputs.mkdir(parents=True)
    write = writer.prepare(inputs)
    injector = Injector()
    target = place / writer.target
    before = work / "before"
    place.mkdir()
    _preload(write, target)
    for variant in ("new", "old"):
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        assert _child(lambda v=variant: write(target, v)) == DONE, f"{name} cannot write"  # type: ignore[misc]
        if variant == "new":
            new, whole = writer.content(target), digest(target)
    shutil.copytree(place, before)
    old = writer.content(target)
    assert old != new
    outcome = Outcome(name, _count(write, target, place, injector))
    for fault in faults:
        for at in range(1, outcome.operations + 1, every):
            shutil.rmtree(place)
            shutil.copytree(before, place)
            outcome.injected += 1
            problem = _inject(writer, write, target, injector, fault, at, old, new)
            if problem is None and digest(target) != whole:
                problem = "the next writing gives other content"
            if problem is None:
                outcome.survived += 1
            else:
                outcome.lost.append(f"{fault.name} at operation {at}: {problem}")
    return outcome


def _preload(write: Write, target: Path) -> None:
    """Import in this process what a writing imports, without the threads that it starts."""
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
    if code == CRASHED:
        return "ended with a traceback"
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
    try:
        work()
        os._exit(DONE)
    except TwinError as error:
        os._exit(TOLD if "\n" not in str(error) else CRASHED)
    except BaseException:
        traceback.print_exc()
        os._exit(CRASHED)


if __name__ == "__main__":
    chosen, folder, step = sys.argv[1:4]
    faulty = tuple(Fault[word] for word in sys.argv[4:]) or FAULTS
    print(json.dumps(dataclasses.asdict(run(chosen, Path(folder), int(step), faulty))))
