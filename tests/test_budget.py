"""Budget: how much there is to read, room by room, and how much of it the two main jobs run.

Who needs more lines takes them from another row of the table, in the same commit, with the reason;
a row that has fewer is lowered to what it has. `python -m tests.test_budget` prints today's table.
"""

import ast
import json
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ("twin", "factory", "learn", "plugins")
OTHERS = ("tests", "benchmarks", "scripts")
TEXT = frozenset({".py", ".js", ".html", ".css", ".yaml", ".toml", ".csv"})
SLACK = 150
"""Lines that a room may have less than its row says before the row is lowered"""

ROOMS = {
    "benchmarks": (14469, 111326),
    "factory": (1550, 11678),
    "factory/commands": (1016, 5993),
    "factory/exporting": (2136, 12231),
    "factory/generation": (1831, 10529),
    "factory/importing": (14055, 102388),
    "factory/samples": (774, 5625),
    "factory/sampling": (2582, 14786),
    "learn": (1869, 10401),
    "learn/commands": (672, 3883),
    "learn/data": (1738, 10244),
    "learn/evaluation": (1422, 8955),
    "learn/networks": (2715, 16399),
    "learn/report": (1725, 11267),
    "learn/shipped": (129, 823),
    "learn/training": (2817, 17739),
    "plugins": (21928, 154944),
    "scripts": (2635, 18915),
    "tests": (69355, 608290),
    "twin": (2364, 12531),
    "twin/checks": (1318, 8696),
    "twin/cli": (1330, 8078),
    "twin/commands": (2228, 12737),
    "twin/compiled": (1267, 7267),
    "twin/control": (4424, 27165),
    "twin/faults": (1215, 6647),
    "twin/fossen": (2501, 18700),
    "twin/identify": (7901, 55637),
    "twin/logs": (3064, 21932),
    "twin/mission": (5059, 33574),
    "twin/navigation": (6884, 40641),
    "twin/physics": (5880, 40526),
    "twin/records": (5003, 29008),
    "twin/sensors": (3419, 22407),
    "twin/show": (10224, 63480),
    "twin/vehicle": (5239, 35654),
    "twin/water": (4907, 33103),
}
"""Of a room: most lines of all its text files, docstrings and blank lines included, and most Python
tokens, so that longer lines win nothing"""
MODULES = 564
LONGEST_FUNCTION, USUAL_FUNCTION = 187, 39
"""Lines of the longest function of the product, and of the 95th percentile"""
OWN_IMPORTS = 6.29
"""Distinct own modules that a file of the product imports, in the mean; where small modules were
joined, a file imports more and all files together less"""
RADIUS = {"factory generate": (87, 841), "learn fit": (206, 2203)}
"""Files and functions of the product that a job runs"""
VARIES = 1.03
"""What is compiled, and what a processor can, changes which functions run"""


def texts(package: str) -> Iterator[Path]:
    """The text files of a package; tests of plugins count as tests."""
    places = [ROOT / package, *((ROOT / "plugins").glob("*/tests") if package == "tests" else ())]
    for place in places:
        for path in sorted(place.rglob("*")):
            inside = path.relative_to(ROOT).parts
            built = {"__pycache__", "build", "dist"} & set(inside) or "egg-info" in str(path)
            if package == "plugins" and "tests" in inside[:3]:
                continue
            if path.suffix in TEXT and path.is_file() and not built:
                yield path


def room_of(path: Path) -> str:
    """The folder of a package that a file lies in, or the package."""
    parts = path.relative_to(ROOT).parts
    if parts[0] == "plugins":
        return "tests" if "tests" in parts[:3] else "plugins"
    return parts[0] if len(parts) == 2 or parts[0] in OTHERS else f"{parts[0]}/{parts[1]}"


def tokens_of(path: Path) -> int:
    """Tokens of a Python file, without comments, docstrings' lines, line ends and indents."""
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    with path.open("rb") as file:
        return sum(one.type not in skipped for one in tokenize.tokenize(file.readline))


