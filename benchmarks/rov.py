"""ROV: surge and sway of `bluerov2` by networks and by rivals, on unseen missions of preset `rov`.

    python -m benchmarks.rov RUN [--folder FOLDER] [--hours 5] [--json]

Sets of about 50 missions: in still water, where the track through the water is the one over ground;
in currents; in currents with one of the four horizontal thrusters dead, which no method is told;
and without a push ahead or aside, for the drift at hover. Stores stay in the folder, and a second
call goes on with them. The EKF has the equations of three axes, with the vehicle file's numbers or
with those of the mission's own hull, which nobody has at sea. Its noises were chosen on other
missions.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import factory
from benchmarks import command
from benchmarks.dead_reckoning.scoring import drawn
from factory.generation.generated_store import GeneratedStore
from factory.sampling.conditions import spread_vehicle
from twin.frames import euler_to_matrix
from twin.navigation.dead_reckoning import (
    Array,
    AttitudeSeries,
    integrate,
    true_ground_track,
    true_water_path,
    true_water_track,
    water_track,
)
from twin.navigation.estimators import open_velocity_estimator
from twin.navigation.estimators.dvl import WATER
from twin.vehicle.vehicle import Vehicle

STILL = {"current.speed": "0"}
LOST = [{f"vehicle.thruster_{k}_thrust_{way}": "1e-6" for way in ("ahead", "astern")}
        for k in (1, 2, 3, 4)]  # fmt: skip
SETS = {
    "pool": ([STILL], 13), "current": ([{}], 14), "thruster lost": (LOST, 15),
    "hover": ([{**STILL, "mission.surge": "0", "mission.sway": "0"}], 25),
}  # fmt: skip
"""Changes of the preset, a store each, and the seed of the first store; 12 is for the noises"""
FIELDS = ("axis", "position", "ahead", "astern", "dead_band", "curvature", "lag",
          "zero_thrust_speed")  # fmt: skip
THRUSTERS = tuple(f"thruster_{k}" for k in range(1, 9))
READ = (
    tuple(f"commanded_{name}" for name in THRUSTERS),
    tuple(f"measured_{axis}_rate" for axis in ("roll", "pitch", "yaw")),
    tuple(f"measured_specific_force_{axis}" for axis in "xyz"),
    ("measured_depth",), ("measured_tether",),
)  # fmt: skip
SUBSTEPS = 10
NOISES = tuple(itertools.product((0.02, 0.1, 0.5), (0.1, 0.5)))
"""Noise of the equations [m/s2/sqrt(Hz)] and of the accelerometer against them [m/s2]"""
DEPTH_NOISE, BIAS, NUDGE = 0.01, 0.05, 1e-4
"""DEPTH_NOISE: [m] of a sample. BIAS: [m/s2] standard deviation of accelerometer biases"""


class Flown(NamedTuple):
    """One mission: signals, the vehicle's file and its own hull."""

    signals: dict[str, Array]
    nominal: Vehicle
    own: Vehicle
    period: float

    def matrix(self, kind: str = "measured") -> Array:
        """Rotation from body to NED, (time, 3, 3)."""
        angles = np.deg2rad(self.rows(*(f"{kind}_{n}" for n in ("roll", "pitch", "heading"))))
        return euler_to_matrix(*angles.T)

    def rows(self, *names: str) -> Array:
        return np.stack([self.signals[name] for name in names], axis=1)


def missions(folder: Path, stores: list[dict[str, str]], hours: float, seed: int) -> list[Flown]:
    """Fly stores of missions, or read them."""
    found = []
    for k, changes in enumerate(stores):
        path = folder / f"{seed + k}.zarr"
        if not path.exists():
            factory.generate(
                path, preset="rov", hours=hours / len(stores), seed=seed + k, changes=changes,
                vehicle="bluerov2", engine="lanes", workers=1, resume=True,
            )  # fmt: skip
        with GeneratedStore(path) as store:
            names = [str(n) for n in store.dataset.data_vars
                     if str(n).startswith(("true_", "measured_", "commanded_"))]  # fmt: skip
            for m in range(len(store)):
                own = spread_vehicle(store.vehicle, store.parameters(m))
                size = int(np.isfinite(store.row("true_surge", m)).sum())
                rows = {name: np.asarray(store.row(name, m)[:size], float) for name in names}
                found.append(Flown(rows, store.vehicle, own, store.period))
    return found


def padded(found: Iterable[Array]) -> Array:
    """Rows of missions, (missions, time, ...), with the last sample repeated to one length."""
    rows = list(found)
    most = max(map(len, rows))
    return np.stack([np.concatenate([r, np.repeat(r[-1:], most - len(r), axis=0)]) for r in rows])


