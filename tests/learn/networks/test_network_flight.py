"""A trained run as an estimator of `twin flight`."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import twin
from learn.networks.network_estimator import NetworkFlight
from twin.errors import InputError, StoreError
from twin.logs.flight_estimator import ESTIMATORS

ROOT = Path(__file__).resolve().parents[3]
OLD = ROOT / "tests" / "data" / "e2ff189"
STORE = OLD / "simulated.zarr"


def test_the_velocities_are_those_of_the_run() -> None:
    estimator = NetworkFlight.open(str(OLD / "run"))
    found = twin.estimate_flight(STORE, estimator=estimator)
    assert found.estimator == "network"
    predicted = {one.mission: one for one in estimator.run.predict(STORE)}
    assert found.flown
    for one in found.missions:
        if one.dive.motion is None:
            continue
        step = round(estimator.run.period / found.store.period)
        surge = predicted[one.dive.mission].surge
        np.testing.assert_allclose(one.dive.motion.surge[::step][: len(surge)], surge, rtol=1e-6)
        assert np.isfinite(one.dive.motion.heave).all()
        under = one.dive.depth > 1.0
        assert np.hypot(*one.dive.velocity.T)[under].mean() > 0.1


def test_it_is_an_entry_point_and_needs_a_run(tmp_path: Path) -> None:
    points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    place = f"{NetworkFlight.__module__}:{NetworkFlight.__name__}"
    assert points[ESTIMATORS.group] == {NetworkFlight.kind: place}
    assert ESTIMATORS.check("network", NetworkFlight) is NetworkFlight
    with pytest.raises(InputError, match="network:runs/NAME"):
        NetworkFlight.open("")
    with pytest.raises((InputError, StoreError)):
        NetworkFlight.open(str(tmp_path))
