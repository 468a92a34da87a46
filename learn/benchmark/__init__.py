"""Benchmark: real logs with truth, public methods, the identified twin and networks side by side.

`learn benchmark real FOLDER` runs whatever tasks the logs of FOLDER allow:

- speed: through the water against a DVL (`learn.benchmark.dvl`);
- depth rate and dead reckoning between fixes (`learn.benchmark.fixes`);
- surge against an on-board current profiler (`learn.benchmark.adcp`).

Whatever is fitted never sees the dives that it is scored on; what is fitted to the depth rate alone
may see all of it, since the score is another quantity.
"""

from learn.benchmark.row import Row

__all__ = ["Row"]