class Hulls:
    """Equations of surge, sway and heave of several vehicles side by side."""

    def __init__(self, vehicles: Sequence[Vehicle]):
        laws = [dict(one.law.derivatives) for one in vehicles]  # type: ignore[attr-defined]
        self.linear, self.square = (
            -np.array([[[law[n] for n in names]] for law in laws])
            for names in (("Xu", "Yv", "Zw"), ("Xuu", "Yvv", "Zww"))
        )
        self.mass = np.array([[one.mass + np.diag(one.added_mass)[:3]] for one in vehicles])
        self.t = {
            field: np.array(
                [[[getattr(one.part(n), field) for n in THRUSTERS]] for one in vehicles]
            )
            for field in FIELDS
        }
        tethers = [one.part("tether") for one in vehicles]
        self.pull = np.array([[[500.0 * one.values()[0]]] for one in tethers])  # half a density
        self.end = np.array([[one.position] for one in tethers])

    def push(self, c: Array) -> tuple[Array, Array]:
        """Thrust at rest [N] and its loss per speed of advance [N s/m] of commands (n, time, 8)."""
        t = self.t
        part = np.maximum(np.abs(c) - t["dead_band"], 0.0) / (1.0 - t["dead_band"])
        most = np.where(c >= 0.0, t["ahead"], t["astern"])
        curve = part * (1.0 - t["curvature"] + t["curvature"] * part)
        return np.sign(c) * most * curve, most * part / t["zero_thrust_speed"]

    def balance(self, c: Array, length: Array) -> Array:
        """Velocities [m/s] at which thrust and drag balance axis by axis, (n, time, 3)."""
        thrust, loss = self.push(c)
        force = (thrust[..., None] * self.t["axis"]).sum(2)
        linear = self.linear + (loss[..., None] * self.t["axis"] ** 2).sum(2)
        square = self.square + self.pull * length
        root = np.sqrt(linear**2 + 4.0 * square * np.abs(force)) - linear
        return np.sign(force) * root / (2.0 * square)

    def change(self, v: Array, w: Array, c: Array, length: Array) -> Array:
        """dv/dt [m/s2] for velocities v (n, m, 3), rates w (n, 3) and positions c (n, 8)."""
        w = w[:, None]
        thrust, loss = self.push(c[:, None])
        advance = (
            (v[:, :, None] + np.cross(w[:, :, None], self.t["position"])) * self.t["axis"]
        ).sum(-1)
        force = ((thrust - loss * advance)[..., None] * self.t["axis"]).sum(2)
        force -= self.linear * v + self.square * v * np.abs(v) + np.cross(w, self.mass * v)
        end = v + np.cross(w, self.end)
        tether = self.pull * length[:, None] * np.linalg.norm(end, axis=2, keepdims=True)
        return (force - tether * end) / self.mass


def ekf(flown: Sequence[Flown], vehicles: Sequence[Vehicle], noises: Array) -> Array:
    """Surge and sway [m/s], (n, time, 2): state of three velocities and accelerometer biases.

    Args:
      noises: of the equations and of the accelerometer, see `NOISES`, (n, 2).
    """
    hulls, period = Hulls(vehicles), flown[0].period
    c, rates, force, depth, length = (padded(m.rows(*names) for m in flown) for names in READ)
    down = padded(m.matrix()[:, 2] for m in flown)
    rise = np.diff(depth, axis=1) / period
    n, step, eye = len(flown), period / SUBSTEPS, np.eye(6)
    x, cov = np.zeros((n, 6)), np.tile(np.diag([0.05**2] * 3 + [BIAS**2] * 3), (n, 1, 1))
    process = np.array([[*[a**2 * period] * 3, *[1e-8] * 3] for a in noises[:, 0]])[:, None] * eye
    noise = np.array([[2.0 * (DEPTH_NOISE / period) ** 2, *[b**2] * 3] for b in noises[:, 1]])
    noise = noise[:, None] * np.eye(4)
    found, place, moves = np.zeros((*c.shape[:2], 2)), c[:, 0] * 0.0, np.vstack([eye[0] * 0, eye])
    for k in range(1, c.shape[1]):
        many = x[:, None] + NUDGE * moves
        for part in (np.arange(SUBSTEPS) + 0.5) / SUBSTEPS:
            now, w = (row[:, k - 1] + part * (row[:, k] - row[:, k - 1]) for row in (c, rates))
            place = place + (now - place) * -np.expm1(-step / hulls.t["lag"][:, 0])
            many[..., :3] += step * hulls.change(many[..., :3], w, place, length[:, k])
        x, jacobian = many[:, 0], np.swapaxes(many[:, 1:] - many[:, :1], 1, 2) / NUDGE
        cov = jacobian @ cov @ np.swapaxes(jacobian, 1, 2) + process
        many = x[:, None] + NUDGE * moves
        felt = hulls.change(many[..., :3], rates[:, k], place, length[:, k]) + many[..., 3:]
        felt += np.cross(rates[:, None, k], many[..., :3]) - 9.81 * down[:, None, k]
        fall = (many[..., :3] * down[:, None, k]).sum(-1, keepdims=True)
        seen = np.concatenate([fall, felt], axis=2)
        h = np.swapaxes(seen[:, 1:] - seen[:, :1], 1, 2) / NUDGE
        across = cov @ np.swapaxes(h, 1, 2)
        gain = across @ np.linalg.inv(h @ across + noise)
        miss = np.concatenate([rise[:, k - 1], force[:, k]], axis=1) - seen[:, 0]
        x = x + (gain @ miss[..., None])[..., 0]
        cov = (eye - gain @ h) @ cov
        found[:, k] = x[:, :2]
    return found


