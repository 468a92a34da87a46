"""The open benchmark of dead reckoning: its scorer, its files, a method of one's own."""

import dataclasses
import json
import re
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from examples import ROOT, needs_docs

from benchmarks.dead_reckoning import public_logs as public
from benchmarks.dead_reckoning import results
from benchmarks.dead_reckoning.__main__ import main
from benchmarks.dead_reckoning.predictions import checked, read_predictions
from benchmarks.dead_reckoning.rivals import RIVALS, chosen
from benchmarks.dead_reckoning.scoring import score
from benchmarks.dead_reckoning.tiers import TIERS, Checksum
from twin.errors import InputError


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Small stores of the tier `family`, and the dives before its score begins."""
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


PERIOD = 0.5


def truth(test):
    with xr.open_zarr(test, decode_times=False) as store:
        return xr.Dataset(
            {n: (("mission", "time"), store[f"true_{n}"].values) for n in ("surge", "sway")}
        )


def test_the_truth_has_no_error_and_a_scale_error_is_seen(made, tmp_path):
    _, test, dives = made
    data = truth(test)
    data.to_netcdf(tmp_path / "truth.nc")
    said = read_predictions(tmp_path / "truth.nc", PERIOD)
    figures = score(test, dives, said)
    assert set(figures) == {"0", "1"}  # nothing is adapted on that is scored
    assert figures["0"] == figures["1"]  # it adapts on nothing
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
    with pytest.raises(InputError, match="lack mission 1; they have 1, 0 to 0, and a mission is"):
        score(test, dives, {0: data.isel(mission=[0]).assign_coords(mission=[0])})
    counts = np.isfinite(data["surge"].values).sum(1)
    longer = data.fillna(0.3) if counts.min() < counts.max() else data.pad(time=(0, 3)).fillna(0.3)
    with pytest.raises(InputError, match=r"mission \d has \d+ samples, the store \d+"):
        score(test, dives, {0: longer.assign_coords(mission=data.mission)})


def test_a_table_says_the_same_as_netcdf(made, tmp_path):
    _, test, dives = made
    data = truth(test) * 1.03
    with xr.open_zarr(test, decode_times=False) as store:
        counts, period = store["n_samples"].values, float(store["time"][1] - store["time"][0])
    lines = ["mission,time_s,surge,sway"]
    for k, count in enumerate(counts.tolist()):
        surge, sway = (data[n].values[k] for n in ("surge", "sway"))
        lines += [f"{k},{i * period},{surge[i]!s},{sway[i]!s}" for i in range(count)]
    (tmp_path / "mine.csv").write_text("\n".join(lines) + "\n")
    table = score(test, dives, read_predictions(tmp_path / "mine.csv", PERIOD))
    assert table["0"]["surge_mse"] == pytest.approx(score(test, dives, {0: data})["0"]["surge_mse"])
    (tmp_path / "bad.csv").write_text("mission,time_s,surge\n0,0,0.3\n")
    with pytest.raises(InputError, match="lacks the column sway"):
        read_predictions(tmp_path / "bad.csv", PERIOD)


def test_a_method_of_ones_own_is_a_file(made, tmp_path):
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
    code = "import sys, benchmarks.dead_reckoning.__main__; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_a_method_that_adapts_says_more_after_more_dives(made, monkeypatch):
    """Networks that are hardly trained, on hulls with 40 % more drag: the hull is what helps."""
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    train, test, dives = made
    found = chosen("flight filter,ema,ema adapted", None)
    assert {name: one.labels for name, one in found.items()} == dict.fromkeys(found, "none")
    figures = {
        name: score(test, dives, one.predict(train, test, 0, 1.0)) for name, one in found.items()
    }
    assert (train.parent / "runs" / "ema-0-1" / "run.json").is_file()  # trained once for both
    assert figures["ema"]["0"] == figures["ema"]["1"]
    assert figures["ema adapted"]["0"]["dr_velocity_percent"] == pytest.approx(
        figures["ema"]["0"]["dr_velocity_percent"], rel=1e-6
    )
    assert figures["ema adapted"]["1"]["surge_mse"] < figures["ema"]["0"]["surge_mse"]
    assert figures["flight filter"]["0"]["missions"] == figures["ema"]["0"]["missions"]


def test_a_balance_of_forces_is_fitted_to_the_first_dives(made):
    """40 % more drag: without a dive the file's hull is too fast by a sixth."""
    train, test, dives = made
    found = score(test, dives, RIVALS["gliderflight"].predict(train, test, 0, 1.0))
    assert found["1"]["surge_mse"] < 0.8 * found["0"]["surge_mse"]
    assert found["1"]["dr_velocity_percent"] < 0.7 * found["0"]["dr_velocity_percent"]
    with pytest.raises(InputError, match="fitted to all dives needs logs"):
        RIVALS["identified twin"].predict(train, test, 0, 1.0)


