"""Current profiles of dives in a known sheared current, by cells whose errors are sampled."""

from types import SimpleNamespace

import numpy as np
import pytest
from logs import SHARED, stored

from twin.frames import euler_to_matrix
from twin.identify.calibration import load_calibration
from twin.logs.corrected_track import currents
from twin.logs.current_profile import current_profile
from twin.logs.track import Fixes
from twin.records.logged import CELLS
from twin.records.reader import MissionStore

COUNT, UNIT = 400, np.array([1.0, 1.0j])


def water(depth):
    """Current north + i east [m/s]: 0.25 m/s eastward in the upper 50 m."""
    return 0.1 * np.exp(-depth / 50.0) - 0.03 + 0.25j / (1.0 + np.exp((depth - 50.0) / 8.0))


def measured(**channels):
    return {f"measured_{k}": np.broadcast_to(v, COUNT) for k, v in channels.items()}


def solved(store, depth, model, moved, down):
    velocity, ends = np.stack([model.real, model.imag], 1), [[0.0, 0.0], [moved.real, moved.imag]]
    fixes = Fixes(sample=np.array([0, len(depth) - 1]), position=np.array(ends))
    (dac,) = currents(0, velocity, depth, store.period, fixes, 0.0)
    dive = SimpleNamespace(mission=0, depth=depth, velocity=velocity, motion=None)
    dive.descending, dive.ascending = down, ~down
    return current_profile(store, dive, load_calibration("slocum-200"), dac), dac


def flown(seed, *, offset=0.0, headings=(30.0, 150.0), farther=0.0, bottom=None):
    """Profile of a dive to 120 m whose compass errs by `offset` [degree]; errors by deviations.
    `bottom`: depth [m] below which the Doppler log sees the bottom."""
    rng, down = np.random.default_rng(seed), np.arange(COUNT) < COUNT // 2
    depth = 120.0 * (1.0 - np.abs(np.arange(COUNT) - 200.0) / 200.0)
    heading = np.where(down, *headings) + 3.0 * np.sin(np.arange(COUNT) / 20.0)
    turn, below = np.exp(1j * np.radians(heading)), np.tile(3.0 + 2.0 * np.arange(10), (COUNT, 1))
    over = water(depth) + 0.3 * turn
    past = (over[:, None] - water(depth[:, None] + below)) / turn[:, None]
    past += rng.normal(0.0, 5e-4) * below + 0.03 * rng.normal(size=(COUNT, 10, 2)) @ UNIT
    wave = rng.normal(size=(COUNT, 2)) @ UNIT
    for k in range(1, COUNT):  # errors of the model last 300 s
        wave[k] = (1.0 - 4.0 / 300.0) * wave[k - 1] + np.sqrt(8.0 / 300.0) * wave[k]
    speed = 0.3 + np.where(down, *rng.normal(0.0, 0.02, 2))
    model = speed * turn * np.exp(-1j * np.radians(offset)) + 0.02 * wave
    moved = np.trapezoid(over, dx=4.0) + farther + np.sqrt(50.0) * (rng.normal(size=2) @ UNIT)
    store = type("Store", (dict,), {"period": 4.0, "row": lambda self, name, _: self[name]})()
    store |= zip(
        (*CELLS, "measured_heading"), (past.real, past.imag, below, heading - offset), strict=True
    )
    if bottom is not None:
        seen = over / turn + 0.005 * rng.normal(size=(COUNT, 2)) @ UNIT
        seen[depth < bottom] = np.nan
        rolled = np.radians(20.0)  # in the hull's axes, of a hull that rolls to starboard
        store |= measured(bottom_surge=seen.real, bottom_sway=seen.imag * np.cos(rolled))
        store |= measured(bottom_heave=-seen.imag * np.sin(rolled), roll=20.0, pitch=0.0)
    found, _ = solved(store, depth, model, moved, down)
    truth = water(found.depth)
    return found, (found.current - np.stack([truth.real, truth.imag], axis=1)) / found.deviation


