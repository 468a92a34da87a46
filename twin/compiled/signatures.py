"""Signatures: a memory of numba's type inference for each function and types of arguments.

numba tries the templates of an operator one after the other at every use, twice: to type the use
and to write its code. For `a + b` of two floats these are some twenty, most of which fail with an
error that is formatted, coloured and discarded. This took a fifth of compile time. The result
depends on the types and, where numba compiles a function for its caller, on the caller's options.

While a function of ours compiles, a private function of numba is replaced by a remembering one. A
numba with other internals stays unchanged and takes longer.
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
"""Options that numba passes from a function to functions that it compiles for it."""
PARAMETERS = ("self", "context", "args", "kws")
"""Parameters of the function that is replaced."""
NAME = "get_call_type"
_find = _own = getattr(types.Function, NAME, None)
_inherited = NAME not in vars(types.Function)
_found: dict[Any, tuple[Any, Any, Any]] = {}
"""Signature, implementation, and the objects whose addresses are the key, kept alive for that. When
numba learns more about a function, the function's type becomes a new object."""


@functools.cache
def usable() -> bool:
    """Tell whether this numba has everything that `remembered` relies on."""
    try:
        from numba.core.compiler import Flags

        template = type("Template", (), {"key": "glider-twin"})
        return (
            tuple(inspect.signature(types.Function.get_call_type).parameters) == PARAMETERS
            and isinstance(types.Function(template)._impl_keys, dict)
            and isinstance(_options(), tuple)
            and all(hasattr(Flags(), name) for name in OPTIONS)
        )
    except Exception:  # another numba may raise anything
        return False


def begin() -> None:
    """Put `remembered` in place of numba's function, unless another library has replaced it."""
    if usable() and types.Function.get_call_type is _own:
        types.Function.get_call_type = remembered


def end() -> None:
    """Restore numba's own function, which its class inherits."""
    if vars(types.Function).get(NAME) is remembered:
        if _inherited:
            del types.Function.get_call_type
        else:
            types.Function.get_call_type = _own


def remembered(kind: Any, context: Any, args: tuple[Any, ...], kws: Mapping[str, Any]) -> Any:
    """Signature of a function for types of arguments; replaces numba's `get_call_type`."""
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
