"""Content: one hash of all source from which a function is compiled.

Compiled code holds copies of the functions that it calls and of the constants that it reads. Its
content is therefore its module and all modules imported from there, directly or not; the dispatch
tables that it calls, directly or not, with the modules of their kernels; and the compiler's
versions. A new type in a table invalidates only that table's callers. The standard library and
other packages in site-packages are left out. Imports are found in the text, without running it.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.machinery
import re
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

OURS = frozenset({"twin", "factory", "learn"})
"""Packages whose imports are followed wherever they are installed."""
_STARTED = time.time()
_TYPING = re.compile(rb"^if TYPE_CHECKING:[^\n]*\n(?:[ \t]+[^\n]*\n|\n)*", re.MULTILINE)
_IMPORT = re.compile(
    rb"^[ \t]*(?:"
    rb"from[ \t]+(?P<base>[.\w]+)[ \t]+import[ \t]*(?P<names>\((?:[^)#]|#[^\n]*)*\)|[^\n#;]+)"
    rb"|import[ \t]+(?P<modules>[^\n#;]+))",
    re.MULTILINE,
)
_NOTE = re.compile(rb"#[^\n]*")
_ALIAS = re.compile(rb"[ \t]as[ \t]+\w+")
TableText = Callable[[], tuple[str, tuple[str, ...]]]
"""Generated text of a dispatch table, and the modules of its kernels."""
Table = tuple[str, str]
"""Module that built a table, and the table's name there."""
_tables: dict[str, dict[str, TableText]] = defaultdict(dict)
_called: dict[Any, tuple[Any, ...]] = {}
"""Functions that each compiled function calls, in this generation."""
_generation = 0


def generation() -> int:
    """Count the changes to dispatch tables; code of an earlier generation may be outdated."""
    return _generation


def changed() -> None:
    """Start a new generation; code that registers a type calls this."""
    global _generation
    _generation += 1
    _called.clear()


def add_table(module: str, name: str, text: TableText) -> Table:
    """Make a generated function part of the content of its callers."""
    _tables[module][name] = text
    _stamp.cache_clear()
    return module, name


def stamp(module: str, function: Any = None) -> str | None:
    """Hash, 32 hexadecimal digits, of the content of a function of a module.

    None when the content is unknown: the source is in no file (a notebook), or the file changed
    after this process began and may differ from the running code. Such code is not kept.

    Args:
      module: name of the module.
      function: one made by `jit` or `generate`, or the Python function of a callback; None: any
        function without dispatch tables.
    """
    return _stamp(module, frozenset() if function is None else tables_of(function), _generation)


def tables_of(function: Any) -> frozenset[Table]:
    """Dispatch tables that a function is or calls, directly or through other functions."""
    seen, waiting, found = {function}, [function], set()
    while waiting:
        one = waiting.pop()
        if (table := getattr(one, "table", None)) is not None:
            found.add(table)
        for other in _called_functions(one):
            if other not in seen:
                seen.add(other)
                waiting.append(other)
    return frozenset(found)


def _called_functions(function: Any) -> tuple[Any, ...]:
    """Functions among the globals, closure and defaults that a function's code names."""
    if isinstance(function, FunctionType):
        return tuple(filter(_is_function, _values(function)))
    if function not in _called:
        _called[function] = tuple(filter(_is_function, _values(function.py_func)))
    return _called[function]


def _is_function(value: Any) -> bool:
    """Tell whether a value is a compiled function, or a Python one that a compiler may inline."""
    if isinstance(value, FunctionType):
        return True
    return not isinstance(value, type) and (
        hasattr(type(value), "py_func") or hasattr(value, "py_func")
    )


def _values(function: FunctionType) -> Iterator[Any]:
    """Values that a function's code may name, including those in modules, tuples and lists."""
    names = names_of(function.__code__)
    waiting = [value for name, value in function.__globals__.items() if name in names]
    waiting += [cell.cell_contents for cell in function.__closure__ or ()]
    waiting += function.__defaults__ or ()
    modules: set[str] = set()
    while waiting:
        value = waiting.pop()
        if isinstance(value, tuple | list):
            waiting += value
        elif isinstance(value, ModuleType):
            if value.__name__ not in modules:
                modules.add(value.__name__)
                waiting += [vars(value)[name] for name in names if name in vars(value)]
        else:
            yield value


def names_of(code: CodeType) -> frozenset[str]:
    """Names and attributes that a code object and the functions in it use."""
    inner = (names_of(part) for part in code.co_consts if isinstance(part, CodeType))
    return frozenset(code.co_names).union(*inner)


