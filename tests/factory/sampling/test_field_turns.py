"""Missions of preset `field` turn as the gliders of real logs do."""

import numpy as np
import pytest

from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe

HOURS = 4.0


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    path = tmp_path_factory.mktemp("turns") / "field.zarr"
    generate(make_recipe(preset="field", hours=HOURS, seed=5), path, workers=2)
    return GeneratedStore(path)


def flown(store, *names):
    """Signals of all missions one after the other."""
    return [
        np.concatenate([store.row(name, m)[: int(store.samples[m])] for m in range(len(store))])
        for name in names
    ]


def test_turn_rate_follows_the_battery_one_way_in_dives_and_the_other_in_climbs(store):
    """In 7 of 7 Seagliders and a SeaExplorer it does."""
    names = ("true_yaw_rate", "true_rotation", "true_roll", "true_pump", "true_depth")
    turn, rotation, roll, pump, depth = flown(store, *names)
    for phase, sign in ((pump < -100.0, 1.0), (pump > 100.0, -1.0)):
        under = phase & (depth > 5.0)
        assert np.count_nonzero(under) > 1000
        assert sign * np.corrcoef(turn[under], rotation[under])[0, 1] > 0.5
        # a battery to port rolls the hull to port in both phases
        assert np.corrcoef(roll[under], rotation[under])[0, 1] < -0.5


def test_guidance_knows_which_way_its_vehicle_turns(store):
    """So a heading is held in climbs as in dives, though the real vehicle is another."""
    heading, wanted, pump, depth = flown(
        store, "true_heading", "commanded_heading", "true_pump", "true_depth"
    )
    error = np.abs((heading - wanted + 180.0) % 360.0 - 180.0)
    for phase in (pump < -100.0, pump > 100.0):
        under = phase & (depth > 5.0) & np.isfinite(wanted)
        assert np.median(error[under]) < 5.0
