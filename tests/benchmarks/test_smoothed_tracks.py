"""The smoother beside the linear correction on simulated missions with all their errors."""

from __future__ import annotations

import pytest

import factory
from benchmarks.smoothed_tracks import figures


def test_under_water_it_errs_by_at_most_0_6_of_the_linear_correction(tmp_path) -> None:
    path = tmp_path / "field.zarr"
    factory.generate(path, preset="field", hours=10.0, seed=7200)
    found = figures(path)
    assert found["smoother_by_linear"] <= 0.6
    assert found["smoother_normalised"] == pytest.approx(1.0, abs=0.25)
