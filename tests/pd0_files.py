"""PD0 files of a made-up Doppler log: bytes by the maker's format, beams by geometry alone."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from twin.frames import euler_to_matrix

AXES = {"beam": 0, "instrument": 1, "ship": 2, "earth": 3}
BAD = -32768
START = 1_700_000_000.0
"""[s] Unix time, as of `factory.samples`"""


def beam_directions(angle: float, alignment: float, *, upward: bool = False) -> np.ndarray:
    """Unit vectors of beams 1 to 4, forward-starboard-down; angles in degree.

    Beam 3 is `alignment` clockwise from the bow; from it beams 2, 4, 1 follow clockwise, or, if the
    instrument was turned about its axis through beams 3 and 4 to look up, counter-clockwise.
    """
    side = -1.0 if upward else 1.0
    azimuth = np.radians(alignment + np.array([270.0, 90.0, 0.0, 180.0]) * side)
    out, down = np.sin(np.radians(angle)), side * np.cos(np.radians(angle))
    return np.stack([out * np.cos(azimuth), out * np.sin(azimuth), np.full(4, down)], axis=1)


def measured(velocity: np.ndarray, one: dict[str, Any]) -> np.ndarray:
    """Velocity that the instrument writes [m/s] for a hull's in the instrument's FRD axes."""
    past = -velocity  # the water, or the bottom
    level = one["axes"] == "earth" or (one["axes"] == "ship" and one["level"])
    if level:
        heading = one["heading"] if one["axes"] == "earth" else 0.0
        angles = np.radians([one["roll"], one["pitch"], heading])
        past = euler_to_matrix(*angles) @ past
    if one["axes"] in ("ship", "earth"):
        return np.array([past[1], past[0], -past[2], 0.0])
    beams = beam_directions(one["angle"], one["alignment"], upward=one["upward"])
    toward = -beams @ past + one["noise"]  # positive toward the transducer
    if one["axes"] == "beam":
        return toward
    # X from beam 1 to beam 2, Y from beam 4 to beam 3, Z toward the transducer: orthogonal
    sine, cosine = np.sin(np.radians(one["angle"])), np.cos(np.radians(one["angle"]))
    x, y, z = beams[1] - beams[0], beams[2] - beams[3], -beams.sum(axis=0)
    return np.array([past @ x / (2 * sine), past @ y / (2 * sine), past @ z / (4 * cosine), 0.0])


def ensemble(one: dict[str, Any]) -> bytes:
    """Bytes of one ensemble; keys as in `SETTINGS`."""
    cells = one["cells"]
    high = {15.0: 0, 20.0: 1, 30.0: 2}[one["angle"]] | 0x40
    low = 0x4B | (0x80 if one["upward"] else 0)
    fixed = struct.pack(
        "<HBBHBBBBHHHBBBBHBBBBhhBBHH", 0x0000, 67, 20, high << 8 | low, 0, 0, 4, cells, 10,
        round(one["cell"] * 100), 88, 1, 64, 0, 0, 2000, 0, 0, 0,
        AXES[one["axes"]] << 3 | (4 if one["says_level"] else 0), round(one["alignment"] * 100),
        0, 0, 0, round(one["first"] * 100), 101,
    ) + bytes(58 - 36)  # fmt: skip
    stamp = np.datetime64(round(one["time"] * 100) * 10, "ms")
    day = stamp.astype("datetime64[D]")
    year, month = (int(x) for x in str(day).split("-")[:2])
    past = int((stamp - day) / np.timedelta64(10, "ms"))
    leader = struct.pack(
        "<HHBBBBBBBBHHHHhhHh", 0x0080, 1, year - 2000, month, int(str(day)[-2:]),
        past // 360000, past // 6000 % 60, past // 100 % 60, past % 100, 0, 0,
        round(one["sound"]), max(round(one["depth"] * 10), 0),
        round(one["heading"] % 360.0 * 100) % 36000,
        round(one["pitch"] * 100), round(one["roll"] * 100), 35, 1000,
    ) + bytes(65 - 28)  # fmt: skip
    blocks = [fixed, leader]
    if one["water"] is not None:
        values = measured(np.asarray(one["water"], float), one) * one["pulled"]
        words = [round(v * 1000) for v in values]
        blocks += [struct.pack("<H", 0x0100) + struct.pack("<4h", *words) * cells]
        for kind, number in ((0x0200, one["correlation"]), (0x0300, one["echo"])):
            blocks.append(struct.pack("<H", kind) + bytes([number]) * 4 * cells)
        good = one["good"]  # of each beam, or of all; or the four numbers of the format
        if not isinstance(good, tuple):
            good = (good,) * 4 if one["axes"] == "beam" else (0, 0, 0, good)
        # the last cell has no echo, so that the file shows its floor
        blocks[-1] = blocks[-1][:-4] + bytes([40]) * 4
        blocks.append(struct.pack("<H", 0x0400) + bytes(good) * cells)
    if one["bottom"] is not None:
        values = measured(np.asarray(one["bottom"], float), {**one, "noise": np.zeros(4)})
        words = [round(v * 1000) for v in values]
        blocks.append(
            struct.pack("<H", 0x0600) + bytes(14)
            + struct.pack("<4H4h", *[round(one["range"] * 100)] * 4, *words) + bytes(81 - 40)
        )  # fmt: skip
    blocks += [struct.pack("<H", kind) + bytes(20) for kind in one["others"]]
    places, at = [], 6 + 2 * len(blocks)
    for block in blocks:
        places.append(at)
        at += len(block)
    header = b"\x7f\x7f" + struct.pack("<HBB", at, 0, len(blocks))
    body = header + struct.pack(f"<{len(places)}H", *places) + b"".join(blocks)
    return body + struct.pack("<H", sum(body) % 65536)


SETTINGS: dict[str, Any] = {
    "axes": "beam", "level": True, "says_level": True, "angle": 30.0, "alignment": 45.0,
    "upward": False, "cells": 6, "cell": 1.0, "first": 1.9, "sound": 1500.0, "correlation": 120,
    "echo": 90, "good": 100, "pulled": 1.0, "noise": np.zeros(4), "bottom": None, "range": 20.0,
    "others": (), "roll": 0.0, "heading": 0.0, "tilt": 0.0,
}  # fmt: skip
"""Of each ensemble; `pulled` is the factor on velocities in which pings without echo leave theirs,
`tilt` [degree] the nose-up tilt of the mount"""


def write(path: Path, ensembles: list[dict[str, Any]]) -> Path:
    """Write ensembles with `time`, `depth`, `pitch` and `water` (hull through the water, in hull
    axes, FRD), and whatever else of `SETTINGS` differs."""
    written = []
    for given in ensembles:
        one = {**SETTINGS, **given}
        cosine, sine = np.cos(np.radians(one["tilt"])), np.sin(np.radians(one["tilt"]))
        for name in ("water", "bottom"):
            if one[name] is not None:
                u, v, w = one[name]
                one[name] = np.array([u * cosine - w * sine, v, u * sine + w * cosine])
        written.append(ensemble(one))
    path.write_bytes(b"".join(written))
    return path


def yo(
    count: int = 400, *, step: float = 3.0, start: float = START, attack=(3.0, -2.0), speed=0.4,
    pitch: float = 25.0, **given: Any,
) -> list[dict[str, Any]]:  # fmt: skip
    """A dive and a climb between level ends, with an angle of attack [degree] of each."""
    found, depth = [], 5.0
    for k in range(count):
        down = k < count // 2
        attitude, angle = (-pitch, attack[0]) if down else (pitch, attack[1])
        water = speed * np.array([np.cos(np.radians(angle)), 0.0, np.sin(np.radians(angle))])
        rate = speed * np.sin(np.radians(angle - attitude))
        found.append(
            {"time": start + k * step, "depth": depth, "pitch": attitude, "water": water, **given}
        )
        depth += rate * step
    return found
