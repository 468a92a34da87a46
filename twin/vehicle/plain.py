"""Plain set: elements with which a vehicle file glides in MuJoCo without this package.

`scripts/fit_plain.py` writes them: geoms, sites and a body whose names begin with "plain_", the
water's density, and actuators with MuJoCo's own filters. The twin has its own water, so reading a
file takes the set out again, and restores what it stands in for. No model, store or figure of the
twin depends on it.
"""

from __future__ import annotations

import re
from pathlib import Path

from twin.errors import VehicleError

MARK = 'name="plain_'
"""Text that only a file with a plain set has."""
NOTE = "<!-- plain MuJoCo: "
"""Beginning of a comment line that belongs to the set."""
_LINES = re.compile(rf"\n[ \t]*(?:<(?:geom|site|body) {MARK}|{NOTE})[^\n]*")
_ATTRIBUTES = (
    (re.compile(r'(<option\b[^<>]* density=")[^"]*'), r"\g<1>0"),
    (re.compile(r'(<geom name="fluid_[^<>]* fluidshape=")none'), r"\g<1>ellipsoid"),
    (re.compile(r'(<general\b[^<>]* dyntype=")filterexact'), r"\g<1>user"),
    (re.compile(r'(<general\b[^<>]* gainprm=")[^"]*" refsite="plain_world'), r"\g<1>0"),
)


def without_plain(xml: str, path: Path) -> str:
    """Return the MJCF text without its plain set; a text without one is returned as it is.

    Raises:
      VehicleError: an element of the set is not on a line of its own.
    """
    text = _LINES.sub("", xml)
    if MARK in xml:
        for pattern, original in _ATTRIBUTES:
            text = pattern.sub(original, text)
    if left := re.search(r"""=\s*["']plain_[^"']*.""", text):
        raise VehicleError(
            f"vehicle file {path}: {left[0].lstrip('= ')} belongs to the set for plain MuJoCo and "
            "is not as scripts/fit_plain.py writes it: one line for each element, its name first; "
            "run the script again, or give another name"
        )
    return text
