"""Extras: optional packages, and the command that installs one that is missing."""

from __future__ import annotations

import importlib

from twin.errors import InputError


def require(package: str, *, extra: str, purpose: str) -> None:
    """Check that the packages of an extra are installed.

    Args:
      package: what will be imported.
      extra: the extra of this project that brings it.
      purpose: what it is for, the start of the message.

    Raises:
      InputError: it cannot be imported; the message says which command installs it.
    """
    try:
        importlib.import_module(package)
    except ImportError as error:
        raise InputError(
            f"{purpose} needs the package {package}, which cannot be imported ({error}): "
            f'pip install "glider-twin[{extra}]"'
        ) from error
