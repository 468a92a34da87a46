"""Public logs: the tier `public`, real dives with a published measurement of the velocity.

    python -m benchmarks.dead_reckoning.public_logs > files.curl       # addresses of the files
    curl --create-dirs --output-dir LOGS -K files.curl
    python -m benchmarks.dead_reckoning --tier public --logs LOGS

`public_logs.toml` lists the files, their owners and checksums; none is shipped. A method may train
on anything but these two deployments; the methods here train on the family of the same vehicle.

The horizontal speed through the water along the heading is scored. It is computed from a method's
surge and sway, the depth rate and the logged attitude, with the pitch corrected by the log's owner.
The depth rate removes the vertical component of a Doppler log's speed. Figures are means over the
dives of a deployment: `dr_velocity_percent` is the sum of a dive's errors in % of its path, where
it has truth; `surge_mse` is the squared error of one-minute means. Deployments weigh the same.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.dead_reckoning.predictions import velocities_of
from benchmarks.dead_reckoning.scoring import drawn
from benchmarks.real_logs.samples import LEAST_DEPTH, level_speed
from learn.data.dataset import filled
from twin.errors import InputError
from twin.navigation.dead_reckoning import (
    Array,
    depth_rate,
    heave_from_depth_rate,
)
from twin.records.logged import LogStore

FILE = Path(__file__).with_name("public_logs.toml")
PERIOD = 5.0
"""[s] Time between samples of the imported dives"""
HOURS = 100.0
"""[h] Simulated missions of the vehicle to train on, preset `family`"""
SEED = 9031
MINUTE = 60.0
LEAST_S = 120.0
"""[s] Least duration of truth in a dive that is scored"""
ATTITUDE = ("measured_roll", "measured_pitch", "measured_heading", "measured_depth")
TRUTH = ("true_surge", "true_sway", "true_heave")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Deployment:
    """Deployment of one vehicle, in files that the user fetched."""

    name: str
    kind: str
    """Type of the log, as `factory import` names it"""
    vehicle: str
    """Shipped vehicle of the same type"""
    truth: str
    """File of times and speeds; or `store` if the imported store has the speeds"""
    pitch: tuple[float, float]
    """Scale [1] and offset [rad] from the logged pitch to the true pitch"""
    about: str
    licence: str
    address: str
    """Address of the folder of the files"""
    files: Mapping[str, str]
    """SHA-256 of each file, by its name below `address`"""

    def check(self, logs: Path) -> Path:
        """Check the files of the deployment, and return their folder.

        Raises:
          InputError: a file is missing, or is not the published one.
        """
        folder = logs / self.name
        for name, wanted in self.files.items():
            path = folder / name
            if not path.is_file():
                raise InputError(
                    f"no file {path}: tier public scores logs that you fetch, from {self.address} "
                    f"({self.licence}); `python -m benchmarks.dead_reckoning.public_logs` lists "
                    "them for curl"
                )
            if hashlib.sha256(path.read_bytes()).hexdigest() != wanted:
                raise InputError(
                    f"{path} is not the published file {self.address}{name}: its SHA-256 is not "
                    f"{wanted}; fetch it again"
                )
        return folder

    def make(
        self, logs: Path, work: Path, parts: Sequence[str] = ("train", "test")
    ) -> tuple[Path, Path]:
        """Stores of training and test; the stores of `parts` are made if they are missing. Errors
        are those of `check`."""
        import factory
        from factory.importing import import_logs
        from twin.records.store import write_store

        folder, test = self.check(logs), work / self.name / "test.zarr"
        train = work / self.name / "train.zarr"
        if "test" in parts and not test.exists():
            test.parent.mkdir(parents=True, exist_ok=True)
            places = sorted({(folder / name).parent for name in self.files if name != self.truth})
            dataset, _ = import_logs(self.kind, places, period=PERIOD)
            write_store(dataset, test)
        if "train" in parts and not train.exists():
            factory.generate(
                train, preset="family", hours=HOURS, seed=SEED, vehicle=self.vehicle,
                engine="lanes", resume=True,
            )  # fmt: skip
        return train, test

    def level(self, logs: Path, dive: LoggedDive) -> Array:
        """Horizontal speed [m/s] along the heading at a dive's samples; NaN without truth."""
        if self.truth == "store":
            known = dive.level(*(dive.signals[name] for name in TRUTH))
            return np.where(dive.signals["measured_depth"] > LEAST_DEPTH, known, np.nan)
        rows = np.load(logs / self.name / self.truth)
        known = np.isfinite(rows[[0, -1]]).all(0)
        time, speed = rows[0, known], rows[-1, known]
        at = np.interp(dive.time, time, speed)
        after = np.searchsorted(time, dive.time)
        near = np.minimum(
            np.abs(time[after.clip(0, time.size - 1)] - dive.time),
            np.abs(time[(after - 1).clip(0)] - dive.time),
        )
        level = np.sqrt(np.maximum(at**2 - dive.rate**2, 0.0))
        return np.where(near < 0.5 * PERIOD, level, np.nan)


