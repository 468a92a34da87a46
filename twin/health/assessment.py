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
from numpy.typing import NDArray

from twin.errors import InputError
from twin.faults.base import FAULTS, Fault
from twin.health.channels import CHANNELS, NAMES, DiveSignals, channels_of, flight_model
from twin.health.judgement import Levels, Verdict, follow, judge
from twin.health.signatures import (
    Hypothesis,
    TypicalDive,
    confusable,
    hypotheses_of,
    in_dives,
    usual_dive,
)
from twin.health.thresholds import threshold_of
from twin.identify.start_values import start_vehicle
from twin.logs.logged_leg import legs_of
from twin.records.attributes import DIVE, DIVE_DURATION
from twin.records.logged import LogStore, log_rows
from twin.records.storage.store_path import StorePath
from twin.vehicle.vehicle import Vehicle, load_vehicle

Array = NDArray[np.float64]

NONE = "none"
"""The kind of a healthy deployment"""
LEAST_DIVES = 6
"""Dives below which nothing is judged"""
ENDS, BELOW = 0.0, 1.0
"""Log of the odds below which an alarm ends: none is then as likely; and by how much it falls below
a level that is lower itself, so that an alarm does not flap"""
CHANGED = {"depth": 0.2, "pitch": 3.0, "volume": 25.0}
"""Changes of a dive from which on a pilot has changed it: of the depth's logarithm, [degree] and
[cm3] of dive and climb; nine of ten dives of preset `faulty`, where nobody does, stay within"""
UNTOLD_WARMING = 0.001
"""Part by which a hull's air changes from dive to dive where a log lacks its temperature: 0.3 K"""
LEANING = 3.0
"""[degree] of what turns a vehicle, in dives and in climbs, from which on it leans to one side"""
ROUND = 10.0
"""[m], and tenths of a degree and of the pump's reach, to which the typical dive is rounded, so
that deployments of one vehicle share its signatures"""
STEEP, LEAST_SAMPLES = 8.0, 20
"""[degree] and samples from which on a vehicle dives or climbs"""
READ = (
    "depth", "pressure", "pitch", "roll", "heading", "pump", "shift", "rotation", "fin", "density",
    "temperature", "conductivity", "salinity", "altitude", "charge", "voltage", "battery_current",
    "pump_power", "vacuum", "dvl_mode",
)  # fmt: skip
"""Signals that channels are made of, without `measured_`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class KindVerdict:
    """What the dives say of one kind of fault."""

    kind: str
    says: str
    probability: float
    since_dive: int | None
    """Number of the first dive with it, as the log counts; None where it is unlikely"""
    size: float
    """in `unit`"""
    size_deviation: float
    unit: str
    settings: dict[str, Any]
    """such as the side of a wing"""
    dives: tuple[int, ...]
    """Numbers of the dives to look at: those that speak for it most"""
    channels: tuple[str, ...]
    """by which it shows"""
    also: tuple[str, ...]
    """Kinds that no channel of this log tells from it"""
    otherwise: str
    find_out: str


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DeploymentHealth:
    """The health of one deployment."""

    name: str
    days: float
    """[d] from its first dive to its last"""
    dives: tuple[int, ...]
    """Numbers of its dives, as the log counts"""
    alarm: bool
    kind: str
    """The most likely fault; none without an alarm"""
    since_dive: int | None
    noticed_dive: int | None
    """The dive after which the alarm that stands was given"""
    rang: tuple[tuple[int, int], ...]
    """First and last dive after which each alarm stood; one whose odds fell back has ended"""
    probability: float
    """of that kind, or of a fault at all where there is no alarm"""
    kinds: tuple[KindVerdict, ...]
    """every kind that the vehicle can have, the likeliest first"""
    evidence: Array
    """log of the odds of a fault after each dive, (dives,)"""
    threshold: float
    levels: Levels
    values: Array
    """of the channels, (dives, channels)"""
    time: Array
    """[s] unix, of the middle of each dive, (dives,)"""
    lacking: tuple[str, ...]
    """Channels that this log does not tell"""
    remarks: tuple[str, ...]
    """What is no fault and a pilot should know: what drove it, how it leans, what was changed"""

    def describe(self) -> dict[str, object]:
        """Plain values, as `--json` prints them."""
        return {
            "name": self.name,
            "days": self.days,
            "dives": len(self.dives),
            "alarm": self.alarm,
            "kind": self.kind,
            "since_dive": self.since_dive,
            "noticed_dive": self.noticed_dive,
            "probability": self.probability,
            "also": list(self.kinds[0].also) if self.alarm else [],
            "size": self.kinds[0].size if self.alarm else None,
            "size_deviation": self.kinds[0].size_deviation if self.alarm else None,
            "rang": [list(dives) for dives in self.rang],
            "remarks": list(self.remarks),
            "lacking": list(self.lacking),
        }

    def verdict(self) -> str:
        """One line for a person."""
        if not self.dives or not self.kinds:
            return f"{self.name}: {len(self.dives)} dives are too few to judge"
        if not self.alarm:
            before = "" if not self.rang else (
                f"; an alarm after dive {self.rang[-1][0]} ended after dive {self.rang[-1][1]}"
            )  # fmt: skip
            return (
                f"{self.name}: nothing wrong in {len(self.dives)} dives, {self.days:.1f} d{before}"
            )
        first = self.kinds[0]
        others = [k for k in first.also if k != first.kind]
        told = f" or {', '.join(others)}" if others else ""
        unit = "" if first.unit == "1" else f" {first.unit}"
        return (
            f"{self.name}: {first.says} ({first.kind}{told}) since dive {self.since_dive}, "
            f"{100.0 * self.probability:.0f} % sure, size {first.size:.3g} +- "
            f"{first.size_deviation:.2g}{unit}"
        )


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


def dives_of(logs: LogStore, deployment: str) -> tuple[list[int], list[DiveSignals], Array]:
    """The dives of a deployment in order of time, and their ways through the water.

    Returns:
      Rows of the store; the signals of each; mean velocity through the water by the compass, north
      and east [m/s], (dives, 2), NaN where it is not known.
    """
    rows = logs.missions_of(deployment)
    names = [f"measured_{name}" for name in READ if f"measured_{name}" in logs]
    if "commanded_heading" in logs:
        names.append("commanded_heading")
    blocks = {name: logs.rows(name, rows) for name in names}
    legs = {leg.mission: leg.leg for leg in legs_of(logs, deployment)}
    dives, ways = [], np.full((len(rows), 2), math.nan)
    of_rows = log_rows(logs)
    for k, row in enumerate(rows):
        current = (math.nan, math.nan)
        leg = legs.get(row)
        if leg is not None and leg.duration > 0.0:
            ways[k] = np.array(leg.through_water) / leg.duration
            moved = np.array(leg.over_ground) / leg.duration - ways[k]
            current = (float(moved[0]), float(moved[1]))
        count = int(logs.samples[row])
        signals = {name: block[k, :count].astype(float) for name, block in blocks.items()}
        heading, powered = signals.get("measured_heading"), of_rows[row].powered
        if powered or heading is None or not np.isfinite(heading).any():
            # a current by the heading that was wanted, or beside a thruster's speed, says nothing
            current, ways[k] = (math.nan, math.nan), math.nan
        dives.append(
            DiveSignals(period=logs.period, signals=signals, current=current, powered=powered)
        )
    return rows, dives, ways


def typical_dive(store: str | StorePath, deployment: str, vehicle: Vehicle) -> TypicalDive:
    """The dive that is usual in a deployment's log; see `typical`."""
    with LogStore(store) as logs:
        return typical(dives_of(logs, deployment)[1], vehicle)


