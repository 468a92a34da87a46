"""Compiled functions, kept between processes by the content of everything they are made from.

`jit` compiles a function at its first call, `cfunc` makes a C callback, and `dispatch` makes one
function of a table of kinds. None of them loads numba before something is compiled.
"""

from twin.compiled.content import changed, generation
from twin.compiled.dispatch import dispatch, generate
from twin.compiled.function import Compiled, cfunc, inline, jit

__all__ = [
    "Compiled",
    "cfunc",
    "changed",
    "dispatch",
    "generate",
    "generation",
    "inline",
    "jit",
]
