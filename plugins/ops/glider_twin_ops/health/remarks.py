"""Remarks: sentences on what explains a log without a fault, for the pilot."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence

import numpy as np

from glider_twin_ops.health.channels import NAMES, Channel
from glider_twin_ops.health.signatures import TypicalDive
from twin import Vehicle
from twin.numbers import Array

WEIGHTY = 0.03
"""[kg] Smallest weight that a remark names"""
LEANING = 3.0
"""[degree] Mean steering angle in dives and in climbs above which a remark names it"""
TURNED, SURE = 3.0, 3.0
"""A remark names a compass that turned by over TURNED [degree] and SURE standard deviations."""


def remarks_of(
    numbers: Sequence[int],
    values: Array,
    changes: Array | None,
    powered: Sequence[bool],
    tests: Sequence[bool],
    vehicle: Vehicle,
    loud: Sequence[tuple[Channel, float]] = (),
) -> tuple[str, ...]:
    """Sentences on what explains a log without a fault, and on channels far off their level."""
    found = []
    if driven := list(itertools.compress(numbers, powered)):
        found.append(
            f"A thruster drove {_dives(driven)}: glide, trim, turns and power are not judged there."
        )
    if tested := list(itertools.compress(numbers, tests)):
        found.append(f"Test dives, of which only the hull is judged: {_dives(tested)}.")
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
    ordered = [] if changes is None else [bool((np.abs(row) > 1.0).any()) for row in changes]
    if any(ordered):
        found.append(
            "Depth, pitch or pumped volume were changed in "
            f"{_dives(list(itertools.compress(numbers, ordered)))}: what changes there with "
            "them counts as the pilot's."
        )
    found += [
        f"In dive {numbers[-1]} {channel.name} was {abs(off):.0f} deviations off its level "
        f"({channel.says}): look at its plot."
        for channel, off in loud
    ]
    return tuple(found)


def _dives(numbers: Sequence[int]) -> str:
    """Write numbers of dives in words: dives 3, 8 to 13."""
    breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
    runs = [(run[0], run[-1]) for run in np.split(np.asarray(numbers), breaks)]
    words = [f"{a}" if a == b else f"{a} to {b}" for a, b in runs]
    return f"dive{'s' if len(numbers) > 1 else ''} {', '.join(words)}"


def ballast_remarks(ballast: float) -> tuple[str, ...]:
    """Sentence on a weight [kg] that the vehicle's file lacks, from `WEIGHTY` on."""
    off = f"{1e3 * abs(ballast):.0f} g {'heavier' if ballast > 0.0 else 'lighter'}"
    said = (
        f"By its first dives the vehicle is {off} in this water than its file says: the rates are "
    )
    return (said + "judged with that weight.",) if abs(ballast) >= WEIGHTY else ()


def plan_remarks(
    asked: TypicalDive, flown: TypicalDive | None, vehicle: Vehicle
) -> tuple[str, ...]:
    """Sentence on the dive in which faults were flown, where the log's cannot be held."""
    if flown is None:
        return (
            f"Vehicle {vehicle.name} holds no dive like the log's: faults of its glide are not "
            "judged; identify it (`twin identify`).",
        )
    names = {"pitch": 1.0, "climb_pitch": 1.0, "net_mass": 0.01, "climb_net_mass": 0.01}
    off = [n for n, most in names.items() if abs(getattr(asked, n) - getattr(flown, n)) > most]
    if not off:
        return ()
    words = ", ".join(f"{n} {getattr(flown, n):.3g} for {getattr(asked, n):.3g}" for n in off)
    return (f"Faults were flown in the nearest dive that vehicle {vehicle.name} holds: {words}.",)


def compass_remarks(turned: tuple[float, float] | None) -> tuple[str, ...]:
    """Sentence on a compass that was turned before the log, by its turn and standard deviation."""
    if turned is None or abs(turned[0]) <= max(TURNED, SURE * turned[1]):
        return ()
    return (
        f"By legs on three headings and more, the compass reads {turned[0]:+.1f} +- "
        f"{turned[1]:.1f} degrees off as a whole since the first dive: `twin identify` "
        "measures it, and --vehicle takes it in.",
    )


def few_remark(channels: Sequence[str], shown: Collection[str], hidden: Collection[str]) -> str:
    """Sentence on what so few channels can show."""
    return (
        f"The log has {len(channels)} channels ({', '.join(channels)}), too few for alarms: their "
        f"levels are given alone. In them would show {', '.join(sorted(shown)) or 'no fault'}; "
        f"{', '.join(sorted(hidden))} would not."
    )
