"""Parameter: one row of the table of everything that the factory draws."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One row of the table."""

    name: str
    """group.name; the store's variable has an underscore for the dot"""
    unit: str
    """as CF writes it; "1" is dimensionless"""
    paper: str
    """distribution in presets paper and paper-test"""
    field: str
    """distribution in preset field"""
    long_name: str
    """what it is, a short noun phrase"""
    why: str = ""
    """one line: why these values, and conventions"""
    per_segment: bool = False
    """drawn for every segment"""

    @property
    def variable(self) -> str:
        """Name in the store."""
        return self.name.replace(".", "_")