def told_by(logs: LogStore, deployment: str, vehicle: Vehicle) -> dict[str, Any]:
    """What `judged` takes of a deployment's log, by its names there."""
    rows, dives, ways = dives_of(logs, deployment)
    calibration = flight_model(vehicle)
    numbers = logs.array(DIVE) if DIVE in logs else np.arange(len(logs))
    starts = np.array([logs.starts[row] for row in rows])
    lasted = np.nan_to_num(logs.number(DIVE_DURATION)[rows])
    return {
        "name": deployment,
        "numbers": tuple(int(numbers[row]) for row in rows),
        "values": np.array([channels_of(dive, calibration) for dive in dives]),
        "time": starts + 0.5 * lasted,
        "ways": ways,
        "dive": typical(dives, vehicle),
        "changes": changes_of(dives),
        "powered": [dive.powered for dive in dives],
        "wander": wander_of(dives),
    }


def wander_of(dives: Sequence[DiveSignals]) -> Array:
    """By how much more channels change than where the log tells all they depend on, (channels,)."""
    found = np.zeros(len(NAMES))
    if all(dive.get("temperature") is None for dive in dives):
        found[NAMES.index("air")] = UNTOLD_WARMING
    return found


def changes_of(dives: Sequence[DiveSignals]) -> Array:
    """By how much each dive is another than the one before, in `CHANGED`, (dives,).

    What a model lacks differs from a depth, a pitch and a volume to others.
    """
    rows = []
    for dive in dives:
        depth, pitch, pump = dive.get("depth"), dive.get("pitch"), dive.get("pump")
        row = [math.nan if depth is None else math.log(max(float(np.nanmax(depth)), 1.0))
               / CHANGED["depth"]]  # fmt: skip
        for sign in (-1.0, 1.0):
            for values, unit in ((pitch, CHANGED["pitch"]), (pump, CHANGED["volume"])):
                way = np.zeros(0, bool) if pitch is None else sign * pitch > STEEP
                if values is None or way.sum() <= LEAST_SAMPLES:
                    row.append(math.nan)
                else:
                    row.append(float(np.nanmedian(values[way])) / unit)
        rows.append(row)
    steps = np.nan_to_num(np.diff(np.array(rows), axis=0))
    return np.concatenate([[0.0], np.linalg.norm(steps, axis=1)])


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
    lacking = tuple(
        c.name
        for c, column in zip(CHANNELS, values.T, strict=True)
        if not np.isfinite(column).any()
    ) if len(values) else ()  # fmt: skip
    seen = values if len(values) else np.full((1, len(CHANNELS)), math.nan)
    levels = follow(seen, changes, wander)
    days = (time - time[0]) / 86400.0 if len(time) else np.zeros(0)
    shared: dict[str, Any] = {
        "name": name, "days": float(days[-1]) if len(days) else 0.0, "dives": tuple(numbers),
        "threshold": threshold, "levels": levels, "values": values, "time": time,
        "lacking": lacking, "remarks": remarks_of(numbers, values, changes, powered, vehicle),
    }  # fmt: skip
    if len(values) < LEAST_DIVES:
        return DeploymentHealth(
            **shared, alarm=False, rang=(), kind=NONE, since_dive=None, noticed_dive=None,
            probability=0.0, kinds=(), evidence=np.full(len(values), -math.inf),
        )  # fmt: skip
    hypotheses = hypotheses_for(vehicle, dive, ways)
    verdict = judge(levels, days, hypotheses)
    rang = rings(verdict.evidence, threshold)
    noise = np.where(
        np.isfinite(values).sum(axis=0) >= LEAST_DIVES, [c.noise for c in CHANNELS], np.inf
    )
    groups = confusable(hypotheses, noise)
    order = np.argsort(-verdict.probability, kind="stable")
    kinds = tuple(
        _kind(verdict, int(k), hypotheses, levels, numbers, groups) for k in order.tolist()
    )
    alarm = bool(rang) and rang[-1][1] == len(values) - 1
    first = kinds[0]
    odds = float(verdict.evidence[-1])
    return DeploymentHealth(
        **shared,
        alarm=alarm,
        kind=first.kind if alarm else NONE,
        since_dive=first.since_dive if alarm else None,
        noticed_dive=int(numbers[rang[-1][0]]) if alarm else None,
        rang=tuple((int(numbers[begin]), int(numbers[end])) for begin, end in rang),
        probability=first.probability if alarm else 1.0 / (1.0 + math.exp(-min(odds, 700.0))),
        kinds=kinds,
        evidence=verdict.evidence,
    )


