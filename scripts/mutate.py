"""Mutation test: change the code at random places, and count the changes that no test notices.

    python scripts/mutate.py --seed 5 --count 100      # continues an interrupted run
    python scripts/mutate.py --seed 5 --list           # the changes; none is run
    python scripts/mutate.py --seed 5 --only twin/water

A place is a node of the syntax tree: a sign, an operator, a comparison, a constant, an index, or
the order of two arguments. Each change is made in a copy of the tree, where tests run until one
fails: the area's own tests in `tests/`, other tests that import its module, and tests that import a
module which imports it. A change also counts as noticed if its tests take far longer than without
it. Results are kept in `build/mutants/SEED.jsonl`. `EQUIVALENT` lists changes that no test can
notice, each judged by hand. The exit code is 1 if fewer than 80 % of the others are noticed.
"""

from __future__ import annotations

import argparse
import ast
import copy
import dataclasses
import itertools
import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("twin", "factory", "learn")
GOAL = 0.80
"""[1] Least fraction of changes that the tests must notice"""
LONGEST_S = 600.0
"""[s] Longest test run of one change; a longer run hangs, and counts as noticed"""
FRESH = {"PYTHONDONTWRITEBYTECODE": "1"}
"""Setting against cached bytecode: Python reuses it for a source of equal size and second"""
EQUIVALENT = {
    "learn/training/optimiser.py:167: True -> False": "every caller gives them by name",
}
"""Names of changes that no test can notice, with the reason"""
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.And: ast.Or, ast.Or: ast.And, ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE,
    ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
"""Operators and comparisons, with the replacement of each"""


@dataclasses.dataclass(frozen=True)
class Mutant:
    """Change of the code at one place."""

    file: str
    line: int
    first: int
    """Index of the character in the file at which the old text starts"""
    old: str
    new: str

    @property
    def name(self) -> str:
        """Description of the change in one line."""
        old, new = (" ".join(text.split())[:70] for text in (self.old, self.new))
        return f"{self.file}:{self.line}: {old} -> {new}"


def changed(node: ast.AST) -> ast.expr | None:
    """Replacement of a node; None for a node that cannot be changed."""
    new = copy.copy(node)
    match new:
        case ast.BinOp() | ast.BoolOp() if type(new.op) in SWAPPED:
            new.op = SWAPPED[type(new.op)]()
        case ast.Compare(ops=[first, *more]) if type(first) in SWAPPED:
            new.ops = [SWAPPED[type(first)](), *more]
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            return new.operand
        case ast.Constant(value=bool(value)):
            new.value = not value
        case ast.Constant(value=int(value)):
            new.value = value + 1
        case ast.Constant(value=float(value)):
            new.value = 1.1 * value if value else 1.0
        case ast.Call(args=[first, second, *_]) if not any(
            isinstance(one, ast.Starred) for one in (first, second)
        ):
            new.args = [second, first, *new.args[2:]]
        case _:
            return None
    return new


def places(*nodes: ast.AST) -> Iterator[ast.expr]:
    """Find all nodes below that can be changed, without annotations and error messages."""
    for node in nodes:
        if isinstance(node, ast.JoinedStr | ast.Raise | ast.arg):
            continue
        if isinstance(node, ast.AnnAssign):
            yield from places(*filter(None, [node.value]))
            continue
        if isinstance(node, ast.expr) and changed(node) is not None:
            yield node
        yield from places(*ast.iter_child_nodes(node))


def written(file: str, node: ast.expr) -> Mutant:
    """Make the change of one node of a file."""
    text = (ROOT / file).read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    before = len("".join(lines[: node.lineno - 1]))
    first = before + len(lines[node.lineno - 1].encode()[: node.col_offset].decode())
    old, new = ast.get_source_segment(text, node), changed(node)
    plain = isinstance(node, ast.Constant | ast.Call)
    return Mutant(
        file, node.lineno, first, old, ast.unparse(new) if plain else f"({ast.unparse(new)})"
    )


