"""The figures of docs/results/real_logs.md are those that the benchmark measured and stored."""

from __future__ import annotations

import pytest
from examples import ROOT, needs_docs

pytestmark = needs_docs


def test_every_table_stands_on_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """`python -m benchmarks.real_logs FOLDER --keep` wrote what the page shows."""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks.real_logs.row import NOT_COMPARED, kept, markdown

    rows = kept()
    tasks = dict.fromkeys(row.task for row in rows if row.kind not in NOT_COMPARED)
    assert len(tasks) >= 6
    page = (ROOT / "docs" / "results" / "real_logs.md").read_text(encoding="utf-8")
    missing = [task for task in tasks if markdown(rows, task) not in page]
    assert not missing, (
        f"docs/results/real_logs.md differs from benchmarks/real_logs/measured.json: {missing}"
    )
