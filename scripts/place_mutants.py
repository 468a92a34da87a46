"""Place mutants: draw statements all over the packages and change one thing in each.

    PYTHONPATH=scripts REACHED=FOLDER python -m pytest -p reached tests
    python scripts/place_mutants.py FOLDER --count 300 --seed 1 >> scripts/mutants.toml

The first line notes which lines each test runs (`scripts/reached.py`), the second draws `count` new
mutants: statements by chance in proportion over the packages' modules, and one operator of
`OPERATORS` by chance among those that fit. Each names the cheapest tests that run the changed line,
those of its own package first. The same tree, folder and seed give the same mutants.

Where things are drawn is left out: no promise hangs on a pixel (`PICTURES`, `DRAWN`).
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import json
import random
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mutate import PACKAGES, ROOT, TABLE, read_table

PICTURES = ("twin/show/figures", "twin/show/render", "twin/show/web", "learn/report")
DRAWN = ("figure.py", "figures.py", "page.py", "logs_page.py")
NUMBERED = ("twin/mission/mission_file.py",)
"""files that number columns, where any other number does as well"""
CHEAP_S, BUDGET_S, MOST_TESTS = 6.0, 12.0, 4
"""[s] a test file that is named whole; [s] all tests of one mutant together; how many are named"""
COMPILES = ("jit", "inline", "cfunc")
"""decorators of functions whose lines no test is seen to run"""

Span = tuple[int, int]
"""begin and end in a file's text [characters]"""


@dataclasses.dataclass(frozen=True)
class Site:
    """One possible change: where, by which operator, and to what."""

    file: str
    function: str
    """name of the function that it stands in; empty: at the top of the module or of a class"""
    names: tuple[str, ...]
    """what the statement defines at the top of a module or class"""
    lines: tuple[int, int]
    """first and last of the statement"""
    compiled: bool
    operator: str
    span: Span
    new: str
    """what replaces the span"""


class Source:
    """A file: its text, its tree, and where the tree's nodes stand in the text."""

    def __init__(self, path: Path) -> None:
        self.file, self.text = path.relative_to(ROOT).as_posix(), path.read_text()
        self.tree = ast.parse(self.text)
        self._begins = [0]
        for line in self.text.splitlines(keepends=True):
            self._begins.append(self._begins[-1] + len(line))

    def span(self, node: Any) -> Span:
        """Where a node stands."""

        def place(number: int, column: int) -> int:
            line = self.text[self._begins[number - 1] : self._begins[number]]
            return self._begins[number - 1] + len(line.encode()[:column].decode())

        end = place(node.end_lineno, node.end_col_offset)
        return place(node.lineno, node.col_offset), end

    def of(self, node: ast.expr) -> str:
        """A node's text, in parentheses where it needs them."""
        begin, end = self.span(node)
        text = self.text[begin:end]
        simple = ast.Name | ast.Constant | ast.Call | ast.Subscript | ast.Attribute
        return text if isinstance(node, simple) else f"({text})"

    def between(self, left: ast.AST, right: ast.AST) -> Span:
        """Where the operator between two nodes stands, with what is around it."""
        return self.span(left)[1], self.span(right)[0]


Made = tuple[Span, str] | None
"""what is replaced, and by what; None: the operator does not fit"""
Operator = Callable[[Any, Source], Made]

