"""Stated standard deviations of `twin identify`, judged on simulated deployments of wrong gliders.

    python -m benchmarks.identified_deviations [--seed 11] [--count 60] [--rows FILE] [--stores DIR]

Deployments of four gliders are flown whose numbers differ from the shipped file's.
`with_wrong_numbers` samples drag, lift, induced drag, mass, trim, compressibility, and the thermal
expansion and lag of the hull; `Deployment` samples the pitch sensor's offset and scale. The preset
`field` of the factory samples ballast, every coefficient (10 %), added mass, zeros of encoders,
currents and water. The compass has 3 deg. `twin identify` gets the signals of a vehicle's log and
starts from the shipped file, with default options, once with fixes and once without. Printed for
each reported number is z, its error over its stated standard deviation: the root mean square, the
mean, and the count beyond 2.58. Standard deviations that hold have an RMS of 1, a mean of 0, and
1 % beyond. `--parameters` asks for numbers that few logs report by default, such as the
compressibility. Deployments of gliders that fell with stalled wings are counted alone.

Each deployment is a line of JSON in --rows, and is not judged again. A sample of 15 minutes has
`--count 12`.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
import tempfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import command
from glider_twin_ops.presets.deployment import DeploymentDraw, DeploymentPlan, fly_deployments
from glider_twin_ops.presets.deployments import dataset_of_logs, log_of
from twin import Mission, Scenario, SensorSuite, load_vehicle
from twin.errors import TwinError
from twin.identify import NAMES, choose, identify, load_calibration, load_logs, motion_of
from twin.identify.calibration import REFERENCE_TEMPERATURE, Calibration
from twin.identify.logged_missions import Log
from twin.identify.speed import steady_parts
from twin.identify.unknowns import PARAMETERS
from twin.records.presence import is_store
from twin.records.store import write_store
from twin.sensors import Compass

VEHICLES = ("slocum-200", "slocum-1000", "seaglider", "seaexplorer")
DIVES = 12
"""Dives of a deployment, from fix to fix"""
TOGETHER = 8
"""Deployments of a vehicle that fly in one block"""
ATTEMPTS = 30
"""Samples of a deployment until one can be flown"""
DRAG, LIFT, INDUCED, MASS = 0.2, 0.18, 0.3, 0.05
"""Standard deviations of logarithms: of drag (sensors and fouling on a hull), of lift over drag
(published Slocums: 48 and 62 per rad), of induced drag over drag (published Slocums: 12 and 70 per
rad2), and of the mass (Slocums of one type: 52 to 60 kg)"""
TRIM = 0.5
"""[kg/m3] Standard deviation of the density in which the vehicle is neutral, beyond `field`"""
COMPRESSIBILITY = 1e-10
"""[1/Pa] Standard deviation of the compressibility: metal hulls have 4e-10 to 7e-10"""
EXPANSION, LAG = 2e-5, 0.5
"""[1/K] and logarithm: standard deviations of the hull's thermal expansion and lag"""
PITCH, SCALE = 1.0, 0.01
"""[deg], [1] Standard deviations of the pitch sensor's offset and scale"""
COMPASS = Compass(offset_deg=2.0, hard_iron_deg=1.5, soft_iron_deg=0.5)
"""A compass of 3 deg in all, between calibrated and not"""
FELL = 0.25
"""Fraction of steady flight with stalled wings beyond which a deployment is left out: at a pitch
that is too flat for its polar a glider falls, and its pilot would steepen it"""
BEYOND = 2.58
"""Standard deviations beyond which a normal number lies in 1 % of the cases"""

