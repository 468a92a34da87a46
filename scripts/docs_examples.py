"""The examples for readers: the site's page with pictures and code, and examples/README.md.

`python scripts/docs_examples.py --write` writes the README; without it the README is compared.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"

INTRODUCTION = """\
# Examples

Short programs, each ending in a picture and a few printed lines. They stand in `examples/` of the
checkout: `python examples/compare_vehicles.py`. What they write lies where they are run.
"""

README = """\
# Examples

Short programs, each ending in a picture and a few printed lines:

    python examples/compare_vehicles.py

They write into the folder where they are run. `make gallery` makes these pictures again; `make
docs` shows the code beside them. Longer walks are the [tutorials](../docs/tutorials/index.md).

| | | |
|---|---|---|
"""


def examples_page() -> str:
    """Markdown of the page."""
    paths = sorted(EXAMPLES.glob("*.py"))
    cards = "\n".join(_card(path) for path in paths)
    grid = f'<div class="grid cards" markdown>\n\n{cards}\n</div>\n'
    return "\n".join([INTRODUCTION, grid, *(_section(path) for path in paths)])


def readme() -> str:
    """Markdown of examples/README.md: three pictures in a row."""
    cells = [
        f"[![{title(path)}](../docs/gallery/examples/{path.stem}.png)]({path.name})"
        f"<br>[{title(path)}]({path.name}): {parts(path)[0]}"
        for path in sorted(EXAMPLES.glob("*.py"))
    ]
    rows = [cells[k : k + 3] for k in range(0, len(cells), 3)]
    rows[-1] += [""] * (3 - len(rows[-1]))
    return README + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def title(path: Path) -> str:
    """The name of an example in words."""
    return path.stem.replace("_", " ").capitalize()


def parts(path: Path) -> tuple[str, str, str]:
    """First line of an example's docstring, the rest of it, and the code below."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    first, _, rest = (ast.get_docstring(tree) or "").partition("\n")
    end = tree.body[0].end_lineno or 0
    return first, rest.strip(), "\n".join(text.splitlines()[end:]).strip()


def _card(path: Path) -> str:
    place = f"#{path.stem.replace('_', '-')}"
    return (
        f"-   [![{title(path)}](gallery/examples/{path.stem}.png)]({place})\n\n"
        f"    [{title(path)}]({place}): {parts(path)[0]}\n"
    )


def _section(path: Path) -> str:
    first, rest, code = parts(path)
    return (
        f"## {title(path)}\n\n{first}\n\n{rest}\n\n"
        f"![{title(path)}](gallery/examples/{path.stem}.png){{ width=560 }}\n\n"
        f'```python title="examples/{path.name}"\n{code}\n```\n'
    )


if __name__ == "__main__":
    place = EXAMPLES / "README.md"
    if "--write" in sys.argv[1:]:
        place.write_text(readme(), encoding="utf-8")
    sys.exit(place.read_text(encoding="utf-8") != readme())
