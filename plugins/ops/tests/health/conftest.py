"""A Slocum's usual dive, what faults do to its channels, and deployments of noise."""

from types import SimpleNamespace

import numpy as np
import pytest

import twin
from glider_twin_ops.health.assessment import flown_signatures, judged
from glider_twin_ops.health.channels import NAMES, NOISE
from glider_twin_ops.health.signatures import usual_dive


@pytest.fixture(scope="session")
def slocum():
    """Vehicle, dive, signatures; `fault` of a kind, `judge` of channels after whose dives."""
    vehicle = twin.load_vehicle("slocum-200")
    dive = usual_dive(vehicle)
    signatures = flown_signatures(vehicle, dive)

    def fault(kind):
        return next(h for h in signatures.hypotheses if h.kind == kind)

    def judge(values, ways=np.nan, threshold=3.0, **said):
        count = len(values)
        usual = {"name": "one", "numbers": range(1, count + 1), "time": 1.08e4 * np.arange(count)}
        ways = ways if np.ndim(ways) else np.full((count, 2), ways)
        usual |= {"dive": dive, "vehicle": vehicle, "threshold": threshold}
        return judged(values=values, ways=ways, **usual | said)

    return SimpleNamespace(
        vehicle=vehicle, dive=dive, signatures=signatures, fault=fault, judge=judge
    )


@pytest.fixture(scope="session")
def noise():
    """Channels of a sound vehicle without walks, (count, channels)."""
    return lambda seed=1, count=20: (
        NOISE * np.random.default_rng(seed).standard_normal((count, len(NAMES)))
    )