def test_a_store_of_another_physics_is_not_taken_for_the_published_one(made):
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


COLUMNS = "mission,time_s,surge,sway\n"
MISTAKES = {
    "times from 1": (COLUMNS + "0,1.0,0.3,0\n0,1.5,0.3,0\n", "begin at 1 s with a sample"),
    "another period": (COLUMNS + "0,0,0.3,0\n0,0.25,0.3,0\n", "a sample every 0.25 s; the store"),
    "a line twice": (COLUMNS + "0,0,0.3,0\n0,0,0.3,0\n0,0.5,0.3,0\n", "mission 0: times begin"),
    "text": (COLUMNS + "0,0,fast,0\n", "cannot be read: Unable to parse string .fast."),
    "nothing": ("", "cannot be read: No columns"),
    "an interval below 0": (
        "mission,time_s,surge,sway,surge_interval\n0,0,0.3,0,-1\n", "surge_interval is below 0"
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_table_that_is_none_is_told(mistake, tmp_path):
    text, message = MISTAKES[mistake]
    (tmp_path / "mine.csv").write_text(text)
    with pytest.raises(InputError, match=rf"mine\.csv.*{message}"):
        read_predictions(tmp_path / "mine.csv", PERIOD)
    with pytest.raises(InputError, match="there is no such file"):
        read_predictions(tmp_path / "other.csv", PERIOD)
    (tmp_path / "mine.nc").write_text(text or "x")
    with pytest.raises(InputError, match=r"mine\.nc cannot be read"):
        read_predictions(tmp_path / "mine.nc", PERIOD)


def test_what_a_method_gives_back_is_looked_at():
    good = xr.Dataset({n: (("mission", "time"), np.zeros((1, 2))) for n in ("surge", "sway")})
    assert checked({0: good.transpose("time", "mission")}, "mine")[0]["surge"].shape == (1, 2)
    for said, message in (
        (good, r"mine gives Dataset; wanted is \{0: Dataset"),
        (None, "mine gives NoneType"),
        ({5: good}, r"mine gives the keys \[5\]"),
        ({0: 0.3}, "mine gives float for 0 dives"),
        ({0: good.drop_vars("sway")}, "mine lacks the variable sway"),
        ({0: good.rename(time="t")}, "mine: surge has the dimensions mission, t; wanted are"),
    ):
        with pytest.raises(InputError, match=message):
            checked(said, "mine")


def test_a_file_that_is_no_method_is_told(tmp_path):
    for text, message in (
        ("import nowhere", "mine.py cannot be run: ModuleNotFoundError"),
        ("def predict(:", "mine.py cannot be run: SyntaxError"),
        ("def predict(test):\n    return {}", "mine.py has no function predict"),
        ("x = 1", "mine.py has no function predict"),
        ("LABELS = 'gps'\ndef predict(*_):\n    return {}", "mine.py: unknown LABELS 'gps'"),
    ):
        (tmp_path / "mine.py").write_text(text)
        with pytest.raises(InputError, match=message):
            chosen("", tmp_path / "mine.py")
    (tmp_path / "mine.py").write_text("TRAINED = False\ndef predict(*_):\n    return {}\n")
    alone = chosen("", tmp_path / "mine.py")
    assert list(alone) == ["mine"]
    assert not alone["mine"].trained
    (tmp_path / "ema.py").write_text("def predict(*_):\n    return {}\n")
    with pytest.raises(InputError, match="ema is the name of a rival"):
        chosen("", tmp_path / "ema.py")
    with pytest.raises(InputError, match="there is no such Python file"):
        chosen("", tmp_path / "nope.py")


def test_options_that_do_not_go_together_are_refused(tmp_path, capsys, monkeypatch):
    for words, message in (
        (["--keep", str(tmp_path)], "--keep needs --who NAME"),
        (["--who", "me"], "--who is for --keep"),
        (["--predictions", "x.nc", "--method", "y.py"], "--predictions is scored alone"),
        (["--tier", "paper", "--test-seed", "7"], "has no other test missions"),
        (["--tier", "public", "--test-seed", "7"], "has no other test missions"),
        (["--tier", "public", "--logs", str(tmp_path), "--make"], "no file .*p1710100.nc"),
    ):
        monkeypatch.setattr(sys, "argv", ["dead_reckoning", *words, "--folder", str(tmp_path)])
        assert main() == 2
        assert re.search(message, capsys.readouterr().err)


# --- The open benchmark's tier of public logs, its files of results, and flight models as rivals


SAMPLES = 200
PITCH = np.deg2rad(-24.0)
SURGE, HEAVE = 0.3, 0.012


def glide(index, *, pitch=(1.0, 0.0)):
    """A steady dive at 0.3 m/s with its truth, whose pitch sensor has a scale and an offset.

    Its truth is wrong in the first 5 m, where a profiler is not believed.
    """
    down = -SURGE * np.sin(PITCH) + HEAVE * np.cos(PITCH)
    ones = np.ones(SAMPLES)
    depth = 2.0 + down * public.PERIOD * np.arange(SAMPLES)
    return public.LoggedDive(
        index,
        1e9 + 1e4 * index + public.PERIOD * np.arange(SAMPLES),
        {
            "measured_depth": depth,
            "measured_roll": 0.0 * ones,
            "measured_heading": 30.0 * ones,
            "measured_pitch": np.rad2deg((PITCH - pitch[1]) / pitch[0]) * ones,
            "true_surge": np.where(depth > 5.0, SURGE, 9.0),
            "true_sway": 0.0 * ones,
            "true_heave": HEAVE * ones,
        },
        pitch,
    )


def said(factor, dives):
    surge = np.full((dives, SAMPLES), factor * SURGE)
    return xr.Dataset(
        {"surge": (("mission", "time"), surge), "sway": (("mission", "time"), 0.0 * surge)},
        coords={"mission": range(dives)},
    )


@pytest.mark.parametrize("pitch", [(1.0, 0.0), (0.86, -0.004)])
def test_a_scale_error_of_the_speed_is_the_error_of_the_way(pitch, monkeypatch, tmp_path):
    """Against an ADCP in the store, and against a Doppler log's speed in a file."""
    level = SURGE * np.cos(PITCH) + HEAVE * np.sin(PITCH)
    dives = [glide(k, pitch=pitch) for k in range(3)]
    monkeypatch.setattr(public, "dives_of", lambda *_: dives)
    # truth every second, but in the first 100 s, in a hole, and in most of the last dive
    time = np.concatenate([d.time[0] + np.arange(1000.0) for d in dives])
    hole = (time > dives[0].time[60]) & (time < dives[0].time[90])
    kept = ~hole & (time > dives[0].time[20]) & (time < dives[2].time[20])
    speed = np.where(kept, np.hypot(SURGE, HEAVE), np.nan)
    (tmp_path / "logs").mkdir()
    np.save(tmp_path / "logs" / "doppler.npy", np.stack([time, speed]))
    for truth in ("store", "doppler.npy"):
        one = dataclasses.replace(public.deployments()[0], name="logs", truth=truth, pitch=pitch)
        percent, squared = public.dive_errors(one, tmp_path, tmp_path, said(1.0, 3))
        assert percent == pytest.approx(0.0, abs=0.05)
        assert squared.max() < 1e-7
        assert len(percent) == (3 if truth == "store" else 2)  # too little truth in the last one
        percent, squared = public.dive_errors(one, tmp_path, tmp_path, said(1.1, 3))
        # heave follows from the depth rate, so that an error of surge counts 1 / cos(pitch)
        off = 0.1 * SURGE / np.cos(PITCH)
        assert percent == pytest.approx(100.0 * off / level, rel=5e-3)
        assert squared == pytest.approx(off**2, rel=5e-3)
        wavy = said(1.0, 3)  # of what changes within a minute the mean counts
        wavy["surge"][:, ::2] += 0.05
        wavy["surge"][:, 1::2] -= 0.05
        percent, squared = public.dive_errors(one, tmp_path, tmp_path, wavy)
        assert squared.max() < 0.02 * 0.05**2
        assert percent.max() < 1.0
        with pytest.raises(InputError, match="lack mission 1"):
            public.dive_errors(one, tmp_path, tmp_path, said(1.0, 1))
    blind = said(1.0, 3)
    blind["surge"][0, 62:89] = np.nan  # where there is no truth nothing need be said
    assert len(public.dive_errors(one, tmp_path, tmp_path, blind)[0]) == 2
    blind["surge"][0, 100] = np.nan
    with pytest.raises(InputError, match="surge of mission 0 is not finite at sample 100"):
        public.dive_errors(one, tmp_path, tmp_path, blind)
    found = public.figures({"a": (np.array([1.0, 3.0]), np.ones(2)), "b": (np.ones(8), np.ones(8))})
    assert found["0"]["dr_velocity_percent"] == pytest.approx(1.5)  # deployments weigh the same
    assert (found["0"]["low"], found["0"]["high"]) == (1.0, 2.0)


def test_files_are_those_that_were_published(tmp_path):
    for one in public.deployments():
        assert one.address.startswith("https://")
        assert one.address.endswith("/")
        assert re.search("/[0-9a-f]{40}/", one.address), "an address that may change"
        assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest in one.files.values())
        assert one.truth == "store" or one.truth in one.files
    one = public.deployments()[0]
    with pytest.raises(InputError, match=r"you fetch, from https://.*BSD-3-Clause"):
        one.check(tmp_path)
    for name in one.files:
        (tmp_path / one.name).mkdir(exist_ok=True)
        (tmp_path / one.name / name).write_bytes(b"another file")
    with pytest.raises(InputError, match="is not the published file"):
        one.check(tmp_path)


def test_what_is_to_be_fetched_is_a_file_of_curl(capsys):
    assert public.main() == 0
    lines = [x for x in capsys.readouterr().out.splitlines() if not x.startswith("#")]
    assert len(lines) == 2 * sum(len(one.files) for one in public.deployments())
    assert lines[0].startswith('url = "https://')
    assert lines[1] == f'output = "sg171/{lines[0].rpartition("/")[2]}'


def test_files_of_results_make_the_page(tmp_path):
    figures = {
        "dr_velocity_percent": 0.4, "low": 0.3, "high": 0.5, "surge_mse": 1e-5, "missions": 9.0,
        "worse": 0.0,
    }  # fmt: skip
    better = {**figures, "dr_velocity_percent": 0.2, "worse": 1.0}
    found = {"labels": "none", "dives": {"0": figures, "1": figures, "5": better}}
    by_hand = {"how": "by hand", "code": "1234abcd"}
    path = results.keep(tmp_path, "My method", "family", found, who="somebody", **by_hand)
    results.keep(tmp_path, "My method", "field", found, who="somebody", **by_hand)
    alone = {**found, "dives": {"0": better}}
    results.keep(tmp_path, "best", "family", alone, who="me", **by_hand)
    results.keep(tmp_path, "floor", "family", {**alone, "labels": "all dives"}, who="me", **by_hand)
    with pytest.raises(InputError, match="is of somebody: give your method's file another name"):
        results.keep(tmp_path, "my method", "field", found, who="me", **by_hand)
    assert path.name == "my_method.json"
    assert set(results.read(path)["tiers"]) == {"family", "field"}
    marks = "\n\n".join(results.MARK.format(tier) for tier in results.TIERS)
    made = results.page(f"# A page\n\n{marks}\n\nThe end.\n", tmp_path)
    family = made[made.index("results: family") : made.index("results: public")]
    rows = [line for line in family.splitlines() if line.startswith("| ")]
    assert [row.split(" | ")[0] for row in rows[2:]] == [
        "| best", "| My method", "| My method", "| floor",
    ]  # fmt: skip
    assert "|\n\n<!--" in made  # else the next heading were a row
    assert {"labels", "worse", "by"} < set(rows[0].split())
    field = made[made.index("results: field") : made.index("results: family")]
    assert "labels" not in field  # none, as in all rows of most tables
    assert "within" not in rows[0]
    assert results.page(made, tmp_path) == made
    assert made.endswith("The end.\n")
    with pytest.raises(InputError, match="no place for tier field"):
        results.page("# Nothing\n", tmp_path)
    path.write_text(json.dumps({"method": "x", "tiers": {"family": {"labels": "none"}}}))
    with pytest.raises(InputError, match="no file of results"):
        results.read(path)


@needs_docs
def test_the_page_has_what_the_files_say():
    text = results.PAGE.read_text(encoding="utf-8")
    assert results.page(text) == text, "run `python -m benchmarks.dead_reckoning.results`"
    assert set(results.tables()) == set(results.TIERS)
