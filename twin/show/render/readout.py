"""Readout: the figures of the strip, as text."""

from __future__ import annotations

import dataclasses

import numpy as np

from twin.show.render.playback import Poses, spins, turns

UNKNOWN = "–"
MINUS = "−"
SHARED = 2
"""Moving parts that still share one readout"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Readout:
    """One figure of the strip."""

    name: str
    value: str
    widest: str
    """A value at least as long as all others: it keeps the columns where they are"""


def readouts(poses: Poses, index: int) -> list[Readout]:
    """Time, depth, pitch, heading, speed, net buoyancy and the moving parts at one frame.

    What nothing tells in the whole mission has no readout; a log shows what it pumped where the net
    buoyancy is not known. In a gap of a log nothing but the time is known.
    """
    heading = round(float(poses.heading[index])) % 360
    speed = float(poses.speed[index])
    depth = Readout(
        name="DEPTH", value=f"{plain(poses.position[index, 2], 1)} m", widest="0000.0 m"
    )
    others = {
        "pitch": Readout(name="PITCH", value=f"{signed(poses.pitch[index], 1)}°", widest="+00.0°"),
        "heading": Readout(name="HEADING", value=f"{heading:03d}°", widest="000°"),
        "speed": Readout(
            name="SPEED",
            value=f"{speed:.2f} m/s" if np.isfinite(speed) else UNKNOWN,
            widest="0.00 m/s",
        ),
        "net_mass": Readout(
            name="NET BUOYANCY", value=buoyancy(float(poses.net_mass[index])), widest="▼ 0.00 kg"
        ),
    }
    items = [depth, *(item for name, item in others.items() if name not in poses.unknown)]
    pumped = None if "pumped" in poses.unknown else poses.pumped
    if "net_mass" in poses.unknown and pumped is not None:
        items += _pumped(float(pumped[index]))
    items += _parts(poses, index)
    if poses.bridged is not None and poses.bridged[index]:
        items = [dataclasses.replace(item, value=UNKNOWN) for item in items]
    return [Readout(name="TIME", value=clock(float(poses.time[index])), widest="00:00:00"), *items]


def _pumped(volume: float) -> list[Readout]:
    """What a log pumped [cm3]; a vehicle that pumps less than nothing is heavy."""
    value = f"{signed(volume, 0)} cm³" if np.isfinite(volume) else UNKNOWN
    return [Readout(name="PUMPED", value=value, widest="+000 cm³")]


def _parts(poses: Poses, index: int) -> list[Readout]:
    """What slides, turns and spins; what is pumped shows as net buoyancy.

    Two share a readout, as a glider's battery has them; of more each has its own.
    """
    single = [
        _part(joint, float(value), fine=len(poses.joints) > SHARED)
        for joint, value in zip(poses.joints, poses.parts[index], strict=True)
    ]
    if not 0 < len(single) <= SHARED:
        return single
    names, values, widest = (
        "  ".join(getattr(item, field) for item in single) for field in ("name", "value", "widest")
    )
    return [Readout(name=names, value=values, widest=widest)]


def _part(joint: str, value: float, *, fine: bool) -> Readout:
    """One part; `fine`: a decimal of its angle too."""
    name = joint.replace("_", " ").upper()
    if spins(joint):
        return Readout(name=name, value=f"{plain(value, 0)} rad/s", widest=f"{MINUS}000 rad/s")
    if turns(joint):
        digits = 1 if fine else 0
        widest = "+00.0°" if fine else "+00°"
        return Readout(name=name, value=f"{signed(np.rad2deg(value), digits)}°", widest=widest)
    return Readout(name=name, value=f"{signed(1000 * value, 0)} mm", widest="+00 mm")


def clock(seconds: float) -> str:
    """Hours, minutes and seconds, such as 1:02:03."""
    whole = round(seconds)
    return f"{whole // 3600:d}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def plain(value: float, digits: int) -> str:
    """A number with a typographic minus, and none on a rounded zero."""
    rounded = round(float(value), digits) + 0.0
    return f"{rounded if rounded else 0.0:.{digits}f}".replace("-", MINUS)


def signed(value: float, digits: int) -> str:
    """As `plain`, with a plus on positive numbers."""
    text = plain(value, digits)
    return f"+{text}" if round(float(value), digits) > 0 else text


def buoyancy(mass: float) -> str:
    """Net buoyancy mass [kg] with the way it pulls: a heavy glider (positive) down."""
    if not np.isfinite(mass):
        return UNKNOWN
    if abs(mass) < 0.005:
        return "neutral"
    return f"{'▼' if mass >= 0 else '▲'} {abs(mass):.2f} kg"
