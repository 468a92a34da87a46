"""Methods are compared on equal samples, with intervals over dives; the factory's model too."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from logs import SHARED

from benchmarks.real_logs.fixes import factory_sink
from benchmarks.real_logs.row import (
    LEAST_DIVES,
    Method,
    Row,
    best,
    common,
    median_interval,
    median_rows,
    rmse_interval,
    rmse_rows,
    table,
)
from benchmarks.real_logs.source import Deployment, imported, logs_folder

RNG = np.random.default_rng(3)


def method(name: str, errors: dict[int, np.ndarray], kind: str = "twin") -> Method:
    return Method(name=name, kind=kind, note="", errors=errors)  # type: ignore[arg-type]


def test_every_method_is_scored_where_all_of_them_say_something() -> None:
    """What one method lacks is taken from all, also a whole dive."""
    one = {0: np.array([1.0, np.nan, 2.0]), 1: np.array([1.0, 1.0]), 2: np.array([np.nan])}
    other = {0: np.array([3.0, 9.0, np.nan]), 1: np.array([3.0, 3.0]), 3: np.array([9.0])}
    first, second = common([method("one", one), method("other", other)])
    assert set(first.errors) == set(second.errors) == {0, 1}
    np.testing.assert_array_equal(first.errors[0], [1.0])
    np.testing.assert_array_equal(second.errors[0], [3.0])
    rows = rmse_rows("task", "data", [method("one", one), method("other", other)])
    assert [(row.value, row.samples, row.dives) for row in rows] == [(1.0, 3, 2), (3.0, 3, 2)]


def test_medians_are_over_the_dives_that_all_methods_have() -> None:
    full = {k: np.array([float(k)]) for k in range(9)}
    gap = full | {8: np.array([np.nan])}
    rows = median_rows("task", "data", "m h-1", [method("full", full), method("gap", gap)])
    assert [row.value for row in rows] == [3.5, 3.5]
    assert rows[0].samples == 8
    assert rows[0].low < 3.5 < rows[0].high


def test_the_interval_is_that_of_dives_and_not_of_samples() -> None:
    """Dives that differ as a whole: a thousand samples of each make it no narrower."""
    levels = RNG.uniform(0.5, 1.5, 12)
    few = rmse_interval([np.full(10, level) for level in levels])
    many = rmse_interval([np.full(1000, level) for level in levels])
    assert few == pytest.approx(many)
    spread = np.std(levels**2) / np.sqrt(12) / (2.0 * np.sqrt(np.mean(levels**2)))
    assert many[1] - many[0] == pytest.approx(2 * 1.96 * spread, rel=0.25)
    assert many == rmse_interval([np.full(1000, level) for level in levels])


def test_intervals_hold_what_they_promise() -> None:
    """Of 200 studies with 20 dives about 95 % hold the truth."""
    held = 0
    for _ in range(200):
        low, high = median_interval(RNG.exponential(size=20))
        held += low <= math.log(2.0) <= high
    assert 0.88 <= held / 200 <= 1.0


def test_too_few_dives_have_no_interval() -> None:
    assert all(map(math.isnan, rmse_interval([np.ones(9)] * (LEAST_DIVES - 1))))
    assert all(map(math.isnan, median_interval(np.ones(LEAST_DIVES - 1))))


def test_the_best_is_marked_among_equal_samples_only() -> None:
    def row(name: str, value: float, samples: int, kind: str = "twin") -> Row:
        return Row(
            task="t",
            data="d",
            method=name,
            kind=kind,
            value=value,
            samples=samples,  # type: ignore[arg-type]
        )

    rows = [
        row("ours", 0.02, 100),
        row("theirs", 0.01, 100, "public method"),
        row("on fewer", 0.001, 50),
        row("printed elsewhere", 0.0001, 100, "published"),
    ]
    assert [one.method for one in best(rows)] == ["theirs"]
    assert [line["best"] for line in table(rows)] == ["", "*", "", ""]


def test_logs_in_a_folder_raw_are_found(tmp_path: Path) -> None:
    folder = tmp_path / "slocum_deep_2022"
    (folder / "raw").mkdir(parents=True)
    assert logs_folder(folder) == folder / "raw"
    (folder / "flight.csv").write_text("time\n")
    assert logs_folder(folder) == folder


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"no public logs at {SHARED}")
def test_the_factory_s_speeds_are_those_of_its_files(tmp_path: Path) -> None:
    """SG171's, of a table, against the depth rate: sinking is positive, and off by a few cm/s."""
    folder = SHARED / "seaglider_apl_ad2cp"
    if not folder.is_dir():
        pytest.skip("the Seagliders' logs are absent")
    pytest.importorskip("pyarrow")
    deployments: list[Deployment] = imported(folder, "seaglider", tmp_path)
    deployment = next(one for one in deployments if one.name == "SG171")
    log = deployment.logs()[0]
    sink = factory_sink(deployment, log)
    assert sink is not None
    known = np.isfinite(sink) & log.use
    assert known.mean() > 0.8
    error = sink[known] - log.depth_rate[known]
    assert np.sqrt(np.mean(error**2)) < 0.04
    assert np.corrcoef(sink[known], log.depth_rate[known])[0, 1] > 0.97
