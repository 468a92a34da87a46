"""Confusion: parameters that a log determines together, but not apart."""

from __future__ import annotations

from twin.identify.answer import Identification
from twin.identify.pitch import PITCHING
from twin.identify.unknowns import NAMES

CLOSE = 0.95
"""Correlation, as printed, from which on two estimates are said not to be told apart"""


def confused(found: Identification) -> list[str]:
    """One sentence for each group of estimates that the log does not tell apart, and what would."""
    names, left = found.determined, set(range(len(found.determined)))
    close = abs(found.correlation).round(2) >= CLOSE
    texts = []
    while left:
        group: set[int] = set()
        edge = {min(left)}
        while edge:
            group |= edge
            edge = {j for i in edge for j in left if close[i, j]} - group
        left -= group
        if len(group) == 1:
            continue
        mine = [names[i] for i in sorted(group)]
        most = max(abs(found.correlation[i, j]) for i in group for j in group if i != j)
        knowable = [name for name in mine if name in NAMES]
        if set(mine) & {p.name for p in PITCHING}:
            advice = (
                "dives at other pitches with the same pump, and at other pump volumes, would tell "
                "them apart"
            )
        elif "thermal_expansion" in mine:
            advice = "dives in water of other temperatures would tell them apart"
        else:
            advice = "dives at other pitches, pump volumes and depths would tell them apart"
        if knowable:
            advice += f"; or give one that you know, such as --known {knowable[0]}=VALUE"
        texts.append(
            f"{', '.join(mine[:-1])} and {mine[-1]} could not be told apart (correlation up to "
            f"{most:.2f}): together they fit the log, each alone is less sure; {advice}"
        )
    return texts
