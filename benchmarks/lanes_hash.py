"""Hashes of the batched engine: equal logs on every processor and in every block of missions.

    python -m benchmarks.lanes_hash [--fleets glider,slocum-200,tethys,gridded,paper,field]

A fleet is one of three: vehicles under a tide and a wind's current, the Slocum with a waypoint and
a fix; gliders in a gridded current; or missions that a preset of `factory generate` samples. One of
its missions flies alone in a small block, with others in a small and a large block, and on two
threads. This runs on three processors, each emulated by a process: SSE2 alone, AVX2, AVX-512. Own
switches of numba, NumPy and the C library disable other instructions. Printed are the SHA-256 of
each log and, for each processor, the compiled equations' counts of packed operations, of single
operations, and of calls. Without x86, only the machine's own processor runs.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy._core._multiarray_umath import __cpu_dispatch__

import twin
from benchmarks import command
from factory.sampling.fly import build_scenario
from factory.sampling.recipe import Recipe
from twin.cli.text_table import format_table
from twin.fossen.lane_block import LANES
from twin.fossen.structure import Arithmetic
from twin.physics.lanes import Lane, fly_in_lanes
from twin.records.trajectory import Trajectory

NAMES = ("NUMBA_CPU_NAME", "OPENBLAS_CORETYPE", "GLIBC_TUNABLES")
SETTINGS = {
    "SSE2": ("x86-64", "Nehalem", "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F"),
    "AVX2": ("haswell", "Haswell", "glibc.cpu.hwcaps=-AVX512F"),
    "AVX-512": ("skylake-avx512", "SkylakeX", ""),
}
PROCESSORS = {one: dict(zip(NAMES, words, strict=True)) for one, words in SETTINGS.items()}
"""Environment of a process that emulates each processor, without NumPy's switch"""
KEPT_BY_NUMPY = {
    "SSE2": (),
    "AVX2": ("AVX", "F16C", "FMA3", "AVX2", "X86_V3"),
    "AVX-512": tuple(__cpu_dispatch__),
}
"""NumPy's names of the instructions, which differ between its versions"""
HERE = "this machine's"
"""Name of the machine's own processor"""
CURRENT = "uniform:0.03,0.02+tide:m2=0.1,k1=0.03,direction=30+ekman:tau=0.1,direction=90"
DURATIONS = {"slocum-200": 1800.0}
"""[s] Durations other than SHORT, by vehicle"""
SHORT = 420.0
DERIVED = ("true_roll", "true_pitch", "true_heading", "true_energy_")
"""Signals that NumPy computes from the log with the C library's arctan2, arcsin and cos, as for
MuJoCo; their last bit differs on processors without FMA"""
VEHICLES = ("glider", "slocum-200", "tethys")
GRIDDED = "gridded"
DRAWN = ("paper", "field")
"""Presets whose missions are cut to SHORT"""
FLEETS = (*VEHICLES, GRIDDED, *DRAWN)
HOURS = 200.0
"""[h] Length of a preset's store, with more missions than fly here"""


def fleet(name: str, count: int, folder: Path) -> list[twin.Scenario]:
    """Make `count` different missions of one structure, with their files in the folder."""
    if name in DRAWN:
        return drawn(name, count)
    vehicle = "glider" if name == GRIDDED else name
    current = twin.parse_current(CURRENT)
    if name == GRIDDED:
        current = twin.parse_current(f"grid:{gridded(folder)},lat=49,lon=-16,time=2000-01-05")
    real = twin.load_vehicle(vehicle)
    mission = twin.load_mission("transects" if vehicle == "tethys" else "default")
    if vehicle == "slocum-200":
        to = {"kind": "waypoint", "targets": [{"north_m": 400.0, "east_m": 150.0}],
              "surface_after_s": 600.0, "max_depth_m": 40.0, "pitch_deg": 26.0}  # fmt: skip
        mission = twin.Mission.from_dict({"name": "there", "segments": [to]})
    return [
        twin.Scenario(
            vehicle=real, mission=mission, current=current, engine="lanes",
            density=twin.parse_density("thermocline"), duration=DURATIONS.get(vehicle, SHORT),
            start={"north": 10.0 * k, "heading": math.radians(7.0 * k)},
        )
        for k in range(count)
    ]  # fmt: skip


def drawn(preset: str, count: int) -> list[twin.Scenario]:
    """First missions of a store of the preset, each with its own vehicle and water."""
    vehicle = twin.load_vehicle("glider")
    recipe = Recipe(preset=preset, hours=HOURS, seed=0, changes={}, vehicle=vehicle, engine="lanes")
    found: list[twin.Scenario] = []
    for mission in range(len(recipe.plan)):
        scenario = build_scenario(recipe.parameters(mission, 0), vehicle, None, "lanes")
        found.append(dataclasses.replace(scenario, duration=SHORT))
        if len(found) == count:
            return found
    raise RuntimeError(f"preset {preset!r} has {len(found)} missions in {HOURS:g} h, not {count}")


