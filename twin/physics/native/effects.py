"""Effects: what hull laws and vehicle parts do, each by the kernel of its kind.

The registries of laws and parts say which kernels there are. A kind that joins them later is
compiled in when the callbacks are next installed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from twin.compiled import changed, dispatch
from twin.vehicle.laws import LAWS
from twin.vehicle.parts import PARTS

_UNKNOWN = (math.nan,) * 6
"""Of a kind that this process does not know: the run fails, which zero would hide."""
_MOTION = ("u", "v", "w", "p", "q", "r")


def _laws(kernel: str) -> Callable[[], Mapping[int, Any]]:
    return lambda: {LAWS.code(kind): getattr(LAWS[kind], kernel) for kind in LAWS}


def _parts(kernel: str) -> Callable[[], Mapping[int, Any]]:
    return lambda: {
        PARTS.code(kind): getattr(PARTS[kind], kernel)
        for kind in PARTS
        if getattr(PARTS[kind], kernel) is not None
    }


law_wrench = dispatch(
    "law_wrench",
    ("values", "density", *_MOTION),
    _laws("native_wrench"),
    _UNKNOWN,
    module=__name__,
    inline="always",
)
"""(code, values, density, u, v, w, p, q, r) -> X, Y, Z, K, M, N of the hull."""

law_rate_damping = dispatch(
    "law_rate_damping",
    ("values", "timestep", "density", *_MOTION),
    _laws("native_rate_damping"),
    (math.nan, math.nan, math.nan),
    module=__name__,
    inline="always",
)
"""(code, values, timestep, density, u, v, w, p, q, r) -> step times rate damping."""

part_wrench = dispatch(
    "part_wrench",
    ("values", "place", "position", *_MOTION, "density", "depth"),
    _parts("native_wrench"),
    _UNKNOWN,
    module=__name__,
)
"""(code, values, place, position, motion, density, depth) -> X, Y, Z, K, M, N of a part."""

part_volume = dispatch(
    "part_volume", ("values", "position"), _parts("native_volume"), math.nan, module=__name__
)
"""(code, values, position) -> displaced volume [cm3]."""

part_mass = dispatch(
    "part_mass", ("values", "position"), _parts("native_mass"), math.nan, module=__name__
)
"""(code, values, position) -> point mass [kg]."""

_versions = [LAWS.version, PARTS.version]


def refresh() -> None:
    """Have the effects compiled again when a registry has changed since the last call."""
    now = [LAWS.version, PARTS.version]
    if now != _versions:
        _versions[:] = now
        changed()
