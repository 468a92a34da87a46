"""Real logs with truth: public methods, the identified twin and networks side by side.

`python -m benchmarks.real_logs FOLDER` runs the tasks that the logs of FOLDER allow:

- speed: through the water against a DVL (`benchmarks.real_logs.dvl`);
- depth rate and dead reckoning between fixes (`benchmarks.real_logs.fixes`);
- surge against an on-board current profiler (`benchmarks.real_logs.adcp`);
- speed by networks trained on other deployments and simulation (`benchmarks.real_logs.left_out`);
- surge and sway of propelled vehicles (`benchmarks.real_logs.propelled`).

No method is fitted to the dives that it is scored on. A method that is fitted to the depth rate
only may use all dives, since the score is of another quantity.
"""
