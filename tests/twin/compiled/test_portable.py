"""Functions compiled once more, with elementary ones in place of the C library's."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import uuid
from math import tan
from pathlib import Path

import numpy as np

from twin.compiled import elementary, generate, jit
from twin.compiled.portable import calls_math, portable


@jit
def inner(x):
    return math.cos(x) + tan(x)


@jit
def outer(x, shift=1.0):
    return inner(x) if x < 1.0 and not math.isnan(x) else math.floor(x) + shift


@jit
def plain(x):
    return math.sqrt(x) + math.pi


table = generate(
    "of_kinds", ("x",), lambda: ("return kernel(x)", {"kernel": inner}), module=__name__
)


def test_the_same_source_with_elementary_functions() -> None:
    x = np.random.default_rng(1).uniform(-1.0, 1.0, 500).tolist()
    mine = [elementary.cos(v) + elementary.tan(v) for v in x]
    assert [portable(outer)(v) for v in x] == mine
    assert [portable(table)(v) for v in x] == mine
    assert [outer(v) for v in x] == [math.cos(v) + math.tan(v) for v in x] != mine
    assert portable(outer)(2.5) == outer(2.5) == 3.0  # a default, and what stays of math
    assert calls_math(outer)
    assert calls_math(table)
    assert not calls_math(plain)
    assert portable(outer) is portable(outer)


def test_another_processor_has_compiled_code_of_its_own(tmp_path: Path) -> None:
    """numba's switches say which; the cache must not hand it code with other instructions."""
    name = f"module_{uuid.uuid4().hex}"
    module = tmp_path / f"{name}.py"
    module.write_text("from twin.compiled import jit\n\n@jit\ndef twice(x):\n    return x + x\n")
    os.utime(module, (1e9, 1e9))  # what was written after the process began is not kept
    script = (
        f"from {name} import twice; twice(1.0); "
        "print(sum(twice.dispatcher.stats.cache_hits.values()))"
    )

    def hits(**switches: str) -> int:
        path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": path, **switches}
        words = [sys.executable, "-c", script]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
        return int(done.stdout)

    other = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    assert [hits(), hits(), hits(**other), hits(**other), hits()] == [0, 1, 0, 1, 1]