def gridded(folder: Path) -> Path:
    """Write a file of a current that varies with depth, place and time."""
    axes = {
        "time": np.datetime64("2000-01-04T12:00", "ns") + np.arange(3) * np.timedelta64(1, "D"),
        "depth": np.array([0.5, 10.0, 50.0, 200.0]),
        "latitude": 48.9 + 0.05 * np.arange(5),
        "longitude": -16.1 + 0.05 * np.arange(5),
    }
    index = np.meshgrid(*(np.arange(len(axis)) for axis in axes.values()), indexing="ij")
    east = 0.1 + 0.02 * index[0] - 0.03 * index[1] + 0.01 * index[2] * index[3]
    velocities = {"uo": ("eastward", east), "vo": ("northward", 0.1 - 0.5 * east)}
    data = xr.Dataset(coords=axes)
    for name, (way, values) in velocities.items():
        about = {"standard_name": f"{way}_sea_water_velocity", "units": "m s-1"}
        data[name] = (tuple(axes), values, about)
    data["depth"].attrs = {"units": "m", "positive": "down", "axis": "Z"}
    path = folder / "water.nc"
    data.to_netcdf(path)
    return path


def digest(flown: Trajectory) -> str:
    """Hash of a log's states and signals, without those that NumPy computes from them."""
    found = hashlib.sha256(flown.states.tobytes())
    for name, values in sorted(flown.signals.items()):
        if not name.startswith(DERIVED):
            found.update(name.encode() + values.tobytes())
    return found.hexdigest()


def hashes(name: str) -> dict[str, str]:
    """Hash of one mission of a fleet in every block."""
    with tempfile.TemporaryDirectory() as folder:
        return _hashes(fleet(name, LANES[-1] + LANES[0], Path(folder)))


def _hashes(missions: list[twin.Scenario]) -> dict[str, str]:
    few, many = LANES[0], LANES[-1]
    ways = {
        "alone": (missions[:1], 1),
        "among few": (missions[: few - 1], 1),
        "among few, behind others": ([*missions[2:few], missions[0]], 1),
        "among many": (missions[:many], 1),
        "two blocks, two threads": ([*missions[1:], missions[0]], 2),
    }
    found = {}
    for way, (flown, threads) in ways.items():
        logs = fly_in_lanes(flown, threads=threads)
        log = logs[flown.index(missions[0])]
        assert isinstance(log, Trajectory), log
        found[way] = digest(log)
    return found


def arithmetic(vehicle: str, lanes: int = LANES[-1]) -> Arithmetic:
    """Instruction counts of the vehicle's compiled equations."""
    return Lane(fleet(vehicle, 1, Path())[0]).structure.arithmetic(lanes)


def on_processor(
    name: str, hashed: Sequence[str] = FLEETS, counted: Sequence[str] = VEHICLES
) -> dict[str, Any]:
    """Run `hashes` and `arithmetic` in a process that emulates processor `name`.

    Names outside PROCESSORS, such as HERE, use the machine as it is.
    """
    switches: dict[str, str] = {}
    if name in PROCESSORS:
        without = [item for item in __cpu_dispatch__ if item not in KEPT_BY_NUMPY[name]]
        switches = {"NUMBA_CPU_FEATURES": "", "NPY_DISABLE_CPU_FEATURES": " ".join(without)}
        switches |= PROCESSORS[name]
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, json.dumps([*hashed]), json.dumps([*counted])],
        env={**os.environ, **switches},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{name}: {done.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


_CHILD = """
import json, sys
from benchmarks import lanes_hash as this

hashed, counted = map(json.loads, sys.argv[1:])
print(json.dumps({
    "hashes": {name: this.hashes(name) for name in hashed},
    "arithmetic": {vehicle: vars(this.arithmetic(vehicle)) for vehicle in counted},
}))
"""


def processors() -> tuple[str, ...]:
    """Processors that this machine can emulate."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return (HERE,)
    from llvmlite.binding import get_host_cpu_features

    has = get_host_cpu_features()
    wanted = {"SSE2": True, "AVX2": has.get("avx2"), "AVX-512": has.get("avx512dq")}
    return tuple(name for name, there in wanted.items() if there)


def main(*, fleets: str = ",".join(FLEETS)) -> int:
    """Print the hashes; exit code 1 if a fleet has several, or code is not vectorised."""
    chosen = tuple(fleets.split(","))
    counted = tuple(name for name in chosen if name in VEHICLES)
    rows, logs, packed = [], dict[str, set[str]](), True
    for processor in processors():
        both = on_processor(processor, chosen, counted)
        for name, found in both["hashes"].items():
            kinds, first = set(found.values()), next(iter(found.values()))
            logs.setdefault(name, set()).update(kinds)
            row = {"processor": processor, "fleet": name, "ways": len(found), "hashes": len(kinds)}
            row |= {"SHA-256 of the log": first, "packed": "", "scalar": "", "calls": ""}
            if name in counted:
                made = both["arithmetic"][name]
                code = Arithmetic(made["packed"], made["scalar"], tuple(made["calls"]))
                packed = packed and code.vector_code
                row |= {"packed": code.packed, "scalar": code.scalar, "calls": len(code.calls)}
            rows.append(row)
    print(format_table(rows))
    for name, found in logs.items():
        print(f"{name}: {len(found)} hash{'es' if len(found) > 1 else ''}")
    return 0 if packed and all(len(found) == 1 for found in logs.values()) else 1


if __name__ == "__main__":
    sys.exit(command.run(main))
