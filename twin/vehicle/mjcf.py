"""MJCF: a vehicle file's elements looked up by name; says which one is missing or malformed."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from twin.errors import VehicleError
from twin.frames import flip_vector

Array = NDArray[np.float64]


class MjcfReader:
    """The elements of one MJCF file by name.

    Every method raises VehicleError, naming the file as the user gave it, when its element is
    missing or malformed. Vectors come in the file's own axes (hull x forward, y port, z up).
    """

    def __init__(self, xml: str, path: Path):
        self.path = path
        try:
            self.root = ElementTree.fromstring(xml)
        except ElementTree.ParseError as error:
            raise VehicleError(f"vehicle file {path} is not well-formed XML: {error}") from error
        if self.root.tag != "mujoco":
            self.fail(f"root element <{self.root.tag}>", "<mujoco>")
        self.numerics = {e.get("name", ""): e for e in self.root.iterfind("./custom/numeric")}

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

    def actuator(self, name: str) -> ElementTree.Element:
        """The <general> actuator of that name."""
        return self._named("general", name, "./actuator/general")

    def numeric(self, name: str, size: int) -> tuple:
        """The `size` numbers of a <custom><numeric>."""
        if name not in self.numerics:
            raise VehicleError(
                f"vehicle file {self.path}: <custom><numeric name={name!r}> is missing; "
                f"it holds {size} number{'s' if size > 1 else ''}"
            )
        return tuple(float(x) for x in self.vector(self.numerics[name], "data", size))

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
