"""Quality: what the flags beside the variables of an OG1.0 file say."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.quality import ENDING
from factory.importing.reading.netcdf import as_array
from factory.importing.reading.tally import Tally

Array = NDArray[np.float64]

BAD = (3, 4)
"""Argo reference table 2: bad, and bad unless somebody corrects it"""


def flags_of(variables: Mapping[str, Any], raw: Mapping[str, Array]) -> dict[str, Array]:
    """Flags of the variables that have some, (samples,) each, by the variable's name."""
    found = {}
    for name, values in raw.items():
        flag = variables.get(f"{name}{ENDING}")
        if flag is not None and flag.dtype != str and flag.dtype.kind in "fiu":
            codes = as_array(flag[:])
            if len(codes) == len(values):
                found[name] = codes
    return found


def without_bad(name: str, values: Array, flags: Mapping[str, Array], tally: Tally) -> Array:
    """Values that the file calls bad as NaN, counted."""
    if name not in flags:
        return values
    bad = np.isin(flags[name], BAD) & np.isfinite(values)
    tally.add("removed", name, int(bad.sum()), "bad by the file's own flags (3, 4)")
    return np.where(bad, np.nan, values)
