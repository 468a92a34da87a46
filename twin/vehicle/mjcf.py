"""MJCF: lookup of a vehicle file's elements by name, and checks of the file.

A vehicle file must stand alone: stores keep its text as the whole vehicle, and an included file
could change later. A few words of MJCF can ask for too much memory or time, so each count has a
largest value that no vehicle needs.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError, nearest, unknown_name
from twin.frames import flip_vector

Array = NDArray[np.float64]
Names = tuple[str, ...]
Texts = Callable[[], dict[str, str]]
USER = "user."
"""Prefix of a file's numbers and texts that the twin ignores."""
MOST_XML = 16 * 2**20
"""[byte] Longest vehicle file: enough for meshes with a hundred thousand vertices."""
MOST_DEPTH = 64
"""Maximum number of elements nested inside each other."""
MOST_ELEMENTS = 20_000
"""Maximum number of elements of a file; an element in a <replicate> counts once for each repeat."""
MOST_CELLS = 2**22
"""Maximum number of cells of a height field, or pixels of a generated texture: 2048 by 2048."""
MOST_MEMORY = 2**30
"""[byte] Largest <size memory>."""
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
"""Largest value of each attribute that is a count (`nuser_...`: 1000)."""
_SIZED = {"size": ("numeric",), "num": ("contact", "tactile")}
"""Elements in which these attributes are counts; elsewhere they are lengths [m] or texts."""
REFUSED = {
    "composite": "a vehicle has no soft bodies",
    "flexcomp": "a vehicle has no soft bodies",
    "plugin": "a plugin's code is not in the file",
    "attach": "another model's content is not in the file",
}
INSTEAD = {
    "mesh": 'write its corners into the file (vertex="x y z ..." face="0 1 2 ..."), or '
    "show the hull by ellipsoids, capsules and cylinders",
    "texture": 'take a generated one (builtin="gradient" ...) or a plain colour (rgba)',
    "hfield": 'write its heights into the file (nrow, ncol, elevation="...")',
}
"""Advice for elements that refer to a file."""


