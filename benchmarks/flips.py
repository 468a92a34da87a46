"""Flips: random bits of stores and runs changed one at a time; how many are found.

    python -m benchmarks.flips STORE|RUN ... [--flips 200] [--seed 0]

Of a store `factory verify` must find each flip; of a run, loading its networks and figures
(`learn evaluate` and `learn compare` do that first), and `factory verify` in every file where the
run has a list of checksums. Bits are drawn over the bytes of all files together, and as many again
with each file equally likely, so that small files count. Printed are the counts by kind of file.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from shutil import copytree

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from factory.store_check import check_files
from learn.run import DESCRIPTION, open_run
from twin.cli.text_table import format_table
from twin.errors import InputError
from twin.records.storage.checksums import LIST, has_checksums

LOADED = (".json", ".safetensors")
"""Endings of what a run's networks are loaded from; its figures and pages are not."""
OTHERS = ("paper-test.json", "ablation.json", LIST)
"""Files of a run that neither its networks nor its figures are read from"""


def flipped(files: Sequence[Path], flips: int, random_: random.Random) -> list[tuple[Path, int]]:
    """File and bit of each flip."""
    sizes = [path.stat().st_size for path in files]
    by_size = random_.choices(files, sizes, k=flips)
    by_file = random_.choices([f for f, size in zip(files, sizes, strict=True) if size], k=flips)
    return [(path, random_.randrange(8 * path.stat().st_size)) for path in (*by_size, *by_file)]


def kind(path: Path, root: Path) -> str:
    """What a file is for, in a table."""
    name = path.relative_to(root).as_posix()
    if name.startswith("checksums"):
        return "list of checksums"
    if path.name == "zarr.json":
        return "metadata of the store" if name == path.name else "metadata of an array"
    return "values" if "/c" in name else path.suffix


def count(
    root: Path, files: Sequence[Path], found: Callable[[Path], bool], flips: int, seed: int
) -> list[dict[str, object]]:
    """Flip bits one at a time; rows of a table, by kind of file."""
    done: Counter[str] = Counter()
    seen: Counter[str] = Counter()
    for path, bit in flipped(files, flips, random.Random(seed)):
        whole = path.read_bytes()
        place = bit // 8
        changed = bytes([whole[place] ^ (1 << bit % 8)])
        path.write_bytes(whole[:place] + changed + whole[place + 1 :])
        done[kind(path, root)] += 1
        if found(path):
            seen[kind(path, root)] += 1
        path.write_bytes(whole)
    assert not found(root), "what was put back is not sound"
    rows: list[dict[str, object]] = [
        {"file": name, "flipped": done[name], "found": seen[name]} for name in sorted(done)
    ]
    return [*rows, {"file": "all", "flipped": done.total(), "found": seen.total()}]


def verified(store: Path) -> Callable[[Path], bool]:
    """Whether the checksums of `factory verify` find damage, and name that file."""

    def found(path: Path) -> bool:
        problems = check_files(store).problems
        name = path.relative_to(store).as_posix()
        return bool(problems) and any(problem.startswith(f"{name} is ") for problem in problems)

    return found


def loaded(run: Path) -> Callable[[Path], bool]:
    """Whether loading a run's networks and figures raises an error of one line that names the
    file."""

    def found(path: Path) -> bool:
        try:
            opened = open_run(run)
            opened.networks()
            _ = opened.figures
        except InputError as error:
            return "\n" not in str(error) and path.stem in str(error)
        return False

    return found


def main() -> int:
    """Print the counts; exit code 1 when a flip was not found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="+", type=Path, metavar="STORE|RUN")
    parser.add_argument("--flips", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    missed = 0
    for path in options.paths:
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / path.name
            copytree(path, copy)
            files = sorted(file for file in copy.rglob("*") if file.is_file())
            if (copy / DESCRIPTION).is_file():
                read = [f for f in files if f.suffix in LOADED and f.name not in OTHERS]
                read = [f for f in read if f.parent == copy]
                judges = {"by loading": (read, loaded(copy))}
            else:
                judges = {}
            if not judges or has_checksums(copy):
                judges["by `factory verify`"] = (files, verified(copy))
            for name, (some, judge) in judges.items():
                rows = count(copy, some, judge, options.flips, options.seed)
                print(f"{path}, {name}\n{format_table(rows)}\n")
                missed += int(rows[-1]["flipped"]) - int(rows[-1]["found"])  # type: ignore[call-overload]
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
