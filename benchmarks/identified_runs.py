"""Identified runs: wrong propelled vehicles, identified from noisy runs and flown again.

    python -m benchmarks.identified_runs [--vehicle remus] [--seeds 1,2] [--bags] [--dimensions]
                                         [--runs 4] [--json]

Each seed makes an unknown vehicle. Every derivative of its hull law differs by up to 15 %, drag by
-25 to +35 %, thrust by 15 %, fins by -25 to +30 % and 1.5 deg. Its centre of gravity is off by 1 mm
along the hull, its righting arm by 15 %, added mass by 15 %, neutral density by 1 kg/m3. The
vehicle flies `--runs` surveys in a current over a sea floor, guided like the shipped vehicle, with
the sensors of `survey-field` (each run with its own errors), and is identified from them. Then the
identified, the shipped and the true vehicle fly three unseen missions in MuJoCo, under the guidance
of the shipped vehicle's file. The program prints errors relative to the true vehicle: mean absolute
error of surge / mean surge, and RMS errors of yaw rate and depth rate / their RMS. `spread` is the
root mean square error of the determined parameters in stated standard deviations. With `--bags` the
identification reads rosbag2 folders, written by ROS's own library and read by `factory import`.
With `--dimensions` it starts from length, diameter, mass, fins and screw, without a file; the
vehicle of these dimensions then replaces the shipped one.
"""

from __future__ import annotations

import sys
import tempfile
from json import dumps
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks import command
from factory.importing import import_logs
from glider_twin_protocols.mcap_file import export_mcap
from twin import load_vehicle, parse_current, parse_floor, simulate
from twin.identify import identify_driven, load_runs
from twin.identify.calibration import Calibration
from twin.identify.driven_fit import UNSURE, driven_parameters
from twin.mission import Mission
from twin.mission.segments import Circle, Transect
from twin.physics.scenario import Scenario
from twin.records.mission_dataset import dataset_of
from twin.records.reader import MissionStore
from twin.records.store import write_store
from twin.records.trajectory import Trajectory
from twin.sensors import SensorSuite
from twin.vehicle.dimensions import Dimensions
from twin.vehicle.vehicle import Vehicle
from twin.water.density import DensityProfile

Array = NDArray[np.float64]

PERIOD = 0.2
"""[s] Sample period of the runs"""
FAST, TURN = {"remus": 1.8, "tethys": 1.0}, {"remus": 12.0, "tethys": 20.0}
"""[m/s], [m] Largest speed and smallest radius of the surveys, by vehicle"""
UNSEEN = 3
START = 10.0
"""[s] Start of each unseen mission that is not judged"""