KEYS = ("vehicle", "seed", "number", "fixes", "parameters")
"""Entries of a row by which it is found again"""
Row = dict[str, Any]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Deployment:
    """A vehicle that no file has, in its sea, and the offset of its pitch sensor."""

    draw: DeploymentDraw
    pitch: tuple[float, float]
    """Scale and offset [deg] of the pitch sensor: true pitch = scale * measured + offset"""

    @classmethod
    def sample(cls, plan: DeploymentPlan, number: int, attempt: int) -> Deployment:
        """Sample a deployment that guidance can fly, from `attempt` on."""
        for again in range(attempt, ATTEMPTS):
            try:
                draw = plan.draw(number, again, faulty=False)
            except TwinError:
                continue
            rng = np.random.default_rng([plan.seed, number, again])
            scenario = with_wrong_numbers(first_dives(draw.scenario), rng)
            pitch = float(rng.normal(1.0, SCALE)), float(rng.normal(0.0, PITCH))
            return cls(draw=dataclasses.replace(draw, scenario=scenario), pitch=pitch)
        raise TwinError(f"{plan.vehicle.name} {number}: none of {ATTEMPTS} samples can be flown")

    def truth(self, compass: Mapping[str, float]) -> dict[str, float]:
        """True values of what identification estimates, in its units."""
        scenario, vehicle = self.draw.scenario, self.draw.scenario.vehicle
        assert scenario.ballast is not None
        # both count from the volume at a temperature, which shipped vehicles differ in
        warmer = REFERENCE_TEMPERATURE - vehicle.hull_reference_temperature
        volume = scenario.ballast.neutral_volume(vehicle, scenario.density)
        volume *= 1.0 + vehicle.hull_thermal_expansion * warmer
        true = Calibration(
            vehicle=vehicle.replace(reference_density=vehicle.mass / volume),
            water_density=vehicle.reference_density,
            thermal_expansion=vehicle.hull_thermal_expansion,
            thermal_lag=vehicle.hull_thermal_lag,
            pitch_scale=self.pitch[0],
            pitch_offset=math.radians(self.pitch[1]),
        )
        numbers = {p.name: p.get(true) for p in PARAMETERS}
        return numbers | {name: -compass[f"compass_{key}_deg"] for name, key in IRON.items()}


IRON = {
    "heading_offset": "a0", "heading_cos": "c", "heading_sin": "b", "heading_cos2": "e",
    "heading_sin2": "d",
}  # fmt: skip
"""Parameters of the compass, and the sensor's constants that they take off"""


def first_dives(scenario: Scenario) -> Scenario:
    """The scenario with its first DIVES dives alone."""
    assert isinstance(scenario.mission, Mission)
    plan = scenario.mission.segments
    share = (2 * DIVES + 1) / len(plan)
    lasts = scenario.sample_period * math.ceil(share * scenario.run_time() / scenario.sample_period)
    mission = dataclasses.replace(
        scenario.mission, segments=(*plan[: 2 * DIVES], plan[-1]), duration_s=lasts
    )
    return dataclasses.replace(scenario, mission=mission, duration=lasts)