WORDS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.And: "and", ast.Or: "or",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
    ast.Is: "is", ast.IsNot: "is not", ast.In: "in", ast.NotIn: "not in",
}  # fmt: skip
PLUS_MINUS: dict[type, type] = {ast.Add: ast.Sub, ast.Sub: ast.Add}
TIMES_OVER: dict[type, type] = {ast.Mult: ast.Div, ast.Div: ast.Mult}
BOUNDS: dict[type, type] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
TURNED: dict[type, type] = {
    ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
FUNCTIONS = {
    "sin": "cos", "cos": "sin", "radians": "degrees", "degrees": "radians", "deg2rad": "rad2deg",
    "rad2deg": "deg2rad", "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum",
    "floor": "ceil", "ceil": "floor", "any": "all", "all": "any", "nanmin": "nanmax",
    "nanmax": "nanmin", "argmin": "argmax", "argmax": "argmin", "median": "max", "mean": "max",
    "nanmean": "nanmax", "nanmedian": "nanmax", "std": "var",
}  # fmt: skip


def _swapped(
    pairs: dict[type, type], op: Any, left: ast.AST, right: ast.AST, source: Source
) -> Made:
    if type(op) not in pairs:
        return None
    begin, end = source.between(left, right)
    gap = source.text[begin:end]
    return (begin, end), gap.replace(WORDS[type(op)], WORDS[pairs[type(op)]], 1)


def _is_arithmetic(*nodes: ast.AST) -> bool:
    """Whether + and - both fit: no texts, lists or sets."""
    other = (ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp, ast.Set, ast.Dict)
    return not any(
        isinstance(n, other) or (isinstance(n, ast.Constant) and isinstance(n.value, str))
        for node in nodes
        for n in ast.walk(node)
    )


def _binary(pairs: dict[type, type]) -> Operator:
    def change(node: Any, source: Source) -> Made:
        if isinstance(node, ast.BinOp) and _is_arithmetic(node):
            return _swapped(pairs, node.op, node.left, node.right, source)
        if isinstance(node, ast.AugAssign) and _is_arithmetic(node.value):
            return _swapped(pairs, node.op, node.target, node.value, source)
        return None

    return change


def _turned(node: Any, source: Source) -> Made:
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        return _swapped(TURNED, node.ops[0], node.left, node.comparators[0], source)
    return None


def _bound(node: Any, source: Source) -> Made:
    """< and <= of whole numbers; of two real ones no promise hangs on their being equal."""
    if not isinstance(node, ast.Compare) or len(node.ops) > 1:
        return None
    whole = any(
        (isinstance(n, ast.Constant) and type(n.value) is int)
        or (isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id == "len")
        or (isinstance(n, ast.Attribute) and n.attr in ("size", "shape"))
        for n in (node.left, node.comparators[0])
    )
    change = _swapped(BOUNDS, node.ops[0], node.left, node.comparators[0], source)
    return change if whole else None


def _and_or(node: Any, source: Source) -> Made:
    if not isinstance(node, ast.BoolOp):
        return None
    pairs: dict[type, type] = {ast.And: ast.Or, ast.Or: ast.And}
    return _swapped(pairs, node.op, *node.values[:2], source)


def _dropped_term(node: Any, source: Source) -> Made:
    if not isinstance(node, ast.BinOp) or not _is_arithmetic(node):
        return None
    if not isinstance(node.op, ast.Add | ast.Sub | ast.Mult) or isinstance(node.left, ast.Constant):
        return None
    return source.span(node), source.of(node.left)


def _unary(kind: type) -> Operator:
    def change(node: Any, source: Source) -> Made:
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, kind):
            return source.span(node), source.of(node.operand)
        return None

    return change


def _other_function(node: Any, source: Source) -> Made:
    if not isinstance(node, ast.Call):
        return None
    function = node.func
    if isinstance(function, ast.Name) and function.id in FUNCTIONS:
        return source.span(function), FUNCTIONS[function.id]
    if isinstance(function, ast.Attribute) and function.attr in FUNCTIONS:
        of = function.value
        if isinstance(of, ast.Name) and of.id in ("np", "math", "torch"):
            return source.span(function), f"{of.id}.{FUNCTIONS[function.attr]}"
    return None


def _other_index(node: Any, source: Source) -> Made:
    """x[1] of x[0], x[0] of x[1] and x[-1]; the last place of several."""
    if not isinstance(node, ast.Subscript):
        return None
    place = node.slice.elts[-1] if isinstance(node.slice, ast.Tuple) else node.slice
    if isinstance(place, ast.UnaryOp) and isinstance(place.operand, ast.Constant):
        return source.span(place), "0"
    if isinstance(place, ast.Constant) and type(place.value) is int:
        return source.span(place), str(1 if place.value == 0 else place.value - 1)
    return None


def _off_by_one(node: Any, source: Source) -> Made:
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return source.span(node), str(node.value + 1)
    return None


def _factor(node: Any, source: Source) -> Made:
    """Twice a constant; not of one that only keeps rounding away."""
    if isinstance(node, ast.Constant) and type(node.value) is float and abs(node.value) > 1e-6:
        return source.span(node), repr(float(f"{2.0 * node.value:.6g}"))
    return None


def _no_refusal(node: Any, source: Source) -> Made:
    if isinstance(node, ast.If) and isinstance(node.body[0], ast.Raise):
        return source.span(node.test), "False"
    return None


def _other_answer(node: Any, source: Source) -> Made:
    value = getattr(node, "value", None) if isinstance(node, ast.stmt) else None
    if isinstance(value, ast.Constant) and isinstance(value.value, bool):
        return source.span(value), str(not value.value)
    return None


OPERATORS: dict[str, Operator] = {
    "plus for minus": _binary(PLUS_MINUS),
    "times for over": _binary(TIMES_OVER),
    "dropped term": _dropped_term,
    "sign": _unary(ast.USub),
    "bound": _bound,
    "turned comparison": _turned,
    "and for or": _and_or,
    "not": _unary(ast.Not),
    "other function": _other_function,
    "other index": _other_index,
    "off by one": _off_by_one,
    "factor 2": _factor,
    "no refusal": _no_refusal,
    "other answer": _other_answer,
}


