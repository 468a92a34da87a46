"""Import: what sensors do wrong, and what the import makes of it. Small written files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logs import Flight, slocum_columns, write_slocum

from factory.importing import import_logs
from factory.importing.angles import in_degrees
from factory.importing.runs import unreachable

FLIGHT = Flight()
SIGNALS = ("measured_pitch", "measured_heading", "measured_roll", "measured_depth")


def with_sentinels(columns: dict[str, np.ndarray], share: float) -> dict[str, np.ndarray]:
    """Pitch, depth and pressure as a Slocum writes them where a sensor was silent."""
    bad = np.random.default_rng(5).random(len(columns["time"])) < share
    changed = {name: columns[name].copy() for name in ("m_pitch", "m_depth", "m_pressure")}
    for name, sentinel in (("m_pitch", -999.0), ("m_depth", 9999.0), ("m_pressure", 999.0)):
        changed[name][bad] = sentinel
    return changed


@pytest.mark.parametrize("factor", [1.0, 180.0 / np.pi])
def test_sentinels_neither_turn_the_unit_nor_leave_depth_behind(
    tmp_path: Path, factor: float
) -> None:
    right, whole = import_logs("slocum", write_slocum(tmp_path, FLIGHT))
    changed = with_sentinels(slocum_columns(FLIGHT), 0.05)
    changed["m_pitch"] = np.where(changed["m_pitch"] == -999.0, -999.0, changed["m_pitch"] * factor)
    dataset, report = import_logs("slocum", write_slocum(tmp_path, FLIGHT, **changed))
    bad = int((changed["m_pitch"] == -999.0).sum())
    assert bad > 20
    assert report.count("removed", "m_pitch") == report.count("removed", "m_pressure") == bad
    repaired = report.count("repaired", "m_pitch")
    assert repaired == (len(FLIGHT.time) - bad if factor > 1.0 else 0)
    assert report.count("repaired") == repaired
    assert report.rows == whole.rows
    # no fix was taken for one under water
    assert report.count("removed", "GPS fixes") == whole.count("removed", "GPS fixes") == 0
    assert float(np.nanmax(dataset["measured_depth"])) < FLIGHT.depth + 1.0
    apart = np.abs(dataset["measured_pitch"].values - right["measured_pitch"].values)
    assert np.nanpercentile(apart, 90.0) < 0.01


def test_runs_of_impossible_depth_go_and_the_dive_stays(tmp_path: Path) -> None:
    columns = slocum_columns(FLIGHT)
    depth, pressure = columns["m_depth"].copy(), columns["m_pressure"].copy()
    run = slice(90, 102)
    pressure[run] = 40.0
    depth[run] = 400.0
    paths = write_slocum(tmp_path, FLIGHT, m_depth=depth, m_pressure=pressure)
    dataset, report = import_logs("slocum", paths)
    assert report.count("removed", "m_pressure") == 12
    assert float(np.nanmax(dataset["measured_depth"])) < FLIGHT.depth + 1.0
    assert report.rows == FLIGHT.dives


@given(st.integers(0, 150), st.integers(1, 20), st.floats(60.0, 9000.0))
def test_only_the_run_is_out_of_reach(start: int, length: int, value: float) -> None:
    time = 4.0 * np.arange(200.0)
    values = 30.0 + 20.0 * np.sin(time / 100.0)
    assert not unreachable(time, values, rate=2.0, jump=4.0).any()
    # far enough that the run's own length does not make it reachable
    values[start : start + length] = value + 2.0 * 4.0 * (length + 2)
    bad = unreachable(time, values, rate=2.0, jump=4.0)
    assert np.flatnonzero(bad).tolist() == list(range(start, start + length))


def test_a_roll_in_degrees_is_not_taken_for_radian(tmp_path: Path) -> None:
    """A few degrees of roll would be half a turn in radian; they are in no other angle's unit."""
    wobble = 3.0 + 2.0 * np.sin(FLIGHT.time / 50.0)
    dataset, report = import_logs("slocum", write_slocum(tmp_path, FLIGHT, m_roll=wobble))
    assert report.count("repaired", "m_roll") == report.count("repaired") == len(wobble)
    assert np.nanmax(np.abs(dataset["measured_roll"])) == pytest.approx(5.0, abs=0.1)


def test_a_slight_roll_follows_the_unit_of_pitch_and_heading(tmp_path: Path) -> None:
    """0.1 to 0.5: a roll that could be either."""
    either = 0.3 + 0.2 * np.sin(FLIGHT.time / 50.0)
    assert in_degrees("roll", either) is None
    columns = slocum_columns(FLIGHT)
    dataset, report = import_logs("slocum", write_slocum(tmp_path, FLIGHT, m_roll=either))
    assert report.count("repaired") == 0
    assert np.nanmax(dataset["measured_roll"]) == pytest.approx(np.degrees(0.5), abs=0.1)
    whole = {n: np.degrees(columns[n]) for n in ("m_pitch", "m_heading")}
    dataset, report = import_logs("slocum", write_slocum(tmp_path, FLIGHT, m_roll=either, **whole))
    assert report.count("repaired", "m_roll") == len(either)
    assert np.nanmax(dataset["measured_roll"]) == pytest.approx(0.5, abs=0.01)


def test_a_heading_sentinel_is_no_heading(tmp_path: Path) -> None:
    heading = slocum_columns(FLIGHT)["m_heading"]
    heading[30:34] = -999.0
    dataset, report = import_logs("slocum", write_slocum(tmp_path, FLIGHT, m_heading=heading))
    assert report.count("removed", "m_heading") == 4
    assert np.allclose(
        dataset["measured_heading"].values[np.isfinite(dataset["measured_heading"].values)],
        FLIGHT.heading,
        atol=1e-3,
    )
