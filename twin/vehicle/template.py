"""Template: a vehicle file to begin with, from a shipped one and what the loader asks of it.

It keeps the shipped text line by line, so that each number has its unit beside it. Left out is what
a first flight does not need: drawn shapes with materials, key frames, other sets of numbers, the
factory's distributions.
"""

from __future__ import annotations

import re

from twin.errors import InputError
from twin.vehicle.mjcf import MjcfReader
from twin.vehicle.plain import without_plain
from twin.vehicle.presets import asset_path, shipped_files, unknown_vehicle
from twin.vehicle.vehicle import Vehicle, number_texts, read_vehicle

HEAD = """<!--
  A vehicle to begin with: the numbers of the shipped {name} ({source}).
  Save it as mine.xml, put your own numbers in, and give it to a command as its vehicle.

  "required": no flight without it. "optional, else 0": without it 0 counts.
  Required besides: {elements}.
  Axes of MJCF: hull x forward, y port, z up, origin at the centre of buoyancy (CB). Numbers under
  custom: x forward, y starboard, z down about the CB, except the axes of parts; SI units, radians.
-->
"""
_TAG = r"""(?:[^<>"]|"[^"]*")*"""
_ABOVE = r"(?:[ \t]*<!--(?:(?!-->).)*-->\n)?[ \t]*"
_LEFT_OUT = (
    rf"{_ABOVE}<(asset|keyframe)>.*?</\1>\s*?\n",
    rf"{_ABOVE}<geom\b{_TAG}\b(?:mesh|material)={_TAG}/>[^\n]*\n",
    rf'{_ABOVE}<(?:text|numeric) name="(?:spread\.[^"]*|presets|[^"]*:[^"]*)"{_TAG}/>[^\n]*\n',
)
"""Patterns of elements that a template lacks, each with the comment above it."""
_NUMBER = re.compile(rf'(<(?:numeric|text) name="([^"]*)"{_TAG}/>)(?: *<!-- (.*?) -->)?', re.DOTALL)
"""Pattern of a number or text, its name, and the comment behind it."""


def vehicle_template(name: str = "glider") -> str:
    """Return the text of a vehicle file that flies, from the shipped `name`; else InputError."""
    if name not in shipped_files():
        raise InputError(unknown_vehicle(name))
    path = asset_path(f"{name}.xml")
    reader = MjcfReader(without_plain(path.read_text("utf-8"), path), path, gather=True)
    source = read_vehicle(reader).source
    text = reader.xml[reader.xml.index("<mujoco") :]
    for pattern in _LEFT_OUT:
        text = re.sub(pattern, "", text, flags=re.DOTALL)
    text = _NUMBER.sub(
        lambda found: f"{found[1]} <!-- {_need(reader, found[2])}: {found[3] or ''} -->", text
    ).replace(":  -->", " -->")
    text = re.sub(r'<mujoco model="[^"]*"', '<mujoco model="mine"', text)
    text = text.replace('group="4"', 'group="1"').replace("; hidden", "")  # nothing else is drawn
    meanings = number_texts(reader)
    absent = "".join(
        f"      {number} ({size}, {_need(reader, number)}): {meanings[number]}\n"
        for number, (size, _) in reader.asked.items()
        if size and number not in reader.numerics and number in meanings
    )
    further = f"\n    <!-- this file does without (count of numbers):\n{absent}    -->\n"
    text = re.sub(r"\n{3,}", "\n\n", text.replace("  </custom>", f"{further}  </custom>", 1))
    return HEAD.format(name=name, source=source, elements=", ".join(reader.elements)) + text


def _need(reader: MjcfReader, name: str) -> str:
    """Text "required", or "optional" with the value that counts without the element."""
    _, default = reader.asked.get(name, (0, ()))
    value = default or getattr(Vehicle, name, None) or "none"
    text = value if isinstance(value, str) else " ".join(f"{number:.4g}" for number in value)
    return "required" if default is None else f"optional, else {text}"