def other(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """Make a vehicle that differs from its file in every number."""
    names = [one.name for one in vehicle.law.uncertainties()]
    law = vehicle.law.scaled({name: float(rng.uniform(0.85, 1.15)) for name in names})
    law = law.with_drag(float(rng.uniform(0.75, 1.35))) or law
    propeller = vehicle.steering["speed"]
    part: Any = vehicle.part(propeller)
    thrust = part.thrust_coefficient * float(rng.uniform(0.85, 1.15))
    changes: dict[str, Any] = {propeller: {"thrust_coefficient": thrust}}
    for name in (vehicle.steering["heading"], vehicle.steering["pitch"]):
        part = vehicle.part(name)
        changes[name] = {
            "lift_slope": part.lift_slope * float(rng.uniform(0.75, 1.3)),
            "neutral": float(np.deg2rad(rng.uniform(-1.5, 1.5))),
        }
    place = vehicle.static_cg.copy()
    place[0] += 1e-3 * rng.uniform(-1.0, 1.0)
    place[2] *= rng.uniform(0.85, 1.15)
    root = np.sqrt(rng.uniform(0.85, 1.15, 6))
    density = vehicle.reference_density + float(rng.uniform(-1.0, 1.0))
    return vehicle.replace(
        law=law, static_cg=place, added_mass=vehicle.added_mass * np.outer(root, root),
        reference_density=density, **changes,
    )  # fmt: skip


def survey(rng: np.random.Generator, fast: float, radius: float, ways: int = 6) -> Mission:
    """Mission of level legs and circles of a minute at various speeds, depths and headings."""
    segments = []
    for _ in range(ways):
        common: dict[str, Any] = {
            "speed_m_s": float(rng.uniform(0.6, 1.0) * fast),
            "depth_m": float(rng.uniform(8.0, 30.0)),
            "duration_s": 60.0,
        }
        if rng.random() < 0.4:
            side = float(rng.choice([-1.0, 1.0]))
            wide = float(rng.uniform(1.0, 2.5))
            segments.append(Circle(radius_m=side * wide * radius, **common))
        else:
            segments.append(Transect(heading_deg=float(rng.uniform(0.0, 360.0)), **common))
    return Mission(
        name="survey", start_heading_deg=float(rng.uniform(0.0, 360.0)), start_depth_m=15.0,
        segments=tuple(segments),
    )  # fmt: skip


def logged(truth: Vehicle, shipped: Vehicle, mission: Mission, seed: int) -> Trajectory:
    """Fly a run of the true vehicle, with the measurements of its sensors."""
    rng = np.random.default_rng(seed)
    water = DensityProfile.constant(shipped.reference_density)
    drift = rng.normal(0, 0.1), rng.normal(0, 0.1)
    run = simulate(Scenario(
        vehicle=truth, believed=shipped, mission=mission, density=water,
        current=parse_current("uniform:{:.3f},{:.3f}".format(*drift)),
        floor=parse_floor("rough:60"), sample_period=PERIOD,
    ))  # fmt: skip
    suite = SensorSuite.preset("survey-field")
    seeds = np.random.SeedSequence(seed)
    run.signals.update(suite.measure(run.signals, dt=PERIOD, rng_seed=seeds, density=water))
    return run


def through_bags(store: Path, vehicle: Vehicle, folder: Path) -> Path:
    """Convert a store's runs to rosbag2 folders, and import these to a store."""
    from rosbags.highlevel import AnyReader
    from rosbags.rosbag2 import Writer

    with MissionStore(store) as runs:
        recordings = export_mcap(runs, range(len(runs.samples)), folder)
    bags = [path.with_suffix("") for path in recordings]
    for recording, bag in zip(recordings, bags, strict=True):
        with AnyReader([recording]) as reader, Writer(bag, version=9) as writer:
            to = {
                one.id: writer.add_connection(one.topic, one.msgtype, typestore=reader.typestore)
                for one in reader.connections
                if not one.topic.startswith("/truth/")
            }
            for one, time, message in reader.messages():
                if one.id in to:
                    writer.write(to[one.id], time, message)
    lines = ['vehicle = "survey"', f'model = "{vehicle.name}"', 'rows = "gaps"', "[signals]"]
    for part in vehicle.parts:
        unit = {"cm3": "m3"}.get(part.unit, part.unit)  # messages use SI units
        for which in ("measured", "commanded"):
            lines.append(
                f'{which}_{part.name} = {{ column = "/{which}/{part.name} data", unit = "{unit}" }}'
            )
    mapping = folder / "bags.toml"
    mapping.write_text("\n".join(lines))
    dataset, _ = import_logs("rosbag2", bags, mapping=mapping)
    return write_store(dataset, folder / "imported.zarr", overwrite=True)


def closed_loop(
    vehicle: Vehicle, truth: Vehicle, shipped: Vehicle, missions: list[Mission]
) -> dict[str, float]:
    """Errors [%] of a vehicle against the true one on missions under the same guidance."""
    off: dict[str, list[Array]] = {}
    size: dict[str, list[Array]] = {}
    for mission in missions:
        mine, real = (
            simulate(Scenario(
                vehicle=one, believed=shipped, mission=mission,
                density=DensityProfile.constant(shipped.reference_density),
            ))
            for one in (vehicle, truth)
        )  # fmt: skip
        step = float(real.time[1] - real.time[0])
        part = slice(round(START / step), min(len(mine.time), len(real.time)))
        last = len(mission.segments)
        ended = [int((run["commanded_segment"] < last).sum()) for run in (mine, real)]
        way = slice(part.start, min(*ended, part.stop))
        for name, signal, judged in (
            ("speed", "true_surge", part), ("turn rate", "true_yaw_rate", part),
            ("depth rate", "true_depth", part),
            ("turn rate until the mission ends", "true_yaw_rate", way),
        ):  # fmt: skip
            a, b = (run[signal].astype(float) for run in (mine, real))
            if signal == "true_depth":
                a, b = np.gradient(a, step), np.gradient(b, step)
            off.setdefault(name, []).append(a[judged] - b[judged])
            size.setdefault(name, []).append(b[judged])
    found = {}
    for name in off:
        a, b = np.concatenate(off[name]), np.concatenate(size[name])
        ratio = np.abs(a).mean() / b.mean() if name == "speed" else _rms(a) / _rms(b)
        found[name] = 100.0 * float(ratio)
    return found


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def of_dimensions(vehicle: Vehicle) -> Vehicle:
    """Make a vehicle from the outer dimensions of another."""
    rudder: Any = vehicle.part(vehicle.steering["heading"])
    screw: Any = vehicle.part("propeller")
    return Dimensions(
        length=vehicle.hull_length, diameter=vehicle.hull_diameter, mass=vehicle.mass,
        fin_area=rudder.area, fin_place=float(rudder.position[0]), screw=screw.diameter,
        density=vehicle.reference_density,
    ).vehicle()  # fmt: skip


def study(
    name: str, seed: int, runs: int, folder: Path, *, bags: bool, dimensions: bool
) -> dict[str, Any]:
    """Identify one vehicle, and compare it and its start with the true vehicle."""
    shipped = load_vehicle(name)
    start, unsure = (of_dimensions(shipped), UNSURE) if dimensions else (shipped, 1.0)
    if start.part_names != shipped.part_names:
        raise SystemExit(f"{name} has parts that its dimensions do not tell of: take remus")
    truth = other(shipped, np.random.default_rng(seed))
    rng = np.random.default_rng([seed, 1])
    kind = name.partition(":")[0]
    made = [
        logged(truth, shipped, survey(rng, FAST[kind], TURN[kind]), 1000 * seed + k)
        for k in range(runs)
    ]
    store = write_store(dataset_of(made), folder / f"{kind}-{seed}.zarr")
    if bags:
        store = through_bags(store, shipped, folder)
    found = identify_driven(load_runs(store, start), start, unsure=unsure)
    true = Calibration(vehicle=truth, water_density=shipped.reference_density)
    known = {p.name: p.get(true) for p in driven_parameters(shipped)} if not dimensions else {}
    told = [e for e in found.estimates if e.determined]
    errors = [(e.value - known[e.name]) / e.deviation for e in told if e.name in known]
    unseen = [survey(rng, FAST[kind], TURN[kind]) for _ in range(UNSEEN)]
    return {
        "vehicle": name,
        "seed": seed,
        "identified": closed_loop(found.calibration.vehicle, truth, shipped, unseen),
        "started from": closed_loop(start, truth, shipped, unseen),
        "determined": len(told),
        "spread": float(np.sqrt(np.mean(np.square(errors)))) if errors else None,
    }


def main(
    *,
    vehicle: Literal["remus", "tethys"] = "remus",
    seeds: str = "1,2",
    runs: int = 4,
    bags: bool = False,
    dimensions: bool = False,
    json: bool = False,
) -> None:
    """Print the errors of each vehicle.

    Args:
      bags: import the runs through rosbag2 folders.
      dimensions: start without a vehicle file.
    """
    for seed in map(int, seeds.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            found = study(vehicle, seed, runs, Path(folder), bags=bags, dimensions=dimensions)
        if json:
            print(dumps(found), flush=True)
            continue
        for which in ("identified", "started from"):
            words = ", ".join(f"{k} {v:.2f} %" for k, v in found[which].items())
            print(f"{found['vehicle']} {seed} {which:12s} {words}", flush=True)
        spread = "" if found["spread"] is None else f", spread {found['spread']:.1f}"
        print(f"    {found['determined']} determined{spread}", flush=True)


if __name__ == "__main__":
    sys.exit(command.run(main))