def rings(evidence: Array, threshold: float) -> list[tuple[int, int]]:
    """First and last dive, as places, of each alarm: above the threshold until they fall back."""
    ends = min(ENDS, threshold - BELOW)
    found: list[tuple[int, int]] = []
    ringing = False
    for d, odds in enumerate(evidence.tolist()):
        if not ringing and odds > threshold:
            found.append((d, d))
            ringing = True
        elif ringing and odds > ends:
            found[-1] = (found[-1][0], d)
        else:
            ringing = False
    return found


def remarks_of(
    numbers: Sequence[int],
    values: Array,
    changes: Array | None,
    powered: Sequence[bool],
    vehicle: Vehicle,
) -> tuple[str, ...]:
    """What is no fault and explains a log, in whole sentences."""
    found = []
    driven = [n for n, is_driven in zip(numbers, powered, strict=False) if is_driven]
    if driven:
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
    signature = np.atleast_2d(best.signature)
    shown = np.nan_to_num(np.abs(signature)).max(axis=0) * best.scale
    over = shown / np.array([channel.noise for channel in CHANNELS])
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
        also=tuple(sorted(groups[name])),
        otherwise=kind.otherwise,
        find_out=kind.find_out,
    )


def typical(dives: Sequence[DiveSignals], vehicle: Vehicle) -> TypicalDive:
    """The dive that is usual in a log, rounded; what the log lacks is the vehicle file's."""
    deepest = [float(np.nanmax(d.signals["measured_depth"])) for d in dives
               if d.get("depth") is not None]  # fmt: skip
    depth = float(np.median(deepest)) if deepest else 150.0
    period = dives[0].period if dives else 4.0
    usual = usual_dive(vehicle, period, max(round(depth / ROUND) * ROUND, 30.0))
    down: list[float] = []
    up: list[float] = []
    heavy: list[float] = []
    light: list[float] = []
    for dive in dives:
        pitch, pump = dive.get("pitch"), dive.get("pump")
        if pitch is None or pump is None:
            continue
        for steep, volume, sign in ((down, heavy, -1.0), (up, light, 1.0)):
            way = sign * pitch > STEEP
            if way.sum() > LEAST_SAMPLES:
                steep.append(float(np.nanmedian(sign * pitch[way])))
                volume.append(float(np.nanmedian(pump[way])))
    if not down or not up:
        return usual
    lightest, heaviest = vehicle.net_mass_range
    # half of what the two pumped volumes differ by pulls each way
    reach = 0.5 * abs(
        vehicle.net_mass_for_pump(float(np.median(heavy)))
        - vehicle.net_mass_for_pump(float(np.median(light)))
    )
    pull = float(np.clip(reach, 0.3 * heaviest, min(heaviest, -lightest)))
    steep = [round(float(np.clip(np.median(v), 12.0, 40.0)) / 2.0) * 2.0 for v in (down, up)]
    return dataclasses.replace(
        usual, pitch=steep[0], climb_pitch=steep[1],
        net_mass=round(pull / heaviest, 1) * heaviest,
        climb_net_mass=round(pull / -lightest, 1) * -lightest,
    )  # fmt: skip


_SIGNATURES: dict[tuple[Any, ...], list[Hypothesis]] = {}


def hypotheses_for(vehicle: Vehicle, dive: TypicalDive, ways: Array) -> list[Hypothesis]:
    """Those of a vehicle in a dive; what is flown is kept for the next deployment of it."""
    key = (vehicle.xml, str(vehicle.changes()), dive, tuple(FAULTS.names()))
    if key not in _SIGNATURES:
        _SIGNATURES[key] = hypotheses_of(vehicle, dive)
    return in_dives(_SIGNATURES[key], ways)
