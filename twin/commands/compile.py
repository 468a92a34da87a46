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

        from twin import load_vehicle, vehicle_names

        shipped = dict.fromkeys(name.partition(":")[0] for name in vehicle_names())
        names = self.vehicle or tuple(sorted(shipped, key=lambda name: name != "glider"))
        for name in self.vehicle:
            load_vehicle(name)  # what is no vehicle is told before anything is compiled
        begun = time.monotonic()
        context = multiprocessing.get_context("spawn")  # fresh: what was imported here stays here
        with ProcessPoolExecutor(PROCESSES, mp_context=context) as pool:
            # the engines share little: one process each at first, then who has time
            waiting = [
                pool.submit(fly_a_second, name, engine) for name in names for engine in ENGINES
            ]
            try:
                for one in waiting:
                    one.result()
            except BaseException:  # Ctrl-C too: what has not begun is not waited for
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        elapsed = time.monotonic() - begun
        console.say(f"compiled for {', '.join(names)}: {elapsed:.0f} s")
        console.answer(vehicles=names, seconds=elapsed)
        return 0


def fly_a_second(name: str, engine: str) -> None:
    """Compile and keep what a flight with sensors needs, and `twin trim`."""
    import contextlib
    import logging

    import twin
    from twin.errors import TwinError
    from twin.mission import steady_glide

    logging.disable(logging.WARNING)  # that it compiles is what was asked for
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
        with contextlib.suppress(TwinError):  # what has an engine has no usual dive
            steady_glide(vehicle, -pitch, net_mass)
            twin.trim(vehicle, 0.0, 0.0, net_mass)
