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
import hashlib
import itertools
import json
import multiprocessing
import multiprocessing.connection
import os
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from logs import write_pyglider  # noqa: E402
from written_logs import WRITERS, mapping, variation  # noqa: E402

from benchmarks.damage import COLUMNS, OPERATIONS, Sound, damage, damaged_flight  # noqa: E402

LONGEST_S, MOST_BYTES, KILLED_BYTES = 60.0, 10**9, 3 * 10**9
"""Processor time [s] and memory [byte] of one import; and the memory at which it is stopped"""
FULL_BYTES = 7 * 10**8
"""[byte] A process that held more is not used again: it would not give all of it back"""
UNDAMAGED = "none"
WRITERS = WRITERS | {
    "ngdac": (*WRITERS["ngdac"], lambda f, flight: [write_pyglider(f / "series.nc", flight)])
}
LAYOUTS = [f"{kind}:{k}" for kind, writers in WRITERS.items() for k in range(len(writers))]
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
NUMBER = re.compile(r"-?\d[\d.e+-]*")
CORPUS = ROOT / "tests" / "data" / "mutants.json"
"""Names of mutants that failed once"""


@dataclasses.dataclass(frozen=True)
class Mutant:
    """One damaged log."""

    layout: str
    """KIND:NUMBER of a writer, or KIND:PATTERN of real logs."""
    operation: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.layout}/{self.operation}/{self.seed}"

    @classmethod
    def parse(cls, name: str) -> Mutant:
        """The mutant of that name."""
        layout, operation, seed = name.rsplit("/", 2)
        return cls(layout, operation, int(seed))

    @property
    def kind(self) -> str:
        return self.layout.partition(":")[0]


@dataclasses.dataclass
class Verdict:
    """What an import made of a mutant."""

    mutant: Mutant
    outcome: str = "read"
    """read, refused, unfit (the operation changes nothing of such files) or failed"""
    file: str = ""
    failures: list[str] = dataclasses.field(default_factory=list)
    raised: list[str] = dataclasses.field(default_factory=list)
    """Errors of readers for which a file was left out, and what it was told by"""
    seconds: float = 0.0
    bytes: int = 0


def mutants(count: int, seed: int, layouts: Iterable[str] = LAYOUTS) -> Iterator[Mutant]:
    """Every layout undamaged, then every layout and operation in turn."""
    layouts = list(layouts)
    yield from (Mutant(one, UNDAMAGED, 0) for one in layouts)
    turns = [(o, one) for o in OPERATIONS for one in layouts]
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
        flight = damaged_flight(random) if flying else Sound()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                WRITERS[mutant.kind][int(pattern)](folder, flight)
        except Exception:  # a format has no such value
            if not flying:
                raise
            return ""
    if flying or mutant.operation == UNDAMAGED:
        return "all"
    with contextlib.suppress(Exception):  # its library writes no such file
        return damage(random, folder, mutant.operation)
    return ""


def place(error: BaseException) -> str:
    """Module and line of the project where an error came from, and its type."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if f.filename.startswith(str(ROOT)) and "benchmarks" not in f.filename]
    last = own[-1] if own else frames[-1]
    return f"{_short(last.filename)}:{last.lineno} {type(error).__name__}"


def _short(filename: str) -> str:
    """A file's place in the project or in its library."""
    return filename.removeprefix(f"{ROOT}/").rpartition("site-packages/")[2]


