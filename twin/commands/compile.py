"""`twin compile`: the code of the shipped vehicles compiled and kept, so that no flight waits."""

from __future__ import annotations

from dataclasses import dataclass

from twin.cli.console import Console, JsonOption

PROCESSES = 2
ENGINES = ("mujoco", "lanes")


@dataclass(frozen=True, kw_only=True)
class CompileVehicles(JsonOption):
    """Compile what the shipped vehicles fly with, in both engines, once for this processor.

    Otherwise the first flight does it for its own vehicle. What is compiled already is found again
    and takes no time; after a change of the code only what it reaches is compiled.

    Examples:

        twin compile
        twin compile --vehicle glider
    """

    vehicle: tuple[str, ...] = ()
    """shipped vehicle names or paths of MJCF files; none: every shipped vehicle"""

    def run(self, console: Console) -> int:
        """Fly a second with each, in two processes, and say how long it took."""
        import multiprocessing
        import time
        from concurrent.futures import ProcessPoolExecutor

        from twin import load_vehicle
        from twin.compiled.folder import cache_root
        from twin.vehicle.presets import shipped_files

        names = self.vehicle or tuple(sorted(shipped_files(), key=lambda name: name != "glider"))
        for name in names:
            load_vehicle(name)  # what is no vehicle is told before anything is compiled
        begun = time.monotonic()
        context = multiprocessing.get_context("spawn")  # fresh: what was imported here stays here
        with ProcessPoolExecutor(PROCESSES, mp_context=context) as pool:
            # the engines share little: one process each at first, then who has time
            waiting = [
                pool.submit(fly_a_second, name, engine) for name in names for engine in ENGINES
            ]
            for one in waiting:
                one.result()
        elapsed = time.monotonic() - begun
        root = cache_root()
        console.say(f"compiled for {len(names)} vehicles in {elapsed:.0f} s: {root}")
        console.answer(vehicles=names, seconds=elapsed, folder=root)
        return 0


def fly_a_second(vehicle: str, engine: str) -> None:
    """Compile and keep what a flight with sensors needs, and `twin trim`."""
    import contextlib
    import logging

    import twin
    from twin.commands.trim import TrimVehicle
    from twin.errors import TwinError

    logging.disable(logging.WARNING)  # that it compiles is what was asked for
    twin.simulate(vehicle=vehicle, engine=engine, duration=1.0, sensors="field")
    if engine == "mujoco":
        with contextlib.suppress(TwinError):  # what does not glide has no usual dive
            TrimVehicle(vehicle=vehicle).run(Console("twin", json=True))
