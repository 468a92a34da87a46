"""Draws that no vehicle can fly are replaced or refused in a line, never a traceback."""

import numpy as np
import pytest

from factory.generation import shard
from factory.sampling.recipe import Recipe
from twin.errors import InputError, VehicleError
from twin.physics.mujoco_model import compile_model
from twin.vehicle.vehicle import load_vehicle


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("vehicle.cg_y_mm", "1e12"),
        ("vehicle.cg_z_mm", "-1e12"),
        ("vehicle.compressibility", "1"),
        ("mission.pitch_deg", "1e12"),
    ],
)
def test_what_nothing_can_fly_is_refused_by_name(name, text, monkeypatch):
    monkeypatch.setattr(shard, "MAX_ATTEMPTS", 2)
    vehicle = load_vehicle("glider")
    with pytest.raises(InputError, match=name.replace(".", r"\.")) as raised:
        shard.fly_missions(Recipe(changes={name: text}, vehicle=vehicle, hours=0.1), [0])
    assert "\n" not in str(raised.value)


def test_an_inertia_that_cannot_be_solved_for_is_refused():
    glider = load_vehicle("glider")
    with pytest.raises(VehicleError, match="Inertia matrix is too close to singular"):
        compile_model(glider.replace(static_cg=np.array([0.0, 1e9, 0.0])))