def drawn(seed: int, only: str) -> Iterator[Mutant]:
    """Sample changes in random order, each place with equal probability."""
    every: list[tuple[str, ast.expr]] = []
    for path in (path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))):
        file = path.relative_to(ROOT).as_posix()
        if only in file:
            tree = ast.parse(path.read_text(encoding="utf-8"))
            every += [(file, node) for node in places(tree)]
    random.Random(seed).shuffle(every)
    return (written(file, node) for file, node in every)


@cache
def imported_by() -> dict[str, set[str]]:
    """Modules that import each module of the packages."""
    found: dict[str, set[str]] = {}
    for path in (path for name in PACKAGES for path in (ROOT / name).rglob("*.py")):
        importer = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                found.setdefault(node.module, set()).add(importer)
    return found


def tests_of(file: str) -> tuple[list[str], list[str]]:
    """Test files of a source file's area, the nearest first; and those of its importers."""
    module = file.removesuffix(".py").replace("/", ".")
    place = ROOT / "tests" / Path(file).with_suffix("")
    while not place.is_dir() or not list(place.glob("test_*.py")):
        place = place.parent
    texts = {path: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")}
    named = [p for p, text in texts.items() if module in text or f"{Path(file).stem}" in p.stem]
    near = [path for path in texts if path.parent == place]
    chosen = dict.fromkeys(sorted(named, key=lambda p: (p.parent != place, p)) + sorted(near))
    users = imported_by().get(module, set())
    further = [p for p, text in texts.items() if p not in chosen and any(u in text for u in users)]
    area, beyond = (
        [p.relative_to(ROOT).as_posix() for p in ps] for ps in (chosen, sorted(further))
    )
    return area, beyond


def judge(mutant: Mutant, tree: Path) -> dict[str, object]:
    """Run the tests of a change in a copy of the tree, and undo the change."""
    source = tree / mutant.file
    whole = source.read_text(encoding="utf-8")
    end = mutant.first + len(mutant.old)
    source.write_text(whole[: mutant.first] + mutant.new + whole[end:], encoding="utf-8")
    area, further = tests_of(mutant.file)
    try:
        by = failure_of(area, tree, f"not through after {LONGEST_S:g} s") or (
            failure_of(further, tree, "") if further else ""
        )
    finally:
        source.write_text(whole, encoding="utf-8")
    return {"name": mutant.name, "noticed": bool(by), "by": by}


def failure_of(tests: Sequence[str], tree: Path, hangs: str) -> str:
    """First failure of test files; empty if all pass, `hangs` if they do not end."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            command, cwd=tree, capture_output=True, text=True, timeout=LONGEST_S, check=False,
            env=os.environ | FRESH,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return hangs
    last = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return "" if done.returncode == 0 else (last or [done.stdout[-200:]])[0][:200]


def main(given: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--only", default="", help="text that a file's path holds")
    parser.add_argument("--list", action="store_true", help="print the changes; run none")
    options = parser.parse_args(given)
    chosen = list(itertools.islice(drawn(options.seed, options.only), options.count))
    if options.list:
        print("\n".join(one.name for one in chosen))
        return 0
    kept = ROOT / "build" / "mutants" / f"{options.seed}.jsonl"
    kept.parent.mkdir(parents=True, exist_ok=True)
    lines = kept.read_text(encoding="utf-8").splitlines() if kept.exists() else []
    known = {one["name"]: one for one in map(json.loads, lines)}
    tree = kept.parent / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    skipped = shutil.ignore_patterns(".git", ".venv*", "build", "site", ".mypy_cache")
    shutil.copytree(ROOT, tree, ignore=skipped, symlinks=True)
    for number, one in enumerate(chosen, 1):
        if one.name in EQUIVALENT:
            print(f"{number:4d} equivalent {one.name}: {EQUIVALENT[one.name]}")
            continue
        if one.name not in known:
            known[one.name] = judge(one, tree)
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(known[one.name]) + "\n")
        said = "noticed" if known[one.name]["noticed"] else "UNNOTICED"
        print(f"{number:4d} {said} {one.name}", flush=True)
    ran = [known[one.name]["noticed"] for one in chosen if one.name in known]
    print(f"{sum(ran)} of {len(ran)} changes noticed ({sum(ran) / max(len(ran), 1):.0%})")
    return 0 if sum(ran) >= GOAL * len(ran) else 1


if __name__ == "__main__":
    sys.exit(main())
