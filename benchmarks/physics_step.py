"""Physics step: cost of a step with and without our water, and of missions in a batch.

    python -m benchmarks.physics_step [--json]

The limit is the bare MuJoCo step of the same model on the same threads in the same run, without
MuJoCo's timers, which the twin disables.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys

from benchmarks.figures import KEEPING, measured
from twin.__main__ import PROGRAM


def main(words: list[str]) -> int:
    """Run `twin bench`; print JSON if figures are kept."""
    if not KEEPING["on"]:
        return PROGRAM.main(["bench", *words])
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = PROGRAM.main(["bench", "--json", *words])
    print(said.getvalue(), end="")
    found = json.loads(said.getvalue())
    bare = found["threads"] * found["timestep_s"] / found["us_per_step_untimed"] * 1e6
    measured(
        "physics_step",
        ratio=found["overhead_ratio"],
        ratio_untimed=found["overhead_ratio_untimed"],
        batch=found["times_real_time"],
        batch_share=found["times_real_time"] / bare,
    )
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