class MjcfReader:
    """Elements of one MJCF file by name.

    Every method raises VehicleError, with the file's path as the user gave it, when its element is
    missing or malformed. With `gather` a missing element is noted, a made-up one takes its place,
    and `refuse` raises for all of them. Vectors are in the file's own axes (hull x forward, y port,
    z up).
    """

    def __init__(self, xml: str, path: Path, *, gather: bool = False):
        self.path, self.xml = path, xml
        check_file(xml, path)
        try:
            self.root = ElementTree.fromstring(xml)
        except ElementTree.ParseError as error:
            raise VehicleError(f"vehicle file {path} is not well-formed XML: {error}") from error
        if self.root.tag != "mujoco":
            self.fail(f"root element <{self.root.tag}>", "<mujoco>")
        self.numerics = {e.get("name", ""): e for e in self.root.iterfind("./custom/numeric")}
        self.texts = {e.get("name", ""): e for e in self.root.iterfind("./custom/text")}
        self.asked: dict[str, tuple[int, tuple[float, ...] | str | None]] = {}
        """Numbers and texts that the code has looked up, by name: count of numbers (0: a text), and
        the value without the element (None: the file must have it)."""
        self.elements: dict[str, None] = {}
        """Other elements that the code has looked up, in that order."""
        self.lacking: dict[str, list[str]] = {}
        """Names of the missing elements by tag."""
        self._gather = gather

    def fail(self, what: str, rule: str) -> NoReturn:
        """Raise a VehicleError: `what` must be `rule`."""
        raise VehicleError(f"vehicle file {self.path}: {what} must be {rule}")

    def lack(self, tag: str, name: str = "") -> ElementTree.Element:
        """Note a missing element and return an empty one; without `gather` raise VehicleError."""
        names = self.lacking.setdefault(tag, [])
        if name not in names:
            names.append(name)
        if not self._gather:
            self.refuse()
        return ElementTree.Element(tag, name=name)

    def one(self, path: str) -> ElementTree.Element:
        """Return the first element at an ElementTree path."""
        self.elements[f"<{path}>"] = None
        element = self.root.find(path)
        return self.lack(path) if element is None else element

    def _named(self, tag: str, name: str, path: str) -> ElementTree.Element:
        self.elements[f"<{tag}> {name!r}"] = None
        found = {e.get("name", ""): e for e in self.root.iterfind(path)}
        return found[name] if name in found else self.lack(tag, name)

    def body(self, name: str) -> ElementTree.Element:
        """Return the <body> of that name, at any depth."""
        return self._named("body", name, ".//body")

    def site(self, name: str) -> ElementTree.Element:
        """Return the <site> of that name on body 'hull'."""
        return self._named("site", name, ".//body[@name='hull']/site")

    def actuators(self) -> list[ElementTree.Element]:
        """Return the <general> actuators in the file's order."""
        found = self.root.findall("./actuator/*")
        for element in found:
            if element.tag != "general":
                self.fail(f"actuator <{element.tag} name={element.get('name')!r}>", "a <general>")
        return found

    def joint(self, name: str) -> ElementTree.Element:
        """Return the <joint> of that name."""
        return self._named("joint", name, ".//body/joint")

    def moving_bodies(self) -> list[ElementTree.Element]:
        """Return the bodies on body 'hull' that have joints of their own."""
        return [b for b in self.body("hull").iterfind(".//body") if b.find("joint") is not None]

    def place(self, site: str) -> Array:
        """Position [m] of a <site> on body 'hull', FRD about the CB, shape (3,)."""
        return flip_vector(self.vector(self.site(site), "pos", 3, default="0 0 0"))

    def text(self, name: str, default: str) -> str:
        """Return the data of a <custom><text>, or `default`."""
        self.asked[name] = (0, default)
        element = self.texts.get(name)
        return default if element is None else element.get("data", default)

    def number(self, name: str, default: float | None = None) -> float:
        """Return the one number of a <custom><numeric>, or `default` if the element is missing."""
        return float(self.numeric(name, 1, None if default is None else (default,))[0])

    def flipped(self, name: str, size: int) -> Array:
        """Return a vector of a <custom><numeric>, turned from the file's axes to FRD."""
        return flip_vector(np.array(self.numeric(name, size)))

    def numeric(self, name: str, size: int, default: tuple[float, ...] | None = None) -> tuple:
        """Return the `size` numbers of a <custom><numeric>, or `default`; raises without either."""
        self.asked[name] = (size, default)
        if name in self.numerics:
            return tuple(float(x) for x in self.vector(self.numerics[name], "data", size))
        if default is not None:
            return default
        self.lack("numeric", name)
        return tuple(np.arange(1.0, size + 1.0).tolist())

    def refuse(self, known: Names = (), own: Names = (), texts: Texts = dict) -> None:
        """Raise VehicleError for all that the file lacks, or for what no code reads.

        Args:
          known, own: names that are allowed unread; parts of names that are.
          texts: function that returns descriptions of numbers by name, with units in brackets.
        """
        right = {*self.asked, *known}
        free = [n for n in (*self.numerics, *self.texts) if n not in right]
        free = [n for n in free if not any(mark in n for mark in own)]
        if self.lacking:
            described = texts()
            said = [self._lacking_of(tag, described, free) for tag in self.lacking]
            way = "`twin vehicles --template` prints a file that has all"
            raise VehicleError(f"vehicle file {self.path} lacks {'; '.join(said)}. {way}")
        if free and own:
            unknown = "; ".join(unknown_name("name", name, right) for name in free)
            way = f"names of your own begin with {USER!r}"
            raise VehicleError(f"vehicle file {self.path}: <custom>: {unknown}; {way}")

    def _lacking_of(self, tag: str, described: dict[str, str], free: Iterable[str]) -> str:
        """Missing elements of one tag, with what stands in the file under a similar name."""
        alike = free if tag == "numeric" else [e.get("name", "") for e in self.root.iter(tag)]
        said = []
        for name in filter(None, self.lacking[tag]):
            size = self.asked[name][0] if tag == "numeric" else 1
            units = re.findall(r"\[([^]]+)\]", described.get(name, "").split(":")[0])
            unit = f" [{', '.join(units)}]" if len(units) in (1, size) else ""
            near = nearest(name, alike)
            mutual = near is not None and nearest(near, self.lacking[tag]) == name
            meant = f" (is {near!r} meant?)" if mutual else ""
            said.append(f"{name}{f' {size} numbers' if size > 1 else ''}{unit}{meant}")
        return f"<{tag}> {', '.join(said)}".strip()

    def vector(
        self, element: ElementTree.Element, attribute: str, size: int, default: str | None = None
    ) -> Array:
        """Return the `size` finite numbers of an attribute, shape (size,)."""
        label = f"<{element.tag} name={element.get('name')!r}> {attribute}"
        text = element.get(attribute, default)
        if text is None:
            self.lack(
                f"{element.tag} {attribute}", f"{element.get('name', '')} {size} numbers".strip()
            )
            return np.arange(1.0, size + 1.0)
        try:
            values = np.array([float(x) for x in text.split()])
        except ValueError:
            self.fail(f"{label} = {text.strip()!r}", f"{size} numbers")
        if values.shape != (size,) or not np.isfinite(values).all():
            self.fail(f"{label} = {text.strip()!r}", f"{size} finite numbers")
        return values

    def _inertial(self, body: ElementTree.Element) -> ElementTree.Element:
        element = body.find("inertial")
        if element is None:
            self.lack("inertial of body", body.get("name", ""))
            return ElementTree.Element("inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")
        return element

    def inertial(self, body: ElementTree.Element, attribute: str) -> Array:
        """Return `pos` [m], shape (3,), or `mass` [kg], shape (1,), of a body's <inertial>."""
        return self.vector(self._inertial(body), attribute, 3 if attribute == "pos" else 1)

    def inertia(self, body: ElementTree.Element) -> Array:
        """Inertia [kg m2], shape (3, 3), FRD about the body's own CG."""
        element = self._inertial(body)
        if element.get("fullinertia") is not None:
            xx, yy, zz, xy, xz, yz = self.vector(element, "fullinertia", 6)
            matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            matrix = np.diag(self.vector(element, "diaginertia", 3))
        signs = flip_vector(np.ones(3))
        return matrix * np.outer(signs, signs)


