"""Bounds: which simulations are missions to keep: possible ones that stay off the ground."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.records.limits import simulated_limits
from twin.records.schema import VARIABLES

Array = NDArray[np.float64]


class Impossible(TwinError):
    """A simulation that stayed finite and left what is possible at `time_s`."""

    def __init__(self, message: str, *, time_s: float):
        super().__init__(message)
        self.time_s = time_s


def check_possible(truth: Mapping[str, Array], time: Array) -> None:
    """Raise Impossible when a simulated signal leaves its limits; NaN is left to others.

    Args:
      truth: signals of shape (time,), by name.
      time: [s], shape (time,).
    """
    earliest, culprit = len(time), ""
    for name, values in truth.items():
        low, high = simulated_limits(name)
        outside = (values < low) | (values > high)
        if outside[:earliest].any():
            earliest, culprit = int(np.argmax(outside)), name
    if culprit:
        low, high = simulated_limits(culprit)
        raise Impossible(
            f"{culprit} became {truth[culprit][earliest]:.3g} {VARIABLES[culprit].units} at "
            f"{time[earliest]:.1f} s, possible are {low:g} to {high:g}",
            time_s=float(time[earliest]),
        )


def check_afloat(truth: Mapping[str, Array], time: Array) -> None:
    """Raise Impossible when the vehicle touched the sea floor or an obstacle.

    Args:
      truth, time: as `check_possible`; missions where nothing can be touched have no
        `true_contact`.
    """
    contact = truth.get("true_contact")
    if contact is not None and contact.any():
        when = float(time[np.argmax(contact)])
        raise Impossible(f"ran aground at {when:.1f} s", time_s=when)
