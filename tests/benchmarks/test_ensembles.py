"""Ensembles of a Doppler log that the test writes: angle of attack by pitch, and its interval."""

import numpy as np
import pd0_files
import pytest

from benchmarks.real_logs.ensembles import attack_by_pitch, read_ensembles
from benchmarks.real_logs.row import central


@pytest.fixture
def path(tmp_path):
    """A dive and a climb with other angles of attack, with noise of single ensembles."""
    rng = np.random.default_rng(3)
    rows = pd0_files.yo(1200, attack=(3.5, -2.0), pitch=25.5)
    rows = [{**row, "noise": 0.03 * rng.standard_normal(4)} for row in rows]
    return pd0_files.write(tmp_path / "a.pd0", rows)


def test_dives_and_climbs_have_their_own_angle_of_attack(path):
    found = read_ensembles(path)
    assert len(found.time) > 1150
    bins = attack_by_pitch(found)
    assert list(bins) == [-26, 25]
    down, up = bins.values()
    assert (down.pitch, up.pitch) == (pytest.approx(-25.5), pytest.approx(25.5))
    assert down.attack == pytest.approx(3.5, abs=0.4)
    assert up.attack == pytest.approx(-2.0, abs=0.4)
    # independent noise: the interval is four standard errors wide
    heave = 0.03 * np.tan(np.radians(30.0)) / np.sqrt(2.0) / np.sin(np.radians(30.0)) / np.sqrt(2.0)
    width = 4.0 * np.degrees(heave / 0.4) / np.sqrt(down.ensembles)
    low, high = central(down.draws)
    assert high - low == pytest.approx(width, rel=0.3)
    assert low < down.attack < high


def test_bins_with_few_ensembles_are_left_out(path):
    assert attack_by_pitch(read_ensembles(path), least=700) == {}


def test_tighter_thresholds_keep_a_part_of_the_ensembles(path):
    every, tight = read_ensembles(path), read_ensembles(path, 0.2)
    assert 0 < len(tight.time) < len(every.time)
    assert set(tight.time) < set(every.time)
