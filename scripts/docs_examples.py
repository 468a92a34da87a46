"""Pages on the examples: the site's page with pictures and code, and examples/README.md.

`python scripts/docs_examples.py --write` writes the README; without it the README is compared.
`--time` runs every example twice and prints the processor time of the second run.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import tempfile
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"

SECONDS = {
    "compare_vehicles": 1.3,
    "current_from_a_log": 6.3,
    "depth_policy": 8.5,
    "energy_by_pitch": 7.3,
    "fleet_with_spread": 2.9,
    "forecast_of_surfacings": 6.4,
    "glider_in_an_eddy": 6.2,
    "mission_in_a_current": 3.2,
    "own_current": 1.5,
    "python_controller": 1.7,
    "store_with_xarray": 4.2,
    "thousand_in_a_batch": 6.7,
    "train_and_dead_reckon": 19.1,
    "virtual_mooring": 3.3,
    "train_depth_policy": 145.0,
}
"""[s] Processor time of each example's second run, by `python scripts/docs_examples.py --time`"""

INTRODUCTION = """\
# Examples

Short programs, each with a picture and a few printed lines. They stand in `examples/` of the
checkout and write into the folder where they run: `python examples/compare_vehicles.py`.

Times are processor times (two cores, no GPU). The very first run compiles the physics, about half
a minute more.
"""

OWN = """\
## Types of your own

One file each: [types of your own](howto/extending.md) has their commands.
"""

README = """\
# Examples

Short programs, each with a picture and a few printed lines:

    python examples/compare_vehicles.py

They write into the folder where they run. Times are processor times (two cores, no GPU); the very
first run compiles the physics, about half a minute more. `make gallery` makes all pictures again
but the last, which trains for minutes. `make docs` shows the code beside them. The
[tutorials](../docs/tutorials/index.md) go further; `own_types/` has a file of each
[type of your own](../docs/howto/extending.md).

| | | |
|---|---|---|
"""


def examples() -> list[Path]:
    """List the examples: short ones by name, then those that take minutes."""
    return [*sorted(EXAMPLES.glob("*.py")), *sorted((EXAMPLES / "training").glob("*.py"))]


def duration(path: Path) -> str:
    """Processor time of an example as text."""
    seconds = SECONDS[path.stem]
    return f"{seconds:.0f} s" if seconds < 60.0 else f"{seconds / 60.0:.0f} min"


def examples_page() -> str:
    """Make the site's page in Markdown."""
    cards = "\n".join(_card(path) for path in examples())
    grid = f'<div class="grid cards" markdown>\n\n{cards}\n</div>\n'
    own = [_file(path) for path in sorted((EXAMPLES / "own_types").iterdir()) if path.is_file()]
    return "\n".join([INTRODUCTION, grid, *(_section(path) for path in examples()), OWN, *own])


def readme() -> str:
    """Make examples/README.md in Markdown, with three pictures in a row."""
    cells = [
        f"[![{title(path)}](../docs/gallery/examples/{path.stem}.png)]({place(path)})"
        f"<br>[{title(path)}]({place(path)}), {duration(path)}"
        for path in examples()
    ]
    rows = [cells[k : k + 3] for k in range(0, len(cells), 3)]
    rows[-1] += [""] * (3 - len(rows[-1]))
    return README + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def place(path: Path) -> str:
    """Path of an example, relative to the folder of all."""
    return path.relative_to(EXAMPLES).as_posix()


def title(path: Path) -> str:
    """Name of an example as words."""
    return path.stem.replace("_", " ").capitalize()


def parts(path: Path) -> tuple[str, str, str]:
    """First line of an example's docstring, its remaining lines, and the code below."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    first, _, rest = (ast.get_docstring(tree) or "").partition("\n")
    end = tree.body[0].end_lineno or 0
    return first, rest.strip(), "\n".join(text.splitlines()[end:]).strip()


def _card(path: Path) -> str:
    link = f"#{path.stem.replace('_', '-')}"
    return (
        f"-   [![{title(path)}](gallery/examples/{path.stem}.png)]({link})\n\n"
        f"    [{title(path)}]({link}), {duration(path)}: {parts(path)[0]}\n"
    )


def _section(path: Path) -> str:
    first, rest, code = parts(path)
    return (
        f"## {title(path)}\n\n{first} ({duration(path)})\n\n{rest}\n\n"
        f"![{title(path)}](gallery/examples/{path.stem}.png){{ width=560 }}\n\n"
        f'```python title="examples/{place(path)}"\n{code}\n```\n'
    )


def _file(path: Path) -> str:
    """Section of the site's page on a file of examples/own_types: its text."""
    text = path.read_text(encoding="utf-8").rstrip()
    language = {".py": "python", ".toml": "toml"}[path.suffix]
    return f'### {path.name}\n\n```{language} title="examples/{place(path)}"\n{text}\n```\n'


def measured(path: Path) -> float:
    """[s] Processor time of a second run, over all processes and threads."""
    import resource  # POSIX

    run = [sys.executable, str(path)]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(run, cwd=folder, check=True, capture_output=True)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(run, cwd=folder, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    page = EXAMPLES / "README.md"
    if "--time" in sys.argv[1:]:
        for example in examples():
            print(f'    "{example.stem}": {measured(example):.1f},', flush=True)
        sys.exit()
    if "--write" in sys.argv[1:]:
        page.write_text(readme(), encoding="utf-8")
    sys.exit(page.read_text(encoding="utf-8") != readme())
