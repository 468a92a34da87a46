"""Propelled: dead reckoning of propelled vehicles without their Doppler logs.

One run is left out each time; every method knows the velocities of the vehicle's other runs alone.
Then one vehicle is left out, and methods know the velocities of the other vehicles. Networks learn
from these runs, from simulation, or from both. The combination shrinks and weighs all methods by
their errors in training runs that are held out for that.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.real_logs.propelled_combination import (
    COMBINED,
    FEW,
    PLAIN,
    SHRUNK,
    Found,
    Parts,
    combine,
    splits,
)
from benchmarks.real_logs.propelled_networks import NETWORKS, Pretrained, network_velocities
from benchmarks.real_logs.propelled_runs import Run
from benchmarks.real_logs.propelled_speeds import (
    CONSTANT,
    METHODS,
    known,
    learned_quiet,
    levels,
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
from twin.navigation.dead_reckoning import AttitudeSeries, rotate_to_ned

SURGE, SWAY, PATH = "propelled, surge", "propelled, sway", "propelled, path"
RATIO, UNDER_WAY = "propelled, surge over constant speed", "propelled, surge under way"
STANDING, LATER = "propelled, standing", "propelled, second half by the first"
LEFT_OUT, BOUND = "propelled, one vehicle left out", "propelled, surge beside bounds"
TASKS = (SURGE, BOUND, UNDER_WAY, LEFT_OUT, RATIO, SWAY, PATH, STANDING, LATER)
PIECE = 120.0
"""[s] Pieces that the bootstrap draws where a vehicle has less than four runs"""
DEFAULT, FIRST = "default", "mean of the first half"
STANDING_FIGURES = ("standing, found", "moving, taken for standing")
FLOORS = ("own mean, in hindsight", "line in all channels, in hindsight")
KEPT = (CONSTANT, COMBINED)
"""Methods that are not shrunk further"""
AROUND = (10.0, 30.0)
"""[s] Times around a sample whose means and noise the last line has"""


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

    def network_velocities(self, parts: Parts) -> list[Found]:
        """Velocities of held-out runs and of the tests; an earlier call's where it kept them."""
        count, first = sum(len(held) for _, held in parts) + len(self.tests), self.tests[0]
        if self.pretrained is None or self.place is None:
            return [{} for _ in range(count)]
        by = "-".join(dict.fromkeys(run.vehicle for run in self.train))
        path = self.place / f"{first.vehicle}-{first.name}-by-{by}-{self.seed}.npz"
        if not path.exists():
            found = network_velocities(parts, self.tests, self.pretrained, self.seed)
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
    """Velocity of each left-out run by each method, by each shrunk, and by their combination."""
    parts = splits(fold.train)
    networks = iter(fold.network_velocities(parts))
    found = []
    for used, runs in (*parts, (fold.train, fold.tests)):
        quiet = learned_quiet(used)
        for one, methods in zip(runs, velocities(used, runs), strict=True):
            for name, (surge, sway) in next(networks).items():
                methods[name] = np.stack([limit_surge(one, surge, quiet, name), sway])
            found.append(methods)
    held = [one for _, some in parts for one in some]
    early, answers = found[: len(held)], found[len(held) :]
    more = combine(held, early, answers)
    return [one | shrunk for one, shrunk in zip(answers, more, strict=True)]


# --- scores ---------------------------------------------------------------------------------------


def pieces(runs: Sequence[Run]) -> list[tuple[int, slice]]:
    """Blocks of the bootstrap: runs, or their pieces if they are few; run and samples."""
    found = []
    for k, one in enumerate(runs):
        step = one.surge.size if len(runs) >= FEW else round(PIECE / one.period)
        found += [(k, slice(n, n + step)) for n in range(0, one.surge.size, step)]
    return found


def hindsight(runs: Sequence[Run]) -> list[Found]:
    """Lower bounds of surge: each run's own mean, and one line for all runs in their channels and
    the means and noise around each sample."""
    inputs = []
    for run in runs:
        x = np.stack([*run.signals.values()])
        around = [part for seconds in AROUND for part in levels(x, seconds, run.period)]
        inputs.append(np.concatenate([x, *around, np.ones((1, run.surge.size))]))
    joined = np.concatenate([x[:, r.moving] for x, r in zip(inputs, runs, strict=True)], axis=1)
    law = np.linalg.lstsq(joined.T, known(runs, lambda run: run.surge), rcond=None)[0]
    own = [np.full(run.surge.size, run.surge[run.moving].mean()) for run in runs]
    both = [(mean, law @ x) for mean, x in zip(own, inputs, strict=True)]
    return [{n: np.stack([v, v]) for n, v in zip(FLOORS, one, strict=True)} for one in both]


def methods_of(runs: Sequence[Run], found: Sequence[Found], axis: int, note: str) -> list[Method]:
    """Errors of surge or sway in moving samples of each piece, by methods that all runs have."""
    cut = pieces(runs)
    methods = []
    for name in [n for n in found[0] if SHRUNK not in n and all(n in one for one in found)]:
        off = [f[name][axis] - (r.surge, r.sway)[axis] for r, f in zip(runs, found, strict=True)]
        errors = {k: off[n][span][runs[n].moving[span]] for k, (n, span) in enumerate(cut)}
        learned = name in (*NETWORKS, COMBINED, DEFAULT)
        kind = "floor" if name in FLOORS else "network" if learned else "public method"
        methods.append(Method(name=name, kind=kind, note=note, errors=errors))
    return methods


