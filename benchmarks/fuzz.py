"""Fuzz test of importers: each damaged log must be imported soundly or refused in one line.

    python -m benchmarks.fuzz --mutants 5000 --seed 1 --seconds 3600 --workers 2

A mutant's name KIND:LAYOUT/OPERATION/SEED reproduces it: `--only NAME`. A mutant fails on an error
that is no `TwinError`, a message of several lines, an unreported value outside its limits, a
warning, a print, a file outside the store's folder, more than 60 s or 0.7 GB without the libraries,
or a crash of the process. Undamaged logs must give all their dives, sound. `--real FOLDER` damages
real logs too.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import hashlib
import itertools
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from json import dumps, loads
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import command
from benchmarks.processes import DONE, ROOT, fork, wait

sys.path.insert(0, str(ROOT / "tests"))

import pd0_files
from logs import SOUND

from benchmarks.damage import COLUMNS, OPERATIONS, damage, damaged_flight
from factory import samples

LONGEST_S, MOST_BYTES, KILLED_BYTES = 60.0, 7 * 10**8, 3 * 10**9
"""Limits of one import: processor time [s] and memory [byte] without the libraries'; and the memory
at which it is stopped"""
DOPPLER = "pd0:0"
"""Layout of an instrument, which logs no flight of a vehicle"""
LAYOUTS = [f"{kind}:{k}" for kind, some in samples.formats().items() for k in range(len(some))]
LAYOUTS += [DOPPLER]
BARE = ("slocum:1", "mcap:0", "rosbag2:0", "ardusub:0", "lsf:0", "dorado:0", DOPPLER)
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
"""Patterns of files in the folder of `--real`, by format"""
CORPUS = ROOT / "tests" / "data" / "mutants.json"
"""Names of mutants that failed once"""
UNDAMAGED = "none"
"""Operation that changes nothing"""
NUMBER = re.compile(r"-?\d[\d.e+-]*")


@dataclasses.dataclass(frozen=True)
class Mutant:
    """Damaged log."""

    layout: str
    """FORMAT:NUMBER of a writer, or FORMAT:PATTERN of real logs."""
    operation: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.layout}/{self.operation}/{self.seed}"

    @classmethod
    def parse(cls, name: str) -> Mutant:
        """Make the mutant of that name."""
        layout, operation, seed = name.rsplit("/", 2)
        return cls(layout, operation, int(seed))

    @property
    def kind(self) -> str:
        return self.layout.partition(":")[0]


@dataclasses.dataclass
class Verdict:
    """Outcome of the import of a mutant."""

    mutant: Mutant
    outcome: str = "read"
    """read, refused, unfit (the operation changes nothing in these files) or failed"""
    file: str = ""
    failures: list[str] = dataclasses.field(default_factory=list)
    raised: list[str] = dataclasses.field(default_factory=list)
    """Errors of readers for which a file was left out, and the place of each error"""
    seconds: float = 0.0
    bytes: int = 0


def drawn(count: int, seed: int, layouts: Iterable[str] = LAYOUTS) -> Iterator[Mutant]:
    """Sample mutants: every layout undamaged, then every layout and operation in turn."""
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
    """Write the damaged log; return the damaged file's name, or "" if no damage applies."""
    random = np.random.default_rng([mutant.seed, *mutant.name.encode()])
    pattern = mutant.layout.partition(":")[2]
    flying = mutant.operation == "flight"
    if not pattern.isdigit():
        assert real is not None, f"{mutant.name} needs --real"
        for path in sorted(real.glob(pattern)):
            shutil.copyfile(path, folder / path.name)
    elif mutant.layout == DOPPLER:
        dives = [one for k in (0, 1) for one in pd0_files.yo(80, start=pd0_files.START + 900.0 * k)]
        turned = [{**one, "heading": 40.0 + 0.3 * k} for k, one in enumerate(dives)]
        pd0_files.write(folder / "yo.pd0", turned)
        if flying:
            return ""
    else:
        flight = damaged_flight(random) if flying else SOUND
        try:
            layout = samples.formats()[mutant.kind][int(pattern)]
            samples.write(mutant.kind, folder, flight, layout=layout)
        except Exception:  # the format cannot hold such a value
            if not flying:
                raise
            return ""
    if flying or mutant.operation == UNDAMAGED:
        return "all"
    with contextlib.suppress(Exception):  # the format's library refuses such a file
        return damage(random, folder, mutant.operation)
    return ""


# --- one import ----------------------------------------------------------------------------------


