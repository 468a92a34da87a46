"""Normalisation: scales of what networks see."""

import numpy as np
import pytest

from learn.data.sequences import NormalisationFit


def test_normalisation_gives_unit_inputs_and_leaves_constants_alone():
    rng = np.random.default_rng(0)
    matrices = [rng.normal(3.0, 2.0, (500, 2)).astype(np.float32) for _ in range(3)]
    matrices = [np.concatenate([m, np.full((500, 1), 7.0, np.float32)], 1) for m in matrices]
    targets = [rng.normal(0.3, 0.1, 500).astype(np.float32) for _ in range(3)]
    fitted = NormalisationFit(("a", "b", "c"), "surge")
    for matrix, wanted in zip(matrices, targets, strict=True):
        fitted.add(matrix, wanted)
    found = fitted.result()
    values = found.inputs(np.concatenate(matrices))
    assert np.allclose(values.mean(0), 0.0, atol=1e-4)
    assert np.allclose(values.std(0), [1.0, 1.0, 0.0], atol=1e-4)
    assert found.scale[2] == 1.0
    everything = np.concatenate(targets).astype(float)
    assert found.target_mean == pytest.approx(everything.mean(), rel=1e-13)
    assert found.target_scale == pytest.approx(everything.std(), rel=1e-13)
    deviations = np.concatenate(matrices).astype(float).std(0)
    assert found.scale[:2] == pytest.approx(deviations[:2], rel=1e-13)
