"""Fuzz: damaged logs of every importer; each import is sound, or refused in one line.

    python -m benchmarks.fuzz --mutants 5000 --seed 1 --seconds 3600 --workers 2

A mutant is named KIND:LAYOUT/OPERATION/SEED, which makes it again: `--only NAME`. It fails by an
error that is no `TwinError`, a message of several lines, a value outside of its limits that the
import did not report, a warning, a print, a file written elsewhere than in the store's folder,
more than 60 s or 1 GB, or the end of its process. Undamaged logs must give all their dives, sound.
`--real FOLDER` damages real logs too.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import gc
import itertools
import json
import multiprocessing
import multiprocessing.connection
import os
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from logs import SOUND  # noqa: E402

from benchmarks.damage import COLUMNS, OPERATIONS, damage, damaged_flight  # noqa: E402
from benchmarks.verdict import UNDAMAGED, Mutant, Verdict, judge, place  # noqa: E402
from factory import samples  # noqa: E402

LONGEST_S, MOST_BYTES, KILLED_BYTES = 60.0, 10**9, 3 * 10**9
"""Processor time [s] and memory [byte] of one import; and the memory at which it is stopped"""
FULL_BYTES = 7 * 10**8
"""[byte] A process that held more is not used again: it would not give all of it back"""
LAYOUTS = [f"{kind}:{k}" for kind, some in samples.formats().items() for k in range(len(some))]
BARE = ("slocum:1", "mcap:0", "rosbag2:0", "ardusub:0", "lsf:0", "dorado:0")
"""Layouts without tables and variables"""
TABLES = ("slocum:0", "seaglider:0", "seaexplorer:0", "csv:0")
"""Layouts without attributes"""
REAL = {
    "slocum": ("slocum_comet_dvl_2016/raw/*", "slocum_seus_2017/ramses*/*5.sbd"),
    "seaglider": ("seaglider_apl_ad2cp/raw/*", "seaglider_apl_basestation3/sg686*"),
    "seaexplorer": ("seaexplorer_pyglider/sea046*",),
    "lrauv": ("lrauv_shore_2013/*133105.mat", "lrauv_onboard_sim_2021/testPitch*"),
    "lsf": ("auv_lauv_noptilus_2015/*.lsf.gz",),
}
"""Files of `--real`, by kind"""
CORPUS = ROOT / "tests" / "data" / "mutants.json"
"""Names of mutants that failed once"""


def mutants(count: int, seed: int, layouts: Iterable[str] = LAYOUTS) -> Iterator[Mutant]:
    """Every layout undamaged, then every layout and operation in turn."""
    layouts = list(layouts)
    yield from (Mutant(one, UNDAMAGED, 0) for one in layouts)
    turns = [
        (OPERATIONS[(k + turn) % len(OPERATIONS)], one)
        for turn in range(len(OPERATIONS))
        for k, one in enumerate(layouts)
    ]
    no = [*itertools.product(COLUMNS, BARE), *itertools.product(("attributes", "shape"), TABLES)]
    fit = [one for one in turns if one not in no and (one[0] != "flight" or one[1] in LAYOUTS)]
    for k, (operation, layout) in enumerate(itertools.islice(itertools.cycle(fit), count)):
        yield Mutant(layout, operation, seed * 1_000_000 + k)


def prepare(mutant: Mutant, folder: Path, real: Path | None) -> str:
    """Write the damaged log; the name of the damaged file, or "" where nothing can be damaged."""
    random = np.random.default_rng([mutant.seed, *mutant.name.encode()])
    pattern = mutant.layout.partition(":")[2]
    flying = mutant.operation == "flight"
    if not pattern.isdigit():
        assert real is not None, f"{mutant.name} needs --real"
        for path in sorted(real.glob(pattern)):
            shutil.copyfile(path, folder / path.name)
    else:
        flight = damaged_flight(random) if flying else SOUND
        try:
            layout = samples.formats()[mutant.kind][int(pattern)]
            samples.write(mutant.kind, folder, flight, layout=layout)
        except Exception:  # a format has no such value
            if not flying:
                raise
            return ""
    if flying or mutant.operation == UNDAMAGED:
        return "all"
    with contextlib.suppress(Exception):  # its library writes no such file
        return damage(random, folder, mutant.operation)
    return ""


def _memory(word: str) -> int:
    """[byte] This process's memory by /proc; 0 on systems without."""
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(next(line.split()[1] for line in lines if line.startswith(word)))
    return 0


