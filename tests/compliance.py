"""The IOOS compliance checker, asked in the same way by every test of an exported file."""

from __future__ import annotations

import functools
import importlib.util
import json
from collections.abc import Sequence
from pathlib import Path

import pytest

needs_checker = pytest.mark.skipif(
    importlib.util.find_spec("compliance_checker") is None,
    reason="compliance-checker is not installed (extra `test`)",
)
DEMANDS = ("high_priorities", "medium_priorities", "low_priorities")


def run_checks(
    path: Path,
    checks: Sequence[str],
    report: Path,
    monkeypatch: pytest.MonkeyPatch,
    report_format: str = "text",
) -> tuple[bool, bool]:
    """Whether a file passes, and whether the checker itself failed; writes its report."""
    from compliance_checker.cf import util
    from compliance_checker.runner import CheckSuite, ComplianceChecker

    # the checker asks the same of the same file thousands of times: half a minute without a memory
    for name in (
        "get_auxiliary_coordinate_variables", "get_axis_variables", "get_geophysical_variables",
        "get_time_variable", "get_time_variables", "get_z_variable", "get_z_variables",
        "get_latitude_variables", "get_longitude_variables", "get_axis_map",
        "get_climatology_variable", "coordinate_dimension_matrix", "guess_feature_type",
    ):  # fmt: skip
        monkeypatch.setattr(util, name, functools.cache(getattr(util, name)))
    CheckSuite.load_all_available_checkers()
    passed, errors = ComplianceChecker.run_checker(
        str(path), list(checks), verbose=0, criteria="strict",
        output_filename=str(report), output_format=report_format,
    )  # fmt: skip
    return passed, errors


def complaints(
    path: Path, checks: Sequence[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> dict[str, dict[str, list[str]]]:
    """What each check says against a file, by how much it matters."""
    report = folder / "report.json"
    run_checks(path, checks, report, monkeypatch, "json")
    found = json.loads(report.read_text())
    return {
        check: {
            demand: [message for part in found[check][demand] for message in part["msgs"]]
            for demand in DEMANDS
        }
        for check in checks
    }
