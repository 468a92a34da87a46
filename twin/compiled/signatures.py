"""Signatures: what numba finds for a function of its own and types of arguments, found once.

numba tries the templates of an operator one after the other, at each use again, once to type the
use and once to write its code: for `a + b` of two floats some twenty, most of which fail with an
error that is worded, coloured and thrown away. That was a fifth of compiling. What is found depends
on the types and, where numba compiles something for its caller, on the caller's options.

A private function of numba is replaced for that, only while a function of ours compiles. A numba
that is made in another way stays as it is, and takes longer.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Mapping
from typing import Any

from numba import types

try:
    from numba.core.targetconfig import ConfigStack
except ImportError:
    ConfigStack = None

OPTIONS = ("nrt", "error_model", "fastmath", "forceinline", "boundscheck", "debuginfo")
"""Options that numba hands from a function to those that it compiles for it"""
PARAMETERS = ("self", "context", "args", "kws")
"""Parameters of the function that is replaced"""
NAME = "get_call_type"
_find = _own = getattr(types.Function, NAME, None)
_inherited = NAME not in vars(types.Function)
_found: dict[Any, tuple[Any, Any, Any]] = {}
"""Signature, what implements it, and the function's type, which lives as long as its address is a
key. What numba learns of a function later makes its type a new one."""


@functools.cache
def usable() -> bool:
    """Whether this numba has everything that `remembered` relies on."""
    try:
        from numba.core.compiler import Flags

        template = type("Template", (), {"key": "glider-twin"})
        return (
            tuple(inspect.signature(types.Function.get_call_type).parameters) == PARAMETERS
            and isinstance(types.Function(template)._impl_keys, dict)
            and isinstance(_options(), tuple)
            and all(hasattr(Flags(), name) for name in OPTIONS)
        )
    except Exception:  # whatever a numba of another make says to that
        return False


def begin() -> None:
    """Put `remembered` in place of numba's function; another library's stays."""
    if usable() and types.Function.get_call_type is _own:
        types.Function.get_call_type = remembered


def end() -> None:
    """Give numba its own function back, which its class inherits."""
    if vars(types.Function).get(NAME) is remembered:
        if _inherited:
            del types.Function.get_call_type
        else:
            types.Function.get_call_type = _own


def remembered(kind: Any, context: Any, args: tuple[Any, ...], kws: Mapping[str, Any]) -> Any:
    """In place of numba's `get_call_type`: the signature of a function for types of arguments."""
    assert _find is not None
    if kws:
        return _find(kind, context, args, kws)
    key = (id(kind), id(context), tuple(args), _options())
    if key in _found:
        signature, kind._impl_keys[signature.args], _ = _found[key]
        return signature
    signature = _find(kind, context, args, kws)
    if signature is not None and signature.args in kind._impl_keys:
        _found[key] = signature, kind._impl_keys[signature.args], (kind, context)
    return signature


def _options() -> tuple[str, ...]:
    flags = ConfigStack.top_or_none()
    return () if flags is None else tuple(str(getattr(flags, name)) for name in OPTIONS)
