"""Propelled: dead reckoning of propelled vehicles without their Doppler logs.

One run is left out each time; every method knows the velocities of the vehicle's other runs alone.
Then one vehicle is left out, and methods know the velocities of the other vehicles. Networks learn
from these runs, from simulation, or from both. The combination weighs all methods by their errors
in training runs that are held out for that.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from benchmarks.real_logs.propelled_networks import NETWORKS, Pretrained, network_velocities
from benchmarks.real_logs.propelled_runs import Run
from benchmarks.real_logs.propelled_speeds import (
    CONSTANT,
    LINE,
    METHODS,
    known,
    learned_quiet,
    limit_surge,
    standing_samples,
)
from benchmarks.real_logs.row import (
    Method,
    Row,
    bootstrap,
    central,
    common,
    pooled_draws,
    rmse,
    rmse_rows,
)
from twin.navigation.dead_reckoning import Array, AttitudeSeries, rotate_to_ned

SURGE, SWAY, PATH = "propelled, surge", "propelled, sway", "propelled, path"
RATIO, UNDER_WAY = "propelled, surge over constant speed", "propelled, surge under way"
STANDING, LATER = "propelled, standing", "propelled, second half by the first"
LEFT_OUT = "propelled, one vehicle left out"
TASKS = (SURGE, RATIO, UNDER_WAY, SWAY, PATH, STANDING, LATER, LEFT_OUT)
PIECE = 120.0
"""[s] Pieces that the bootstrap draws where a vehicle has less than four runs"""
FEW = 4
"""Fewest runs for a bootstrap over runs; fewest moving samples for a default"""
EQUAL = 0.02
"""[1] Pull of the combination's weights towards equal ones, as a fraction of the variance"""
PLAIN = "constant speed, never standing"
COMBINED, DEFAULT, FIRST = "combination", "default", "mean of the first half"
STANDING_FIGURES = ("standing, found", "moving, taken for standing")
FLOORS = ("own mean, in hindsight", "line in all inputs, in hindsight")
Found = dict[str, Array]
"""Surge and sway [m/s] of a run, (2, time), by method"""


@dataclasses.dataclass(frozen=True)
class Fold:
    """Runs of a vehicle that are left out, with the runs and networks that methods learn from."""

    train: tuple[Run, ...]
    tests: tuple[Run, ...]
    pretrained: Pretrained | None
    """Networks trained on simulation; None: no networks"""
    seed: int
    place: Path | None
    """Folder that keeps what networks predicted"""

    @property
    def own(self) -> bool:
        """True: methods know runs of the same vehicle."""
        return self.train[0].vehicle == self.tests[0].vehicle

    def network_velocities(self, used: Sequence[Run], held: Sequence[Run]) -> list[Found]:
        """Velocities of held-out runs and of the tests; an earlier call's where it kept them."""
        count, first = len(held) + len(self.tests), self.tests[0]
        if self.pretrained is None or self.place is None:
            return [{} for _ in range(count)]
        by = "-".join(dict.fromkeys(run.vehicle for run in self.train))
        path = self.place / f"{first.vehicle}-{first.name}-by-{by}-{self.seed}.npz"
        if not path.exists():
            found = network_velocities(used, held, self.tests, self.pretrained, self.seed)
            np.savez(path, **{f"{n} {k}": v for k, one in enumerate(found) for n, v in one.items()})
        with np.load(path) as kept:
            return [{n: kept[f"{n} {k}"] for n in NETWORKS} for k in range(count)]


Vehicles = Mapping[str, Sequence[Run]]
"""Runs by vehicle"""


def folds(
    vehicles: Vehicles, pretrained: Pretrained | None, seed: int, place: Path | None
) -> list[Fold]:
    """Make a fold for each run, by the vehicle's other runs, and for each vehicle, by others."""
    found = []
    for vehicle, runs in vehicles.items():
        others = tuple(r for name, some in vehicles.items() if name != vehicle for r in some)
        parts = [(tuple(other for other in runs if other is not run), (run,)) for run in runs]
        parts.append((others, tuple(runs)))
        found += [Fold(*part, pretrained, seed, place) for part in parts if part[0]]
    return found