def sites(source: Source) -> Iterator[Site]:
    """Every change that the operators know of a file."""
    for statement, function, compiled in _statements(source.tree.body, "", False):
        own = list(_expressions(statement))
        last = max([statement.lineno, *(n.end_lineno or 0 for n in own)])
        for node in (statement, *own):
            for name, operator in OPERATORS.items():
                made = operator(node, source)
                if made is not None:
                    yield Site(
                        file=source.file, function=function, lines=(statement.lineno, last),
                        names=() if function else _defined(statement), compiled=compiled,
                        operator=name, span=made[0], new=made[1],
                    )  # fmt: skip


def texts(source: Source, site: Site) -> tuple[str, str] | None:
    """Old and new text: the changed line, with as many before it as make the old text unique.

    None where six lines do not, or where the change is none that Python can read.
    """
    text, (begin, end) = source.text, site.span
    changed = text[:begin] + site.new + text[end:]
    try:
        if ast.dump(ast.parse(changed)) == ast.dump(source.tree):
            return None
    except SyntaxError:
        return None
    first = text.rfind("\n", 0, begin) + 1
    last = text.find("\n", end)
    indent = len(text[first:]) - len(text[first:].lstrip(" "))
    for extra in (indent, 0, 0, 0, 0, 0):
        old = text[first + extra : last]
        if text.count(old) == 1:
            return old, text[first + extra : begin] + site.new + text[end:last]
        first = first if extra else text.rfind("\n", 0, max(first - 1, 0)) + 1
    return None


def _statements(
    body: list[ast.stmt], function: str, compiled: bool
) -> Iterator[tuple[ast.stmt, str, bool]]:
    """Statements with the function that they stand in, from top to bottom."""
    for statement in body:
        if isinstance(statement, ast.FunctionDef):
            its = compiled or any(
                isinstance(n, ast.Name) and n.id in COMPILES
                for decorator in statement.decorator_list
                for n in ast.walk(decorator)
            )
            yield from _statements(statement.body, function or statement.name, its)
            continue
        if isinstance(statement, ast.ClassDef):
            yield from _statements(statement.body, "", False)
            continue
        if isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.dump(statement.test):
            continue
        yield statement, function, compiled
        for name in ("body", "orelse", "finalbody"):
            yield from _statements(getattr(statement, name, []), function, compiled)
        for handler in getattr(statement, "handlers", []):
            yield from _statements(handler.body, function, compiled)


def _expressions(statement: ast.stmt) -> Iterator[ast.expr]:
    """The expressions of a statement: not of those in it, nor annotations, texts and messages."""
    if isinstance(statement, ast.Raise | ast.Import | ast.ImportFrom | ast.Assert):
        return
    ahead: list[ast.AST] = []
    for name, value in ast.iter_fields(statement):
        if name != "annotation":
            parts = value if isinstance(value, list) else [value]
            ahead += [part for part in parts if isinstance(part, ast.expr | ast.withitem)]
    while ahead:
        node = ahead.pop(0)
        if isinstance(node, ast.JoinedStr):
            continue
        if isinstance(node, ast.expr):
            yield node
        ahead += ast.iter_child_nodes(node)


def _defined(statement: ast.stmt) -> tuple[str, ...]:
    targets = getattr(statement, "targets", None) or [getattr(statement, "target", None)]
    return tuple(n.id for t in targets if t for n in ast.walk(t) if isinstance(n, ast.Name))


class Tests:
    """Which tests run which lines, from the folder of `scripts/reached.py`."""

    def __init__(self, folder: Path) -> None:
        self.seconds: dict[str, float] = {}
        """of each test, and of each file with all of its tests"""
        self._by_line: dict[tuple[str, int], set[str]] = defaultdict(set)
        self._lines: dict[str, int] = {}
        for path in sorted(folder.glob("*.json")):
            for test, what in json.loads(path.read_text()).items():
                file = test.partition("::")[0]
                self.seconds[test] = what["seconds"]
                self.seconds[file] = self.seconds.get(file, 0.0) + what["seconds"]
                self._lines[test] = sum(map(len, what["lines"].values()))
                for source, numbers in what["lines"].items():
                    for number in numbers:
                        self._by_line[source, number].add(test)

    def running(self, file: str, first: int, last: int) -> set[str]:
        """The tests that run one of these lines."""
        return {t for n in range(first, last + 1) for t in self._by_line.get((file, n), ())}

    def chosen(self, site: Site, tests: set[str]) -> list[str]:
        """The cheapest few that should notice: of the mirrored folder first, whole files if cheap.

        Among the tests of a long file those that run the fewest lines, for they are about these.
        """
        folder = "tests/" + "/".join(site.file.split("/")[:2])
        stem = Path(site.file).stem.rstrip("s")
        by_file: dict[str, list[str]] = defaultdict(list)
        for test in sorted(tests, key=lambda test: (self._lines[test], test)):
            by_file[test.partition("::")[0]].append(test)

        def rank(file: str) -> tuple[bool, bool, float, str]:
            its = sum(self._lines[test] for test in by_file[file]) / len(by_file[file])
            return not file.startswith(folder), stem not in file, its, file

        found: list[str] = []
        spent = 0.0
        for file in sorted(by_file, key=rank):
            options = [file] if self.seconds[file] <= CHEAP_S else by_file[file][:MOST_TESTS]
            for test in options:
                if not found or spent + self.seconds[test] <= BUDGET_S:
                    found.append(test)
                    spent += self.seconds[test]
            if len(found) >= MOST_TESTS:
                break
        return found