def contents(folder: Path) -> dict[str, str]:
    """Digests of the files of a folder and of those below."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def judge(mutant: Mutant, verdict: Verdict, folder: Path, written: list[str]) -> None:
    """Import a prepared log and look for all that may not be."""
    from factory.importing import deployment_log, import_logs
    from factory.soundness import verify_logs
    from twin.errors import TwinError
    from twin.records.logged import LogStore
    from twin.records.schema.limits import recorded_limits
    from twin.records.store import write_store

    logs, out = folder / "logs", folder / "out"
    layout = mutant.layout.partition(":")[2]
    given = variation(mutant.kind, int(layout), Sound()) if layout.isdigit() else None
    told = deployment_log.failed_reading

    def failed_reading(path: Path, error: Exception) -> Any:
        verdict.raised.append(place(error))
        return told(path, error)

    deployment_log.failed_reading = failed_reading
    before = contents(logs)
    written.clear()
    report = None
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            dataset, report = import_logs(
                mutant.kind, [logs], variation_deg=given, mapping=mapping(mutant.kind, logs)
            )
    except TwinError as error:
        verdict.outcome, said = "refused", str(error)
        if "\n" in said or not said.strip() or len(said) > 2100 or "this is a bug" in said:
            verdict.failures.append(f"message of {len(said)} characters: {said[:200]!r}")
    except Exception as error:
        verdict.failures.append(f"{place(error)}: {str(error)[:200]}")
    finally:
        deployment_log.failed_reading = told
    with warnings.catch_warnings(record=True) as left:
        warnings.simplefilter("always")
        gc.collect()  # files that nobody closed
    verdict.failures += [
        f"warning at {_short(one.filename)}:{one.lineno} {one.category.__name__}: "
        f"{' '.join(str(one.message).split())}" for one in (*warned, *left)
    ]  # fmt: skip
    verdict.failures += [f"written outside: {path}" for path in written]
    if contents(logs) != before:
        verdict.failures.append("the folder of the logs was changed")
    if report is None:
        return
    suspect = " ".join(e.subject for e in report.entries if e.action == "suspect")
    problems: list[tuple[str, list[str]]] = []
    names = [str(name) for name in dataset.data_vars]
    for name, variable in dataset.data_vars.items():
        with contextlib.suppress(LookupError):
            low, high = recorded_limits(str(name))
            values = np.asarray(variable.values)
            if values.dtype.kind == "f" and ((values < low) | (values > high)).any():
                problems.append((f"{name} outside of {low:g} to {high:g}", [str(name)]))
    try:
        write_store(dataset, out / "log.zarr")
        for check in verify_logs(LogStore(str(out / "log.zarr"))).checks:
            problems += [
                (f"{check.name}: {NUMBER.sub('#', problem)}", [n for n in names if n in problem])
                for problem in check.problems
            ]
    except Exception as error:
        verdict.failures.append(f"{place(error)}: {str(error)[:200]}")
    for problem, of in problems:
        if not suspect or any(name not in suspect for name in of):
            verdict.failures.append(f"not told: {problem}")
    if mutant.operation == UNDAMAGED and layout.isdigit():
        if report.rows != Sound().dives:
            verdict.failures.append(f"{report.rows} dives of undamaged logs, not {Sound().dives}")
        verdict.failures += [f"suspect undamaged logs: {e.subject}: {e.detail}"
                             for e in report.entries if e.action == "suspect"]  # fmt: skip


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
        """Which limit the process is beyond."""
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
                    except EOFError:
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
    parser.add_argument("--json", type=Path, help="file of all verdicts")
    options = parser.parse_args()
    layouts = [*LAYOUTS]
    if options.real:
        layouts += [f"{kind}:{one}" for kind, every in REAL.items() for one in every]
    if options.kinds:
        layouts = [o for o in layouts if o.partition(":")[0] in options.kinds.split(",")]
    every = map(Mutant.parse, options.only or ()) if options.only else mutants(
        options.mutants, options.seed, layouts
    )  # fmt: skip
    verdicts = []
    for one in run(every, workers=options.workers, seconds=options.seconds, real=options.real):
        verdicts.append(one)
        for failure in one.failures:
            print(f"{one.mutant.name} ({one.file}): {failure}", flush=True)
        if options.only:
            print(one, flush=True)
    if options.json:
        options.json.write_text(json.dumps([dataclasses.asdict(one) for one in verdicts]))
    kinds = {one.mutant.kind for one in verdicts}
    for kind in sorted(kinds):
        of = [one for one in verdicts if one.mutant.kind == kind]
        count = Counter("failed" if one.failures else one.outcome for one in of)
        said = ", ".join(f"{n} {outcome}" for outcome, n in sorted(count.items()))
        raised = sum(bool(one.raised) for one in of)
        print(f"{kind}: {len(of)} mutants: {said}; a reader raised in {raised}")
    causes: dict[str, list[str]] = {}
    for one in verdicts:
        for cause in dict.fromkeys(f"reader raised {cause}" for cause in one.raised):
            causes.setdefault(cause, []).append(one.mutant.name)
    for cause, found in sorted(causes.items(), key=lambda item: -len(item[1])):
        print(f"{len(found):5d} {cause} ({found[0]})")
    most = max((one.bytes for one in verdicts), default=0)
    slowest = max((one.seconds for one in verdicts), default=0.0)
    failed = sum(bool(one.failures) for one in verdicts)
    print(f"{len(verdicts)} mutants, {failed} failed; at most {most / 1e6:.0f} MB, {slowest:.1f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
