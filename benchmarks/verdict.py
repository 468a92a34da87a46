"""Verdict: what an import made of a damaged log, and all of it that may not be.

A problem of the store is none where the import says that its variable is suspect.
"""

from __future__ import annotations

import dataclasses
import gc
import hashlib
import re
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from logs import SOUND

from factory import samples

ROOT = Path(__file__).resolve().parents[1]
UNDAMAGED = "none"
"""Operation that changes nothing"""
NUMBER = re.compile(r"-?\d[\d.e+-]*")


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
    """Outcome of the import of a mutant."""

    mutant: Mutant
    outcome: str = "read"
    """read, refused, unfit (the operation changes nothing of such files) or failed"""
    file: str = ""
    failures: list[str] = dataclasses.field(default_factory=list)
    raised: list[str] = dataclasses.field(default_factory=list)
    """Errors of readers for which a file was left out, and what it was told by"""
    seconds: float = 0.0
    bytes: int = 0


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
        gc.collect()  # files that nobody closed
        gc.freeze()  # the libraries stay: the next time only what is new is looked through
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