@functools.cache
def _stamp(module: str, tables: frozenset[Table], _: int) -> str | None:
    digest = hashlib.sha256(_compiler().encode())
    own = OURS | {module.partition(".")[0]}
    seen, waiting, parts = {module}, [module], []
    for table in sorted(tables):
        generated, kernels = _tables[table[0]][table[1]]()
        parts.append((":".join(table), generated.encode()))
        # a kernel without a file has no stamp, and neither has its caller
        if any(_module_file(kernel) is None for kernel in kernels):
            return None
        own = own | {kernel.partition(".")[0] for kernel in kernels}
        waiting.extend({table[0], *kernels} - seen)
        seen.update({table[0], *kernels})
    while waiting:
        name = waiting.pop()
        path = _module_file(name)
        if path is None:
            if name == module or name in _tables:
                return None
            continue
        if not _is_followed(name, path, own):
            continue
        try:
            state = Path(path).stat()
            source = _source(path, state.st_mtime_ns, state.st_size)
        except OSError:
            return None
        if state.st_mtime > _STARTED:
            return None
        parts.append((name, source.digest))
        for other in _imported_modules(name, path, source.imports):
            if other not in seen:
                seen.add(other)
                waiting.append(other)
    for name, content in sorted(parts):
        digest.update(f"\n{name}\n".encode() + content)
    return digest.hexdigest()[:32]


@functools.cache
def _compiler() -> str:
    """Versions and processor that compiled code depends on."""
    import llvmlite
    import numba
    import numpy as np
    from llvmlite.binding import get_host_cpu_name

    versions = (sys.version, numba.__version__, llvmlite.__version__, np.__version__)
    return "\n".join((*versions, get_host_cpu_name()))


class _Source(NamedTuple):
    digest: bytes
    imports: tuple[tuple[str, tuple[str, ...]], ...]


@functools.cache
def _source(path: str, _mtime: int, _size: int) -> _Source:
    """Hash and imports of a file: (module, names taken from it)."""
    text = Path(path).read_bytes()
    digest = hashlib.sha256(text).digest()
    if not path.endswith(".py"):
        return _Source(digest, ())
    imports: list[tuple[str, tuple[str, ...]]] = []
    for match in _IMPORT.finditer(_TYPING.sub(b"", text.replace(b"\\\n", b" "))):
        taken = match["names"] or match["modules"]
        plain = _ALIAS.sub(b"", _NOTE.sub(b"", taken)).decode()
        names = tuple(name.strip() for name in plain.strip(" ()\n\t").split(",") if name.strip())
        if match["base"] is None:
            imports.extend((name, ()) for name in names)
        else:
            imports.append((match["base"].decode(), names))
    return _Source(digest, tuple(imports))


def _imported_modules(
    module: str, path: str, imports: tuple[tuple[str, tuple[str, ...]], ...]
) -> Iterator[str]:
    """Modules that a module's imports may mean: each name may be a submodule or not."""
    package = module if Path(path).name == "__init__.py" else module.rpartition(".")[0]
    for base, names in imports:
        if base.startswith("."):
            up = len(base) - len(base.lstrip(".")) - 1
            parts = package.split(".")
            base = ".".join([*parts[: len(parts) - up], *filter(None, [base.lstrip(".")])])
        if base.partition(".")[0] in sys.stdlib_module_names:
            continue
        yield base
        for name in names:
            yield f"{base}.{name}"


def _is_followed(name: str, path: str, own: frozenset[str]) -> bool:
    """Tell whether a module is ours, or source outside every site-packages folder."""
    if name.partition(".")[0] in own:
        return True
    return not {"site-packages", "dist-packages"} & set(Path(path).parts)


@functools.cache
def _search(name: str) -> tuple[str | None, tuple[str, ...]]:
    """File and search path of a module that is not loaded, found without importing anything."""
    parent, _, _ = name.rpartition(".")
    path: list[str] | None = None
    if parent:
        path = list(_package_folders(parent))
        if not path:
            return None, ()
    try:
        spec = importlib.machinery.PathFinder.find_spec(name, path)
    except (ImportError, ValueError, KeyError):  # KeyError: a namespace in a package not loaded
        spec = None
    if spec is None:
        return None, ()
    return spec.origin, tuple(spec.submodule_search_locations or ())


def _package_folders(name: str) -> tuple[str, ...]:
    module = sys.modules.get(name)
    if module is not None:
        return tuple(getattr(module, "__path__", ()))
    return _search(name)[1]


def _module_file(name: str) -> str | None:
    """File of a module; None for a namespace, a notebook, or a name that is not a module."""
    module = sys.modules.get(name)
    if module is None:
        return _search(name)[0]
    path = getattr(module, "__file__", None)
    return path if path and Path(path).exists() else None
