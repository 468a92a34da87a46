"""Depth rates of yo-yos: of logs, of a twin, and what cannot be compared."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from logs import SHARED, stored

from benchmarks.real_logs import yo_yos
from factory.importing import import_logs
from factory.samples import Flight
from glider_twin_protocols.auv_samples import write_mat
from twin.errors import InputError
from twin.records.store import write_store

SHORE = SHARED / "lrauv_shore_2013"


def triangle(down: float, up: float, period: float = 2.0) -> np.ndarray:
    """Three yo-yos of 50 m."""
    one = np.concatenate([np.arange(0.0, 50.0, down * period), np.arange(50.0, 0.0, -up * period)])
    return np.tile(one, 3)


def test_rates_are_those_of_the_legs() -> None:
    found = yo_yos.rates([(triangle(0.2, 0.25), 2.0)])
    assert np.median(found.down) == pytest.approx(0.2, rel=0.01)
    assert np.median(found.up) == pytest.approx(0.25, rel=0.01)
    assert len(found.down) == len(found.up) == 3
    assert found.bottom == pytest.approx(50.0, abs=0.5)


def test_a_leg_with_a_hole_is_left_out() -> None:
    depth = triangle(0.2, 0.25)
    depth[20:80] = np.nan  # in the first descent
    assert len(yo_yos.rates([(depth, 2.0)]).down) == 2
    with pytest.raises(InputError, match="the depth never turns round"):
        yo_yos.rates([(np.full(100, 3.0), 2.0)])


def test_the_pitch_of_the_logs_rates() -> None:
    assert yo_yos.matching_pitch([10.0, 20.0], [0.1, 0.3], 0.2) == pytest.approx(15.0)
    assert math.isnan(yo_yos.matching_pitch([10.0, 20.0], [0.1, 0.3], 0.4))


def test_the_command_prints_logs_and_twin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = Flight(depth=40.0, speed=1.0, pitch=15.0, surface=600.0, step=2.0)
    stored(tmp_path / "shore.zarr", "lrauv", [write_mat(tmp_path / "log.mat", flight)])
    words = [str(tmp_path / "shore.zarr"), "--vehicle", "tethys", "--pitch", "12", "18", "--json"]
    assert yo_yos.main(words) == 0
    answer = json.loads(capsys.readouterr().out)
    logs, gentle, steep = answer["rows"]
    assert logs["down [m/s]"] == pytest.approx(math.sin(math.radians(15.0)), rel=0.1)
    assert gentle["down [m/s]"] < logs["down [m/s]"] < steep["down [m/s]"]
    assert 12.0 < answer["matching_pitch_deg"]["down"] < 18.0
    assert yo_yos.main([str(tmp_path / "none.zarr")]) == 2
    assert "none.zarr" in capsys.readouterr().err


@pytest.mark.skipif(not SHORE.is_dir(), reason="needs the shared LRAUV logs")
def test_the_shore_logs(tmp_path: Path) -> None:
    write_store(import_logs("lrauv", [SHORE])[0], tmp_path / "shore.zarr")
    found = yo_yos.logged(tmp_path / "shore.zarr")
    # as others computed it from the same files: 0.230 and 0.245
    assert np.median(found.down) == pytest.approx(0.23, abs=0.005)
    assert np.median(found.up) == pytest.approx(0.245, abs=0.005)
