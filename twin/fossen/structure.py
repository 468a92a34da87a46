"""Structure: the common part of vehicles in a batch, as one compiled function.

Vehicles of one structure have the same parts, masses and hull law, but different numbers. A block
(`twin.fossen.lane_block`) holds several of them; a lane is one vehicle's place in it. The function
of a structure computes the rate of the state. Its text (`twin.fossen.structure_text`) has no loop
except the one over lanes.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import re
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from twin.compiled import Compiled, content
from twin.compiled.portable import calls_math, portable, widest_vectors
from twin.fossen.lane_block import PART, PARTS_AT
from twin.fossen.structure_text import body, written
from twin.numbers import Array
from twin.vehicle.vehicle import Vehicle

_ROW = re.compile(r"\{(\d+)\}")


@dataclasses.dataclass(frozen=True)
class Structure:
    """Structure of a vehicle: its compiled function and the layout of the function's numbers."""

    parts: int
    size: int
    """Number of rows of a block."""
    text: str
    """Text of the function's loop; `{k}` stands for the first number of row k."""
    names: tuple[tuple[str, Any], ...]
    """Compiled functions that the text calls, by name."""
    kernels: tuple[tuple[str, str], ...]
    """Description of each type's function, and the text of a loop with this function alone."""

    @property
    def numbers_at(self) -> int:
        """First row of the vehicle's own numbers."""
        return PARTS_AT + len(PART) * self.parts

    def rate(self, lanes: int) -> Any:
        """Compiled function for blocks of `lanes` lanes, numba's CFunc: (block, g [s]).

        It writes the rows `rate`, `current`, `water`, `net_mass` and `path_rate` from the others.
        With `g` above 0 the accelerations are those of a linearly implicit step: see
        `twin.fossen.lanes`.
        """
        return _compiled(self, lanes, content.generation())

    def arithmetic(self, lanes: int) -> Arithmetic:
        """Count the function's operations; compiles the function again: cached code has no text."""
        return Arithmetic.of(_kept_loop(self, self.text, lanes, keep=False)[0])


@functools.lru_cache(maxsize=64)
def _compiled(structure: Structure, lanes: int, _: int) -> Any:
    from twin.compiled.folder import keep_note, kept_note

    function, stamp = _kept_loop(structure, structure.text, lanes)
    # cached code has no text, so the finding is kept beside the code
    slow = kept_note(__name__, stamp) if function.cache_hits else None
    if slow is None:
        text = structure.arithmetic(lanes) if function.cache_hits else Arithmetic.of(function)
        slow = "" if text.vector_code else _scalar_kinds(structure)
        keep_note(__name__, stamp, slow)
    if slow:
        warnings.warn(
            f"the lanes of this vehicle fly 4 to 7 times slower than they could, because {slow}"
            " did not become vector code: write it of scalars, with @scalar of "
            "twin.compiled.elementary, without loops, arrays or calls of other libraries "
            "(docs/howto/extending.md)",
            RuntimeWarning,
            stacklevel=3,
        )
    return function


def _kept_loop(
    structure: Structure, body: str, lanes: int, *, keep: bool = True
) -> tuple[Any, str | None]:
    """Compile a loop over `lanes` lanes; returns it with its stamp, None when it is not kept.

    `keep`: True keeps the code between processes.
    """
    import numba
    from numba import types

    from twin.compiled.folder import decorated

    names = {
        name: portable(value) if isinstance(value, Compiled) and calls_math(value) else value
        for name, value in structure.names
    }
    space = {"__name__": __name__, "carray": numba.carray, "widest_vectors": widest_vectors}
    space |= names
    body = _ROW.sub(lambda found: str(int(found[1]) * lanes), body)
    text = (
        f"def rate(address, g):\n    b = carray(address, {structure.size * lanes})\n"
        f"    widest_vectors()\n    for l in range({lanes}):\n{body}"
    )
    exec(compile(text, "<structure>", "exec"), space)
    stamps = [content.stamp(__name__, space["rate"])]
    stamps += [v._content() for v in names.values() if isinstance(v, Compiled)]
    stamp = None
    if keep and None not in stamps:
        joined = "\n".join([text, *map(str, stamps)])
        stamp = hashlib.sha256(joined.encode()).hexdigest()[:32]
    signature = types.void(types.CPointer(types.float64), types.float64)
    function = decorated(
        lambda cache: numba.cfunc(signature, cache=cache, error_model="numpy")(space["rate"]),
        __name__,
        stamp,
    )
    return function, stamp


