"""The open benchmark's tier of public logs, its files of results, and flight models as rivals."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest
import xarray as xr
from examples import needs_docs

from benchmarks.dead_reckoning import public_logs as public
from benchmarks.dead_reckoning import results
from twin.errors import InputError

SAMPLES = 200
PITCH = np.deg2rad(-24.0)
SURGE, HEAVE = 0.3, 0.012


def glide(index: int, *, pitch: tuple[float, float] = (1.0, 0.0)):
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


def said(factor: float, dives: int) -> xr.Dataset:
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
    assert "worse" in rows[0]
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
