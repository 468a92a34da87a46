"""Assessment: the health of every deployment of a store of logs.

found = assess("real.zarr", vehicle="mine.xml")
found[0].alarm, found[0].kind, found[0].since_dive
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.health.channels import CHANNELS, NAMES
from glider_twin_ops.health.deployment_dives import told_by
from glider_twin_ops.health.deployment_health import (
    NONE,
    DeploymentHealth,
    KindVerdict,
    loud_channels,
)
from glider_twin_ops.health.disturbances import standing, steps_in_shear
from glider_twin_ops.health.judgement import (
    FIRST,
    Levels,
    Verdict,
    follow,
    judge,
    sure,
    threshold_of,
)
from glider_twin_ops.health.signatures import (
    Hypothesis,
    Signatures,
    TypicalDive,
    confusable,
    signatures_of,
)
from twin import Vehicle, load_vehicle
from twin.errors import InputError
from twin.faults import FAULTS, Fault
from twin.identify import start_vehicle
from twin.numbers import Array
from twin.records import LogStore
from twin.records.storage import StorePath

LEAST_DIVES = FIRST + 2
"""Dives below which nothing is judged: those that a fault needs before it, and two of an alarm"""
OFTEN = 6
"""Dives that must tell a channel for it to tell faults apart"""
ENDS, BELOW = 0.0, 1.0
"""Log of the odds below which an alarm ends: none is then as likely; and by how much it falls below
a level that is lower itself, so that an alarm does not flap"""
LEANING = 3.0
"""[degree] of what turns a vehicle, in dives and in climbs, from which on it leans to one side"""


def assess(
    store: str | StorePath,
    vehicle: str | Path | Vehicle | None = None,
    *,
    false_alarm_days: float = 30.0,
    deployments: Sequence[str] | None = None,
    advance: Callable[[], object] = lambda: None,
) -> list[DeploymentHealth]:
    """Judge every deployment of a store of logs.

    Args:
      store: of logs, as `factory import` or `factory generate --preset faulty` writes it.
      vehicle: that made them: what `twin identify` wrote, or a shipped name; default the one of the
        log's kind.
      false_alarm_days: [d] of sound vehicles in which one false alarm is borne.
      deployments: names of those to judge, all by default.
      advance: called once for each deployment that is done.

    Raises:
      StoreError: no store of logs. InputError: an unknown deployment, a rate that nobody can bear,
        a vehicle that cannot fly the log's dives.
    """
    threshold = threshold_of(false_alarm_days)
    if vehicle is None:
        vehicle = start_vehicle(store)
    elif not isinstance(vehicle, Vehicle):
        vehicle = load_vehicle(vehicle)
    with LogStore(store) as logs:
        names = list(dict.fromkeys(logs.deployments))
        for name in deployments or ():
            if name not in names:
                raise InputError(f"store {store} has no deployment {name!r}: {', '.join(names)}")
        found = []
        for name in deployments or names:
            told = told_by(logs, name, vehicle)
            found.append(judged(**told, vehicle=vehicle, threshold=threshold))
            advance()
    return found


def judged(
    name: str,
    numbers: Sequence[int],
    values: Array,
    time: Array,
    ways: Array,
    dive: TypicalDive,
    vehicle: Vehicle,
    threshold: float,
    changes: Array | None = None,
    powered: Sequence[bool] = (),
    wander: Array | None = None,
) -> DeploymentHealth:
    """A verdict over the channels of a deployment.

    Args:
      numbers: of the dives, as the log counts. values: (dives, channels).
      time: [s] unix, of the middles of the dives. ways: (dives, 2), see `dives_of`.
      dive: that faults are flown in.
      changes: see `changes_of`. powered: whether a thruster drove each dive.
      wander: see `wander_of`.
    """
    untold = {
        c.name for c, column in zip(CHANNELS, values.T, strict=True)
        if not np.isfinite(column).any()
    } if len(values) else set()  # fmt: skip
    lacking = tuple(
        c.name for c in CHANNELS
        if c.name in untold and (not c.instead or c.instead in untold)
    )  # fmt: skip
    seen = values if len(values) else np.full((1, len(CHANNELS)), math.nan)
    days = (time - time[0]) / 86400.0 if len(time) else np.zeros(0)
    judgeable = len(values) >= LEAST_DIVES
    signatures = flown_signatures(vehicle, dive) if judgeable else None
    steps = np.zeros(seen.shape) if wander is None else np.broadcast_to(wander, seen.shape)
    if signatures is not None:
        sheared = steps_in_shear(signatures.sheared, ways, days, dive.depth)
        steps = np.hypot(steps, sheared)
    levels = follow(seen, changes, steps)
    shared: dict[str, Any] = {
        "name": name, "days": float(days[-1]) if len(days) else 0.0, "dives": tuple(numbers),
        "threshold": threshold, "levels": levels, "values": values, "time": time,
        "lacking": lacking, "remarks": (
            *remarks_of(numbers, values, changes, powered, vehicle), *_loud(numbers, levels),
        ),
        "driven": _driven(numbers, powered),
    }  # fmt: skip
    if signatures is None:
        return DeploymentHealth(
            **shared, alarm=False, rang=(), kind=NONE, since_dive=None, noticed_dive=None,
            probability=0.0, kinds=(), evidence=np.full(len(values), -math.inf),
        )  # fmt: skip
    every = signatures.in_dives(ways)
    known = np.atleast_1d(np.isfinite(values).any(axis=0))
    hypotheses = [one for one in every if one.shows_in(known)] or every
    verdict = judge(levels, days, hypotheses, standing(ways, days))
    rang = rings(verdict.evidence, threshold)
    noise = np.where(np.isfinite(values).sum(axis=0) >= OFTEN, [c.noise for c in CHANNELS], np.inf)
    groups = confusable(hypotheses, noise)
    alarm = bool(rang) and rang[-1][1] == len(values) - 1
    loud = [NAMES.index(channel.name) for channel, _ in loud_channels(levels)]
    telling = {one.kind for one in hypotheses if (_over(one)[loud] > 1.0).any()}
    order = np.argsort(-verdict.probability, kind="stable").tolist()
    order[alarm:] = sorted(order[alarm:], key=lambda k: verdict.kinds[k] not in telling)
    kinds = tuple(_kind(verdict, k, hypotheses, levels, numbers, groups) for k in order)
    first = kinds[0]
    return DeploymentHealth(
        **shared,
        alarm=alarm,
        kind=first.kind if alarm else NONE,
        since_dive=first.since_dive if alarm else None,
        noticed_dive=int(numbers[rang[-1][0]]) if alarm else None,
        rang=tuple((int(numbers[begin]), int(numbers[end])) for begin, end in rang),
        probability=first.probability if alarm else float(verdict.probability.sum()),
        kinds=kinds,
        evidence=verdict.evidence,
    )


def rings(evidence: Array, threshold: float) -> list[tuple[int, int]]:
    """First and last dive, as places, of each alarm: two dives in a row begin it and end it."""
    ends = min(ENDS, threshold - BELOW)
    surely = sure(evidence)
    found: list[tuple[int, int]] = []
    ringing = False
    for d, odds in enumerate(evidence.tolist()):
        if not ringing and surely[d] > threshold:
            found.append((d, d))
            ringing = True
        elif ringing and max(odds, float(evidence[d - 1])) > ends:
            found[-1] = (found[-1][0], d)
        else:
            ringing = False
    return found


def _driven(numbers: Sequence[int], powered: Sequence[bool]) -> tuple[int, ...]:
    """Numbers of the dives that a thruster drove."""
    return tuple(int(n) for n, is_driven in zip(numbers, powered, strict=False) if is_driven)


def remarks_of(
    numbers: Sequence[int],
    values: Array,
    changes: Array | None,
    powered: Sequence[bool],
    vehicle: Vehicle,
) -> tuple[str, ...]:
    """What is no fault and explains a log, in whole sentences."""
    found = []
    if driven := _driven(numbers, powered):
        found.append(
            f"A thruster drove {_dives(driven)}: glide, trim, turns and power are not judged there."
        )
    part = vehicle.steered("heading")
    if len(values) and part is not None:
        held = [values[:, NAMES.index(name)] for name in ("turn_dive", "turn_climb")]
        if all(np.isfinite(one).any() for one in held):
            down, up = (float(np.nanmedian(one)) for one in held)
            if min(abs(down), abs(up)) > LEANING and down * up > 0.0:
                found.append(
                    f"It holds its heading with the {part.name} at {down:.0f} degrees in dives and "
                    f"{up:.0f} in climbs: an asymmetry of the hull or the trim, or the zero of "
                    "that drive."
                )
    changed = [] if changes is None else np.flatnonzero(changes > 1.0).tolist()
    if changed:
        found.append(
            f"Depth, pitch or pumped volume were changed in {_dives([numbers[d] for d in changed])}"
            ": what changes there with them counts as the pilot's."
        )
    return tuple(found)


def _loud(numbers: Sequence[int], levels: Levels) -> list[str]:
    """Of each loud channel a sentence."""
    return [
        f"In dive {numbers[-1]} {channel.name} was {abs(off):.0f} deviations off its level "
        f"({channel.says}): look at its plot."
        for channel, off in loud_channels(levels)
    ]


def _dives(numbers: Sequence[int]) -> str:
    """Numbers of dives as a person writes them: dives 3, 8 to 13."""
    runs: list[list[int]] = []
    for n in numbers:
        if runs and n == runs[-1][-1] + 1:
            runs[-1] = [runs[-1][0], n]
        else:
            runs.append([n, n])
    words = [f"{a}" if a == b else f"{a} to {b}" for a, b in runs]
    return f"dive{'s' if len(numbers) > 1 else ''} {', '.join(words)}"


def _over(one: Hypothesis) -> Array:
    """[noise] by which a fault of its usual size shows in each channel, (channels,)."""
    shown = np.nan_to_num(np.abs(np.atleast_2d(one.signature))).max(axis=0) * one.scale
    return np.asarray(shown / np.array([channel.noise for channel in CHANNELS]))


def _kind(
    verdict: Verdict,
    k: int,
    hypotheses: Sequence[Hypothesis],
    levels: Levels,
    numbers: Sequence[int],
    groups: dict[str, set[str]],
) -> KindVerdict:
    name = verdict.kinds[k]
    best = hypotheses[verdict.best[k]]
    kind = FAULTS[name]
    first = int(verdict.since[k])
    over = _over(best)
    told = np.atleast_1d(np.isfinite(levels.innovation).any(axis=0))
    by = [c for c in np.argsort(-over).tolist() if over[c] > 1.0 and told[c]][:4]
    loud = np.nan_to_num(np.abs(levels.innovation[first:, by])).sum(axis=1) if by else np.zeros(0)
    look = sorted(first + int(d) for d in np.argsort(-loud)[:3]) if len(loud) else []
    settings = {
        field.name: getattr(best.fault, field.name)
        for field in dataclasses.fields(Fault) + dataclasses.fields(best.fault)
        if field.name not in ("start", kind.size_name)
    }
    return KindVerdict(
        kind=name,
        says=kind.says,
        probability=float(verdict.probability[k]),
        since_dive=int(numbers[first]) if first < len(numbers) else None,
        size=float(verdict.size[k]),
        size_deviation=float(verdict.size_deviation[k]),
        unit=kind.unit,
        settings=settings,
        dives=tuple(int(numbers[d]) for d in look),
        channels=tuple(CHANNELS[c].name for c in by),
        also=tuple(sorted(groups[name] - {name})),
        otherwise=kind.otherwise,
        find_out=kind.find_out,
    )


_SIGNATURES: dict[tuple[Any, ...], Signatures] = {}


def flown_signatures(vehicle: Vehicle, dive: TypicalDive) -> Signatures:
    """Those of a vehicle in a dive; what is flown is kept for the next deployment of it."""
    key = (vehicle.xml, str(vehicle.changes()), dive, tuple(FAULTS.names()))
    if key not in _SIGNATURES:
        _SIGNATURES[key] = signatures_of(vehicle, dive)
    return _SIGNATURES[key]
