"""Pytest server: a process that imports what most tests need and forks for each run of pytest.

Imports of other packages take seconds, as much as the tests of most mutants. Nothing of the
packages under test is imported here: each fork takes it anew from the folder that it is told.

Orders are lines of JSON on standard input: the `root` to run in, pytest's `arguments`, variables of
the `environment` (null: removed), `seconds` of a processor (null: no limit) and the file `output`
for what pytest says. The answers are lines too: the process's number (it leads a group of its own)
and, when it has ended, its exit code, below 0 for a signal.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import resource
import sys
from pathlib import Path
from typing import Any, NoReturn

IMPORTED = (
    *("numpy", "scipy.signal", "scipy.optimize", "scipy.interpolate", "scipy.stats"),
    *("pandas", "xarray", "zarr", "numba", "pytest", "hypothesis", "tyro", "torch"),
)


def run(order: dict[str, Any]) -> NoReturn:
    """Become pytest."""
    os.setsid()
    output = os.open(order["output"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (1, 2):
        os.dup2(output, stream)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    if order["seconds"] is not None:
        resource.setrlimit(resource.RLIMIT_CPU, (order["seconds"], order["seconds"]))
    for name, value in order["environment"].items():
        os.environ.pop(name, None)
        if value is not None:
            os.environ[name] = value
    os.chdir(order["root"])
    own = Path(__file__).resolve().parent
    others = [path for path in sys.path if Path(path).resolve() not in (own, own.parent)]
    sys.path[:] = [order["root"], *others]
    sys.argv[:] = ["pytest", *order["arguments"]]
    import pytest
    from numba.core.config import reload_config

    reload_config()
    raise SystemExit(pytest.main(order["arguments"]))


def serve() -> None:
    """Take orders until there are no more."""
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()  # none of it is garbage: not looked at again
    for line in sys.stdin:
        order = json.loads(line)
        child = os.fork()
        if child == 0:
            run(order)
        print(child, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == "__main__":
    serve()
