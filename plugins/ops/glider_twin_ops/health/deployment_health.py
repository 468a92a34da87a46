"""Health of a deployment: what its dives say of each kind of fault, and a verdict."""

from __future__ import annotations

import dataclasses
from typing import Any

from glider_twin_ops.health.channels import CHANNELS, Channel
from glider_twin_ops.health.judgement import Levels
from twin.numbers import Array

LOUD = 6.0
"""Deviations off its level from which a channel of the last dive is told"""
NONE = "none"
"""The kind of a healthy deployment"""


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
    """Other kinds that no channel of this log tells from it"""
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
    """every kind that the vehicle can have and the log can show: of an alarm the one it is of, then
    those that show in what is far off its level in the last dive, then the likeliest"""
    evidence: Array
    """log of the odds of a fault after each dive, see `Verdict`, (dives,)"""
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
    driven: tuple[int, ...] = ()
    """Numbers of the dives that a thruster drove"""

    @property
    def judged(self) -> bool:
        """Whether there were dives enough; without them the probability is 0."""
        return bool(self.kinds)

    def describe(self) -> dict[str, object]:
        """Plain values, as `--json` prints them."""
        return {
            "name": self.name,
            "days": self.days,
            "dives": len(self.dives),
            "alarm": self.alarm,
            "judged": self.judged,
            "kind": self.kind,
            "since_dive": self.since_dive,
            "noticed_dive": self.noticed_dive,
            "probability": self.probability,
            "also": list(self.kinds[0].also) if self.alarm else [],
            "size": self.kinds[0].size if self.alarm else None,
            "size_deviation": self.kinds[0].size_deviation if self.alarm else None,
            "otherwise": self.kinds[0].otherwise if self.alarm else None,
            "find_out": self.kinds[0].find_out if self.alarm else None,
            "rang": [list(dives) for dives in self.rang],
            "remarks": list(self.remarks),
            "lacking": list(self.lacking),
        }

    def verdict(self) -> str:
        """One line for a person."""
        if not self.judged:
            few = len(self.dives)
            said = "1 dive is" if few == 1 else f"{few} dives are"
            return f"{self.name}: {said} too few to judge"
        if not self.alarm:
            before = "" if not self.rang else (
                f"; an alarm after dive {self.rang[-1][0]} ended after dive {self.rang[-1][1]}"
            )  # fmt: skip
            by, judged = "", len(CHANNELS) - len(self.lacking)
            if 2 * judged < len(CHANNELS):
                by = f", judged by {judged} of {len(CHANNELS)} channels only"
            found = "nothing wrong"
            if self.evidence[-1] > self.threshold:  # an alarm takes two dives
                before += f"; dive {self.dives[-1]} alone would be an alarm: the next one decides"
                found = "no alarm"
            if loud := loud_channels(self.levels):
                off = (f"{channel.name} was {abs(by):.0f} deviations off" for channel, by in loud)
                before += f"; look at dive {self.dives[-1]}: {' and '.join(off)}"
                found = "no alarm"
            return f"{self.name}: {found} in {len(self.dives)} dives, {self.days:.1f} d{by}{before}"
        first = self.kinds[0]
        told = f" or {', '.join(first.also)}" if first.also else ""
        unit = "" if first.unit == "1" else f" {first.unit}"
        return (
            f"{self.name}: {first.says} ({first.kind}{told}) since dive {self.since_dive}, "
            f"{100.0 * self.probability:.0f} % sure, size {first.size:.3g} +- "
            f"{first.size_deviation:.2g}{unit}{self._judged_until()}"
        )

    def _judged_until(self) -> str:
        """Since when a thruster drove every dive, so that little could speak against an alarm."""
        last = [dive for dive in self.dives if dive not in self.driven]
        if not self.driven or self.dives[-1] not in self.driven or not last:
            return ""
        return f"; a thruster drove it after dive {last[-1]}: hardly judged since"


def loud_channels(levels: Levels) -> list[tuple[Channel, float]]:
    """Channels that were `LOUD` deviations off their levels in the last dive, and by how many,
    whatever the verdict says of it."""
    if not len(levels.innovation):
        return []
    return [
        (channel, off)
        for channel, off in zip(CHANNELS, levels.innovation[-1].tolist(), strict=True)
        if abs(off) > LOUD
    ]
