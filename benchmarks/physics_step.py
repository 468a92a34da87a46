"""Cost of the physics: one step with and without our water, and missions in a batch.

    python -m benchmarks.physics_step [--json]

The limit is the bare MuJoCo step of the same model on the same threads in the same run. The
project asks for a ratio of at most 1.25 and at least 30 000 times real time on 2 threads.
"""

from __future__ import annotations

import sys

from twin.__main__ import PROGRAM

if __name__ == "__main__":
    sys.exit(PROGRAM.main(["bench", *sys.argv[1:]]))
