"""The open benchmark of dead reckoning: its scorer, its files, a method of one's own."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from examples import ROOT

from twin.errors import InputError


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, int]:
    """Small stores of the tier `family`, and the dives before its score begins."""
    sys.path.insert(0, str(ROOT))
    from benchmarks.dead_reckoning.tiers import TIERS

    tier = TIERS["family"]
    changes = {**tier.test["changes"], "mission.duration_h": "2", "mission.max_depth_m": "40"}
    small = dataclasses.replace(
        tier,
        train={**tier.train, "hours": 4.0},
        test={**tier.test, "hours": 4.0, "changes": changes},
        checksums={},
    )
    train, test = small.make(tmp_path_factory.mktemp("tier"))
    assert small.make(train.parent) == (train, test)  # made once
    return train, test, 1


def truth(test: Path) -> xr.Dataset:
    with xr.open_zarr(test, decode_times=False) as store:
        return xr.Dataset(
            {n: (("mission", "time"), store[f"true_{n}"].values) for n in ("surge", "sway")}
        )


def test_the_truth_has_no_error_and_a_scale_error_is_seen(made, tmp_path):
    from benchmarks.dead_reckoning.scoring import read_predictions, score

    _, test, dives = made
    data = truth(test)
    data.to_netcdf(tmp_path / "truth.nc")
    said = read_predictions(tmp_path / "truth.nc")
    figures = score(test, dives, said)
    assert set(figures) == {"0", "1", "5"}
    assert figures["0"] == figures["5"]  # it adapts on nothing
    assert figures["0"]["dr_velocity_percent"] < 0.3
    assert figures["0"]["surge_mse"] == 0.0
    scaled = score(test, dives, {0: data * 1.05, 1: data * 1.02})
    assert scaled["0"]["surge_mse"] > scaled["1"]["surge_mse"] > 0.0
    assert 3.0 < scaled["0"]["dr_velocity_percent"] < 7.0
    count = figures["0"]["missions"]
    assert (scaled["0"]["worse"], scaled["1"]["worse"]) == (0.0, 0.0)
    assert score(test, dives, {0: data * 1.02, 1: data * 1.05})["1"]["worse"] == count
    assert "within" not in scaled["0"]
    for interval, wanted in (
        (np.abs(0.06 * data["surge"]) + 1e-9, 1.0),
        (0.0 * data["surge"], 0.0),
    ):
        told = {0: (data * 1.05).assign(surge_interval=interval)}
        assert score(test, dives, told)["0"]["within"] == wanted
    broken = data.copy(deep=True)
    broken["surge"][0, 7] = np.nan
    with pytest.raises(InputError, match="not finite at sample 7"):
        score(test, dives, {0: broken})
    with pytest.raises(InputError, match="lack mission 1"):
        score(test, dives, {0: data.isel(mission=[0])})


def test_a_table_says_the_same_as_netcdf(made, tmp_path):
    from benchmarks.dead_reckoning.scoring import read_predictions, score

    _, test, dives = made
    data = truth(test) * 1.03
    with xr.open_zarr(test, decode_times=False) as store:
        counts, period = store["n_samples"].values, float(store["time"][1] - store["time"][0])
    lines = ["mission,time_s,surge,sway"]
    for k, count in enumerate(counts.tolist()):
        surge, sway = (data[n].values[k] for n in ("surge", "sway"))
        lines += [f"{k},{i * period},{surge[i]!s},{sway[i]!s}" for i in range(count)]
    (tmp_path / "mine.csv").write_text("\n".join(lines) + "\n")
    table = score(test, dives, read_predictions(tmp_path / "mine.csv"))
    assert table["0"]["surge_mse"] == pytest.approx(score(test, dives, {0: data})["0"]["surge_mse"])
    (tmp_path / "bad.csv").write_text("mission,time_s,surge\n0,0,0.3\n")
    with pytest.raises(InputError, match="lacks the column sway"):
        read_predictions(tmp_path / "bad.csv")


def test_a_method_of_ones_own_is_a_file(made, tmp_path):
    from benchmarks.dead_reckoning.rivals import chosen
    from benchmarks.dead_reckoning.scoring import score

    train, test, dives = made
    (tmp_path / "mine.py").write_text(
        "from benchmarks.dead_reckoning.rivals import RIVALS\n"
        "def predict(train, test, seed, seconds):\n"
        "    said = RIVALS['steady flight'].predict(train, test, seed, seconds)\n"
        "    return {d: data * 0.9 for d, data in said.items()}\n"
    )
    found = chosen("steady flight", tmp_path / "mine.py")
    assert list(found) == ["steady flight", "mine"]
    plain, mine = (score(test, dives, one.predict(train, test, 0, 1.0)) for one in found.values())
    assert mine["0"]["surge_mse"] != plain["0"]["surge_mse"]
    with pytest.raises(InputError, match="unknown method 'emu': did you mean 'ema'"):
        chosen("emu", None)


def test_scoring_needs_no_torch():
    code = "import sys, benchmarks.dead_reckoning.scoring; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_a_method_that_adapts_says_more_after_more_dives(made, monkeypatch):
    """Networks that are hardly trained, on hulls with 40 % more drag: the hull is what helps."""
    from benchmarks.dead_reckoning.rivals import chosen
    from benchmarks.dead_reckoning.scoring import score

    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    train, test, dives = made
    found = chosen("flight filter,ema,ema adapted", None)
    assert {name: one.labels for name, one in found.items()} == dict.fromkeys(found, "none")
    figures = {
        name: score(test, dives, one.predict(train, test, 0, 1.0)) for name, one in found.items()
    }
    assert (train.parent / "runs" / "ema-0-1" / "run.json").is_file()  # trained once for both
    assert figures["ema"]["0"] == figures["ema"]["5"]
    assert figures["ema adapted"]["0"]["dr_velocity_percent"] == pytest.approx(
        figures["ema"]["0"]["dr_velocity_percent"], rel=1e-6
    )
    assert figures["ema adapted"]["1"]["surge_mse"] < figures["ema"]["0"]["surge_mse"]
    assert figures["flight filter"]["0"]["missions"] == figures["ema"]["0"]["missions"]


def test_a_balance_of_forces_is_fitted_to_the_first_dives(made):
    """40 % more drag: without a dive the file's hull is too fast by a sixth."""
    from benchmarks.dead_reckoning.rivals import RIVALS
    from benchmarks.dead_reckoning.scoring import score

    train, test, dives = made
    found = score(test, dives, RIVALS["gliderflight"].predict(train, test, 0, 1.0))
    assert found["5"]["surge_mse"] < 0.7 * found["0"]["surge_mse"]
    assert found["1"]["dr_velocity_percent"] < 0.7 * found["0"]["dr_velocity_percent"]
    with pytest.raises(InputError, match="an identified twin needs logs"):
        RIVALS["identified twin"].predict(train, test, 0, 1.0)


def test_a_store_of_another_physics_is_not_taken_for_the_published_one(made):
    from benchmarks.dead_reckoning.tiers import TIERS, Checksum

    _, test, _ = made
    found = Checksum.of(test)
    assert found.samples > 1000 * found.missions
    assert found.same(found._replace(metres=found.metres * (1.0 + 1e-8)))
    assert not found.same(found._replace(metres=found.metres * (1.0 + 1e-5)))
    tier = dataclasses.replace(TIERS["family"], checksums={"test": found})
    assert tier.others(test.parent) == []
    tier = dataclasses.replace(tier, checksums={"test": found._replace(samples=1)})
    (line,) = tier.others(test.parent)
    assert "the published one" in line
