"""Basestation3: extension that adds a flight model's results to the netCDF files of dives.

A line in `.extensions` names this file. The basestation loads the file into its own interpreter,
which lacks glider-twin's packages. The file therefore imports only Python's standard library, and
runs the interpreter of the environment in which it is installed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

DIVE = re.compile(r"p\d{7}\.nc")
"""Pattern of the name of a dive's file"""
BEFORE = 20
"""Number of dives before the first new one that are read for their fixes"""
VEHICLE = "glider_twin.xml"
"""File in the mission's folder that `twin identify` wrote"""
PYTHON = "GLIDER_TWIN_PYTHON"
"""Environment variable with the interpreter of another environment"""


def load_additional_arguments() -> tuple[list[str], dict[str, str], dict[str, Any]]:
    """Arguments of the extension, which the basestation asks for: names of the basestation's
    options, groups, further options."""
    return ["mission_dir"], {}, {}


def main(
    *_: Any,
    base_opts: Any = None,
    dive_nc_file_names: list[Path] | None = None,
    nc_files_created: list[Path] | None = None,
    **_others: Any,
) -> int:
    """Add results to the dives' files just made, or to all if none was; returns 0, or 1 with the
    reason in the basestation's log. The basestation passes more arguments, which are ignored."""
    from BaseLog import log_error, log_info, log_warning  # the basestation's own

    mission = Path(base_opts.mission_dir) if base_opts is not None else Path.cwd()
    given = dive_nc_file_names or sorted(mission.glob("p*.nc"))
    dives = sorted({Path(one) for one in given if DIVE.fullmatch(Path(one).name)})
    new = [one for one in map(Path, nc_files_created or ()) if one in dives] or dives
    if not dives:
        log_info("glider-twin: no dive to add to")
        return 0
    read = dives[max(dives.index(min(new)) - BEFORE, 0) :]
    words = [interpreter(), "-P", "-m", "glider_twin_pipelines", *map(str, read), "--write"]
    words += map(str, new)
    if (mission / VEHICLE).is_file():
        words += ["--vehicle", str(mission / VEHICLE)]
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    except OSError as error:
        log_error(f"glider-twin: {words[0]} does not run: {error}; set {PYTHON}")
        return 1
    if done.returncode:
        log_error(f"glider-twin: {done.stderr.strip()}")
        return 1
    if done.stderr.strip():
        log_warning(f"glider-twin: {done.stderr.strip()}")
    log_info(f"glider-twin: {done.stdout.strip()}")
    return 0


def interpreter() -> str:
    """Path of the Python with glider-twin: from $GLIDER_TWIN_PYTHON, or this file's environment."""
    if os.environ.get(PYTHON):
        return os.environ[PYTHON]
    packages = Path(__file__).resolve().parent.parent  # resolves the mission folder's link
    if packages.name == "site-packages":  # ENVIRONMENT/lib/python3.x/site-packages
        return str(packages.parents[2] / "bin" / "python")
    return sys.executable
