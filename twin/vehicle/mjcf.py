"""MJCF: a vehicle file's elements looked up by name; says which one is missing or malformed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError, unknown_name
from twin.frames import flip_vector
from twin.vehicle.file_limits import check_file

Array = NDArray[np.float64]

USER = "user."
"""Begins the names of a file's numbers and texts that are not for the twin"""


class MjcfReader:
    """The elements of one MJCF file by name.

    Every method raises VehicleError, naming the file as the user gave it, when its element is
    missing or malformed. Vectors come in the file's own axes (hull x forward, y port, z up).
    """

    def __init__(self, xml: str, path: Path):
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
        self.asked: set[str] = set()
        """Names of numbers and texts that somebody has looked for, there or not."""

    def fail(self, what: str, rule: str) -> NoReturn:
        """Raise a VehicleError: `what` must be `rule`."""
        raise VehicleError(f"vehicle file {self.path}: {what} must be {rule}")

    def one(self, path: str) -> ElementTree.Element:
        """The first element at an ElementTree path."""
        element = self.root.find(path)
        if element is None:
            raise VehicleError(
                f"vehicle file {self.path}: element <{path}> is missing; "
                "compare with the shipped assets/glider.xml"
            )
        return element

    def _named(self, tag: str, name: str, path: str) -> ElementTree.Element:
        found = {e.get("name", ""): e for e in self.root.iterfind(path)}
        if name not in found:
            raise VehicleError(
                f"vehicle file {self.path}: <{tag} name={name!r}> is missing"
                + (f" (found: {', '.join(sorted(filter(None, found)))})" if found else "")
            )
        return found[name]

    def body(self, name: str) -> ElementTree.Element:
        """The <body> of that name, at any depth."""
        return self._named("body", name, ".//body")

    def site(self, name: str) -> ElementTree.Element:
        """The <site> of that name on body 'hull'."""
        return self._named("site", name, ".//body[@name='hull']/site")

    def actuators(self) -> list[ElementTree.Element]:
        """The <general> actuators, in their order."""
        found = self.root.findall("./actuator/*")
        for element in found:
            if element.tag != "general":
                self.fail(f"actuator <{element.tag} name={element.get('name')!r}>", "a <general>")
        return found

    def joint(self, name: str) -> ElementTree.Element:
        """The <joint> of that name."""
        return self._named("joint", name, ".//body/joint")

    def moving_bodies(self) -> list[ElementTree.Element]:
        """The bodies on body 'hull' that have joints of their own."""
        return [b for b in self.body("hull").iterfind(".//body") if b.find("joint") is not None]

    def place(self, site: str) -> Array:
        """Position [m] of a <site> on body 'hull', FRD about the CB, shape (3,)."""
        return flip_vector(self.vector(self.site(site), "pos", 3, default="0 0 0"))

    def text(self, name: str, default: str) -> str:
        """The data of a <custom><text>, or `default`."""
        self.asked.add(name)
        element = self.texts.get(name)
        return default if element is None else element.get("data", default)

    def number(self, name: str, default: float | None = None) -> float:
        """The one number of a <custom><numeric>, or `default` when there is none."""
        self.asked.add(name)
        if default is not None and name not in self.numerics:
            return default
        return float(self.numeric(name, 1)[0])

    def flipped(self, name: str, size: int) -> Array:
        """A vector of a <custom><numeric> in the file's axes, turned to FRD."""
        return flip_vector(np.array(self.numeric(name, size)))

    def numeric(self, name: str, size: int, default: tuple[float, ...] | None = None) -> tuple:
        """The `size` numbers of a <custom><numeric>; without a default it must be there."""
        self.asked.add(name)
        if name not in self.numerics:
            if default is not None:
                return default
            raise VehicleError(
                f"vehicle file {self.path}: <custom><numeric name={name!r}> is missing; "
                f"it holds {size} number{'s' if size > 1 else ''}"
            )
        return tuple(float(x) for x in self.vector(self.numerics[name], "data", size))

    def refuse_unknown(self, known: Iterable[str], own: tuple[str, ...]) -> None:
        """Raise VehicleError for a number or text that would be ignored.

        Args:
          known: names that are right although nobody has asked for them.
          own: what names of another purpose begin with or contain.
        """
        right = self.asked | set(known)
        for name in (*self.numerics, *self.texts):
            if name not in right and not any(mark in name for mark in own):
                raise VehicleError(
                    f"vehicle file {self.path}: <custom>: {unknown_name('name', name, right)}; "
                    f"names of your own begin with {USER!r}"
                )

    def vector(
        self, element: ElementTree.Element, attribute: str, size: int, default: str | None = None
    ) -> Array:
        """The `size` finite numbers of an attribute, shape (size,)."""
        label = f"<{element.tag} name={element.get('name')!r}> {attribute}"
        text = element.get(attribute, default)
        if text is None:
            raise VehicleError(f"vehicle file {self.path}: {label} is missing ({size} numbers)")
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
            raise VehicleError(
                f"vehicle file {self.path}: body {body.get('name')!r} lacks <inertial>; "
                "mass and inertia must be explicit"
            )
        return element

    def inertial(self, body: ElementTree.Element, attribute: str) -> Array:
        """`pos` [m], shape (3,), or `mass` [kg], shape (1,), of a body's <inertial>."""
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
