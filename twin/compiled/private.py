"""Where compiled code goes when neither the installation nor the user's cache can be written."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def private_folder() -> Path:
    """A folder of this user and program in the system's temporary folder; not created here."""
    user = os.getuid() if hasattr(os, "getuid") else "user"
    return Path(tempfile.gettempdir()) / f"glider-twin-{user}"


def ensure_numba_cache() -> None:
    """Give numba a cache folder where its own choices (package, user cache) cannot be written.

    Must run before numba is imported.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    package = Path(__file__).resolve().parents[1]
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    nearest = next((place for place in (cache, *cache.parents) if place.exists()), cache)
    if os.access(package, os.W_OK) or os.access(nearest, os.W_OK):
        return
    os.environ["NUMBA_CACHE_DIR"] = str(private_folder() / "numba")
