"""Versions: commands on stores that other versions wrote: read, or refused in one line."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.kills.processes import small_recipe
from factory.__main__ import PROGRAM as FACTORY
from factory.generation.generation import generate
from learn.__main__ import PROGRAM as LEARN
from twin.cli.program import Program
from twin.records.attributes import SETTINGS, VERSION
from twin.records.storage.sharded import METADATA

OLD = Path(__file__).parents[2] / "tests" / "data" / "e2ff189"
"""Stores of the commit of that name, of version 0.1.0"""
NEWER = 99


def check_versions(folder: Path) -> dict[str, Any]:
    """Run every check; a row of the table, with what went wrong."""
    begun, lost = time.perf_counter(), []
    place = folder / "versions"
    place.mkdir()
    checks = [*_old(place), *_newer(place)]
    for name, check in checks:
        problem = check()
        if problem is not None:
            lost.append(f"{name}: {problem}")
    return {
        "kind": "versions",
        "done": len(checks),
        "survived": len(checks) - len(lost),
        "lost": lost,
        "seconds": time.perf_counter() - begun,
    }


Check = tuple[str, Callable[[], str | None]]


def _old(place: Path) -> list[Check]:
    """Stores of version 0.1.0 are read; what was begun with them is not mixed with new missions."""
    simulated, logged = place / "simulated.zarr", place / "logged.zarr"
    for store in (simulated, logged):
        shutil.copytree(OLD / store.name, store)
    return [
        *(_works(FACTORY, command, store) for command in ("info", "verify")
          for store in (simulated, logged)),
        _refused(FACTORY, ["replay", simulated], "physics"),
        _refused(FACTORY, ["repair", simulated], "older glider-twin"),
        _refused(FACTORY, ["generate", "--resume", "--out", simulated], "other settings"),
        _refused(FACTORY, ["generate", "--resume", "--out", logged], "logs"),
    ]  # fmt: skip


def _newer(place: Path) -> list[Check]:
    """Stores of a schema that is not known are refused with both versions."""
    store = place / "newer.zarr"
    generate(small_recipe(0.2), store, workers=1)
    path = store / METADATA
    document = json.loads(path.read_text())
    document["attributes"][VERSION] = NEWER
    settings = json.loads(document["attributes"][SETTINGS])
    settings["versions"]["glider-twin"] = f"{NEWER}.0"
    document["attributes"][SETTINGS] = json.dumps(settings)
    path.write_text(json.dumps(document))
    return [
        *(
            _refused(program, words, f"version {NEWER}", "upgrade glider-twin to 99.0")
            for program, words in (
                (FACTORY, ["info", store]),
                (FACTORY, ["generate", "--resume", "--out", store]),
                (FACTORY, ["replay", store]),
                (FACTORY, ["plot", store, "--out", place / "out.png"]),
                (FACTORY, ["export", store, "--to", "og1", "--out", place / "out"]),
                (LEARN, ["fit", store, "--name", "newer"]),
            )
        ),
    ]


def _works(program: Program, command: str, store: Path) -> Check:
    def check() -> str | None:
        code, text = _run(program, [command, store])
        return None if code == 0 else f"exit code {code}: {text}"

    return f"{command} {store.name}", check


def _refused(program: Program, words: Sequence[object], *told: str) -> Check:
    def check() -> str | None:
        code, text = _run(program, words)
        lines = text.strip().splitlines()
        if code == 2 and len(lines) == 1 and all(part in text for part in told):
            return None
        return f"exit code {code}: {text}"

    return " ".join(map(str, words)), check


def _run(program: Program, words: Sequence[object]) -> tuple[int, str]:
    """Exit code and what was said on standard error."""
    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        code = program.main([str(word) for word in words])
    return code, said.getvalue()
