"""`twin bench`: cost of the physics, side by side in one run."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from twin.cli.console import Console, JsonOption
from twin.cli.options import EngineOption


@dataclass(frozen=True, kw_only=True)
class Bench(EngineOption, JsonOption):
    """Time a step with and without our water, and a batch of closed-loop missions; of lanes such a
    batch, and their arithmetic alone.

    Examples:

        twin bench --threads 2
        twin bench --engine lanes --vehicle seaglider
    """

    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file; :PRESET behind it takes a preset of it"""
    threads: int = 0
    """threads of the batch; 0 takes every core"""
    rounds: int | None = None
    """pairs of stretches timed in MuJoCo [default: 40]"""

    def run(self, console: Console) -> int:
        """Measure and print."""
        import os

        from twin import load_vehicle
        from twin.checks import bench
        from twin.errors import InputError

        if self.threads < 0 or (self.rounds is not None and self.rounds < 1):
            raise InputError("--threads must be 0 or more and --rounds 1 or more")
        threads = self.threads or os.cpu_count() or 1
        if self.engine == "lanes":
            if self.rounds is not None:
                raise InputError("--rounds are of MuJoCo's stretches: leave it out with lanes")
            return self._lanes(threads, console)
        given = {} if self.rounds is None else {"rounds": self.rounds}
        result = bench(load_vehicle(self.vehicle), threads=threads, **given)
        console.answer(**asdict(result))
        low, high = result.overhead_quartiles
        console.pairs(
            {
                "step with our water": f"{result.us_per_step:.2f} us",
                "bare MuJoCo step": f"{result.us_per_step_bare_mujoco:.2f} us",
                "without the clock of its timers": f"{result.us_per_step_untimed:.2f} us",
                "ratio to the bare step": f"{result.overhead_ratio:.3f} (quartiles {low:.3f} to "
                f"{high:.3f} of {result.pairs} pairs)",
                "ratio to it without the clock": f"{result.overhead_ratio_untimed:.3f}",
                "step with guidance and log": f"{result.us_per_step_with_guidance:.2f} us",
                "time step": f"{result.timestep_s:g} s",
                f"batch of {result.missions} missions on {result.threads} threads": (
                    f"{result.times_real_time:,.0f} times real time"
                ),
                "limit (bare steps on these threads)": (f"{limit(result):,.0f} times real time"),
            },
            title="Cost of the physics (medians of pairs measured in turn)",
        )
        return 0

    def _lanes(self, threads: int, console: Console) -> int:
        """Closed-loop missions side by side."""
        from twin import load_vehicle
        from twin.checks import bench_lanes

        result = bench_lanes(load_vehicle(self.vehicle), threads=threads)
        console.answer(engine=self.engine, vehicle=self.vehicle, **asdict(result))
        console.pairs(
            {
                f"{result.missions} missions on {result.threads} threads": (
                    f"{result.times_real_time:,.0f} times real time"
                ),
                "one block on one core": f"{result.times_real_time_one_core:,.0f} times real time",
                "from scenarios to signals": (
                    f"{result.times_real_time_to_signals:,.0f} times real time"
                ),
                "limit of one core (arithmetic alone)": (
                    f"{result.limit_one_core:,.0f} times real time"
                ),
                "part of that limit": f"{result.part_of_limit:.2f}",
                "a vehicle's step": f"{result.ns_per_step:.0f} ns",
                "time step": f"{result.timestep_s:g} s",
            },
            title="Cost of lanes: sheared current, tabulated density, guidance, log at 2 Hz",
        )
        return 0


def limit(result) -> float:  # type: ignore[no-untyped-def]
    """Times real time if a batch did nothing but bare MuJoCo steps."""
    return result.threads * result.timestep_s / (result.us_per_step_untimed * 1e-6)
