"""Assessment: health of every deployment of a store of logs.

found = assess("real.zarr", vehicle="mine.xml")
found[0].alarm, found[0].kind, found[0].since_dive
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_twin_ops.health.channels import (
    CHANNELS,
    HEADING,
    NAMES,
    NOISE,
    PLACE,
    Channel,
    ordered_steps,
    standing,
    steps_in_shear,
)
from glider_twin_ops.health.deployment_dives import told_by
from glider_twin_ops.health.dive_channels import Mask
from glider_twin_ops.health.judgement import (
    FIRST,
    NONE,
    Levels,
    Verdict,
    chance,
    follow,
    judge,
    rings,
    sure,
    threshold_of,
)
from glider_twin_ops.health.remarks import (
    ballast_remarks,
    compass_remarks,
    few_remark,
    plan_remarks,
    remarks_of,
)
from glider_twin_ops.health.signatures import (
    Hypothesis,
    Signatures,
    TypicalDive,
    signatures_of,
)
from twin import Vehicle, load_vehicle
from twin.errors import InputError
from twin.faults import FAULTS
from twin.identify import start_vehicle
from twin.numbers import Array
from twin.records import LogStore
from twin.records.storage import StorePath

LEAST_DIVES = FIRST + 2
"""Minimum number of dives that are judged: those before the earliest fault, and two for an alarm"""
OFTEN, LEAST_CHANNELS = 6, 5
"""OFTEN: minimum number of dives for a channel to count. LEAST_CHANNELS: minimum number of channels
that count for an alarm"""
TOGETHER = 0.1
"""Probability over that of the likeliest kind from which on a kind is named beside it"""
APART = 45.0
"""[degree] Smallest angle between two headings of legs"""
MOST_ROWS, UNLIKELY = 5, 0.005
"""MOST_ROWS: maximum number of kinds in a table. UNLIKELY: smallest probability of a listed kind"""
LOUD = 6.0
"""Standard deviations off its level above which a channel of the last dive is reported"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class KindVerdict:
    """Verdict on one kind of fault."""

    kind: str
    says: str
    probability: float
    since_dive: int | None
    """Number of the first faulty dive, as the log counts; None where the kind is unlikely"""
    size: float
    """Size in `unit`"""
    size_deviation: float
    unit: str
    dives: tuple[int, ...]
    """Numbers of the dives with the strongest evidence"""
    channels: tuple[str, ...]
    """Channels in which the fault shows"""
    also: tuple[str, ...]
    """Other kinds that are about as likely by the same dives"""
    otherwise: str
    find_out: str


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DeploymentHealth:
    """Health of one deployment."""

    name: str
    days: float
    """[d] Time from the first dive to the last"""
    dives: tuple[int, ...]
    """Numbers of the dives, as the log counts"""
    alarm: bool = False
    kind: str = NONE
    """Likeliest fault; none without an alarm"""
    since_dive: int | None = None
    noticed_dive: int | None = None
    """Dive after which the standing alarm was given"""
    rang: tuple[tuple[int, int], ...] = ()
    """First and last dive after which each alarm stood"""
    probability: float = 0.0
    """Probability of `kind`, or of any fault where there is no alarm"""
    kinds: tuple[KindVerdict, ...] = ()
    """Kinds that the vehicle can have and the log can show. The kind of an alarm comes first, then
    kinds that show in channels far off their level in the last dive, then the likeliest"""
    evidence: Array
    """Log odds of a fault after each dive, see `Verdict`, (dives,)"""
    threshold: float
    levels: Levels
    values: Array
    """Channels, (dives, channels)"""
    time: Array
    """[s] Unix time of the middle of each dive, (dives,)"""
    lacking: tuple[str, ...]
    """Channels that this log lacks"""
    remarks: tuple[str, ...]
    """Notes for the pilot that are no fault: thruster, steering angle, changed settings"""
    driven: tuple[int, ...] = ()
    """Numbers of the dives that a thruster propelled"""
    judged_dives: int = 0
    """Number of dives with `LEAST_CHANNELS` channels and more, of which none is a test dive"""
    compass_turned: tuple[float, float] | None = None
    """[degree] Compass reading less heading since the first dive, and its standard deviation; None
    without legs on three headings"""

    @property
    def judged(self) -> bool:
        """True where there were enough dives and channels; otherwise the probability is 0."""
        return bool(self.kinds)

    def describe(self) -> dict[str, object]:
        """Return plain values, as `--json` prints them."""
        same = ("name", "days", "alarm", "judged", "kind", "since_dive", "noticed_dive",
                "probability")  # fmt: skip
        first = self.kinds[0] if self.alarm else None
        of_alarm = ("size", "size_deviation", "otherwise", "find_out")
        return {
            **{name: getattr(self, name) for name in same},
            **{name: getattr(first, name, None) for name in of_alarm},
            "dives": len(self.dives),
            "judged_dives": self.judged_dives,
            "compass_turned": None if self.compass_turned is None else list(self.compass_turned),
            "also": list(first.also) if first else [],
            "rang": [list(dives) for dives in self.rang],
            "remarks": list(self.remarks),
            "lacking": list(self.lacking),
        }

    def likeliest(self) -> list[dict[str, object]]:
        """Rows of the table of kinds above `UNLIKELY`."""
        return [
            {
                "fault": kind.kind,
                "probability": kind.probability,
                "since dive": kind.since_dive,
                "size": kind.size,
                "+-": kind.size_deviation,
                "unit": kind.unit,
                "shows in": ", ".join(kind.channels),
                "dives to look at": ", ".join(map(str, kind.dives)),
            }
            for kind in self.kinds[:MOST_ROWS]
            if kind.probability > UNLIKELY
        ]

    def verdict(self) -> str:
        """Verdict in one line."""
        many = len(self.dives)
        told_by = len(CHANNELS) - len(self.lacking)
        if not self.judged:
            said = "1 dive is" if many == 1 else f"{many} dives are"
            if many >= LEAST_DIVES:
                said = f"{told_by} of {len(CHANNELS)} channels are"
            return f"{self.name}: {said} too few to judge"
        if self.alarm:
            first = self.kinds[0]
            told = f" or {', '.join(first.also)}" if first.also else ""
            unit = "" if first.unit == "1" else f" {first.unit}"
            glided, since = [dive for dive in self.dives if dive not in self.driven], ""
            if glided and self.dives[-1] in self.driven:  # little could speak against it
                since = f"; a thruster drove it after dive {glided[-1]}: hardly judged since"
            return (
                f"{self.name}: {first.says} ({first.kind}{told}) since dive {self.since_dive}, "
                f"{100.0 * self.probability:.0f} % sure, size {first.size:.3g} +- "
                f"{first.size_deviation:.2g}{unit}{since}"
            )
        found, by, before = "nothing wrong", "", ""
        if self.rang:
            before = f"; an alarm after dive {self.rang[-1][0]} ended after dive {self.rang[-1][1]}"
        if 2 * told_by < len(CHANNELS):
            by = f", judged by {told_by} of {len(CHANNELS)} channels only"
        if self.evidence[-1] > self.threshold:  # an alarm takes two dives
            before += f"; dive {self.dives[-1]} alone would be an alarm: the next one decides"
            found = "no alarm"
        if loud := loud_channels(self.levels):
            off = (f"{channel.name} was {abs(by):.0f} deviations off" for channel, by in loud)
            before += f"; look at dive {self.dives[-1]}: {' and '.join(off)}"
            found = "no alarm"
        return f"{self.name}: {found} in {many} dives, {self.days:.1f} d{by}{before}"