def with_wrong_numbers(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The scenario of a vehicle with further errors, which guidance does not know."""
    ballast, calibration = scenario.ballast, load_calibration(scenario.vehicle)
    assert ballast is not None
    factors = dict(
        zip(
            ("mass", "drag", "lift_ratio", "induced_ratio"),
            np.exp(rng.normal(0.0, (MASS, DRAG, LIFT, INDUCED))),
            strict=True,
        )
    )
    for parameter in choose(list(factors)):
        value = parameter.get(calibration) * float(factors[parameter.name])
        calibration = parameter.set(calibration, value)
    vehicle = calibration.vehicle
    changed = vehicle.replace(
        hull_compressibility=vehicle.hull_compressibility + rng.normal(0.0, COMPRESSIBILITY),
        hull_thermal_expansion=vehicle.hull_thermal_expansion + rng.normal(0.0, EXPANSION),
        hull_thermal_lag=vehicle.hull_thermal_lag * math.exp(rng.normal(0.0, LAG)),
    )
    heavy = ballast.heavy + changed.neutral_volume * rng.normal(0.0, TRIM)
    ballast = dataclasses.replace(ballast, heavy=heavy)
    return dataclasses.replace(scenario, vehicle=changed, ballast=ballast)


def flown(name: str, seed: int, numbers: Sequence[int], folder: Path) -> dict[int, Path]:
    """Stores of deployments of a vehicle, true values beside them; what is stored is not flown."""
    own = zlib.crc32(name.encode())  # vehicles have other seas and errors
    plan = DeploymentPlan(vehicle=load_vehicle(name), seed=seed + own)
    suite = SensorSuite.preset("field").replace(compass=COMPASS)
    stores = {number: folder / f"{name}-{seed}-{number}.zarr" for number in numbers}
    waiting = {number: 0 for number in numbers if not is_store(stores[number])}
    while waiting:
        made = [Deployment.sample(plan, *one) for one in waiting.items()]
        for place, signals in fly_deployments([one.draw for one in made], suite):
            one, number = made[place], made[place].draw.number
            if isinstance(signals, TwinError):  # it came to harm: another one in its place
                waiting[number] = one.draw.attempt + 1
                continue
            scale, offset = one.pitch
            signals["measured_pitch"] = (signals["measured_pitch"] - offset) / scale
            truth = one.truth(suite.draw(one.draw.sensor_seed))
            stores[number].with_suffix(".json").write_text(json.dumps(truth))
            logs = dataset_of_logs([(one.draw, log_of(one.draw, signals, plan))], plan)
            write_store(logs, stores[number], overwrite=True)
            del waiting[number]
    return stores


def fell(name: str, logs: Sequence[Log], truth: Mapping[str, float]) -> bool:
    """True where the wings of the true vehicle were stalled for a quarter of its steady flight."""
    true = load_calibration(name)
    for parameter in choose(list(truth)):
        true = parameter.set(true, truth[parameter.name])
    attacks = [
        np.abs(motion_of(log, true).angle_of_attack[log.use & steady_parts(log)]) for log in logs
    ]
    return bool(np.mean(np.concatenate(attacks) > true.vehicle.flow_frame.blend_angle) > FELL)


def judged(name: str, store: Path, *, fixes: bool, parameters: Sequence[str]) -> Row:
    """Error, standard deviation and z of each reported number, and the stalled dives."""
    truth = json.loads(store.with_suffix(".json").read_text())
    logs, asked = load_logs(store), list(parameters) or None
    found = identify(logs, load_calibration(name), parameters=asked, fixes=fixes)
    numbers = {
        e.name: {
            "error": e.value - truth[e.name],
            "deviation": e.deviation,
            "z": (e.value - truth[e.name]) / e.deviation,
        }
        for e in found.estimates
        if e.determined and e.name in truth
    }
    return {
        "numbers": numbers,
        "stalled": list(found.stalled),
        "fell": fell(name, logs, truth),
    }


def rows_of(
    seed: int,
    count: int,
    rows: Path | None,
    folder: Path,
    vehicles: Sequence[str],
    parameters: Sequence[str],
) -> Iterator[Row]:
    """A row of each deployment, with fixes and without; those of the file come first."""
    lines = rows.read_text().splitlines() if rows is not None and rows.exists() else []
    kept = {tuple(r[key] for key in KEYS): r for r in map(json.loads, lines)}
    asked = " ".join(parameters)
    each = range(-(-count // len(vehicles)))
    for name in vehicles:
        for first in range(0, len(each), TOGETHER):
            numbers = each[first : first + TOGETHER]
            cases = [(name, seed, n, fixes, asked) for n in numbers for fixes in (True, False)]
            yield from (kept[case] for case in cases if case in kept)
            lacking = list(dict.fromkeys(case[2] for case in cases if case not in kept))
            stores = flown(name, seed, lacking, folder)
            for case in cases:
                if case not in kept:
                    made = judged(name, stores[case[2]], fixes=case[3], parameters=parameters)
                    row = {**dict(zip(KEYS, case, strict=True)), **made}
                    if rows is not None:
                        with rows.open("a") as file:
                            file.write(json.dumps(row) + "\n")
                    yield row


def table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """RMS, mean and part beyond BEYOND of z, for each reported number with fixes and without."""
    out = []
    for fixes in (True, False):
        own = [row for row in rows if row["fixes"] == fixes]
        some = [row["numbers"] for row in own if not row["fell"]]
        for name in NAMES:
            z = np.array([one[name]["z"] for one in some if name in one])
            if len(z):
                out.append({
                    "fixes": "yes" if fixes else "no",
                    "parameter": name,
                    "reported": len(z),
                    "of": len(some),
                    "fell": len(own) - len(some),
                    "RMS of z": float(np.sqrt(np.mean(z**2))),
                    "mean of z": float(z.mean()),
                    "beyond 2.58": int((np.abs(z) > BEYOND).sum()),
                    "median deviation": float(
                        np.median([one[name]["deviation"] for one in some if name in one])
                    ),
                })  # fmt: skip
    return out


def main(
    *,
    seed: int = 11,
    count: int = 60,
    rows: Path | None = None,
    stores: Path | None = None,
    vehicles: tuple[str, ...] = VEHICLES,
    parameters: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """Print z of each reported number.

    Args:
      count: deployments in all.
      rows: file of the judged deployments, which are not judged again.
      stores: folder that keeps the logs.
      parameters: numbers to ask for; default: those that identification chooses.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = stores or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        found = list(rows_of(seed, count, rows, folder, vehicles, parameters))
    command.say(table(found), table(found), json=json, digits=2)


if __name__ == "__main__":
    sys.exit(command.run(main))
