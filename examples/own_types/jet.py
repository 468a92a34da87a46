"""Jet: a current for `--current jet:speed=0.3,width=5000`."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp
from typing import ClassVar

from twin.compiled import Compiled, jit
from twin.water.current import Current, register


@jit
def jet_kernel(program, start, size, t, north, east, depth):
    """Speed, half-width, and how fast the axis of the jet moves north."""
    speed, width, drift = program[start], program[start + 1], program[start + 2]
    x = (north - drift * t) / width
    v_east = speed * exp(-x * x)
    slope = -2.0 * x / width * v_east  # dVe/dn
    return (
        0.0, v_east, 0.0,  # velocity north, east, down [m/s]
        0.0, -drift * slope, 0.0,  # local rate dV/dt [m/s2]
        0.0, 0.0, 0.0,  # gradient [1/s]: of the north velocity along north, east and depth,
        slope, 0.0, 0.0,  # of the east velocity,
        0.0, 0.0, 0.0,  # of the down velocity
    )  # fmt: skip


@register
@dataclass(frozen=True, kw_only=True)
class Jet(Current):
    """An eastward jet whose axis moves north."""

    kind: ClassVar[str] = "jet"
    payload_size: ClassVar[int] = 3
    kernel: ClassVar[Compiled] = jet_kernel
    usage: ClassVar[Mapping[str, str]] = {"jet:speed=0.3,width=5000": "eastward jet, m/s and m"}

    speed: float
    width: float
    drift: float = 0.0

    def records(self, duration_s, origin):
        return [self.record(self.speed, self.width, self.drift)]
