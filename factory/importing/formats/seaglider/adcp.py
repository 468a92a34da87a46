"""Velocity and current that a Seaglider's on-board current profiler (ADCP) measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from factory.importing.reading.columns import stacked, tidy, unix_seconds
from factory.importing.reading.deployment_log import Channel
from factory.importing.reading.tally import Tally

Array = NDArray[np.float64]

ADCP_DEPTH = 1.5
"""[m] Shallower the inverse solution is the constraint that a drifting glider moves with the
water, not a measurement."""


def adcp_truth(
    glider: str, pieces: Sequence[Mapping[str, Array]], tally: Tally
) -> dict[str, Channel]:
    """Velocity through the water and current of the on-board ADCP's inverse solution [m/s]."""
    if not pieces:
        return {}
    names = ("time", "depth_m", "u_ttw", "v_ttw", "w_ttw", "u_ocn", "v_ocn")
    columns = stacked(pieces, names)
    subject = f"{glider} ADCP"
    time = unix_seconds(columns.pop("time"), subject, tally)
    time, columns = tidy(time, columns, subject, tally)
    good = np.all([np.isfinite(columns[n]) for n in ("u_ttw", "v_ttw", "w_ttw")], axis=0)
    if "depth_m" in columns:
        shallow = good & ~(columns["depth_m"] > ADCP_DEPTH)
        tally.add(
            "left out", subject, int(shallow.sum()),
            f"shallower than {ADCP_DEPTH:g} m: a constraint of the inverse, no measurement",
        )  # fmt: skip
        good &= ~shallow
    tally.add("read", subject, int(good.sum()), "truth samples")
    found = {
        "velocity_east": Channel(time[good], columns["u_ttw"][good]),
        "velocity_north": Channel(time[good], columns["v_ttw"][good]),
        # w_ttw is upward: it is opposite to the depth rate
        "velocity_down": Channel(time[good], -columns["w_ttw"][good]),
    }
    for column, target in (("u_ocn", "current_east"), ("v_ocn", "current_north")):
        if column in columns:
            there = good & np.isfinite(columns[column])
            found[target] = Channel(time[there], columns[column][there])
    return found
