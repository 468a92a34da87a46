"""Quality: the flags beside variables, which OceanGliders has taken over from Argo."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factory.exporting.og1.variables import Og1Variable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NOT_CHECKED, GOOD, ESTIMATED, MISSING = 0, 1, 8, 9
FLAGS = {
    NOT_CHECKED: "no_qc_performed",
    GOOD: "good_data",
    2: "probably_good_data",
    3: "bad_data_that_are_potentially_correctable",
    4: "bad_data",
    5: "value_changed",
    6: "not_used",
    7: "not_used",
    ESTIMATED: "estimated_value",
    MISSING: "missing_value",
}
"""Argo reference table 2, which the format takes"""
ENDING = "_QC"


def quality(name: str, values: Array, *, estimated: Mask | None = None, good: Mask | None = None
            ) -> tuple[str, Og1Variable]:  # fmt: skip
    """The flag variable of one variable: missing values, those estimated, those known to be good.

    Args:
      name: of the variable.
      values: its values, NaN where missing.
      estimated: where they are interpolated or dead-reckoned.
      good: where a measurement says so.
    """
    codes = np.full(len(values), NOT_CHECKED)
    if estimated is not None:
        codes[estimated] = ESTIMATED
    if good is not None:
        codes[good] = GOOD
    codes[~np.isfinite(values)] = MISSING
    meanings = [f"{word}_{code}" if word == "not_used" else word for code, word in FLAGS.items()]
    attributes = {
        "long_name": f"quality flag of {name}",
        "standard_name": "status_flag",
        "flag_values": np.array(list(FLAGS), np.int8),
        "flag_meanings": " ".join(meanings),
        "coverage_content_type": "qualityInformation",
    }
    return f"{name}{ENDING}", Og1Variable(codes, attributes, fill=-127, kind="i1")