def place(error: BaseException) -> str:
    """Module and line of the project where an error arose, and its type."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if f.filename.startswith(str(ROOT)) and "benchmarks" not in f.filename]
    last = own[-1] if own else frames[-1]
    return f"{_short(last.filename)}:{last.lineno} {type(error).__name__}"


def _short(filename: str) -> str:
    """Path of a file in the project or in its library."""
    return filename.removeprefix(f"{ROOT}/").rpartition("site-packages/")[2]


def contents(folder: Path) -> dict[str, str]:
    """Digests of all files in a folder and its subfolders."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def judge(mutant: Mutant, verdict: Verdict, folder: Path, written: list[str]) -> None:
    """Import a prepared log and check all conditions."""
    from factory.importing import deployment_log, import_logs
    from factory.soundness import verify_logs
    from twin.errors import TwinError
    from twin.records.attributes import SUSPECT
    from twin.records.logged import LogStore
    from twin.records.schema import VARIABLES
    from twin.records.schema.limits import recorded_limits
    from twin.records.store import write_store

    logs, out = folder / "logs", folder / "out"
    layout = mutant.layout.partition(":")[2]
    given = samples.options(mutant.kind, logs) if layout.isdigit() else {}
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
            dataset, report = import_logs(mutant.kind, [logs], **given)
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
        gc.collect()  # finds unclosed files
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
    names = [str(name) for name in dataset.data_vars if name in VARIABLES]
    problems: list[tuple[str, list[str]]] = []
    for name in names:
        low, high = recorded_limits(name)
        values = np.asarray(dataset[name].values)
        if values.dtype.kind == "f" and ((values < low) | (values > high)).any():
            problems.append((f"{name} outside of {low:g} to {high:g}", [name]))
    try:
        write_store(dataset, out / "log.zarr")
        for check in verify_logs(LogStore(str(out / "log.zarr"))).checks:
            problems += [
                (f"{check.name}: {NUMBER.sub('#', problem)}", [n for n in names if n in problem])
                for problem in check.problems
                if check.name != SUSPECT or not report.suspect
            ]
    except Exception as error:
        verdict.failures.append(f"{place(error)}: {str(error)[:200]}")
    for problem, of in problems:
        if not suspect or any(name not in suspect for name in of):
            verdict.failures.append(f"not told: {problem}")
    if mutant.operation == UNDAMAGED and layout.isdigit():
        if report.rows != SOUND.dives:
            verdict.failures.append(f"{report.rows} dives of undamaged logs, not {SOUND.dives}")
        verdict.failures += [f"suspect undamaged logs: {e.subject}: {e.detail}"
                             for e in report.entries if e.action == "suspect"]  # fmt: skip


# --- many, a process each ------------------------------------------------------------------------