def loud_channels(levels: Levels) -> list[tuple[Channel, float]]:
    """Channels more than `LOUD` standard deviations off their level in the last dive, with that
    number, whatever the verdict."""
    if not len(levels.innovation):
        return []
    last = levels.innovation[-1].tolist()
    return [(one, off) for one, off in zip(CHANNELS, last, strict=True) if abs(off) > LOUD]


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
      store: store of logs, as `factory import` or `factory generate --preset faulty` writes it.
      vehicle: vehicle that made the logs: a file of `twin identify`, or a shipped name; default:
        the shipped one of the log's kind.
      false_alarm_days: [d] of sound vehicles in which one false alarm is accepted.
      deployments: names of the deployments to judge, all by default.
      advance: called after each deployment.

    Raises:
      StoreError: no store of logs. InputError: an unknown deployment, a rate that nobody can bear,

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
    tests: Sequence[bool] = (),
    wander: Array | None = None,
    ballast: float = 0.0,
) -> DeploymentHealth:
    """Judge the channels of a deployment.

    Args:
      numbers: numbers of the dives, as the log counts. values: (dives, channels).
      time: [s] unix, middles of the dives. ways: (dives, 2), see `dives_of`.
      dive: usual dive, in which faults are flown.
      changes: see `changes_of`. powered: True for dives that a thruster propelled. tests: True for
        test dives.
      wander: standard deviation of each channel's further step from dive to dive, where the log
        lacks a signal that it depends on, (channels,).
      ballast: [kg] weight that the vehicle's file lacks, which `values` are made with.
    """
    many = len(values)
    told = np.isfinite(values).reshape(-1, len(CHANNELS))
    ever: Mask = np.asarray(told.any(axis=0))
    untold = set(itertools.compress(NAMES, ~ever)) if many else set()
    lacking = tuple(c.name for c in CHANNELS if {c.name, c.instead or c.name} <= untold)
    seen = values if many else np.full((1, len(CHANNELS)), math.nan)
    days = (time - time[0]) / 86400.0 if len(time) else np.zeros(0)
    signatures = flown_signatures(vehicle, dive) if many >= LEAST_DIVES else None
    steps = np.zeros(seen.shape) if wander is None else np.broadcast_to(wander, seen.shape)
    if changes is not None and many:
        steps = np.hypot(steps, ordered_steps(changes))
    if signatures is not None:
        steps = np.hypot(steps, steps_in_shear(signatures.sheared, ways, days, dive.depth))
    levels = follow(seen, steps)
    off_level = loud_channels(levels)
    often = told.sum(axis=0) >= OFTEN
    remarks = remarks_of(numbers, values, changes, powered, tests, vehicle, off_level)
    enough = told.sum(axis=1) >= LEAST_CHANNELS
    found = DeploymentHealth(
        name=name,
        days=float(days[-1]) if len(days) else 0.0,
        dives=tuple(numbers),
        threshold=threshold,
        levels=levels,
        values=values,
        time=time,
        lacking=lacking,
        remarks=remarks,
        driven=tuple(itertools.compress(numbers, powered)),
        evidence=np.full(many, -math.inf),
        judged_dives=int(sum(enough) - sum(itertools.compress(enough, tests))),
    )
    if signatures is None:
        return found
    every = signatures.in_dives(ways)
    remarks += plan_remarks(dive, signatures.dive, vehicle) + ballast_remarks(ballast)
    if often.sum() < LEAST_CHANNELS:
        shown = {one.kind for one in every if (_over(one)[often] > 1.0).any()}
        hidden = {one.kind for one in every} - shown
        remarks += (few_remark(list(itertools.compress(NAMES, often)), shown, hidden),)
        return dataclasses.replace(found, remarks=remarks)
    hypotheses = [one for one in every if (_over(one)[ever] > 0.0).any()] or every
    verdict = judge(levels, days, hypotheses, standing(ways, days))
    turned = compass_turned(verdict, values, ways)
    remarks += compass_remarks(turned)
    rang = rings(verdict.evidence, threshold)
    alarm = bool(rang) and rang[-1][1] == many - 1
    loud = [NAMES.index(channel.name) for channel, _ in off_level]
    telling = {one.kind for one in hypotheses if (_over(one)[loud] > 1.0).any()}
    likely = verdict.probability
    if alarm:
        whole = max(float(likely.sum()), 1e-300)
        likely = likely * chance(float(sure(verdict.evidence)[-1])) / whole
    order = np.argsort(-likely, kind="stable").tolist()
    group = [k for k in order if likely[k] >= TOGETHER * likely[order[0]]]
    order[alarm:] = sorted(order[alarm:], key=lambda k: verdict.kinds[k] not in telling)
    kinds = [_kind(verdict, k, float(likely[k]), hypotheses, levels, numbers) for k in order]
    if alarm:
        also = tuple(verdict.kinds[k] for k in group if k != order[0])
        kinds[0] = dataclasses.replace(kinds[0], also=also)
    found = dataclasses.replace(
        found,
        rang=tuple((int(numbers[begin]), int(numbers[end])) for begin, end in rang),
        kinds=tuple(kinds),
        evidence=verdict.evidence,
        probability=float(likely.sum()),
        remarks=remarks,
        compass_turned=turned,
    )
    if not alarm:
        return found
    return dataclasses.replace(
        found,
        alarm=True,
        kind=kinds[0].kind,
        since_dive=kinds[0].since_dive,
        noticed_dive=int(numbers[rang[-1][0]]),
        probability=float(likely[group].sum()),
    )


