"""Models of a drag that falls with speed and of a constant one are told apart."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.real_logs.drag_exponent import FALLS
from benchmarks.real_logs.public import USUAL, SteadyModel, fit_balance


def _dive(pump: float, model: SteadyModel) -> tuple[SimpleNamespace, np.ndarray, np.ndarray]:
    steady = np.repeat([-0.3, -0.6, -0.9], 200)
    pitch = np.concatenate([steady, -steady])
    count = pitch.size
    dive = SimpleNamespace(
        depth=np.full(count, 50.0), use=np.ones(count, bool),
        pump=np.where(pitch < 0.0, -pump, pump), period=1.0,
    )  # fmt: skip
    density = np.full(count, 1027.0)
    dive.depth_rate = model.fly(dive, pitch, density).sink
    return dive, pitch, density


@pytest.mark.parametrize("true", [0.0, 0.5])
def test_the_power_that_made_the_dives_fits_best(true):
    model = SteadyModel(mass=52.0, volume=52.0 / 1027.0, drag=0.12, fall=true)
    columns = zip(*[_dive(pump, model) for pump in (60.0, 120.0, 300.0)], strict=True)
    dives, pitches, densities = map(list, columns)
    errors = {}
    for fall in FALLS:
        start = SteadyModel(mass=52.0, volume=0.0, drag=0.2, fall=fall)
        found = fit_balance(dives, pitches, densities, start)
        rates = [found.fly(*each).sink for each in zip(dives, pitches, densities, strict=True)]
        missed = np.concatenate(rates) - np.concatenate([dive.depth_rate for dive in dives])
        errors[fall] = float(np.sqrt(np.mean(missed**2)))
    assert min(errors, key=errors.get) == true
    assert errors[true] < 1e-5 < 1e-3 < min(e for fall, e in errors.items() if fall != true)


def test_a_falling_coefficient_is_the_constant_one_at_the_usual_speed():
    constant = SteadyModel(mass=52.0, volume=52.0 / 1027.0, drag=0.12)
    falling = SteadyModel(mass=52.0, volume=52.0 / 1027.0, drag=0.12, fall=0.5)
    _, pitch, density = _dive(100.0, constant)
    slow, fast = (SimpleNamespace(pump=np.sign(pitch) * pump) for pump in (20.0, 600.0))
    for dive, sign in ((slow, -1.0), (fast, 1.0)):
        ratio = falling.fly(dive, pitch, density).speed / constant.fly(dive, pitch, density).speed
        side = np.sign(constant.fly(dive, pitch, density).speed - USUAL)
        assert (side == sign).all()
        assert ((ratio - 1.0) * sign > 0.0).all()
