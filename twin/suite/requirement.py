"""Requirement: dm_control, which needs its own command to install from Python 3.13 on."""

from __future__ import annotations

import importlib.util

from twin.errors import InputError

INSTALL = 'pip install --no-deps "dm-control>=1.0.50,<2"'
"""dm-control asks for labmaze, which has no wheel from Python 3.13 on and which is not needed."""


def require_dm_control() -> None:
    """Check that dm_control is installed.

    Raises:
      InputError: it is not; the message says which command installs it.
    """
    if importlib.util.find_spec("dm_control") is None:
        raise InputError(f"twin.suite needs dm_control, which is not installed: {INSTALL}")