@dataclasses.dataclass(frozen=True)
class LoggedDive:
    """Signals of one logged dive."""

    index: int
    time: Array
    """[s] Unix time of each sample"""
    signals: Mapping[str, Array]
    pitch: tuple[float, float]
    """Scale and offset of the deployment"""

    @functools.cached_property
    def rate(self) -> Array:
        """[m/s] Depth rate."""
        return depth_rate(self.signals["measured_depth"], PERIOD)

    def level(self, surge: Array, sway: Array, heave: Array | None = None) -> Array:
        """Horizontal speed [m/s] along the heading; without `heave`, the depth rate gives it."""
        roll, pitch = (np.deg2rad(self.signals[f"measured_{n}"]) for n in ("roll", "pitch"))
        pitch = self.pitch[0] * pitch + self.pitch[1]
        if heave is None:
            heave = heave_from_depth_rate(self.rate, surge, sway, roll, pitch)
        return level_speed(surge, sway, heave, roll, pitch)


@functools.cache
def deployments() -> tuple[Deployment, ...]:
    """Read the deployments of `public_logs.toml`."""
    found = tomllib.loads(FILE.read_text(encoding="utf-8"))["deployment"]
    return tuple(Deployment(**one) for one in found)


def dives_of(deployment: Deployment, test: Path) -> list[LoggedDive]:
    """Read the dives of a deployment's imported store."""
    found = []
    with LogStore(test) as store:
        for index in range(len(store)):
            signals = {name: store.signal(name, index) for name in (*ATTITUDE, *TRUTH)}
            for name in ATTITUDE:
                signals[name] = filled(name, signals[name])
            found.append(LoggedDive(index, store.time(index), signals, deployment.pitch))
    return found


def dive_errors(
    deployment: Deployment, logs: Path, test: Path, said: xr.Dataset
) -> tuple[Array, Array]:
    """Errors of each scored dive: sum of the errors in % of the path, and mean squared error of
    one-minute means [(m/s)^2].

    Raises:
      InputError: the predictions lack a dive, or are not finite where there is truth.
    """
    percent, squared = [], []
    for dive in dives_of(deployment, test):
        truth = deployment.level(logs, dive)
        known = np.isfinite(truth)
        if known.sum() * PERIOD < LEAST_S:
            continue
        surge, sway = velocities_of(said, dive.index, truth.size, known)
        off = (dive.level(surge, sway) - truth)[known]
        percent.append(100.0 * abs(off.sum()) / truth[known].sum())
        minute = (np.flatnonzero(known) * PERIOD / MINUTE).astype(int)
        counts = np.bincount(minute)
        whole = counts * PERIOD >= 0.5 * MINUTE
        means = np.bincount(minute, off)[whole] / counts[whole]
        squared.append(float(np.mean(means**2)))
    if not percent:
        raise InputError(f"no dive of {deployment.name} has {LEAST_S:g} s of truth")
    return np.array(percent), np.array(squared)


def figures(found: Mapping[str, tuple[Array, Array]]) -> dict[str, dict[str, float]]:
    """Figures of each deployment's `dive_errors`, and means of the deployments, whose bootstrap
    samples are independent."""
    means = np.mean([drawn(p, seed) for seed, (p, _) in enumerate(found.values())], axis=0)
    low, high = np.percentile(means, (2.5, 97.5))
    one = {
        "dr_velocity_percent": float(np.mean([p.mean() for p, _ in found.values()])),
        "low": float(low),
        "high": float(high),
        "surge_mse": float(np.mean([s.mean() for _, s in found.values()])),
        "missions": float(sum(p.size for p, _ in found.values())),
        "worse": 0.0,
        **{name: float(p.mean()) for name, (p, _) in found.items()},
    }
    return {"0": one}


def main() -> int:
    """Print the addresses of the files as a configuration of curl."""
    lines = []
    for one in deployments():
        lines.append(f"# {one.name}: {one.about}\n# {one.licence}")
        lines += [
            f'url = "{one.address}{name}"\noutput = "{one.name}/{name}"' for name in one.files
        ]
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