def split(train: Sequence[Run], test: Run) -> tuple[list[Run], list[Run]]:
    """Divide training runs into used and held-out ones: the vehicle most alike, every fourth run,
    the last of few, or half of a single one."""
    alike = {run.vehicle: len(set(run.signals) & set(test.signals)) for run in train}
    if len(alike) > 1:
        held = max(alike, key=lambda name: alike[name])
        return [r for r in train if r.vehicle != held], [r for r in train if r.vehicle == held]
    if len(train) == 1:
        half = train[0].surge.size // 2
        return [train[0].part(slice(0, half))], [train[0].part(slice(half, None))]
    rows = list(range(3, len(train), 4)) or [len(train) - 1]
    return [r for k, r in enumerate(train) if k not in rows], [train[k] for k in rows]


def velocities(train: Sequence[Run], runs: Sequence[Run]) -> list[Found]:
    """Velocities of runs by each method that their signals and the training runs' allow."""
    found: list[Found] = [{} for _ in runs]
    yaw, sway = known(train, lambda run: np.stack([run.signals["r"], run.sway], axis=1)).T
    good = np.isfinite(sway)
    turned = float(yaw[good] @ yaw[good])
    slope = float(yaw[good] @ sway[good]) / turned if turned > 0.0 else 0.0
    mean = float(sway[good].mean())
    quiet = learned_quiet(train)
    for name, (fit, needs) in METHODS.items():
        able = [run for run in train if needs <= set(run.signals) and run.moving.any()]
        predict = fit(able) if able else None
        for run, one in zip(runs, found, strict=True):
            if predict is None or not needs <= set(run.signals):
                continue
            surge = predict(run)
            if name == CONSTANT:
                one[PLAIN] = np.stack([surge, np.full(surge.size, mean)])
            side = np.where(standing_samples(run, quiet), 0.0, slope * run.signals["r"])
            one[name] = np.stack([limit_surge(run, surge, quiet, name), side])
    return found


def run(fold: Fold) -> list[Found]:
    """Velocity of each left-out run by each method, and their combination."""
    used, held = split(fold.train, fold.tests[0])
    found = velocities(used, held) + velocities(fold.train, fold.tests)
    networks = fold.network_velocities(used, held)
    found = [one | more for one, more in zip(found, networks, strict=True)]
    early, answers = found[: len(held)], found[len(held) :]
    names = [n for n in answers[0] if n != PLAIN and all(n in one for one in found)]
    both = []
    for axis in (0, 1):
        weights = combine(held, [[one[name][axis] for name in names] for one in early], axis)
        both.append([weights @ [one[name][axis] for name in names] for one in answers])
    return [
        one | {COMBINED: np.stack(pair)}
        for one, pair in zip(answers, zip(*both, strict=True), strict=True)
    ]


def combine(held: Sequence[Run], found: Sequence[Sequence[Array]], axis: int) -> Array:
    """Weights of the methods, at least 0 and 1 together, of least error on held-out runs.

    Args:
      found: surge or sway [m/s] of each run by each method. axis: 0 for surge, 1 for sway.
    """
    rows = [run.moving & np.isfinite((run.surge, run.sway)[axis]) for run in held]
    truth = np.concatenate([(r.surge, r.sway)[axis][m] for r, m in zip(held, rows, strict=True)])
    each = np.concatenate([np.stack(f, axis=1)[m] for f, m in zip(found, rows, strict=True)])
    size = each.shape[1]
    pull = np.sqrt(EQUAL * truth.size) * (truth.std() if truth.size else 1.0)
    matrix = np.concatenate([each, pull * np.eye(size), 1e3 * np.ones((1, size))])
    weights, _ = nnls(matrix, np.concatenate([truth, np.full(size, pull / size), [1e3]]))
    return np.asarray(weights / weights.sum())


# --- scores ---------------------------------------------------------------------------------------