def ratio_rows(data: str, runs: Sequence[Run], found: Sequence[Found]) -> list[Row]:
    """Rows of each shrunk method's RMSE over that of the constant speed, on the same samples."""
    plain = [
        {n.removesuffix(SHRUNK): v for n, v in one.items() if n in KEPT or n.endswith(SHRUNK)}
        for one in found
    ]
    methods = common(methods_of(runs, plain, 0, "shrunk by the gain in held-out runs"))
    draws = {one.name: pooled_draws([list(one.errors.values())])[1:] for one in methods}
    level = {row.method: row for row in rmse_rows(RATIO, data, methods)}
    rows = []
    for name in [name for name in level if name != CONSTANT]:
        low, high = central(draws[name] / draws[CONSTANT])
        value = level[name].value / level[CONSTANT].value
        rows.append(dataclasses.replace(level[name], value=value, low=low, high=high, unit="1"))
    return rows


def path_rows(vehicle: str, runs: Sequence[Run], found: Sequence[Found]) -> list[Row]:
    """Rows of the error of dead reckoning at the end of the runs, in % of their paths."""
    cut = pieces(runs)
    whose = np.eye(len(runs))[[number for number, _ in cut]]
    drawn = np.stack([np.bincount(d, minlength=len(cut)) for d in bootstrap(len(cut))])
    drawn = np.vstack([np.ones(len(cut), int), drawn])
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
        ends = np.einsum("dp,pr,pk->drk", drawn, whose, off)
        figures = 100.0 * np.hypot(*ends.transpose(2, 0, 1)).sum(axis=1) / (drawn @ path)
        low, high = central(figures[1:])
        rows.append(Row(
            task=PATH, data=vehicle, method=method.name, kind=method.kind, value=float(figures[0]),
            low=low, high=high, unit="%", samples=len(runs), dives=len(runs),
            note=f"end errors over {path.sum():.0f} m",
        ))  # fmt: skip
    return rows


def standing_rows(vehicle: str, runs: Sequence[Run]) -> list[Row]:
    """Rows of standing samples that are found, and of moving ones that are taken for them."""
    others = [[other for other in runs if other is not one] for one in runs]
    quiet = [learned_quiet(some) if some else 0.0 for some in others]
    found = np.concatenate([standing_samples(*pair) for pair in zip(runs, quiet, strict=True)])
    moving = np.concatenate([one.moving for one in runs])
    still = np.isfinite(np.concatenate([one.surge for one in runs])) & ~moving
    return [
        Row(
            task=STANDING, data=vehicle, method=name, kind="floor", unit="%", dives=len(runs),
            value=100.0 * float(found[asked].mean()), samples=int(asked.sum()),
        )
        for name, asked in zip(STANDING_FIGURES, (still, moving), strict=True)
        if asked.any()
    ]  # fmt: skip


def halves(one: Run, found: Found) -> tuple[Run, Found] | None:
    """Second half of a run; the default is the method of `KEPT`, or the mean, of least error in the
    first half."""
    half = one.surge.size // 2
    rows = one.moving[:half]
    if rows.sum() < FEW or one.moving[half:].sum() < FEW:
        return None
    surge, sway = found[CONSTANT]
    mean = float(one.surge[:half][rows].mean())
    kept = {name: found[name] for name in KEPT}
    kept[FIRST] = np.stack([np.where(surge > 0.0, mean, 0.0), sway])
    errors = {n: rmse((v[0] - one.surge)[:half][rows]) for n, v in kept.items()}
    kept[DEFAULT] = kept[min(errors, key=lambda name: errors[name])]
    return one.part(slice(half, None)), {name: v[:, half:] for name, v in kept.items()}


def rows_of(
    vehicles: Vehicles, jobs: Sequence[Fold], answers: Sequence[Sequence[Found]]
) -> list[Row]:
    """Rows of all tasks."""
    rows: list[Row] = []
    for vehicle, runs in vehicles.items():
        mine = [p for p in zip(jobs, answers, strict=True) if p[0].tests[0].vehicle == vehicle]
        own, other = ([f for j, a in mine if j.own is kind for f in a] for kind in (True, False))
        if own:
            some = [pair for pair in zip(runs, own, strict=True) if pair[0].moving.any()]
            able, full = zip(*some, strict=True)
            note = "other runs' velocities"
            rows += rmse_rows(SURGE, vehicle, methods_of(able, full, 0, note))
            rows += rmse_rows(SWAY, vehicle, methods_of(able, full, 1, note))
            both = [f | bound for f, bound in zip(full, hindsight(able), strict=True)]
            few = [one for one in methods_of(able, both, 0, note) if one.name in (*KEPT, *FLOORS)]
            rows += rmse_rows(BOUND, vehicle, few) + ratio_rows(vehicle, able, full)
            rows += path_rows(vehicle, runs, own)
            slowest = 0.5 * float(np.percentile(known(runs, lambda run: run.surge), 90.0))
            quick = [dataclasses.replace(one, slowest=slowest) for one in runs]
            same = folds({vehicle: quick}, jobs[0].pretrained, jobs[0].seed, jobs[0].place)
            again = [run(job)[0] for job in same]
            rows += rmse_rows(UNDER_WAY, vehicle, methods_of(quick, again, 0, f"{slowest:.2f} m/s"))
            rows += ratio_rows(f"{vehicle}, under way", quick, again)
        if other:
            rows += rmse_rows(LEFT_OUT, vehicle, methods_of(runs, other, 0, "other vehicles"))
            rows += ratio_rows(f"{vehicle}, by other vehicles", runs, other)
        parts = [halves(*pair) for pair in zip(runs, own or other, strict=bool(own or other))]
        later = [part for part in parts if part is not None]
        if later:
            cut = methods_of([r for r, _ in later], [f for _, f in later], 0, "second half")
            rows += rmse_rows(LATER, vehicle, cut)
        rows += standing_rows(vehicle, runs)
    return rows
