"""`factory import`: what it says, writes and refuses; and the tools of cleaning and reading."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logs import refused

from factory.__main__ import PROGRAM
from factory.importing import import_logs
from factory.importing.cleaning import degrees_minutes, spikes
from factory.importing.columns import tidy
from factory.importing.deployment_log import Channel, LoggedFixes
from factory.importing.dives.segments import surface_drift
from factory.importing.plausibility import DiveRules
from factory.importing.sample_clock import parse_stamps, unix_seconds
from factory.importing.tally import Tally
from factory.samples import Flight
from factory.samples.gliders import nmea, write_slocum
from twin.records.store import open_store

FLIGHT = Flight()


def run(capsys, *words):
    code = PROGRAM.main([str(word) for word in words])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_the_command_writes_a_store_and_prints_the_report(tmp_path, capsys):
    write_slocum(tmp_path, FLIGHT)
    out = tmp_path / "real.zarr"
    code, said, err = run(capsys, "import", "slocum", tmp_path, "--out", out)
    assert code == 0, err
    assert "3, 3 from GPS fix to GPS fix" in said
    assert "measured_density" in said
    assert open_store(out).sizes["mission"] == 3
    code, _, err = run(capsys, "import", "slocum", tmp_path, "--out", out)
    assert code == 2
    assert "already exists" in err
    code, said, _ = run(
        capsys, "import", "slocum", tmp_path, "--out", out, "--overwrite", "--json", "--period", 4
    )
    answer = json.loads(said)
    assert code == 0
    assert answer["report"]["period"] == 4.0
    assert answer["report"]["rows"] == 3
    history = open_store(out).attrs["history"]
    assert history.endswith(f": factory import slocum {tmp_path} --period 4.0")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["slocum", "nowhere.dbd"], "no file nowhere.dbd"),
        (["slocum"], "no files to import"),
        (["slocum", ".", "--period", "0"], "period must be within"),
        (["slocum", ".", "--min-depth", "-1"], "--min-depth must be positive"),
        (["slocum", ".", "--variation-deg", "400"], "within +-180 degree"),
        (["slocom", "."], "did you mean 'slocum'"),
    ],
)
def test_bad_requests_are_one_line(tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, "import", *words, "--out", "real.zarr")
    assert code == 2
    assert message in err
    assert err.count("\n") == 1
    assert not Path("real.zarr").exists()


def test_shallow_logs_and_unknown_kinds_are_told(tmp_path):
    paths = write_slocum(tmp_path, Flight(depth=4.0, speed=0.1))
    refused(r"no dive deeper than 5 m.*--min-depth", "slocum", paths)
    assert import_logs("slocum", paths, rules=DiveRules(min_depth=2.0))[1].rows == 3
    refused("unknown kind of log 'petrel'", "petrel", paths)


@given(st.integers(0, 2**32 - 1))
def test_tidy_sorts_and_keeps_each_value_once(seed):
    rng = np.random.default_rng(seed)
    times = 1e9 + rng.integers(0, 40, 60).astype(float)
    values = np.where(rng.random(60) < 0.3, np.nan, rng.normal(size=60))
    tally = Tally()
    time, columns = tidy(times, {"x": values}, "table", tally)
    assert np.array_equal(time, np.unique(times))
    for t, x in zip(time, columns["x"], strict=True):
        there = values[(times == t) & np.isfinite(values)]
        assert np.isnan(x) if not len(there) else x == there[0]
    counted = {e.action: e.count for e in tally.entries()}
    assert counted.get("removed", 0) + counted.get("repeated", 0) == 60 - len(time)


@given(st.integers(2, 57), st.floats(8.0, 60.0), st.booleans())
def test_a_single_spike_is_found_and_a_step_is_kept(at, size, down):
    time = np.arange(60.0)
    values = np.linspace(0.0, 30.0, 60)
    assert not spikes(time, values, rate=3.0, jump=2.0).any()
    spiked = values.copy()
    spiked[at] += -size if down else size
    assert np.flatnonzero(spikes(time, spiked, rate=3.0, jump=2.0)).tolist() == [at]
    step = values + np.where(np.arange(60) >= at, size, 0.0)
    assert not spikes(time, step, rate=3.0, jump=2.0).any()


@given(st.floats(-89.0, 89.0))
def test_nmea_positions_round_trip(degrees):
    assert degrees_minutes(nmea(np.array([degrees])))[0] == pytest.approx(degrees, abs=1e-9)


def test_times_of_every_kind():
    unix = np.array([1.7e9, 1.7e9 + 1.5])
    for given_time in (unix * 1e3, unix * 1e6, unix * 1e9, unix / 86400.0 + 719529.0):
        tally = Tally()
        assert unix_seconds(given_time, "x", tally) == pytest.approx(unix, abs=1e-4)
        assert tally.entries()[0].count == 2
    words = np.array(["14/11/2023 22:13:20", "2023-11-14T22:13:21.5Z", "soon"], dtype=object)
    assert parse_stamps(words)[:2] == pytest.approx(unix)
    assert np.isnan(parse_stamps(words)[2])


def test_a_drift_needs_a_minute():
    time = np.array([0.0, 30.0, 59.0])
    fixes = LoggedFixes(time, 49.0 + time * 1e-6, np.full(3, 10.0))
    assert np.isnan(surface_drift(fixes)).all()
    time = np.array([0.0, 30.0, 90.0])
    fixes = LoggedFixes(time, 49.0 + time * 1e-6, np.full(3, 10.0))
    assert surface_drift(fixes)[0] == pytest.approx(0.1112, abs=1e-3)


def test_channels_cut_with_both_ends():
    channel = Channel(np.arange(10.0), np.arange(10.0) ** 2)
    assert channel.within(2.0, 4.0).time.tolist() == [2.0, 3.0, 4.0]
    assert channel.within(2.5, 4.5).time.tolist() == [3.0, 4.0]
    assert len(channel.within(20.0, 30.0)) == 0


def test_imports_and_exports_of_one_moment_are_the_same_bytes(tmp_path, capsys, monkeypatch):
    (tmp_path / "logs").mkdir()
    write_slocum(tmp_path / "logs", FLIGHT)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    found = []
    for name in ("first", "second"):
        monkeypatch.chdir(tmp_path)
        (tmp_path / name).mkdir()
        store, out = tmp_path / name / "real.zarr", tmp_path / name / "og1"
        assert run(capsys, "import", "slocum", "logs", "--out", store)[0] == 0
        assert run(capsys, "export", store, "--to", "og1", "--out", out)[0] == 0
        files = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        found.append({path.relative_to(tmp_path / name): path.read_bytes() for path in files})
    assert found[0].keys() == found[1].keys()
    assert [name for name in found[0] if found[0][name] != found[1][name]] == []
    assert open_store(store).attrs["history"].startswith("2023-11-14T22:13:20Z: factory import")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    code, _, err = run(capsys, "import", "slocum", "logs", "--out", tmp_path / "third.zarr")
    assert code == 2
    assert "SOURCE_DATE_EPOCH is 'yesterday': give whole seconds since 1970" in err
