"""A detector of faults learns what a fault does to the channels, and since when there is one."""

import math

import numpy as np
import pytest

from glider_twin_ops.health import FaultDetector
from glider_twin_ops.health.channels import NAMES, NOISE
from glider_twin_ops.health.fault_detector import FIRST, features
from twin.errors import InputError

DIVES, BEGUN = 30, 14
SHOWN = {"hotel_raised": ("hotel", 0.4), "wing_lost": ("roll_climb", 3.0)}


def deployment(seed, kind):
    rng = np.random.default_rng(seed)
    values = 5.0 + NOISE * rng.standard_normal((DIVES, len(NAMES)))
    values[:, NAMES.index("lock")] = math.nan
    if kind != "none":
        name, size = SHOWN[kind]
        values[BEGUN:, NAMES.index(name)] += size
    return values


@pytest.fixture(scope="module")
def detector():
    kinds = ["none", *SHOWN] * 6
    values = [deployment(seed, kind) for seed, kind in enumerate(kinds)]
    onsets = [None if kind == "none" else BEGUN for kind in kinds]
    return FaultDetector.fit(values, kinds, onsets, seed=3)


@pytest.mark.parametrize("kind", SHOWN)
def test_it_calls_a_fault_by_its_name_and_not_before_it_begins(detector, kind):
    odds, named = detector.judge(deployment(100, kind))
    assert (odds[:BEGUN] < 0.0).all()
    assert (odds[BEGUN + 3 :] > 2.0).all()
    assert named[-1] == kind
    assert np.isneginf(odds[:FIRST]).all()


def test_a_sound_vehicle_is_sound(detector):
    assert max(detector.judge(deployment(seed, "none"))[0].max() for seed in range(90, 96)) < 2.0


def test_what_it_sees_knows_no_later_dive_and_no_level():
    values = deployment(1, "wing_lost")
    told = features(values)
    assert np.isfinite(told).all()
    np.testing.assert_allclose(features(values[:20]), told[:20], atol=1e-12)
    np.testing.assert_allclose(features(values + 3.0), told, atol=1e-6)


def test_it_needs_both_sound_deployments_and_faults():
    with pytest.raises(InputError, match="with a fault and sound ones"):
        FaultDetector.fit([deployment(0, "none")], ["none"], [None])