def compass_turned(verdict: Verdict, values: Array, ways: Array) -> tuple[float, float] | None:
    """[degree] Compass reading less heading from the first dive on, and its standard deviation.

    None without two dives with a current on each of three headings.
    """
    known = np.isfinite(values[:, PLACE["current_north"]]) & np.isfinite(ways).all(axis=1)
    left, headings = np.rad2deg(np.arctan2(ways[known, 1], ways[known, 0])), 0
    while len(left):
        near = np.abs((left - left[0] + 180.0) % 360.0 - 180.0) < APART
        headings, left = headings + (near.sum() > 1), left[~near]
    if headings < 3:
        return None
    size, deviation = (float(np.rad2deg(one[HEADING])) for one in verdict.standing)
    return -size, deviation


def _over(one: Hypothesis) -> Array:
    """Change of each channel by a fault of its usual size, in noises, (channels,)."""
    shown = np.nan_to_num(np.abs(np.atleast_2d(one.signature))).max(axis=0) * one.scale
    return np.asarray(shown / NOISE)


def _kind(
    verdict: Verdict,
    k: int,
    probability: float,
    hypotheses: Sequence[Hypothesis],
    levels: Levels,
    numbers: Sequence[int],
) -> KindVerdict:
    """Verdict on one kind."""
    name, first = verdict.kinds[k], int(verdict.since[k])
    kind, over = FAULTS[name], _over(hypotheses[verdict.best[k]])
    told: Mask = np.asarray(np.isfinite(levels.innovation).any(axis=0))
    by = [c for c in np.argsort(-over).tolist() if over[c] > 1.0 and told[c]][:4]
    loud = np.nan_to_num(np.abs(levels.innovation[first:, by])).sum(axis=1) if by else np.zeros(0)
    look = sorted(first + int(d) for d in np.argsort(-loud)[:3])
    return KindVerdict(
        kind=name,
        says=kind.says,
        probability=probability,
        since_dive=int(numbers[first]) if first < len(numbers) else None,
        size=float(verdict.size[k]),
        size_deviation=float(verdict.size_deviation[k]),
        unit=kind.unit,
        dives=tuple(int(numbers[d]) for d in look),
        channels=tuple(CHANNELS[c].name for c in by),
        also=(),
        otherwise=kind.otherwise,
        find_out=kind.find_out,
    )


_SIGNATURES: dict[tuple[Any, ...], Signatures] = {}


def flown_signatures(vehicle: Vehicle, dive: TypicalDive) -> Signatures:
    """Signatures of a vehicle in a dive, kept for its next deployment."""
    key = (vehicle.xml, str(vehicle.changes()), dive, tuple(FAULTS.names()))
    if key not in _SIGNATURES:
        _SIGNATURES[key] = signatures_of(vehicle, dive)
    return _SIGNATURES[key]
