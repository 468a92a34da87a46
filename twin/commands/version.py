"""`twin version`: what is installed, for bug reports."""

from __future__ import annotations

from dataclasses import dataclass

from twin.cli.console import Console, JsonOption

REPORTED = ("mujoco", "dm-control", "numba", "numpy", "scipy", "xarray", "zarr", "torch")
"""Distributions whose version can change a result."""


@dataclass(frozen=True, kw_only=True)
class Version(JsonOption):
    """Versions of this package, of Python and of the libraries that can change a result.

    Example:

        twin version --json
    """

    def run(self, console: Console) -> int:
        """Print the versions; a library that is not installed has none."""
        import platform
        from importlib import metadata

        from twin.version import __version__

        versions: dict[str, str | None] = {
            "glider-twin": __version__,
            "python": platform.python_version(),
        }
        for name in REPORTED:
            try:
                versions[name] = metadata.version(name)
            except metadata.PackageNotFoundError:
                versions[name] = None
        console.pairs(versions)
        console.answer(**versions)
        return 0
