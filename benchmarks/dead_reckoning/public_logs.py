"""Tier `public`: real dives whose velocity through the water somebody measured and published.

    python -m benchmarks.dead_reckoning.public_logs > files.curl       # what is to be fetched
    curl --create-dirs --output-dir LOGS -K files.curl
    python -m benchmarks.dead_reckoning --tier public --logs LOGS

The files, whose they are and their checksums stand in `public_logs.toml`; none is shipped. A method
may train on anything but these two deployments; those here train on the family of the same vehicle.

Scored is the horizontal speed through the water along the heading: what a method's surge and sway
make of it with the depth rate and the attitude as logged, the pitch as the log's owner corrects it.
A Doppler log's speed is freed of its vertical part by the depth rate. Figures are means over the
dives of a deployment: `dr_velocity_percent` is the sum of a dive's errors over its path where there
is truth, `surge_mse` the squared error of means over a minute; deployments weigh the same.
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
"""[s] between samples of the imported dives"""
HOURS = 100.0
"""[h] of preset `family` of the vehicle, to train on"""
SEED = 9031
MINUTE = 60.0
LEAST_S = 120.0
"""[s] of truth that a dive is scored from"""
ATTITUDE = ("measured_roll", "measured_pitch", "measured_heading", "measured_depth")
TRUTH = ("true_surge", "true_sway", "true_heave")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Deployment:
    """Logs of one vehicle, of files that the user fetched."""

    name: str
    kind: str
    """as `factory import` calls it"""
    vehicle: str
    """shipped, of the same kind"""
    truth: str
    """a file of times and speeds, or `store`: the import knows it"""
    pitch: tuple[float, float]
    """scale, and offset [rad], that make the true pitch of the logged one"""
    about: str
    licence: str
    address: str
    """of the folder"""
    files: Mapping[str, str]
    """SHA-256 by the name below `address`"""

    def check(self, logs: Path) -> Path:
        """The folder of these files.

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
        """Stores of training and test; those of `parts` are made where they are missing. Errors as
        of `check`."""
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
    """What a dive logged of how it went."""

    index: int
    time: Array
    """[s] unix"""
    signals: Mapping[str, Array]
    pitch: tuple[float, float]
    """as of the deployment"""

    @functools.cached_property
    def rate(self) -> Array:
        """[m/s] of the depth."""
        return depth_rate(self.signals["measured_depth"], PERIOD)

    def level(self, surge: Array, sway: Array, heave: Array | None = None) -> Array:
        """Horizontal speed [m/s] along the heading; heave is by the depth rate if not given."""
        roll, pitch = (np.deg2rad(self.signals[f"measured_{n}"]) for n in ("roll", "pitch"))
        pitch = self.pitch[0] * pitch + self.pitch[1]
        if heave is None:
            heave = heave_from_depth_rate(self.rate, surge, sway, roll, pitch)
        return level_speed(surge, sway, heave, roll, pitch)


@functools.cache
def deployments() -> tuple[Deployment, ...]:
    """Those of `public_logs.toml`."""
    found = tomllib.loads(FILE.read_text(encoding="utf-8"))["deployment"]
    return tuple(Deployment(**one) for one in found)


def dives_of(deployment: Deployment, test: Path) -> list[LoggedDive]:
    """The dives of a deployment's imported store."""
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
    """Of each dive that is scored: the sum of the errors over its path in %, and the mean squared
    error of means over a minute [(m/s)^2].

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
    """Figures of each deployment's `dive_errors`; deployments weigh the same, and their draws are
    independent."""
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
    """What is to be fetched, as curl reads it."""
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
