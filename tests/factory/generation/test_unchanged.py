"""Nothing moves unsaid: the arrays of an hour of each preset are those of this physics.

A change on purpose counts up `PHYSICS_VERSION` and keeps the new hashes
(`python -m benchmarks.arrays --write`); docs/physics/versions.md shows it. Ten hours of
each are compared by `python -m benchmarks.arrays`. Another version of MuJoCo, numba or
numpy may change last bits; with the pinned ones a difference is a changed simulation.
"""

import pytest
from unchanged import PRESETS, SEED, differences, expected_hashes

from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from twin.records.storage.checksums import array_checksums


@pytest.mark.parametrize("preset", PRESETS)
def test_an_hour_has_the_same_arrays(tmp_path, preset):
    store = tmp_path / "missions.zarr"
    generate(make_recipe(preset=preset, hours=1.0, seed=SEED), store, workers=2)
    assert differences(array_checksums(store), expected_hashes(1, preset)) == []


def test_a_changed_array_is_named():
    kept = expected_hashes(1, "paper")
    assert differences({**kept, "true_surge": "other"}, kept) == ["true_surge"]
    assert differences({**kept, "new": "x"}, kept) == ["new"]
