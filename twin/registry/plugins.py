"""Plugins: files of a user's own kinds, named by the environment.

Each process runs them once, before it first looks a name up.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

from twin.errors import InputError

PLUGINS = "GLIDER_TWIN_PLUGINS"
"""Environment variable with the Python files of a user's own kinds."""
PLUGIN_MODULE = "glider_twin_plugin_"
"""Start of the names under which those files are known as modules."""

_plugins_ran: set[str] = set()


def run_plugins() -> None:
    """Run the files that the environment names, each once.

    Raises:
      InputError: a file is not there or fails; the message names it.
    """
    for text in os.environ.get(PLUGINS, "").split(os.pathsep):
        if not text or text in _plugins_ran:
            continue
        _plugins_ran.add(text)  # before it runs: it looks names up itself
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
    sys.modules[name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except InputError as error:
        raise InputError(f"{path} ({PLUGINS}): {error}") from error
    except Exception as error:
        raise InputError(f"{path} ({PLUGINS}) fails: {type(error).__name__}: {error}") from error
