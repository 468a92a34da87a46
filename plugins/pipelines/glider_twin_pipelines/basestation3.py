"""Extension of basestation3: adds what a flight model says to the netCDF files of its dives.

A line in `.extensions` names this file. The basestation loads it into its own interpreter, whose
packages glider-twin does not share: so this file needs Python's library alone, and the work is done
by the interpreter of the environment that this file is installed in.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

DIVE = re.compile(r"p\d{7}\.nc")
"""Name of a dive's file"""
BEFORE = 20
"""Dives before the first new one that are read for their fixes"""
VEHICLE = "glider_twin.xml"
"""In the mission's folder: what `twin identify` wrote"""
PYTHON = "GLIDER_TWIN_PYTHON"
"""Environment variable: the interpreter of another environment"""


def load_additional_arguments() -> tuple[list[str], dict[str, str], dict[str, Any]]:
    """What the basestation asks of each extension: options of its own that it needs, groups, and
    further options."""
    return ["mission_dir"], {}, {}


def main(
    *_: Any,
    base_opts: Any = None,
    dive_nc_file_names: list[Path] | None = None,
    nc_files_created: list[Path] | None = None,
    **_others: Any,
) -> int:
    """Add to the dives that were just made, or to all where none was; 0, or 1 with the reason in
    the basestation's log. Extensions are given more arguments, by their names."""
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
    """Path of the Python that has glider-twin: of the environment around this file."""
    if os.environ.get(PYTHON):
        return os.environ[PYTHON]
    packages = Path(__file__).resolve().parent.parent  # the mission has a link to it
    if packages.name == "site-packages":  # ENVIRONMENT/lib/python3.x/site-packages
        return str(packages.parents[2] / "bin" / "python")
    return sys.executable