@cache
def counted() -> tuple[dict[str, int], dict[str, int]]:
    """Lines and tokens by room."""
    lines, tokens = Counter[str](), Counter[str]()
    for package in (*PRODUCT, *OTHERS):
        for path in texts(package):
            lines[room_of(path)] += len(path.read_text("utf-8").splitlines())
            if path.suffix == ".py":
                tokens[room_of(path)] += tokens_of(path)
    return dict(lines), dict(tokens)


def modules() -> list[Path]:
    """The Python files of the product."""
    return [path for name in PRODUCT for path in texts(name) if path.suffix == ".py"]


@cache
def functions() -> tuple[int, int, float]:
    """Lines of the longest function and of the 95th percentile; own modules that a file imports."""
    sizes, imports = [], []
    for path in modules():
        tree = ast.parse(path.read_text("utf-8"))
        own = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno:
                sizes.append(node.end_lineno - node.lineno + 1)
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PRODUCT):
                own.add(node.module)
            elif isinstance(node, ast.Import):
                own |= {one.name for one in node.names if one.name.startswith(PRODUCT)}
        imports.append(len(own))
    sizes.sort()
    return sizes[-1], sizes[int(0.95 * len(sizes))], round(sum(imports) / len(imports), 2)


JOBS = {
    "factory generate": "factory generate --hours 0.3 --workers 1 --out flown.zarr",
    "learn fit": "learn fit flown.zarr --epochs 1 --members 1 --name net",
}
WATCHED = """
import json, sys, threading
root, packages, out = sys.argv[1], tuple(sys.argv[2].split(",")), sys.argv[3]
seen = set()
def watch(frame, event, _):
    code = frame.f_code
    if event == "call" and code.co_filename.startswith(packages):
        seen.add((code.co_filename, code.co_qualname, code.co_firstlineno))
sys.argv = sys.argv[4:]
threading.settrace(watch)  # called at each call alone, since it returns nothing
sys.settrace(watch)
try:
    import runpy
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
except SystemExit as end:
    assert not end.code, end.code
finally:
    sys.settrace(None)
    run = [one for one in seen if not one[1].startswith("<module>")]
    json.dump([len({one[0] for one in run}), len(run)], open(out, "w"))
"""


def radius(arguments: list[str], folder: Path) -> tuple[int, int]:
    """Files and functions of the product that a command runs, in a process of its own."""
    packages = ",".join(f"{ROOT / name}/" for name in PRODUCT)
    out = folder / "radius.json"
    command = [sys.executable, "-c", WATCHED, str(ROOT), packages, str(out), *arguments]
    subprocess.run(command, check=True, cwd=folder, capture_output=True, text=True)
    files, functions = json.loads(out.read_text())
    return files, functions


def measured(folder: Path) -> dict[str, tuple[int, int]]:
    """Radius of both main jobs, the second on what the first made."""
    return {job: radius(command.split(), folder) for job, command in JOBS.items()}


@pytest.mark.parametrize("room", sorted({*ROOMS, *counted()[0]}))
def test_no_room_grows(room: str) -> None:
    most, most_tokens = ROOMS.get(room, (0, 0))
    lines, tokens = (found.get(room, 0) for found in counted())
    assert lines <= most, f"{room} has {lines} lines: take them from another row of the table"
    assert tokens <= most_tokens, f"{room} has {tokens} tokens"
    assert lines > most - SLACK, f"{room} has {lines} lines: lower its row"


def test_no_function_grows_and_no_module_is_added() -> None:
    longest, usual, imports = functions()
    assert longest <= LONGEST_FUNCTION
    assert usual <= USUAL_FUNCTION
    assert imports <= OWN_IMPORTS
    assert len(modules()) <= MODULES


def test_the_main_jobs_run_no_more_of_it(tmp_path: Path) -> None:
    for job, (files, run) in measured(tmp_path).items():
        most_files, most = (VARIES * number for number in RADIUS[job])
        assert files <= most_files, f"{job} runs {files} files"
        assert run <= most, f"{job} runs {run} functions"


if __name__ == "__main__":
    import tempfile

    lines, tokens = counted()
    for room, number in sorted(lines.items()):
        print(f'    "{room}": ({number}, {tokens.get(room, 0)}),')
    print("modules:", len(modules()))
    print("longest function, 95 %, own imports:", functions())
    with tempfile.TemporaryDirectory() as place:
        print("radius:", measured(Path(place)))
