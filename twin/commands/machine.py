"""Commands `twin version`, `compile` and `bench`: versions, compilation, speed of a machine."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from twin.cli.console import Console, JsonOption
from twin.cli.options import EngineOption

REPORTED = ("mujoco", "dm-control", "numba", "numpy", "scipy", "xarray", "zarr", "torch")
"""Names of the distributions whose version can change a result."""
PROCESSES = 2
ENGINES = ("mujoco", "lanes")


@dataclass(frozen=True, kw_only=True)
class Version(JsonOption):
    """Versions of this package, of Python and of the libraries that can change a result.

    Example:

        twin version --json
    """

    def run(self, console: Console) -> int:
        """Print the versions; a library that is not installed has none."""
        import platform
        from importlib import metadata

        from twin.version import __version__

        versions: dict[str, str | None] = {
            "glider-twin": __version__,
            "python": platform.python_version(),
        }
        for name in REPORTED:
            try:
                versions[name] = metadata.version(name)
            except metadata.PackageNotFoundError:
                versions[name] = None
        console.pairs(versions)
        console.answer(**versions)
        return 0


@dataclass(frozen=True, kw_only=True)
class CompileVehicles(JsonOption):
    """Compile the code of the shipped vehicles in both engines, once for this processor.

    Without this command the first flight compiles the code of its vehicle. Compiled code is cached;
    after a change of the source only the affected functions are compiled again.

    Examples:

        twin compile
        twin compile --vehicle glider
    """

    vehicle: tuple[str, ...] = ()
    """shipped vehicle names or paths of MJCF files; none: every shipped vehicle"""

    def run(self, console: Console) -> int:
        """Fly each vehicle for a second, in two processes, and report the elapsed time."""
        import multiprocessing
        import time
        from concurrent.futures import ProcessPoolExecutor

        from twin import load_vehicle, vehicle_names

        shipped = dict.fromkeys(name.partition(":")[0] for name in vehicle_names())
        names = self.vehicle or tuple(sorted(shipped, key=lambda name: name != "glider"))
        for name in self.vehicle:
            load_vehicle(name)  # an unknown vehicle is reported before anything is compiled
        begun = time.monotonic()
        context = multiprocessing.get_context("spawn")  # a fresh process, without imported modules
        with ProcessPoolExecutor(PROCESSES, mp_context=context) as pool:
            # the engines share little code: each process begins with one engine, then takes any job
            jobs = [(name, engine) for name in names for engine in ENGINES]
            waiting = [pool.submit(fly_a_second, *job) for job in jobs]
            try:
                for one in waiting:
                    one.result()
            except BaseException:  # also Ctrl-C: jobs that have not begun are cancelled
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        elapsed = time.monotonic() - begun
        console.say(f"compiled for {', '.join(names)}: {elapsed:.0f} s")
        console.answer(vehicles=names, seconds=elapsed)
        return 0


def fly_a_second(name: str, engine: str) -> None:
    """Compile and cache the code that a flight with sensors and `twin trim` need."""
    import contextlib
    import logging

    import twin
    from twin.errors import TwinError
    from twin.mission import steady_glide

    logging.disable(logging.WARNING)  # messages about compiling are no news here
    twin.simulate(
        vehicle=name,
        engine=engine,
        duration=1.0,
        sensors="field",
        current="uniform:0.1,0.0",
        floor="depth:1000",
    )
    if engine == "mujoco":
        vehicle = twin.load_vehicle(name)
        pitch, net_mass = vehicle.usual_glide
        with contextlib.suppress(TwinError):  # a propelled vehicle has no usual dive
            steady_glide(vehicle, -pitch, net_mass)
            twin.trim(vehicle, 0.0, 0.0, net_mass)


@dataclass(frozen=True, kw_only=True)
class Bench(EngineOption, JsonOption):
    """Time a MuJoCo step with and without our hydrodynamics, and a batch of closed-loop missions.
    With --engine lanes, time such a batch and the bare arithmetic of lanes.

    Examples:

        twin bench --threads 2
        twin bench --engine lanes --vehicle seaglider
    """

    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file; :PRESET after it selects a preset in it"""
    threads: int = 0
    """number of threads of the batch; 0 takes every core"""
    rounds: int | None = None
    """number of pairs of timed stretches in MuJoCo [default: 40]"""

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
        bare = result.threads * result.timestep_s / (result.us_per_step_untimed * 1e-6)
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
                "limit (bare steps on these threads)": f"{bare:,.0f} times real time",
            },
            title="Cost of the physics (medians of pairs measured in turn)",
        )
        return 0

    def _lanes(self, threads: int, console: Console) -> int:
        """Time the batched engine on closed-loop missions."""
        from twin import load_vehicle
        from twin.checks import bench_lanes

        result = bench_lanes(load_vehicle(self.vehicle), threads=threads)
        times = "{:,.0f} times real time".format
        console.answer(engine=self.engine, vehicle=self.vehicle, **asdict(result))
        console.pairs(
            {
                f"{result.missions} missions on {result.threads} threads": times(
                    result.times_real_time
                ),
                "one block on one core": times(result.times_real_time_one_core),
                "from scenarios to signals": times(result.times_real_time_to_signals),
                "limit of one core (arithmetic alone)": times(result.limit_one_core),
                "part of that limit": f"{result.part_of_limit:.2f}",
                "a vehicle's step": f"{result.ns_per_step:.0f} ns",
                "time step": f"{result.timestep_s:g} s",
            },
            title="Cost of lanes: sheared current, tabulated density, guidance, log at 2 Hz",
        )
        return 0
