"""One deployment left out: its truth, what it must not learn from, and how deployments pool."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.real_logs import left_out
from benchmarks.real_logs.left_out import Labelled
from benchmarks.real_logs.row import Method, Row, pooled_draws, rmse
from benchmarks.real_logs.source import Deployment, imported
from benchmarks.real_logs.surge_networks import INPUTS, TUNED, Pretrained, Weights, fit_network
from factory.samples import Flight, write_csv
from factory.samples.gliders import write_slocum

FLIGHTS = {"one": Flight(dives=5, depth=90.0), "two": Flight(dives=5, depth=90.0, speed=0.3)}


def deployment(root: Path, name: str, *, velocities: bool = True) -> Deployment:
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
def labelled(tmp_path_factory: pytest.TempPathFactory) -> list[Labelled]:
    """Both deployments, prepared."""
    root = tmp_path_factory.mktemp("logs")
    found = [left_out.prepare(deployment(root, name)) for name in FLIGHTS]
    return [one for one in found if one is not None]


def test_the_truth_is_the_level_part_of_the_speed_over_whole_minutes(
    labelled: list[Labelled], tmp_path: Path
) -> None:
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


def predicted(job: left_out.LeftOutJob) -> dict[str, np.ndarray]:
    """Speeds [m/s] by every method."""
    level = {dive.row: dive.level for dive in job.tested.dives}
    return {
        one.name: np.concatenate([e + level[row] for row, e in one.errors.items()])
        for one in left_out.run(job)
    }


def test_velocities_of_the_deployment_that_is_scored_teach_nothing(
    labelled: list[Labelled], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(left_out, "TUNED", dataclasses.replace(TUNED, epochs=20, validations=4))
    dives = [dive for one in labelled for dive in one.dives]
    short = dataclasses.replace(TUNED, epochs=2, validations=1)
    first = fit_network(dives, dives[:1], INPUTS[left_out.ON_TWIN], short, seed=0)
    networks: Pretrained = {left_out.ON_TWIN: [Weights.of(first)] * 3}
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


def test_deployments_weigh_the_same_and_a_ratio_is_of_the_same_draws() -> None:
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

    def row(task: str, data: str, method: str) -> Row:
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