def work(pipe: Any, real: Path | None) -> None:
    """Judge mutants as they come, one by one, in a process of its own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.dont_write_bytecode = True
    written: list[str] = []
    allowed = ["/dev/", "/proc/"]

    def watch(event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(given[0], str | bytes) and isinstance(given[2], int):
            path, change = os.fsdecode(given[0]), given[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        elif event in ("os.rename", "os.mkdir", "os.symlink", "os.link"):
            path, change = os.fsdecode(given[0 if event == "os.mkdir" else 1]), 1
        else:
            return
        path = os.path.realpath(path)
        ours = path.startswith(tuple(allowed)) or "__pycache__" in path
        if change and not ours and not (event == "os.mkdir" and Path(path).is_dir()):
            written.append(path)

    sys.addaudithook(watch)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as base, contextlib.suppress(EOFError):
        printed = Path(base, "printed").open("wb+", buffering=0)  # noqa: SIM115
        for number in (1, 2):
            os.dup2(printed.fileno(), number)
        folder = Path(base, "one")
        tempfile.tempdir = str(folder / "temporary")
        allowed += [str(folder / name) for name in ("temporary", "out")]
        import factory.soundness  # noqa: F401 - garbage is looked for among what comes later

        gc.freeze()
        while True:
            mutant = Mutant.parse(pipe.recv())
            for name in ("logs", "out", "temporary"):
                (folder / name).mkdir(parents=True)
            verdict = Verdict(mutant)
            begun = time.process_time()
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    verdict.file = prepare(mutant, folder / "logs", real)
                begun = time.process_time()
                with contextlib.suppress(OSError):
                    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
                if verdict.file:
                    judge(mutant, verdict, folder, written)
            except Exception as error:
                verdict.failures.append(f"harness {place(error)}: {str(error)[:200]}")
            verdict.seconds, verdict.bytes = time.process_time() - begun, _memory("VmHWM")
            if verdict.bytes > MOST_BYTES:
                verdict.failures.append("more than 1 GB")
            if verdict.seconds > LONGEST_S:
                verdict.failures.append("more than 60 s")
            if printed.tell():
                printed.seek(0)
                verdict.failures.append(f"printed {printed.read(200)!r}")
                printed.seek(0)
                printed.truncate()
            verdict.failures = list(dict.fromkeys(verdict.failures))
            verdict.outcome = verdict.outcome if verdict.file else "unfit"
            shutil.rmtree(folder)
            pipe.send(verdict)


class Hand:
    """A process that judges, and what it is busy with."""

    def __init__(self, real: Path | None, target: Callable[..., None]) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=target, args=(theirs, real), daemon=True)
        self.process.start()
        theirs.close()
        self.mutant: Mutant | None = None

    def begin(self, mutant: Mutant) -> None:
        self.mutant, self._begun = mutant, self._used()[0]
        with contextlib.suppress(BrokenPipeError):  # it has ended, as its pipe says next
            self.pipe.send(mutant.name)

    def _used(self) -> tuple[float, int]:
        """Processor time [s] and memory [byte] of the process."""
        with contextlib.suppress(OSError):
            words = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
            ticks = int(words[11]) + int(words[12])
            return ticks / os.sysconf("SC_CLK_TCK"), int(words[21]) * os.sysconf("SC_PAGE_SIZE")
        return 0.0, 0

    def over(self) -> str:
        """Name the limit that the process is beyond; empty within all."""
        seconds, held = self._used()
        if held > KILLED_BYTES:
            return "more than 3 GB, stopped"
        return "more than 60 s, stopped" if seconds - self._begun > LONGEST_S + 15.0 else ""

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def run(
    given: Iterable[Mutant],
    *,
    workers: int = 1,
    seconds: float = 1e9,
    real: Path | None = None,
    target: Callable[..., None] = work,
) -> Iterator[Verdict]:
    """Verdicts on mutants, as they come; no mutant begins after so many seconds."""
    end, rest = time.monotonic() + seconds, iter(given)
    hands = [Hand(real, target) for _ in range(workers)]
    try:
        while True:
            for hand in hands:
                if hand.mutant is None and time.monotonic() < end:
                    following = next(rest, None)
                    if following is not None:
                        hand.begin(following)
            busy = [hand for hand in hands if hand.mutant is not None]
            if not busy:
                return
            ready = multiprocessing.connection.wait([hand.pipe for hand in busy], 0.2)
            for hand in busy:
                assert hand.mutant is not None
                verdict, failure = None, hand.over()
                if hand.pipe in ready:
                    try:
                        verdict = hand.pipe.recv()
                    except (EOFError, OSError):
                        hand.process.join()
                        failure = f"its process ended with {hand.process.exitcode}"
                if verdict is None and failure:
                    verdict = Verdict(hand.mutant, failures=[failure], bytes=KILLED_BYTES)
                if verdict is not None:
                    hand.mutant = None
                    yield verdict
                    if verdict.bytes > FULL_BYTES:
                        hand.end()
                        hands[hands.index(hand)] = Hand(real, target)
    finally:
        for hand in hands:
            hand.end()


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--mutants", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=1e9, help="after which no mutant begins")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--kinds", help="of logs, separated by commas")
    parser.add_argument("--only", nargs="+", help="names of mutants")
    parser.add_argument("--real", type=Path, help="folder of real logs, damaged too")
    parser.add_argument("--json", type=Path, help="file to which a line is added for each")
    options = parser.parse_args()
    layouts = [*LAYOUTS]
    if options.real:
        layouts += [f"{kind}:{one}" for kind, every in REAL.items() for one in every]
    if options.kinds:
        layouts = [o for o in layouts if o.partition(":")[0] in options.kinds.split(",")]
    every = map(Mutant.parse, options.only or ()) if options.only else mutants(
        options.mutants, options.seed, layouts
    )  # fmt: skip
    verdicts: list[Verdict] = []
    with contextlib.suppress(KeyboardInterrupt):  # what is done is counted
        for one in run(every, workers=options.workers, seconds=options.seconds, real=options.real):
            verdicts.append(one)
            for failure in one.failures:
                print(f"{one.mutant.name} ({one.file}): {failure}", flush=True)
            if options.only:
                print(one, flush=True)
            if options.json:
                with options.json.open("a") as lines:
                    lines.write(json.dumps(dataclasses.asdict(one)) + "\n")
    if verdicts:
        report(verdicts)
    return 1 if any(one.failures for one in verdicts) else 0


def report(verdicts: list[Verdict]) -> None:
    """Print outcomes by kind, causes with a mutant of each, and what took the most."""
    for kind in sorted({one.mutant.kind for one in verdicts}):
        of = [one for one in verdicts if one.mutant.kind == kind]
        count = Counter("failed" if one.failures else one.outcome for one in of)
        said = ", ".join(f"{n} {outcome}" for outcome, n in sorted(count.items()))
        raised = sum(bool(one.raised) for one in of)
        print(f"{kind}: {len(of)} mutants: {said}; a reader raised in {raised}")
    causes: dict[str, list[str]] = {}
    for one in verdicts:
        told = [f if f.startswith("not told") else f.partition(": ")[0] for f in one.failures]
        for cause in dict.fromkeys([*told, *(f"reader raised {cause}" for cause in one.raised)]):
            causes.setdefault(cause, []).append(one.mutant.name)
    for cause, found in sorted(causes.items(), key=lambda item: -len(item[1])):
        print(f"{len(found):5d} {cause} ({found[0]})")
    most, slowest = (max(getattr(o, n) for o in verdicts) for n in ("bytes", "seconds"))
    failed = sum(bool(one.failures) for one in verdicts)
    print(f"{len(verdicts)} mutants, {failed} failed; at most {most / 1e6:.0f} MB, {slowest:.1f} s")


if __name__ == "__main__":
    sys.exit(main())