def test_the_current_is_found_within_its_deviations_whatever_the_compass():
    offsets, ways = np.random.default_rng(0).normal(0.0, 2.0, 40), ((30.0, 150.0), (30.0, 30.0))
    scores = [flown(k, offset=o, headings=ways[k % 2])[1] for k, o in enumerate(offsets)]
    # nodes of a dive err alike, so that 40 dives give the root mean square to 10 %
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.25)
    # an offset looks like a steady current: its prior, 2 degree, has to hold it
    assert np.sqrt(np.mean([flown(k, offset=5.0)[1] ** 2 for k in range(10)])) < 2.0


def test_an_eastward_current_of_the_upper_50_m_is_eastward_and_there():
    found, _ = flown(1)
    north, east = found.current.T
    assert (east[found.depth < 35.0] > 0.15).all()
    assert (np.abs(east[found.depth > 70.0]) < 0.05).all()
    assert north[found.depth < 20.0].mean() > 0.04 + north[found.depth > 100.0].mean()


def test_fixes_close_the_mean():
    shift = flown(2, farther=80.0 - 40.0j)[0].current - flown(2)[0].current
    assert 4.0 * (COUNT - 1) * shift.mean(axis=0) == pytest.approx([80.0, -40.0], rel=0.05)


def test_bottom_track_narrows_the_current_and_its_deviations_hold():
    blind, seeing = (flown(3, offset=5.0, bottom=b)[0] for b in (None, 60.0))
    deep = seeing.depth > 70.0
    assert (seeing.deviation[deep] < blind.deviation[deep]).all()
    scores = [flown(k, offset=5.0, bottom=60.0)[1] for k in range(20)]
    assert np.sqrt(np.mean(np.square(scores))) < 1.25


@pytest.mark.parametrize("run", [1, 2])
def test_fixes_tell_a_real_auv_what_its_bottom_track_tells(run, tmp_path, monkeypatch):
    path = SHARED / "auv_remus600_ooi_2014" / f"remus600_run{run}.pd0"
    if not path.is_file():
        pytest.skip("needs the shared real logs")
    store = MissionStore(stored(tmp_path / "real.zarr", "pd0", [path]))
    angles = [np.radians(store.row(f"measured_{n}", 0)) for n in ("roll", "pitch", "heading")]

    def level(source):
        body = np.stack([store.row(f"{source}_{n}", 0) for n in ("surge", "sway", "heave")])
        ned = np.array([1.0, 1.0j, 0.0]) @ np.einsum("tij,jt->it", euler_to_matrix(*angles), body)
        known = np.flatnonzero(np.isfinite(ned))
        return np.interp(np.arange(len(ned)), known, ned[known])

    over, depth = level("measured_bottom"), store.row("measured_depth", 0).astype(float)
    moved = np.trapezoid(over, dx=store.period)
    flown = depth, level("measured_dvl"), moved, np.zeros(len(depth), bool)
    seen, dac = solved(store, *flown)
    monkeypatch.setattr("twin.logs.current_profile.OVER_BOTTOM", ("none",))
    found, _ = solved(store, *flown)
    scores = (found.current - seen.current) / found.deviation
    assert np.sqrt(np.mean(scores**2)) < 1.25
    ahead, starboard, below = (store.row(n, 0).astype(float) for n in CELLS)
    each = over[:, None] - (ahead + 1j * starboard) * np.exp(1j * angles[2])[:, None]
    at = np.rint((depth[:, None] + below - found.depth[0]) / np.diff(found.depth)[0])
    nodes = np.unique(at[np.isfinite(at)]).astype(int)
    misses = [found.current[k] @ UNIT - np.mean(each[at == k]) for k in nodes]
    rivals = [dac.north + 1j * dac.east - np.mean(each[at == k]) for k in nodes]
    assert np.linalg.norm(misses) < np.linalg.norm(rivals)
