"""Slurm's scancel of the jobs that `sbatch.py` started in the background."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from pathlib import Path

for number in sys.argv[1:]:
    with contextlib.suppress(OSError, ValueError):
        os.killpg(
            int((Path(os.environ["SLURM_STATE"]) / f"{number}.pid").read_text()), signal.SIGKILL
        )
