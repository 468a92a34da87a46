"""Methods are compared on equal samples, with intervals over dives; the factory's model too."""

import dataclasses
import math

import numpy as np
import pytest
from logs import SHARED

from benchmarks.real_logs import left_out
from benchmarks.real_logs.fixes import factory_sink
from benchmarks.real_logs.row import (
    LEAST_DIVES,
    Method,
    Row,
    best,
    common,
    median_interval,
    median_rows,
    pooled_draws,
    rmse,
    rmse_interval,
    rmse_rows,
    table,
)
from benchmarks.real_logs.source import imported, logs_folder
from benchmarks.real_logs.surge_networks import INPUTS, TUNED, fit_network
from factory.samples import Flight, write_csv
from factory.samples.gliders import write_slocum

RNG = np.random.default_rng(3)


def method(name, errors, kind="twin"):
    return Method(name=name, kind=kind, note="", errors=errors)


def test_every_method_is_scored_where_all_of_them_say_something():
    """What one method lacks is taken from all, also a whole dive."""
    one = {0: np.array([1.0, np.nan, 2.0]), 1: np.array([1.0, 1.0]), 2: np.array([np.nan])}
    other = {0: np.array([3.0, 9.0, np.nan]), 1: np.array([3.0, 3.0]), 3: np.array([9.0])}
    first, second = common([method("one", one), method("other", other)])
    assert set(first.errors) == set(second.errors) == {0, 1}
    np.testing.assert_array_equal(first.errors[0], [1.0])
    np.testing.assert_array_equal(second.errors[0], [3.0])
    rows = rmse_rows("task", "data", [method("one", one), method("other", other)])
    assert [(row.value, row.samples, row.dives) for row in rows] == [(1.0, 3, 2), (3.0, 3, 2)]


def test_medians_are_over_the_dives_that_all_methods_have():
    full = {k: np.array([float(k)]) for k in range(9)}
    gap = full | {8: np.array([np.nan])}
    rows = median_rows("task", "data", "m h-1", [method("full", full), method("gap", gap)])
    assert [row.value for row in rows] == [3.5, 3.5]
    assert rows[0].samples == 8
    assert rows[0].low < 3.5 < rows[0].high


def test_the_interval_is_that_of_dives_and_not_of_samples():
    """Dives that differ as a whole: a thousand samples of each make it no narrower."""
    levels = RNG.uniform(0.5, 1.5, 12)
    few = rmse_interval([np.full(10, level) for level in levels])
    many = rmse_interval([np.full(1000, level) for level in levels])
    assert few == pytest.approx(many)
    spread = np.std(levels**2) / np.sqrt(12) / (2.0 * np.sqrt(np.mean(levels**2)))
    assert many[1] - many[0] == pytest.approx(2 * 1.96 * spread, rel=0.25)
    assert many == rmse_interval([np.full(1000, level) for level in levels])


def test_intervals_hold_what_they_promise():
    """Of 200 studies with 20 dives about 95 % hold the truth."""
    held = 0
    for _ in range(200):
        low, high = median_interval(RNG.exponential(size=20))
        held += low <= math.log(2.0) <= high
    assert 0.88 <= held / 200 <= 1.0


def test_too_few_dives_have_no_interval():
    assert all(map(math.isnan, rmse_interval([np.ones(9)] * (LEAST_DIVES - 1))))
    assert all(map(math.isnan, median_interval(np.ones(LEAST_DIVES - 1))))


def test_the_best_is_marked_among_equal_samples_only():
    def row(name, value, samples, kind="twin"):
        return Row(task="t", data="d", method=name, kind=kind, value=value, samples=samples)

    rows = [
        row("ours", 0.02, 100),
        row("theirs", 0.01, 100, "public method"),
        row("on fewer", 0.001, 50),
        row("printed elsewhere", 0.0001, 100, "published"),
    ]
    assert [one.method for one in best(rows)] == ["theirs"]
    assert [line["best"] for line in table(rows)] == ["", "*", "", ""]


def test_logs_in_a_folder_raw_are_found(tmp_path):
    folder = tmp_path / "slocum_deep_2022"
    (folder / "raw").mkdir(parents=True)
    assert logs_folder(folder) == folder / "raw"
    (folder / "flight.csv").write_text("time\n")
    assert logs_folder(folder) == folder


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"no public logs at {SHARED}")
def test_the_factory_s_speeds_are_those_of_its_files(tmp_path):
    """SG171's, of a table, against the depth rate: sinking is positive, and off by a few cm/s."""
    folder = SHARED / "seaglider_apl_ad2cp"
    if not folder.is_dir():
        pytest.skip("the Seagliders' logs are absent")
    pytest.importorskip("pyarrow")
    deployments = imported(folder, "seaglider", tmp_path)
    deployment = next(one for one in deployments if one.name == "SG171")
    log = deployment.logs()[0]
    sink = factory_sink(deployment, log)
    assert sink is not None
    known = np.isfinite(sink) & log.use
    assert known.mean() > 0.8
    error = sink[known] - log.depth_rate[known]
    assert np.sqrt(np.mean(error**2)) < 0.04
    assert np.corrcoef(sink[known], log.depth_rate[known])[0, 1] > 0.97