def pieces(runs: Sequence[Run]) -> list[tuple[int, slice]]:
    """Blocks of the bootstrap: runs, or their pieces if they are few; run and samples."""
    found = []
    for k, one in enumerate(runs):
        step = one.surge.size if len(runs) >= FEW else round(PIECE / one.period)
        found += [(k, slice(n, n + step)) for n in range(0, one.surge.size, step)]
    return found


def hindsight(one: Run) -> Found:
    """Lower bounds by hindsight on a run: its own mean, and a line in all its inputs."""
    inputs = np.stack([*one.signals.values(), np.ones(one.surge.size)], axis=1)
    both = [(v, one.moving & np.isfinite(v)) for v in (one.surge, one.sway)]
    return {
        name: np.stack([x @ np.linalg.lstsq(x[good], v[good], rcond=None)[0] for v, good in both])
        for name, x in zip(FLOORS, (inputs[:, -1:], inputs), strict=True)
    }


def methods_of(runs: Sequence[Run], found: Sequence[Found], axis: int, note: str) -> list[Method]:
    """Errors of surge or sway in moving samples of each piece, by methods that all runs have."""
    cut = pieces(runs)
    methods = []
    for name in [n for n in found[0] if all(n in one for one in found)]:
        off = [f[name][axis] - (r.surge, r.sway)[axis] for r, f in zip(runs, found, strict=True)]
        errors = {k: off[n][span][runs[n].moving[span]] for k, (n, span) in enumerate(cut)}
        learned = name in (*NETWORKS, COMBINED, DEFAULT)
        kind = "floor" if name in FLOORS else "network" if learned else "public method"
        methods.append(Method(name=name, kind=kind, note=note, errors=errors))
    return methods


def ratio_rows(vehicle: str, methods: Sequence[Method]) -> list[Row]:
    """Rows of each method's RMSE over that of the constant speed, on the same bootstrap samples."""
    draws = {one.name: pooled_draws([list(one.errors.values())]) for one in common(methods)}
    rows = []
    for one in methods:
        if one.kind != "floor" and one.name not in (CONSTANT, PLAIN):
            over = draws[one.name] / draws[CONSTANT]
            low, high = central(over[1:])
            rows.append(Row(
                task=RATIO, data=vehicle, method=one.name, kind=one.kind, value=float(over[0]),
                low=low, high=high, unit="1", note=one.note, dives=len(one.errors),
                samples=sum(errors.size for errors in one.errors.values()),
            ))  # fmt: skip
    return rows


def path_rows(vehicle: str, runs: Sequence[Run], found: Sequence[Found]) -> list[Row]:
    """Rows of the error of dead reckoning at the end of the runs, in % of their paths."""
    cut = pieces(runs)
    whose = np.array([number for number, _ in cut])
    drawn = np.vstack([np.arange(len(cut)), bootstrap(len(cut))])
    rows = []
    for method in methods_of(runs, found, 0, ""):
        off, path = np.zeros((len(cut), 2)), np.zeros(len(cut))
        for k, (number, span) in enumerate(cut):
            one = runs[number]
            truth = np.stack([one.surge, one.sway])
            good = np.isfinite(truth).all(axis=0)
            errors = np.where(good, found[number][method.name] - truth, 0.0)
            attitude = AttitudeSeries(**{n: one.signals[n] for n in ("roll", "pitch", "heading")})
            level = rotate_to_ned(np.column_stack([*errors, np.zeros(good.size)]), attitude)
            off[k] = one.period * level[span, :2].sum(axis=0)
            path[k] = one.period * np.abs(np.where(good, one.surge, 0.0)[span]).sum()
        ends = np.zeros((len(drawn), len(runs), 2))
        for row, end in zip(drawn, ends, strict=True):
            np.add.at(end, whose[row], off[row])
        figures = 100.0 * np.hypot(*ends.transpose(2, 0, 1)).sum(axis=1) / path[drawn].sum(axis=1)
        low, high = central(figures[1:])
        rows.append(Row(
            task=PATH, data=vehicle, method=method.name, kind=method.kind, value=float(figures[0]),
            low=low, high=high, unit="%", samples=len(runs), dives=len(runs),
            note=f"end errors over {path.sum():.0f} m",
        ))  # fmt: skip
    return rows


