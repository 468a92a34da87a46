"""GPS fixes: where the antenna is, when the first one comes, how far off they are."""

import numpy as np
import pytest

from twin.errors import InputError
from twin.sensors import Gps

DT = 0.5
SIGMA = {"gps_sigma": 4.0}


def float_and_dive(*stays, n=8000):
    """Truth with the hull breaking the surface in the given [start, stop) seconds."""
    immersion, depth = np.ones(n), np.full(n, 20.0)
    for start, stop in stays:
        piece = slice(round(start / DT), round(stop / DT))
        immersion[piece], depth[piece] = 0.992, 0.1
    return {
        "true_immersion": immersion, "true_depth": depth, "true_roll": np.zeros(n),
        "true_pitch": np.zeros(n), "true_north": np.linspace(0.0, 900.0, n),
        "true_east": np.linspace(0.0, -500.0, n),
    }  # fmt: skip


def fixes(gps, truth, seed=0, drawn=SIGMA):
    out = gps.measure(truth, dt=DT, drawn=drawn, rng=np.random.default_rng(seed))
    north, east = out["measured_gps_north"], out["measured_gps_east"]
    assert np.array_equal(np.isnan(north), np.isnan(east))
    return north, east


def test_fixes_come_only_at_the_surface_and_after_the_time_to_first_fix():
    truth = float_and_dive((1000.0, 1500.0), (3000.0, 3020.0))
    waits = []
    for seed in range(300):
        north, _ = fixes(Gps(), truth, seed)
        at = np.flatnonzero(np.isfinite(north)) * DT
        assert at.max() < 1500.0  # the second stay is shorter than any time to first fix
        waits.append(at.min() - 1000.0)
        assert np.allclose(np.diff(at), 1.0)
    assert min(waits) >= 30.0
    assert max(waits) <= 120.5
    assert np.mean(waits) == pytest.approx(75.0, abs=5.0)


def test_a_mission_that_starts_at_the_surface_has_its_fix():
    truth = float_and_dive((0.0, 60.0))
    assert np.isfinite(fixes(Gps(), truth)[0][0])
    waiting = Gps(tracking_at_start=False, first_fix_min=40.0, first_fix_max=40.0)
    at = np.flatnonzero(np.isfinite(fixes(waiting, truth)[0]))
    assert at[0] == round(40.0 / DT)


def test_short_dips_do_not_restart_the_search():
    truth = float_and_dive((1000.0, 1130.0), (1133.0, 1200.0), (1300.0, 1325.0))
    north, _ = fixes(Gps(fix_interval=0.0), truth)
    at = np.flatnonzero(np.isfinite(north)) * DT
    assert np.isnan(north[round(1130.0 / DT) : round(1133.0 / DT)]).all()
    assert np.isfinite(north[round(1133.0 / DT) : round(1200.0 / DT)]).all()
    assert at.max() < 1200.0


def test_error_has_the_drawn_sigma_and_is_correlated():
    n = 400_000
    truth = float_and_dive((0.0, n * DT), n=n)
    north, east = fixes(Gps(fix_interval=0.0), truth)
    error = north - truth["true_north"]
    assert error.std() == pytest.approx(4.0, rel=0.08)
    assert (east - truth["true_east"]).std() == pytest.approx(4.0, rel=0.08)
    lag = round(120.0 / DT)
    assert np.corrcoef(error[:-lag], error[lag:])[0, 1] == pytest.approx(np.exp(-1), abs=0.08)
    sigmas = [Gps().draw(np.random.default_rng(s))["gps_sigma"] for s in range(500)]
    assert 3.0 <= min(sigmas) < 3.1
    assert 4.9 < max(sigmas) <= 5.0


def test_ideal_is_exact_at_once_and_still_blind_below():
    truth = float_and_dive((1000.0, 1500.0))
    north, east = fixes(Gps.ideal(), truth, drawn={"gps_sigma": 0.0})
    wet = truth["true_immersion"] == 1.0
    assert np.isnan(north[wet]).all()
    assert np.array_equal(north[~wet], truth["true_north"][~wet])
    assert np.array_equal(east[~wet], truth["true_east"][~wet])


def test_a_tail_antenna_needs_the_nose_down():
    truth = float_and_dive((0.0, 4000.0))
    tail = Gps(antenna_position=(-1.45, 0.0, -0.03))
    assert not tail.at_surface(truth).any()  # level: 0.03 m above the axis, which is 0.1 m deep
    truth["true_pitch"][:] = -30.0
    assert tail.at_surface(truth).all()
    truth["true_pitch"][:] = 30.0
    assert not tail.at_surface(truth).any()


def test_wrong_settings_are_explained():
    with pytest.raises(InputError, match="above first_fix_max 120: swap them"):
        Gps(first_fix_min=200.0)
    with pytest.raises(InputError, match=r"antenna_position is nan"):
        Gps(antenna_position=(0.0, 0.0, np.nan))
