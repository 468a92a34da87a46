"""Structure: what vehicles have in common that fly side by side, as one compiled function.

Vehicles of one structure have the same parts, masses and hull law, each with numbers of its own. A
block (`twin.fossen.lane_block`) holds some of them. The function of a structure is written out as
text (`twin.fossen.structure_text`), without a loop but the one over lanes; it takes the state and
gives its rate.
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
    """The structure of a vehicle: its compiled function, and the numbers that it reads."""

    parts: int
    size: int
    """rows of a block"""
    text: str
    """of the function's loop, in which `{k}` is the first number of row k"""
    names: tuple[tuple[str, Any], ...]
    """what the text calls: compiled functions, by name"""
    kernels: tuple[tuple[str, str], ...]
    """function of a kind in words, and the text of a loop with nothing else in it"""

    @property
    def numbers_at(self) -> int:
        """First row of the vehicle's own numbers."""
        return PARTS_AT + len(PART) * self.parts

    def rate(self, lanes: int) -> Any:
        """The compiled function for blocks of so many lanes, numba's CFunc: (block, g [s]).

        It writes the rows `rate`, `current`, `water`, `net_mass` and `path_rate` from the others.
        With `g` above 0 the accelerations are those of a linearly implicit step: see
        `twin.fossen.lanes`.
        """
        return _compiled(self, lanes, content.generation())

    def arithmetic(self, lanes: int) -> Arithmetic:
        """Operations of that function, by compiling it anew: the cache keeps no text of it."""
        return Arithmetic.of(_kept_loop(self, self.text, lanes, keep=False)[0])


@functools.lru_cache(maxsize=64)
def _compiled(structure: Structure, lanes: int, _: int) -> Any:
    from twin.compiled.folder import keep_note, kept_note

    function, stamp = _kept_loop(structure, structure.text, lanes)
    # kept code has no text any more: what was found in it when it was compiled is kept beside it
    slow = kept_note(__name__, stamp) if function.cache_hits else None
    if slow is None:
        text = structure.arithmetic(lanes) if function.cache_hits else Arithmetic.of(function)
        slow = "" if text.vector_code else _blamed(structure)
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
    """A loop over so many lanes, compiled, and the stamp under which it is kept, None: it is not.

    `keep`: between processes.
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
    """operations on several lanes at once"""
    scalar: int
    """on one"""
    calls: tuple[str, ...]
    """functions that are called, once a lane"""

    @classmethod
    def of(cls, function: Any) -> Arithmetic:
        """Count a CFunc that was compiled in this process; one from the cache has no text."""
        return cls.of_text(function.inspect_llvm())

    @classmethod
    def of_text(cls, text: str) -> Arithmetic:
        """Count the first function of LLVM's text."""
        # the first function is ours, those behind it call it from C and let memory go
        text = text[text.index("\ndefine ") :].partition("\n}")[0]
        packed = len(_PACKED.findall(text))
        called = set(_CALLED.findall(text))
        if " frem " in text:
            called.add("fmod")
        found = (name for name in called if not name.startswith(_INSTRUCTIONS))
        return cls(packed, len(_FLOATING.findall(text)) - packed, tuple(sorted(found)))

    @property
    def vector_code(self) -> bool:
        """Whether lanes share instructions: less than a tenth is scalar, nothing is called."""
        return not self.calls and self.scalar < 0.1 * (self.packed + self.scalar)


_FLOATING = re.compile(r"= f(?:add|sub|mul|div)\b")
_PACKED = re.compile(r"= f(?:add|sub|mul|div)\b[a-z ]* <\d+ x double>")
_CALLED = re.compile(r"\bcall\b[^\n@]*@([\w.$]+)")
_INSTRUCTIONS = tuple(
    f"llvm.{name}." for name in ("fabs", "sqrt", "copysign", "assume", "experimental", "lifetime")
)
"""Calls in LLVM's text that are compiled to instructions"""
_ALONE = 4096
"""lanes of a loop with one kind's function: so many that the loop stays one"""


def _blamed(structure: Structure) -> str:
    """The functions of kinds that did not become vector code, in words."""
    blamed = []
    for name, text in structure.kernels:
        found = Arithmetic.of(_kept_loop(structure, text, _ALONE, keep=False)[0])
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
    """The structure of a vehicle, and its numbers in the rows from `numbers_at` on.

    Args:
      neutral_volume: [m3] as it was really ballasted; None: the vehicle's own.
      zeros: where parts really are when their encoders say 0, by part, in the parts' units.

    Raises:
      VehicleError: a law that does not fly in lanes, or a kind that is not compiled.
    """
    volume = vehicle.neutral_volume if neutral_volume is None else neutral_volume
    w = written(vehicle, volume, zeros or {})
    size = w.first + len(w.numbers)
    names = tuple(sorted(w.names.items()))
    structure = Structure(len(vehicle.parts), size, body(w.lines), names, tuple(w.kernels))
    return structure, np.array(w.numbers)