def standing_rows(vehicle: str, runs: Sequence[Run]) -> list[Row]:
    """Rows of standing samples that are found, and of moving ones that are taken for them."""
    rows = []
    for name in STANDING_FIGURES:
        hit = size = 0
        for k, one in enumerate(runs):
            quiet = learned_quiet([*runs[:k], *runs[k + 1 :]]) if len(runs) > 1 else 0.0
            asked = (
                one.moving if name.startswith("moving") else np.isfinite(one.surge) & ~one.moving
            )
            hit, size = (
                hit + int((standing_samples(one, quiet) & asked).sum()),
                size + int(asked.sum()),
            )
        if size:
            rows.append(Row(
                task=STANDING, data=vehicle, method=name, kind="floor", value=100.0 * hit / size,
                unit="%", samples=size, dives=len(runs),
            ))  # fmt: skip
    return rows


def halves(one: Run, found: Found) -> tuple[Run, Found] | None:
    """Second half of a run; the default method is the one of least error in the first half."""
    half = one.surge.size // 2
    rows = one.moving[:half]
    if rows.sum() < FEW or one.moving[half:].sum() < FEW:
        return None
    surge, sway = found[CONSTANT]
    mean = float(one.surge[:half][rows].mean())
    every = found | {FIRST: np.stack([np.where(surge > 0.0, mean, 0.0), sway])}
    errors = {n: rmse((v[0] - one.surge)[:half][rows]) for n, v in every.items()}
    kept = {name: every[name] for name in (CONSTANT, FIRST, COMBINED)}
    kept[DEFAULT] = every[min(errors, key=lambda name: errors[name])]
    return one.part(slice(half, None)), {name: v[:, half:] for name, v in kept.items()}


def under_way(runs: Sequence[Run], found: Sequence[Found]) -> list[Method]:
    """Errors at more than half the usual speed, where constant and line are fitted to the same."""
    slowest = 0.5 * float(np.percentile(known(runs, lambda run: run.surge), 90.0))
    fast = [dataclasses.replace(run, slowest=slowest) for run in runs]
    again = []
    for k, (one, answer) in enumerate(zip(fast, found, strict=True)):
        (fitted,) = velocities([*fast[:k], *fast[k + 1 :]], [one])
        again.append(answer | {name: fitted[name] for name in (CONSTANT, LINE) if name in fitted})
    return methods_of(fast, again, 0, f"above {slowest:.2f} m/s")


def rows_of(
    vehicles: Vehicles, jobs: Sequence[Fold], answers: Sequence[Sequence[Found]]
) -> list[Row]:
    """Rows of all tasks."""
    rows: list[Row] = []
    for vehicle, runs in vehicles.items():
        mine = [p for p in zip(jobs, answers, strict=True) if p[0].tests[0].vehicle == vehicle]
        own, other = ([f for j, a in mine if j.own is kind for f in a] for kind in (True, False))
        if own:
            full = [
                f | hindsight(r) if r.moving.any() else f for r, f in zip(runs, own, strict=True)
            ]
            full = [one for r, one in zip(runs, full, strict=True) if r.moving.any()]
            able = [run for run in runs if run.moving.any()]
            surge = methods_of(able, full, 0, "other runs' velocities")
            rows += rmse_rows(SURGE, vehicle, surge) + ratio_rows(vehicle, surge)
            rows += rmse_rows(SWAY, vehicle, methods_of(able, full, 1, "other runs' velocities"))
            rows += rmse_rows(UNDER_WAY, vehicle, under_way(runs, own))
            rows += path_rows(vehicle, runs, own)
        if other:
            learned = methods_of(runs, other, 0, "other vehicles' velocities")
            rows += rmse_rows(LEFT_OUT, vehicle, learned)
        parts = [halves(*pair) for pair in zip(runs, own or other, strict=bool(own or other))]
        later = [part for part in parts if part is not None]
        if later:
            cut = methods_of([r for r, _ in later], [f for _, f in later], 0, "second half")
            rows += rmse_rows(LATER, vehicle, cut)
        rows += standing_rows(vehicle, runs)
    return rows