# --- One deployment left out: its truth, what it must not learn from, and how deployments pool


FLIGHTS = {"one": Flight(dives=5, depth=90.0), "two": Flight(dives=5, depth=90.0, speed=0.3)}


def deployment(root, name, *, velocities=True):
    """Logs of a Slocum, with a Doppler log that works below 12 m."""
    flight = FLIGHTS[name]
    folder = root / f"slocum_{name}_2024"
    folder.mkdir()
    write_slocum(folder, flight)
    if velocities:
        deep = flight.state(flight.time)["depth"] > 12.0
        speed = np.where(deep, flight.speed, np.nan)
        write_csv(folder / f"{name}_dvl_truth.csv", {"time": flight.time, "U_dvl_ms": speed})
    (found,) = imported(folder, "slocum", root)
    return found


@pytest.fixture(scope="module")
def labelled(tmp_path_factory):
    """Both deployments, prepared."""
    root = tmp_path_factory.mktemp("logs")
    found = [left_out.prepare(deployment(root, name)) for name in FLIGHTS]
    return [one for one in found if one is not None]


def test_the_truth_is_the_level_part_of_the_speed_over_whole_minutes(labelled, tmp_path):
    for one, flight in zip(labelled, FLIGHTS.values(), strict=True):
        assert len(one.dives) == flight.dives
        found = np.concatenate([dive.level for dive in one.dives])
        away = np.median(found) - flight.speed * np.cos(np.radians(flight.pitch))
        assert abs(away) < 2e-3, "the depth rate is the vertical part"
    assert left_out.prepare(deployment(tmp_path, "one", velocities=False)) is None
    since = np.concatenate([np.arange(0.0, 130.0), np.arange(170.0, 260.0)])
    centres, means = left_out.minute_means(since, since)
    assert centres.tolist() == [30.0, 90.0, 210.0], "10 s of the third minute are not its mean"
    np.testing.assert_allclose(means, [29.5, 89.5, 209.5])


def predicted(job):
    """Speeds [m/s] by every method."""
    level = {dive.row: dive.level for dive in job.tested.dives}
    return {
        one.name: np.concatenate([e + level[row] for row, e in one.errors.items()])
        for one in left_out.run(job)
    }


def test_velocities_of_the_deployment_that_is_scored_teach_nothing(labelled, monkeypatch):
    monkeypatch.setattr(left_out, "TUNED", dataclasses.replace(TUNED, epochs=20, validations=4))
    dives = [dive for one in labelled for dive in one.dives]
    short = dataclasses.replace(TUNED, epochs=2, validations=1)
    first = fit_network(dives, dives[:1], INPUTS[left_out.ON_TWIN], short, seed=0)
    networks = {left_out.ON_TWIN: [first] * 3}
    job, other = left_out.jobs(labelled, networks)
    before = predicted(job)
    assert len(before) == 5
    faster = [dataclasses.replace(dive, level=dive.level + 0.2) for dive in job.tested.dives]
    tested = dataclasses.replace(job.tested, dives=tuple(faster))
    (again, _) = left_out.jobs([tested, labelled[1]], networks)
    for name, speed in predicted(again).items():
        np.testing.assert_allclose(speed, before[name], rtol=0.0, atol=1e-9, err_msg=name)
    # the other's do
    (_, taught) = left_out.jobs([tested, labelled[1]], networks)
    learned = {"ridge on the twin", "network on the twin, simulation then the other"}
    unmoved = predicted(other)
    for name, speed in predicted(taught).items():
        moved = float(np.max(np.abs(speed - unmoved[name])))
        assert (moved > 1e-3) == (name in learned), (name, moved)
    assert left_out.jobs(labelled[:1], networks) == [], "there is none to learn from"


def test_deployments_weigh_the_same_and_a_ratio_is_of_the_same_draws():
    rng = np.random.default_rng(3)
    twin = [{k: rng.normal(0.0, scale, size) for k in range(8)} for scale, size in
            ((0.03, 200), (0.05, 4))]  # fmt: skip
    found = [
        [
            Method(name=left_out.TWIN, kind="twin", note="", errors=errors),
            Method(
                name="half", kind="network", note="", errors={k: e / 2 for k, e in errors.items()}
            ),
        ]
        for errors in twin
    ]
    rows = left_out.rows_of(["a", "b"], found)

    def row(task, data, method):
        (one,) = [r for r in rows if (r.task, r.data, r.method) == (task, data, method)]
        return one

    apart = [row(left_out.TASK, name, left_out.TWIN) for name in ("a", "b")]
    both = row(left_out.TASK, left_out.TOGETHER, left_out.TWIN)
    assert both.value == pytest.approx(rmse(np.array([one.value for one in apart])))
    assert both.low < both.value < both.high
    assert (both.samples, both.dives) == (8 * 204, 16)
    ratio = row(left_out.RATIO, left_out.TOGETHER, "half")
    assert (ratio.value, ratio.low, ratio.high) == pytest.approx((0.5, 0.5, 0.5))
    assert np.isnan(pooled_draws([list(twin[0].values()), [np.ones(3)]])).all(), "too few dives"
