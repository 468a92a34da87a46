"""Uncertainty: a number of a vehicle that its file cannot say exactly, and how far it may be off.

Hull laws and parts name theirs, and the factory draws them: the real vehicle then differs from the
one that guidance believes in.
"""

from __future__ import annotations

import dataclasses

COEFFICIENT_SPREAD = "uniform(0.9, 1.1)"
"""Factor on a coefficient; +-10 % is our guess of how well one is known."""
LAG_SPREAD = "uniform(0.8, 1.2)"
"""Factor on a lag or on a largest rate; they are rarely published."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """One number of a vehicle that its file cannot say exactly."""

    name: str
    """of the factory's parameter after `vehicle.`; that of a part follows the part's own name"""
    spread: str
    """distribution of the real value, as the factory writes it"""
    long_name: str
    """what it is, a short noun phrase"""
    why: str
    """one line: why this spread, and conventions"""
    unit: str = "1"
    """as CF writes it; "1" is a factor on the file's value"""
    certain: float = 1.0
    """value at which the vehicle is as its file says"""
    field: str | None = None
    """of a part: the field that the factor multiplies; None: the position at which its encoder
    says 0"""
    scale: float = 1.0
    """of a position: the part's unit in `unit`"""
    known: bool = False
    """of a hull law: guidance has it too, as a pilot knows which way the vehicle turns"""


def coefficient(name: str, what: str, *, field: str | None = None) -> Uncertainty:
    """A factor on a coefficient of the vehicle file."""
    return Uncertainty(
        name=name,
        spread=COEFFICIENT_SPREAD,
        long_name=f"factor on the {what}",
        why="of the vehicle file; +-10 % is our guess of how well it is known",
        field=field,
    )
