"""Register: adds a kind of current, or says what it lacks."""

from __future__ import annotations

import dataclasses
import inspect
import re
import zlib
from typing import TypeVar

from twin.compiled import Compiled
from twin.errors import CurrentError, unknown_name
from twin.water.current import registry
from twin.water.current import sampler as layout
from twin.water.current.axes import Origin
from twin.water.current.base import TABLE, Current, CurrentSum

C = TypeVar("C", bound=type[Current])

DAY = 86_400.0
"""[s] of the missions for which examples are tried"""
KERNEL_ARGUMENTS = 7
DIRECTIONAL_ARGUMENTS = 11


def register(cls: C) -> C:
    """Class decorator: from now on `cls.kind` can be parsed, described, compiled and flown.

    What its usage shows is tried: see `twin.water.current.probe`. Raises CurrentError naming what
    the class lacks, what another kind has already, or a derivative that is not its velocity's.
    """
    name = cls.kind
    where = f"current {name!r} ({cls.__qualname__})"
    if not re.fullmatch(r"[a-z][a-z0-9-]*", name) or name in ("none", CurrentSum.kind, TABLE):
        raise CurrentError(
            f"{cls.__qualname__}: kind must be lower-case letters, digits and hyphens, not {name!r}"
        )
    if not dataclasses.is_dataclass(cls) or "__dataclass_params__" not in vars(cls):
        raise CurrentError(f"{where} is not a dataclass: add @dataclass(frozen=True, kw_only=True)")
    if inspect.isabstract(cls):
        raise CurrentError(
            f"{where} lacks {', '.join(sorted(cls.__abstractmethods__))}(): return its settings as"
            " [self.record(...)]"
        )
    kernel = _function(where, cls, "kernel", KERNEL_ARGUMENTS)
    directional = _function(where, cls, "directional", DIRECTIONAL_ARGUMENTS)
    if (kernel is None) == (directional is None):
        raise CurrentError(
            f"{where} needs one of kernel and directional, it has"
            f" {'neither' if kernel is None else 'both'}: what flies is compiled, so give kernel, a"
            " function decorated with twin.compiled.jit that returns velocity, local rate and"
            " gradient (3 + 3 + 9 numbers)"
        )
    settings = cls.setting_fields()
    fields = {field.name for field in dataclasses.fields(cls)}
    for field in settings.values():
        if field not in fields:
            raise CurrentError(f"{where}: {unknown_name('field in settings', field, fields)}")
    if not cls.usage or not all(text.startswith(f"{name}:") for text in cls.usage):
        raise CurrentError(
            f"{where} needs usage: a mapping of example texts that begin with {name}: to a few"
            " words each"
        )
    code = cls.code
    if code is None:
        code = registry.FIRST_FREE_CODE + zlib.crc32(name.encode())
    registry.add(
        name,
        registry.Kind(
            cls=cls,
            code=code,
            payload_size=cls.payload_size,
            kernel=kernel,
            directional=directional,
        ),
    )
    if code >= registry.FIRST_FREE_CODE:
        try:
            _try_examples(where, cls)
        except CurrentError:
            registry.remove(name)
            raise
    return cls


def _try_examples(where: str, cls: type[Current]) -> None:
    """Compile what `usage` shows, which compares its derivatives with differences.

    Examples that need a file, or are no settings but their form, are compared when they are flown.
    """
    for example in cls.usage:
        try:
            current = cls.parse(example.partition(":")[2])
            drawn = [layout.program(current.records(DAY, Origin())) for _ in range(2)]
        except CurrentError:
            continue
        if drawn[0].tobytes() != drawn[1].tobytes():
            raise CurrentError(
                f"{where}: records() of {example!r} differ from call to call: draw what is random"
                " from a seed that is a setting, by numpy.random.default_rng(seed)"
            )
        current.compile(DAY)


def _function(where: str, cls: type[Current], name: str, arguments: int) -> Compiled | None:
    function = getattr(cls, name)
    if function is None:
        return None
    if not isinstance(function, Compiled):
        raise CurrentError(f"{where}: {name} is {function!r}; decorate it with twin.compiled.jit")
    count = len(inspect.signature(function.py_func).parameters)
    if count != arguments:
        raise CurrentError(
            f"{where}: {name} takes {count} arguments, it must take {arguments}: program, start,"
            " size, t, north, east, depth"
            + (", and a direction in t, north, east, depth" if arguments > KERNEL_ARGUMENTS else "")
        )
    return function