class Uses:
    """Where names are used: what is compiled, or read once at import, is known by its users."""

    def __init__(self, sources: list[Source]) -> None:
        self._uses: dict[str, list[tuple[str, int, int, str, tuple[str, ...], bool]]] = defaultdict(
            list
        )
        self._imports: dict[str, set[str]] = {}
        for source in sources:
            file, module = source.file, source.tree
            self._imports[file] = {file} | {
                name.replace(".", "/") + ".py"
                for node in ast.walk(module)
                if isinstance(node, ast.ImportFrom) and node.module
                for name in (node.module, *(f"{node.module}.{a.name}" for a in node.names))
            }
            for statement, function, compiled in _statements(module.body, "", False):
                own = list(_expressions(statement))
                last = max([statement.lineno, *(n.end_lineno or 0 for n in own)])
                where = (file, statement.lineno, last, function, _defined(statement), compiled)
                for node in own:
                    name = getattr(node, "id", None) or getattr(node, "attr", None)
                    if name and isinstance(node.ctx, ast.Load):  # type: ignore[attr-defined]
                        self._uses[name].append(where)

    def tests(self, site: Site, tests: Tests) -> set[str]:
        """The tests that run the site, or else what uses it, or what uses that."""
        found = set() if site.compiled else tests.running(site.file, *site.lines)
        names = {site.function} if site.function else set(site.names)
        ahead, seen = [(site.file, name) for name in names], set[tuple[str, str]]()
        for _ in range(6):
            if found:
                return found
            users: list[tuple[str, str]] = []
            for file, name in ahead:
                for user, first, last, function, defined, compiled in self._uses[name]:
                    if file in self._imports[user] or (user, function) in seen:
                        if not compiled:
                            found |= tests.running(user, first, last)
                        users += [(user, name) for name in ([function] if function else defined)]
            ahead = [user for user in users if user not in seen]
            seen |= set(ahead)
        return found


def place(count: int, seed: int, folder: Path) -> Iterator[dict[str, Any]]:
    """Entries of new mutants for the table."""
    paths = sorted(p for package in PACKAGES for p in (ROOT / package).rglob("*.py"))
    sources = {source.file: source for source in map(Source, paths)}
    tests, uses = Tests(folder), Uses(list(sources.values()))
    taken = {(mutant.file, mutant.old) for mutant in read_table(TABLE)}
    statements: dict[tuple[str, int], list[Site]] = defaultdict(list)
    for file, source in sources.items():
        if not file.startswith((*PICTURES, *NUMBERED)) and not file.endswith(DRAWN):
            for site in sites(source):
                statements[file, site.lines[0]].append(site)
    rng = random.Random(seed)
    keys = sorted(statements)
    rng.shuffle(keys)
    for key in keys:
        operators = sorted({site.operator for site in statements[key]})
        operator = rng.choice(operators)
        site = rng.choice([site for site in statements[key] if site.operator == operator])
        found = texts(sources[site.file], site)
        if count == 0 or found is None or (site.file, found[0]) in taken:
            continue
        count -= 1
        yield {
            "file": site.file, "old": found[0], "new": found[1], "placed": operator,
            "tests": tests.chosen(site, uses.tests(site, tests)),
        }  # fmt: skip


def main() -> int:
    """Print new mutants as entries of the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("reached", type=Path, help="folder that scripts/reached.py wrote")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for mutant in place(options.count, options.seed, options.reached):
        print("\n" + entry(mutant), end="")
    return 0


def entry(mutant: dict[str, Any]) -> str:
    """A mutant as the table has it."""

    def quoted(text: str) -> str:
        if "\n" in text and "'''" not in text:
            return f"'''\n{text}'''"
        return json.dumps(text, ensure_ascii=False) if "'" in text else f"'{text}'"

    lines = ["[[mutant]]"]
    for name, value in mutant.items():
        if name == "tests":
            value = json.dumps(list(value))
        else:
            value = "true" if value is True else quoted(value)
        lines.append(f"{name} = {value}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