@dataclasses.dataclass(frozen=True)
class Arithmetic:
    """Operations of a compiled loop over lanes, counted in its text."""

    packed: int
    """Number of operations on several lanes at once."""
    scalar: int
    """Number of operations on a single lane."""
    calls: tuple[str, ...]
    """Functions that are called once per lane."""

    @classmethod
    def of(cls, function: Any) -> Arithmetic:
        """Count a CFunc that was compiled in this process; one from the cache has no text."""
        return cls.of_text(function.inspect_llvm())

    @classmethod
    def of_text(cls, text: str) -> Arithmetic:
        """Count the first function of LLVM's text."""
        # the first function is the loop; the others are its C wrapper and memory management
        text = text[text.index("\ndefine ") :].partition("\n}")[0]
        packed = len(_PACKED.findall(text))
        called = set(_CALLED.findall(text))
        if " frem " in text:
            called.add("fmod")
        found = (name for name in called if not name.startswith(_INSTRUCTIONS))
        return cls(packed, len(_FLOATING.findall(text)) - packed, tuple(sorted(found)))

    @property
    def vector_code(self) -> bool:
        """True when lanes share instructions: less than a tenth is scalar, without calls."""
        return not self.calls and self.scalar < 0.1 * (self.packed + self.scalar)


_FLOATING = re.compile(r"= f(?:add|sub|mul|div)\b")
_PACKED = re.compile(r"= f(?:add|sub|mul|div)\b[a-z ]* <\d+ x double>")
_CALLED = re.compile(r"\bcall\b[^\n@]*@([\w.$]+)")
_INSTRUCTIONS = tuple(
    f"llvm.{name}." for name in ("fabs", "sqrt", "copysign", "assume", "experimental", "lifetime")
)
"""Calls in LLVM's text that are compiled to instructions."""
_KIND_LANES = 4096
"""Lanes of a loop with one type's function; LLVM does not unroll a loop of this length."""


def _scalar_kinds(structure: Structure) -> str:
    """Names of the types' functions that did not become vector code."""
    blamed = []
    for name, text in structure.kernels:
        found = Arithmetic.of(_kept_loop(structure, text, _KIND_LANES, keep=False)[0])
        if not found.vector_code:
            calls = f", calls {', '.join(found.calls)}" if found.calls else ""
            blamed.append(
                f"{name} ({found.packed} packed operations, {found.scalar} scalar{calls})"
            )
    return " and ".join(blamed) or "its equations together"


def structure_of(
    vehicle: Vehicle,
    *,
    neutral_volume: float | None = None,
    zeros: Mapping[str, float] | None = None,
) -> tuple[Structure, Array]:
    """Structure of a vehicle, and the vehicle's numbers in the rows from `numbers_at` on.

    Args:
      neutral_volume: [m3] after the actual ballasting; None: the vehicle's own.
      zeros: true positions at which encoders read 0, by part, in the parts' units.

    Raises:
      VehicleError: the law does not fly in lanes, or a type is not compiled.
    """
    volume = vehicle.neutral_volume if neutral_volume is None else neutral_volume
    w = written(vehicle, volume, zeros or {})
    size = w.first + len(w.numbers)
    names = tuple(sorted(w.names.items()))
    structure = Structure(len(vehicle.parts), size, body(w.lines), names, tuple(w.kernels))
    return structure, np.array(w.numbers)
