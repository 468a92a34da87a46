"""Normalisation: scales of what networks see."""

import numpy as np
import pytest

from learn.data.normalisation import fit_normalisation


def test_normalisation_gives_unit_inputs_and_leaves_constants_alone():
    rng = np.random.default_rng(0)
    matrices = [rng.normal(3.0, 2.0, (500, 2)).astype(np.float32) for _ in range(3)]
    matrices = [np.concatenate([m, np.full((500, 1), 7.0, np.float32)], 1) for m in matrices]
    targets = [rng.normal(0.3, 0.1, 500).astype(np.float32) for _ in range(3)]
    found = fit_normalisation(matrices, targets, features=("a", "b", "c"), target="surge")
    values = found.inputs(np.concatenate(matrices))
    assert np.allclose(values.mean(0), 0.0, atol=1e-4)
    assert np.allclose(values.std(0), [1.0, 1.0, 0.0], atol=1e-4)
    assert found.scale[2] == 1.0
    assert found.target_scale == pytest.approx(0.1, rel=0.1)
