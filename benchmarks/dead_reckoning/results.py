"""Results: one file of figures for each method, and the page with their tables.

python -m benchmarks.dead_reckoning --tier family --methods ema --keep --who "the authors"
python -m benchmarks.dead_reckoning.results              # writes the tables into the page
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks import command
from benchmarks.dead_reckoning.predictions import ALL_DIVES
from twin.errors import InputError

FOLDER = Path(__file__).with_name("methods")
PAGE = Path(__file__).parents[2] / "docs" / "results" / "dead_reckoning.md"
TIERS = ("paper", "field", "family", "public")
PERCENT = "dead reckoning, %"
DEPLOYMENTS = ("sg171", "comet")
"""Deployments of tier public, each with its own figures"""
CODE = ("benchmarks/dead_reckoning", "benchmarks/real_logs", "factory", "learn", "twin", "assets")
"""Folders of code that figures depend on"""
USUAL = {"labels": "none", "dives": "0", "by": "the authors"}
"""Values that leave a column out of a table if all rows have them"""
MARK = "<!-- results: {} -->"
"""Mark before a tier's table on the page"""


def keep(
    folder: Path, method: str, tier: str, found: Mapping[str, Any], *, who: str, how: str, code: str
) -> Path:
    """Write a method's figures of a tier into its file; figures of other tiers stay.

    Args:
      who: owner of the method.
      how: the command.
      code: `commit` of the code that made them.

    Raises:
      InputError: the file has another owner.
    """
    path = folder / (re.sub(r"[^a-z0-9]+", "_", method.lower()) + ".json")
    kept = read(path) if path.exists() else {"method": method, "who": who, "tiers": {}}
    if kept["who"] != who:
        raise InputError(f"{path} is of {kept['who']}: give your method's file another name")
    kept["tiers"][tier] = {**found, "how": how, "commit": code}
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--keep {folder}: give a folder")
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    return path


def commit() -> str:
    """Commit of the code, with + if the code is changed; empty outside of git."""
    root = Path(__file__).parents[2]

    def git(*words: str) -> str:
        said = subprocess.run(
            ["git", *words], cwd=root, capture_output=True, text=True, check=False
        )
        return said.stdout.strip() if said.returncode == 0 else ""

    changed = git("status", "--porcelain", "--", *CODE, f":!{FOLDER.relative_to(root)}")
    return git("rev-parse", "--short=8", "HEAD") + "+" * bool(changed)


def read(path: Path) -> dict[str, Any]:
    """Read a file of results.

    Raises:
      InputError: `path` is no file of results.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        if not (isinstance(found["method"], str) and isinstance(found["who"], str)):
            raise TypeError("its method and who are no texts")
        for tier, figures in found["tiers"].items():
            if tier not in TIERS:
                raise KeyError(tier)
            rows({found["method"]: figures})
            str(figures["commit"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path} is no file of results ({error!r}): `--keep` of the benchmark writes one"
        ) from None
    return dict(found)


def rows(methods: Mapping[str, Any]) -> list[dict[str, str]]:
    """Rows of a table: each method without adaptation, and by number of dives adapted on."""
    return [
        {
            "method": name, "labels": found["labels"], "dives": dives,
            PERCENT: f"{one['dr_velocity_percent']:.3f}",
            "95 %": f"{one['low']:.3f} to {one['high']:.3f}",
            "seeds": f"{one['least']:.3f} to {one['most']:.3f}" if "least" in one else "",
            "surge MSE": f"{one['surge_mse']:.2e}",
            "worse": f"{one['worse']:.0f}" if dives != "0" else "",
            "within": f"{100.0 * one['within']:.0f} %" if "within" in one else "",
            **{f"{key}, %": f"{one[key]:.1f}" for key in DEPLOYMENTS if key in one},
        }
        for name, found in methods.items()
        for dives, one in {"0": found["dives"]["0"], **found["dives"]}.items()
        if dives == "0" or one != found["dives"]["0"]
    ]  # fmt: skip


def tables(folder: Path = FOLDER) -> dict[str, str]:
    """Tables in Markdown of the tiers that have figures: the best method is first; methods that
    have seen the scored dives are last."""
    kept = [read(path) for path in sorted(folder.glob("*.json"))]
    found = {}
    for tier in TIERS:
        own = sorted(
            ((one["tiers"][tier], one) for one in kept if tier in one["tiers"]),
            key=lambda pair: (
                pair[0]["labels"] == ALL_DIVES,
                pair[0]["dives"]["0"]["dr_velocity_percent"],
            ),
        )
        lines = []
        for figures, one in own:
            for row in rows({one["method"]: figures}):
                row[PERCENT] += f" ({row.pop('95 %')})"
                line = {f"{PERCENT} (95 %)" if k == PERCENT else k: v for k, v in row.items()}
                lines.append({**line, "by": one["who"]})
        if lines:
            used = [k for k in lines[0] if any(line[k] != USUAL.get(k, "") for line in lines)]
            cells = [[line[name].replace("|", "/") for name in used] for line in lines]
            found[tier] = command.markdown(used, cells)
    return found


def page(text: str, folder: Path = FOLDER) -> str:
    """Return the page with new tables."""
    for tier, table in tables(folder).items():
        head, found, rest = text.partition(MARK.format(tier))
        if not found:
            raise InputError(f"the page has no place for tier {tier}: {MARK.format(tier)}")
        rest = re.sub(r"\A\n*(?:\|.*\n)*\n*", "", rest)
        text = f"{head}{found}\n\n{table}\n\n{rest}"
    return text


def main(folder: command.Positional[Path] = FOLDER, *, print: bool = False) -> None:
    """Write the page.

    Args:
      folder: files of results.
      print: print the tables, write no page.
    """
    found = tables(folder)
    if not found:
        raise InputError(f"there are no files of results in {folder}")
    if print:
        sys.stdout.write("\n\n".join(f"{tier}\n\n{table}" for tier, table in found.items()) + "\n")
        return
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8"), folder), encoding="utf-8")
    sys.stdout.write(f"tables: {PAGE}\n")


if __name__ == "__main__":
    sys.exit(command.run(main))
