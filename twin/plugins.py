"""Plugins: a user's own types, from files that an environment variable names or entry points.

A type is a named class, function or object of an extension point. Each process runs the files
once, before its first lookup of a name. A place says where a type is defined, as `module:Name`.

Entry points offer types and commands of installed distributions. The plugins of this project,
whose names begin with `glider-twin-`, must have the same version as glider-twin.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

from twin.errors import InputError, TwinError
from twin.version import __version__

PLUGINS = "GLIDER_TWIN_PLUGINS"
"""Environment variable that lists the Python files of a user's own types."""
PLUGIN_MODULE = "glider_twin_plugin_"
"""Prefix of the module names that the files in `PLUGINS` get."""
PROGRAMS = ("__main__", "__mp_main__")
"""Module names of the file that Python was started with, in this process and its workers."""
PLUGIN_FOLDER, OWN_PLUGINS = "plugins/", "glider-twin-"
"""Prefixes of own plugins. PLUGIN_FOLDER: folders in a clone. OWN_PLUGINS: distributions"""

_plugins_ran: set[str] = set()


def run_plugins() -> None:
    """Run each file that the environment variable names, once.

    Raises:
      InputError: a file is missing or fails; the message names the file.
    """
    for text in os.environ.get(PLUGINS, "").split(os.pathsep):
        if not text or text in _plugins_ran:
            continue
        _plugins_ran.add(text)  # before it runs, since the file itself may look names up
        try:
            _run_plugin(Path(text))
        except BaseException:
            _plugins_ran.discard(text)
            raise


def _run_plugin(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{PLUGINS} names {path}, which is not a file; correct the variable")
    name = f"{PLUGIN_MODULE}{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{PLUGINS} names {path}, which is not a Python file (.py)")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # the decorator `dataclass` needs the class's module there
    try:
        spec.loader.exec_module(module)
    except InputError as error:
        raise InputError(f"{path} ({PLUGINS}): {error}") from error
    except Exception as error:
        raise InputError(f"{path} ({PLUGINS}) fails: {type(error).__name__}: {error}") from error


def imported(place: str) -> Any:
    """Import the object at `module:attribute`."""
    module, _, attribute = place.partition(":")
    return getattr(importlib.import_module(module), attribute)


def place_of(kind: Any) -> str:
    """Place `module:Name` of a class or function, or of an object's class."""
    found = kind if hasattr(kind, "__qualname__") else type(kind)
    return f"{found.__module__}:{found.__qualname__}"


def same_place(one: Any, other: Any) -> bool:
    """Return True if two classes or functions have one place, as after a second definition."""
    both = hasattr(one, "__qualname__") and hasattr(other, "__qualname__")
    return both and place_of(one) == place_of(other)


def from_plugin(kind: Any) -> bool:
    """Return True if a file that GLIDER_TWIN_PLUGINS names defines this type."""
    return place_of(kind).startswith(PLUGIN_MODULE)


def importable(kind: Any) -> bool:
    """Return True if a child process can import a type by its module and name."""
    module, _, name = place_of(kind).partition(":")
    if "<locals>" in name:
        return False
    if module == "__main__":
        return hasattr(sys.modules[module], "__file__")
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def installation(source: str) -> str:
    """Command that installs a plugin of this project, or an extra.

    Args:
      source: `plugins/NAME`, or the name of an extra.
    """
    if source.startswith(PLUGIN_FOLDER):
        return f"`pip install ./{source}` in a clone"
    return f'pip install "glider-twin[{source}]"'


def entry_point(group: str, name: str) -> importlib.metadata.EntryPoint | None:
    """Look up one entry point by its name; None if no installed distribution has it."""
    return next(iter(importlib.metadata.entry_points(group=group, name=name)), None)


def load_entry_point(point: importlib.metadata.EntryPoint, what: str) -> Any:
    """Import the object of an entry point.

    Args:
      what: noun and name of the object, for errors.

    Raises:
      InputError: the import fails, or a plugin of this project has another version.
    """
    if point.dist and point.dist.name.startswith(OWN_PLUGINS) and point.dist.version != __version__:
        raise InputError(
            f"{point.dist.name} {point.dist.version} brings the {what}, but glider-twin is "
            f"{__version__}: install both of one version"
        )
    try:
        return point.load()
    except TwinError:
        raise
    except Exception as error:  # importing foreign code can raise anything
        raise InputError(
            f"{origin_of(point)} offers the {what} as {point.value}, which cannot be loaded: "
            f"{type(error).__name__}: {error}"
        ) from error


def origin_of(point: importlib.metadata.EntryPoint) -> str:
    """Text that names the distribution of an entry point."""
    return f"distribution {point.dist.name!r}" if point.dist else "an entry point"
