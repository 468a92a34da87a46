"""File limits: what a vehicle file may hold, checked before anything is built from it.

A vehicle file stands alone. Stores keep its text, and the text must be the whole vehicle: what
another file adds could change behind the same text. And a few words of MJCF can ask for more
memory or time than there is; each count has a largest value that no vehicle needs.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from twin.errors import VehicleError

MOST_XML = 16 * 2**20
"""[byte] of a vehicle file: meshes written out have a hundred thousand vertices in it"""
MOST_DEPTH = 64
"""Elements inside each other"""
MOST_ELEMENTS = 20_000
"""Elements, each counted as often as the <replicate> around it repeats it"""
MOST_CELLS = 2**22
"""Cells of a height field, or pixels of a generated texture: 2048 by 2048"""
MOST_MEMORY = 2**30
"""[byte] in <size memory>"""

AREAS = (("nrow", "ncol"), ("width", "height"))
COUNTS = {
    "actdim": 100, "dim": 1000, "num": 1000, "nsample": 100_000, "size": 1_000_000,
    "iterations": 10_000, "ls_iterations": 10_000, "noslip_iterations": 10_000,
    "ccd_iterations": 10_000, "sdf_iterations": 1000, "sdf_initpoints": 1000,
    "nuserdata": 1_000_000, "nkey": 10_000, "nstack": 100_000_000, "njmax": 1_000_000,
    "nconmax": 1_000_000, "octree_maxdepth": 8, "maxhullvert": 100_000,
    "offwidth": 16_384, "offheight": 16_384, "resolution": 16_384, "shadowsize": 16_384,
    "offsamples": 64, "numslices": 1000, "numstacks": 1000, "numquads": 1000,
}  # fmt: skip
"""Largest value of every attribute that counts something (`nuser_...`: 1000)"""
_SIZED = {"size": ("numeric",), "num": ("contact", "tactile")}
"""Elements in which these attributes are counts; elsewhere they are lengths [m] or texts"""
REFUSED = {
    "composite": "a vehicle has no soft bodies",
    "flexcomp": "a vehicle has no soft bodies",
    "plugin": "a plugin's code is not in the file",
    "attach": "another model's content is not in the file",
}


def check_file(xml: str, path: Path) -> None:
    """Raise VehicleError when a vehicle file is not complete in itself or asks for too much."""
    if len(xml) > MOST_XML:
        _fail(path, 1, f"is longer than {MOST_XML // 2**20} MB", "leave out what is not needed")
    _Check(path).run(xml)


def _fail(path: Path, line: int, what: str, advice: str) -> NoReturn:
    raise VehicleError(f"vehicle file {path}, line {line}: {what}; {advice}")


class _Check:
    """One pass over the text. Errors of XML itself are left to who parses it next."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._begin
        self.parser.EndElementHandler = self._end
        self.repeats = [1.0]
        """How often each of the open elements is repeated, the outermost first"""
        self.elements = 0.0

    def run(self, xml: str) -> None:
        try:
            self.parser.Parse(xml, True)
        except (expat.ExpatError, UnicodeEncodeError):
            return

    def fail(self, what: str, advice: str) -> NoReturn:
        _fail(self.path, self.parser.CurrentLineNumber, what, advice)

    def _doctype(self, *_: object) -> None:
        self.fail("<!DOCTYPE> is not allowed", "a vehicle file needs no entities: leave it out")

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        if tag == "include":
            self.fail(
                f"<include file={attributes.get('file', '')!r}> is not allowed: a stored mission "
                "must hold the whole vehicle",
                "put the elements of that file in its place",
            )
        if tag in REFUSED:
            self.fail(f"<{tag}> is not allowed", REFUSED[tag])
        for name, value in attributes.items():
            if name.startswith("file") and value:
                self._refuse_file(tag, name, value)
            self._check_count(tag, name, value)
        for sides in AREAS:
            cells = math.prod(self._whole(tag, n, attributes.get(n, "1")) for n in sides)
            if cells > MOST_CELLS:
                self.fail(
                    f"<{tag}>: {sides[0]} by {sides[1]} is {cells:.3g}", self._most(MOST_CELLS)
                )
        repeats = self.repeats[-1]
        self.elements += repeats
        if tag == "replicate":
            repeats *= max(1.0, self._whole(tag, "count", attributes.get("count", "1")))
        if self.elements > MOST_ELEMENTS or repeats > MOST_ELEMENTS:
            self.fail("too many elements, those of <replicate> counted", self._most(MOST_ELEMENTS))
        self.repeats.append(repeats)
        if len(self.repeats) > MOST_DEPTH:
            self.fail("too many elements inside each other", self._most(MOST_DEPTH))

    def _end(self, tag: str) -> None:
        self.repeats.pop()

    def _refuse_file(self, tag: str, name: str, value: str) -> NoReturn:
        instead = {
            "mesh": 'write its corners into the file (vertex="x y z ..." face="0 1 2 ..."), or '
            "show the hull by ellipsoids, capsules and cylinders",
            "texture": 'take a generated one (builtin="gradient" ...) or a plain colour (rgba)',
            "hfield": 'write its heights into the file (nrow, ncol, elevation="...")',
        }
        self.fail(
            f"<{tag} {name}={value!r}> is not allowed: a stored mission must hold the whole "
            "vehicle",
            instead.get(tag, "write its content into the file"),
        )

    def _check_count(self, tag: str, name: str, value: str) -> None:
        if name == "memory":
            if self._bytes(value) > MOST_MEMORY:
                self.fail(f"<{tag} memory={value!r}> is too much", "at most 1G is possible")
            return
        most = 1000 if name.startswith("nuser_") else COUNTS.get(name)
        if most is None or tag not in _SIZED.get(name, (tag,)):
            return
        for word in value.split():
            if self._whole(tag, name, word) > most:
                self.fail(f"<{tag} {name}={_short(value)!r}> is too much", self._most(most))

    def _whole(self, tag: str, name: str, word: str) -> float:
        try:
            return float(word)
        except ValueError:
            self.fail(f"<{tag} {name}={_short(word)!r}> is not a number", "give a whole number")

    def _bytes(self, value: str) -> float:
        units = {"K": 2.0**10, "M": 2.0**20, "G": 2.0**30, "T": 2.0**40, "P": 2.0**50, "E": 2.0**60}
        word = value.strip()
        unit = units.get(word[-1:].upper(), 1.0)
        return self._whole("size", "memory", word[:-1] if unit > 1.0 else word) * unit

    @staticmethod
    def _most(number: float) -> str:
        return f"at most {number:,.0f} are possible".replace(",", " ")


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:40]}..."