def accelerometer(flown: Flown) -> Array:
    """Surge and sway [m/s] by the integral of specific force and gravity from rest, (time, 2)."""
    turn = flown.matrix()
    change = np.einsum("nij,nj->ni", turn, flown.rows(*READ[2])) + np.array([0.0, 0.0, 9.81])
    return np.asarray(np.einsum("nij,ni->nj", turn, integrate(change, flown.period))[:, :2])


def doppler(flown: Flown) -> Array:
    """Surge and sway [m/s] by the Doppler log in its lock, held without one, (time, 2)."""
    log = flown.rows("measured_dvl_surge", "measured_dvl_sway")
    good = np.isfinite(log).all(axis=1)
    last = np.maximum.accumulate(np.where(good, np.arange(len(log)), -1))
    return np.where(last[:, None] >= 0, log[last], 0.0)


def errors(flown: Flown, said: Array, log: bool = False) -> Array:
    """Mean squared errors of surge and sway, drift in % of the path, and in m/min.

    A Doppler log is judged by the velocity that its lock measures, over ground or through the
    water, and by the track over ground of the estimator `dvl`.
    """
    s, truth = flown.signals, flown.rows("true_surge", "true_sway")
    said = said[: len(truth)]
    track = true_water_track(s, flown.period)
    made = water_track(*said.T, s["measured_depth"], AttitudeSeries.of(s), flown.period)
    if log:
        over = flown.rows(*(f"true_velocity_{n}" for n in ("north", "east", "down")))
        over = np.einsum("nij,ni->nj", flown.matrix("true"), over)[:, :2]
        truth = np.where(s["measured_dvl_mode"][:, None] == WATER, truth, over)
        found = open_velocity_estimator("dvl", flown.nominal, flown.period).batch(s).ground_track
        track, made = true_ground_track(s), made * 0.0 if found is None else found
    end, path = np.linalg.norm(made[-1] - track[-1]), true_water_path(s, flown.period)[-1]
    minutes = flown.period * (len(said) - 1) / 60.0
    return np.array([*np.mean((said - truth) ** 2, axis=0), 100.0 * end / path, end / minutes])


def main(
    run: command.Positional[Path], folder: Path = Path("rov-missions"), hours: float = 5.0,
    json: bool = False,
) -> None:  # fmt: skip
    """Print the figures of every method, with networks of a run, on `hours` of each set."""
    tuning, noises = missions(folder, [{}], 0.2 * hours, 12), {}
    for whose in ("nominal", "own"):
        many = [m for _ in NOISES for m in tuning]
        said = ekf(many, [getattr(m, whose) for m in many], np.repeat(NOISES, len(tuning), axis=0))
        each = [errors(m, one)[:2] for m, one in zip(many, said, strict=True)]
        mse = np.mean(np.reshape(each, (len(NOISES), -1)), axis=1)
        noises[whose] = NOISES[int(np.argmin(mse))]
    network = open_velocity_estimator(f"network:{run}", tuning[0].nominal, tuning[0].period)

    def networks(m: Flown) -> Array:
        found = network.batch(m.signals)
        return np.stack([found.surge, found.sway], axis=1)  # type: ignore[arg-type]

    found = []
    for name, (stores, seed) in SETS.items():
        flown = missions(folder, stores, hours, seed)
        files, own = [m.nominal for m in flown], [m.own for m in flown]
        c, length = (padded(m.rows(*READ[k]) for m in flown) for k in (0, 4))
        ones = np.ones((len(flown), 1))
        methods: dict[str, Any] = {
            "networks": map(networks, flown),
            "zero": np.zeros((*c.shape[:2], 2)),
            "thrust model": Hulls(files).balance(c, length)[..., :2],
            "EKF": ekf(flown, files, ones * noises["nominal"]),
            "EKF, own hull": ekf(flown, own, ones * noises["own"]),
            "accelerometer": map(accelerometer, flown),
            "Doppler log": map(doppler, flown),
        }
        for method, said in methods.items():
            pairs = zip(flown, said, strict=True)
            each = np.array([errors(m, one, "Doppler" in method) for m, one in pairs])
            row: dict[str, Any] = {"missions": f"{len(flown)}, {name}", "method": method}
            for k, label in enumerate(("surge RMSE", "sway RMSE", "drift %", "drift m/min")):
                one = [each[:, k].mean(), *np.percentile(drawn(each[:, k]), (2.5, 97.5))]
                row[label] = "{:.3g} ({:.3g} to {:.3g})".format(*(np.sqrt(one) if k < 2 else one))
            found.append(row)
    command.say({"noises": noises, "rows": found}, found, json=json)


if __name__ == "__main__":
    raise SystemExit(command.run(main))