def work(mutant: Mutant, folder: Path, real: Path | None) -> None:
    """Judge a mutant in this process, and write the verdict to the folder."""
    resource.setrlimit(resource.RLIMIT_CPU, (round(LONGEST_S) + 15, resource.RLIM_INFINITY))
    sys.dont_write_bytecode = True
    written: list[str] = []
    allowed = ("/dev/", "/proc/", str(folder / "temporary"), str(folder / "out"))

    def watch(event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(given[0], str | bytes) and isinstance(given[2], int):
            path, change = os.fsdecode(given[0]), given[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        elif event in ("os.rename", "os.mkdir", "os.symlink", "os.link"):
            path, change = os.fsdecode(given[0 if event == "os.mkdir" else 1]), 1
        else:
            return
        path = os.path.realpath(path)
        ours = path.startswith(allowed) or "__pycache__" in path
        if change and not ours and not (event == "os.mkdir" and Path(path).is_dir()):
            written.append(path)

    sys.addaudithook(watch)
    printed = (folder / "printed").open("wb+", buffering=0)
    for number in (1, 2):
        os.dup2(printed.fileno(), number)
    for name in ("logs", "out", "temporary"):
        (folder / name).mkdir(parents=True)
    tempfile.tempdir = str(folder / "temporary")
    gc.freeze()  # leak checks then cover later objects only
    verdict = Verdict(mutant)
    begun = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            verdict.file = prepare(mutant, folder / "logs", real)
        begun = time.process_time()
        with contextlib.suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")  # resets the peak
        held = _memory("VmRSS")
        if verdict.file:
            judge(mutant, verdict, folder, written)
        verdict.bytes = _memory("VmHWM") - held
    except Exception as error:
        verdict.failures.append(f"harness {place(error)}: {str(error)[:200]}")
    verdict.seconds = time.process_time() - begun
    if verdict.bytes > MOST_BYTES:
        verdict.failures.append(f"more than {MOST_BYTES / 1e9:g} GB")
    if verdict.seconds > LONGEST_S:
        verdict.failures.append(f"more than {LONGEST_S:g} s")
    if printed.tell():
        printed.seek(0)
        verdict.failures.append(f"printed {printed.read(200)!r}")
    verdict.failures = list(dict.fromkeys(verdict.failures))
    verdict.outcome = verdict.outcome if verdict.file else "unfit"
    (folder / "verdict").write_text(dumps(dataclasses.asdict(verdict)))


def _memory(word: str) -> int:
    """[byte] Memory of this process from /proc; 0 on systems without /proc."""
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(next(line.split()[1] for line in lines if line.startswith(word)))
    return 0


def run(
    given: Iterable[Mutant],
    *,
    workers: int = 1,
    seconds: float = 1e9,
    real: Path | None = None,
    target: Callable[[Mutant, Path, Path | None], object] = work,
) -> Iterator[Verdict]:
    """Judge mutants, each in a fork; no mutant starts after `seconds`."""
    end, rest, busy = time.monotonic() + seconds, iter(given), dict[int, tuple[Mutant, Path]]()
    known = set[str]()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as base:
        try:
            while True:
                while len(busy) < workers and time.monotonic() < end:
                    if (mutant := next(rest, None)) is None:
                        break
                    if mutant.layout not in known:
                        known.add(mutant.layout)
                        _load(mutant)
                    folder = Path(tempfile.mkdtemp(dir=base))
                    busy[fork(partial(target, mutant, folder, real))] = mutant, folder
                if not busy:
                    return
                time.sleep(0.01)
                for process, (mutant, folder) in list(busy.items()):
                    found, status = os.waitpid(process, os.WNOHANG)
                    if found:
                        del busy[process]
                        yield _left(mutant, folder, os.waitstatus_to_exitcode(status))
                        shutil.rmtree(folder)
                    elif _held(process) > KILLED_BYTES:
                        (folder / "stopped").touch()
                        os.kill(process, signal.SIGKILL)
        finally:
            for process in busy:
                wait(process, kill=True)


def _load(mutant: Mutant) -> None:
    """Import an undamaged log here, so that forks find libraries and compiled code loaded."""
    import factory.soundness  # noqa: F401
    from factory.importing import import_logs

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with contextlib.suppress(Exception):
            prepare(dataclasses.replace(mutant, operation=UNDAMAGED), Path(folder), None)
            import_logs(mutant.kind, [folder], **samples.options(mutant.kind, folder))


def _held(process: int) -> int:
    """[byte] Memory of a process; 0 after its end."""
    with contextlib.suppress(OSError):
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize()
    return 0


def _left(mutant: Mutant, folder: Path, code: int) -> Verdict:
    """Verdict that a process wrote, or the failure that it ended without one."""
    path = folder / "verdict"
    if code == DONE and path.exists():
        return Verdict(**loads(path.read_text()) | {"mutant": mutant})
    why = f"its process ended with {code}"
    if code == -signal.SIGXCPU:
        why = f"more than {LONGEST_S:g} s, stopped"
    elif (folder / "stopped").exists():
        why = f"more than {KILLED_BYTES / 1e9:g} GB, stopped"
    return Verdict(mutant, failures=[why])


def main(
    mutants: int = 1000,
    seed: int = 1,
    seconds: float = 1e9,
    workers: int = 1,
    kinds: str = "",
    only: tuple[str, ...] = (),
    real: Path | None = None,
    json: Path | None = None,
) -> int:
    """Judge mutants, with exit code 1 if one failed.

    Args:
      mutants: number of mutants.
      seconds: time after which no mutant starts.
      kinds: formats of logs, separated by commas.
      only: names of mutants.
      real: folder of real logs, damaged too.
      json: file that gets a line for each mutant.
    """
    layouts = [*LAYOUTS]
    if real:
        layouts += [f"{kind}:{one}" for kind, every in REAL.items() for one in every]
    if kinds:
        layouts = [o for o in layouts if o.partition(":")[0] in kinds.split(",")]
    every = map(Mutant.parse, only) if only else drawn(mutants, seed, layouts)
    verdicts: list[Verdict] = []
    with contextlib.suppress(KeyboardInterrupt):  # finished mutants are reported
        for one in run(every, workers=workers, seconds=seconds, real=real):
            verdicts.append(one)
            for failure in one.failures:
                print(f"{one.mutant.name} ({one.file}): {failure}", flush=True)
            if only:
                print(one, flush=True)
            if json:
                with json.open("a") as lines:
                    lines.write(dumps(dataclasses.asdict(one)) + "\n")
    if verdicts:
        report(verdicts)
    return 1 if any(one.failures for one in verdicts) else 0


def report(verdicts: list[Verdict]) -> None:
    """Print outcomes by format, causes with a mutant of each, and the costliest mutants."""
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
    sys.exit(command.run(main))
