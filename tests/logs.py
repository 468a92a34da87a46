"""Helpers of tests of logs: the layouts of `factory.samples`, and changes that no vehicle makes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import factory
from factory import samples
from factory.importing import import_logs
from factory.samples import START, Array, Flight
from factory.samples.gliders import write_slocum
from twin.errors import InputError
from twin.geodesy import from_tangent_plane

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared" / "data"
SOUND = Flight(dives=2, surface=600.0, swing=1.0)
"""A flight in which an import finds nothing suspect"""
LAYOUTS = [(kind, one) for kind, layouts in samples.formats().items() for one in layouts]
LIBRARIES = {
    ("slocum", "dbd"): "dbdreader", ("ardusub", "dataflash"): "pymavlink", ("lsf", "lsf"): "imcpy",
    ("mcap", "mcap"): "rosbags", ("rosbag2", "sqlite3"): "rosbags",
}  # fmt: skip
"""Library that writes or reads a layout, an extra of the product"""


def write(kind: str, layout: str, folder: Path, flight: Flight = SOUND) -> list[Path]:
    """Write a sample, or skip the test where its library is absent."""
    if (kind, layout) in LIBRARIES:
        pytest.importorskip(LIBRARIES[kind, layout])
    return samples.write(kind, folder, flight, layout=layout)


def stored(out: Path, kind: str, files: Sequence[Path], **options: Any) -> Path:
    """Import logs into a store and return its path."""
    factory.import_logs(kind, files, out, **options)
    return out


def values(dataset: Any, name: str, row: int = 0) -> Array:
    """The samples of a row of a data set of logs."""
    return dataset[name].values[row, : int(dataset["n_samples"][row])].astype(float)


def said(report: Any, action: str, subject: str) -> str:
    """Counts and words of a report about a subject."""
    found = [e for e in report.entries if (e.action, e.subject) == (action, subject)]
    return "; ".join(f"{e.count} {e.detail}" for e in found)


def details(report: Any, action: str) -> dict[str, str]:
    """Reason of each entry of an action, by its subject."""
    return {e.subject: e.detail for e in report.entries if e.action == action}


def told(report: Any, action: str) -> list[str]:
    """Subject and reason of each entry of an action."""
    return [f"{e.subject}: {e.detail}" for e in report.entries if e.action == action]


def why(report: Any, action: str, word: str) -> int:
    """Count of the entries of an action whose reason holds a word."""
    return sum(e.count for e in report.entries if e.action == action and word in e.detail)


def part(columns: dict[str, Array], rows: Any) -> dict[str, Array]:
    """Some rows of columns."""
    return {name: values[rows] for name, values in columns.items()}


def slocum(folder: Path, flight: Flight, name: str = "unit1", **written: Any) -> Any:
    """Import the tables of `write_slocum`: dataset and report."""
    return import_logs("slocum", write_slocum(folder, flight, name, **written))


def refused(match: str, *args: Any, by: Callable[..., Any] = import_logs, **options: Any) -> None:
    """Call what shall raise an InputError of one line that matches."""
    with pytest.raises(InputError, match=match) as caught:
        by(*args, **options)
    assert "\n" not in str(caught.value)


SENTINEL = 25.032015
"""[m/s] What a Sailfish's DVL writes without lock."""


def sailfish_columns(seconds: float = 400.0) -> dict[str, Array]:
    """A run of circles and straight legs at 1.5 m/s; the vehicle slips outwards in turns."""
    time = np.arange(0.0, seconds, 0.1)
    turning = (time % 100.0) < 50.0
    rate = np.where(turning, 0.08, 0.0)  # [rad/s] to starboard
    heading = np.cumsum(rate) * 0.1
    surge, sway = np.full(len(time), 1.5), -2.0 * rate
    north = np.cumsum(surge * np.cos(heading) - sway * np.sin(heading)) * 0.1
    east = np.cumsum(surge * np.sin(heading) + sway * np.cos(heading)) * 0.1
    latitude, longitude = from_tangent_plane(north, east, 34.5, 108.4)
    nothing = np.zeros(len(time))
    lost = (time % 40.0) < 10.0
    return {
        "lat": latitude, "lon": longitude, "alt": nothing,
        "roll": nothing + 0.02, "pitch": nothing + 0.1,
        "yaw": np.angle(np.exp(1j * (0.5 * np.pi - heading))),
        "vn": nothing, "ve": nothing,
        "vf": np.where(lost, -SENTINEL, surge), "vl": np.where(lost, SENTINEL, -sway),
        "vu": nothing, "ax": np.gradient(surge, 0.1), "ay": nothing, "az": nothing,
        "wx": nothing, "wy": nothing + 0.01, "wz": -rate, "wf": nothing, "numsats": nothing,
        "time": time,
    }  # fmt: skip


def circles(seconds: float = 300.0, step: float = 0.2) -> tuple[Array, dict[str, Array]]:
    """Times and states of a propelled vehicle that circles at 3 m, slips outwards and rolls."""
    since = np.arange(0.0, seconds, step)
    rate = np.where(since % 100.0 < 50.0, 0.08, -0.02)
    return START + since, {
        "depth": 3.0 + 0.2 * np.sin(0.05 * since), "pitch": 2.0 * np.cos(0.05 * since),
        "roll": 5.0 * np.sin(0.03 * since), "yaw_rate": rate,
        "heading": np.degrees(np.cumsum(rate) * step) % 360.0,
        "surge": 1.5 + 0.05 * np.sin(0.1 * since), "sway": -2.0 * rate,
        "rpm": 600.0 + 30.0 * np.sin(0.02 * since),
    }  # fmt: skip


def pack(content: bytes, block: int = 32 * 1024) -> bytes:
    """A Slocum's compressed file: blocks of lz4 behind their lengths, big-endian."""
    import lz4.block

    packed = bytearray()
    for start in range(0, len(content), block):
        piece = lz4.block.compress(content[start : start + block], store_size=False)
        packed += len(piece).to_bytes(2, "big") + piece
    return bytes(packed)


def example(page: str, name: str) -> str:
    """The program of a page's indented block that begins with the comment `# name`."""
    block = page.split(f"    # {name}\n")[1]
    lines = []
    for line in block.splitlines():
        if line.strip() and not line.startswith("    "):
            break
        lines.append(line[4:])
    return "\n".join(lines)
