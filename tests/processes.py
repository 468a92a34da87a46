"""Processes of Python's that tests start."""

import os
import subprocess
import sys

from patience import HANG_S


def python(*words, cwd=None, env=os.environ, **variables) -> subprocess.CompletedProcess[str]:
    """A process of these words that ended; `variables` join its environment."""
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd, env={**env, **variables}, capture_output=True, text=True, timeout=HANG_S,
    )  # fmt: skip