def check_file(xml: str, path: Path) -> None:
    """Raise VehicleError when a vehicle file refers to other files or exceeds a limit."""
    check = _Check(path)
    if len(xml) > MOST_XML:
        check.fail(f"is longer than {MOST_XML // 2**20} MB", "leave out what is not needed")
    try:
        check.parser.Parse(xml, True)
    except (expat.ExpatError, UnicodeEncodeError):
        return  # the next parser reports the error


class _Check:
    """One pass over the text of a vehicle file, with its limits."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._begin
        self.parser.EndElementHandler = self._end
        self.repeats = [1.0]
        """Number of repeats of each open element, the outermost first."""
        self.elements = 0.0

    def fail(self, what: str, advice: str) -> NoReturn:
        line = self.parser.CurrentLineNumber
        raise VehicleError(f"vehicle file {self.path}, line {line}: {what}; {advice}")

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
                self.fail(
                    f"<{tag} {name}={value!r}> is not allowed: a stored mission must hold the "
                    "whole vehicle",
                    INSTEAD.get(tag, "write its content into the file"),
                )
            self._check_count(tag, name, value)
        for sides in AREAS:
            cells = math.prod(self._parse_count(tag, n, attributes.get(n, "1")) for n in sides)
            if cells > MOST_CELLS:
                self.fail(
                    f"<{tag}>: {sides[0]} by {sides[1]} is {cells:.3g}", self._limit(MOST_CELLS)
                )
        repeats = self.repeats[-1]
        self.elements += repeats
        if tag == "replicate":
            repeats *= max(1.0, self._parse_count(tag, "count", attributes.get("count", "1")))
        if self.elements > MOST_ELEMENTS or repeats > MOST_ELEMENTS:
            self.fail("too many elements, those of <replicate> counted", self._limit(MOST_ELEMENTS))
        self.repeats.append(repeats)
        if len(self.repeats) > MOST_DEPTH:
            self.fail("too many elements inside each other", self._limit(MOST_DEPTH))

    def _end(self, tag: str) -> None:
        self.repeats.pop()

    def _check_count(self, tag: str, name: str, value: str) -> None:
        if name == "memory":
            if self._parse_memory(value) > MOST_MEMORY:
                self.fail(f"<{tag} memory={value!r}> is too much", "at most 1G is possible")
            return
        most = 1000 if name.startswith("nuser_") else COUNTS.get(name)
        if most is None or tag not in _SIZED.get(name, (tag,)):
            return
        for word in value.split():
            if self._parse_count(tag, name, word) > most:
                self.fail(f"<{tag} {name}={_shortened(value)!r}> is too much", self._limit(most))

    def _parse_count(self, tag: str, name: str, word: str) -> float:
        try:
            return float(word)
        except ValueError:
            self.fail(f"<{tag} {name}={_shortened(word)!r}> is not a number", "give a whole number")

    def _parse_memory(self, value: str) -> float:
        units = {"K": 2.0**10, "M": 2.0**20, "G": 2.0**30, "T": 2.0**40, "P": 2.0**50, "E": 2.0**60}
        word = value.strip()
        unit = units.get(word[-1:].upper(), 1.0)
        return self._parse_count("size", "memory", word[:-1] if unit > 1.0 else word) * unit

    @staticmethod
    def _limit(number: float) -> str:
        return f"at most {number:,.0f} are possible".replace(",", " ")


def _shortened(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:40]}..."


def field_texts(cls: type) -> dict[str, str]:
    """Docstring of each field of a dataclass, in one line; those of its bases too."""
    source = "".join(inspect.getsource(one) for one in reversed(cls.__mro__[:-1]))
    field = r'^    (\w+): .*(?:\n(?:     |    \)).*)*\n    """((?:[^"]|"(?!""))*)"""'
    found = re.findall(field, source, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}
