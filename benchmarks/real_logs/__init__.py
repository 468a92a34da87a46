"""Real logs with truth: public methods, the identified twin and networks side by side.

`python -m benchmarks.real_logs FOLDER` runs whatever tasks the logs of FOLDER allow:

- speed: through the water against a DVL (`benchmarks.real_logs.dvl`);
- depth rate and dead reckoning between fixes (`benchmarks.real_logs.fixes`);
- surge against an on-board current profiler (`benchmarks.real_logs.adcp`);
- speed of one deployment by what others and simulation teach (`benchmarks.real_logs.left_out`).

Whatever is fitted never sees the dives that it is scored on; what is fitted to the depth rate alone
may see all of it, since the score is another quantity.
"""
