"""Runs the commands that a Markdown page shows beside its pictures.

A fenced block whose info string is `sh gallery` is both what the reader sees and what runs here,
line by line in a shell at the top of the repository, so a picture and its command cannot part.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"^```sh gallery\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def commands(page: str) -> list[str]:
    """The shell blocks of a page's text that make pictures, in order."""
    return [block.strip() for block in BLOCK.findall(page)]


def main(pages: list[str]) -> int:
    """Run the blocks of the pages; the first failure ends it with that exit code."""
    blocks = [block for page in pages for block in commands((ROOT / page).read_text())]
    if not blocks:
        print(f"gallery: no block marked `sh gallery` in {', '.join(pages)}", file=sys.stderr)
        return 1
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for block in blocks:
        print(f"$ {block}", flush=True)
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block], cwd=ROOT, env={**os.environ, "PATH": path}
        )
        if done.returncode:
            return done.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
