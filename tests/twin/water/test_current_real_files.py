"""Gridded currents on real files, where they are at hand (see CONTRIBUTING)."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from twin.errors import CurrentError
from twin.water.current import Grid, current_from_dict
from twin.water.current.sampler import sample_track

FOLDER = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "currents"
ATLANTIC = FOLDER / "nemo_orca025_ne_atlantic_200001.nc"
MONTEREY = FOLDER / "monterey_bay_las_20030801_1km.nc"

pytestmark = pytest.mark.skipif(
    not (ATLANTIC.exists() and MONTEREY.exists()),
    reason="the real current files are not beside the repository (../shared/data/currents)",
)

PLACE = {"latitude_deg": 49.0, "longitude_deg": -16.0}


def test_the_profile_at_49_north_16_west():
    """Speeds published with the file's description, January mean."""
    grid = Grid(path=str(ATLANTIC), time="2000-01-02T12:00", **PLACE)
    t = 86400.0 * np.arange(0.0, 25.1, 5.0)
    depth = np.array([0.0, 31.0, 334.0, 697.0, 1387.0])
    u = grid.velocity(t[:, None], 0.0, 0.0, depth)
    with xr.open_dataset(ATLANTIC) as data:
        point = data.sel(latitude=49.0, longitude=-16.0)
        judge = point.interp(depth=np.maximum(depth, float(point.depth[0])))
        np.testing.assert_allclose(u[..., 1], judge.uo.values, atol=1e-6)
        np.testing.assert_allclose(u[..., 0], judge.vo.values, atol=1e-6)


def test_the_rate_along_a_glide_through_the_real_field():
    program = Grid(path=str(ATLANTIC), time="2000-01-05", **PLACE).compile(36_000.0)
    random = np.random.default_rng(1)
    n, step = 500, 1e-3
    point = np.ascontiguousarray(random.uniform([0, -1e4, -1e4, 1], [36_000, 1e4, 1e4, 1500],
                                                (n, 4)).T)  # fmt: skip
    velocity = np.ascontiguousarray(random.uniform(-0.5, 0.5, (n, 3)).T)
    move = np.vstack([np.ones(n), velocity]) * step
    ahead = sample_track(program, *(point + move), *velocity)[:, :3]
    behind = sample_track(program, *(point - move), *velocity)[:, :3]
    rate = sample_track(program, *point, *velocity)[:, 3:]
    np.testing.assert_allclose(rate, (ahead - behind) / (2 * step), rtol=1e-6, atol=2e-12)


def test_a_snapshot_of_one_kilometre_serves_a_ten_hour_mission():
    grid = Grid(path=str(MONTEREY), latitude_deg=36.807, longitude_deg=-121.824)
    speed = np.linalg.norm(grid.velocity(36_000.0, 0.0, 0.0, np.linspace(0, 60, 30)), axis=-1)
    assert 0.005 < speed.max() < 0.2
    pinned = grid.pinned(36_000.0)
    rebuilt = current_from_dict(pinned.describe())
    assert rebuilt.compile(36_000.0).tobytes() == grid.compile(36_000.0).tobytes()
    with pytest.raises(CurrentError, match=r"only time of .* is 2003-08-01T03:00:00"):
        Grid(path=str(MONTEREY), latitude_deg=36.807, longitude_deg=-121.824,
             time="2003-08-03").compile(60.0)  # fmt: skip
