"""Signatures: what numba finds for a function of its own and types of arguments, found once.

numba tries the templates of an operator one after the other, at each use again, once to type the
use and once to write its code: for `a + b` of two floats some twenty, most of which fail with an
error that is worded, coloured and thrown away. That was a fifth of compiling. What is found depends
on the types and, where numba compiles something for its caller, on the caller's options.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numba import types
from numba.core.targetconfig import ConfigStack

OPTIONS = ("nrt", "error_model", "fastmath", "forceinline", "boundscheck", "debuginfo")
"""Options that numba hands from a function to those that it compiles for it"""

_find = types.Function.get_call_type
_found: dict[Any, tuple[Any, Any, Any]] = {}
"""Signature, what implements it, and the function's type, which lives as long as its address is a
key. What numba learns of a function later makes its type a new one."""


def remembered(kind: Any, context: Any, args: tuple[Any, ...], kws: Mapping[str, Any]) -> Any:
    """In place of numba's `get_call_type`: the signature of a function for types of arguments."""
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


types.Function.get_call_type = remembered
