"""Durations of slow test files, written to tests/slow.json.

    python -m pytest --junitxml report.xml
    python scripts/durations.py report.xml

`make quick` leaves these files out; the whole suite begins with the longest of them.
"""

from __future__ import annotations

import json
import sys
import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SLOW = ROOT / "tests" / "slow.json"
FROM_S = 2.0
"""[s] Total time of a file's tests from which the file is slow"""


def seconds(report: Path) -> dict[str, float]:
    """Seconds of each test file in a report, the longest first.

    Raises:
      ValueError: a test of the report is in no file of this tree.
    """
    found: dict[str, float] = defaultdict(float)
    for case in ElementTree.parse(report).iter("testcase"):
        parts = str(case.get("classname")).split(".")
        while parts and not (ROOT / "/".join(parts)).with_suffix(".py").is_file():
            parts.pop()  # a class name
        if not parts:
            raise ValueError(f"{case.get('classname')} is in no file: run the suite of this tree")
        found["/".join(parts) + ".py"] += float(case.get("time", 0.0))
    return dict(sorted(found.items(), key=lambda item: -item[1]))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    slow = {name: round(s, 1) for name, s in seconds(Path(sys.argv[1])).items() if s >= FROM_S}
    SLOW.write_text(json.dumps(slow, indent=1) + "\n")
