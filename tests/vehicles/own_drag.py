"""A drag law of one's own: the flow-frame law with a drag that grows as V to the power of 1.7."""

import dataclasses
import math
from typing import ClassVar

from twin.compiled import jit
from twin.compiled.elementary import scalar
from twin.vehicle.laws import FlowFrame, register
from twin.vehicle.laws import flow_frame as printed

EXPONENT, SPEED = 1.7, 0.3
"""Power of the speed; [m/s] where it has the printed drag"""


@jit
def native_wrench(c, density, u, v, w, p, q, r):
    x, y, z, k, m, n = printed.native_wrench(c, density, u, v, w, p, q, r)
    speed = math.sqrt(u * u + v * v + w * w)
    if speed > 1e-9:
        alpha = math.atan2(w, u)
        drag = (c[printed.K_D0] + c[printed.K_D] * alpha * alpha) * speed
        more = drag * ((speed / SPEED) ** (EXPONENT - 2.0) - 1.0)
        x, y, z = x - more * u, y - more * v, z - more * w
    return x, y, z, k, m, n


@scalar
def fossen_wrench(c, density, u, v, w, p, q, r):
    x, y, z, k, m, n = printed.fossen_wrench(c, density, u, v, w, p, q, r)
    speed = math.sqrt(max(u * u + v * v + w * w, 1e-18))
    alpha = math.atan2(w, u)
    drag = (c[printed.K_D0] + c[printed.K_D] * alpha * alpha) * speed
    more = drag * (math.exp((EXPONENT - 2.0) * math.log(speed / SPEED)) - 1.0)
    return x - more * u, y - more * v, z - more * w, k, m, n


@register
@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class SlowDrag(FlowFrame):
    """Drag of a hull whose boundary layer is laminar at the front."""

    kind: ClassVar[str] = "slow-drag"
    native_wrench = staticmethod(native_wrench)
    fossen_wrench = staticmethod(fossen_wrench)
