"""A vehicle from its dimensions: Lamb's table, published vehicles, and what cannot be."""

from typing import Any

import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.vehicle import Dimensions
from twin.vehicle.dimensions import _lamb


@pytest.mark.parametrize(
    ("slenderness", "along", "across", "turning"),
    [(1.5, 0.305, 0.621, 0.094), (2.51, 0.156, 0.763, 0.367), (6.01, 0.045, 0.918, 0.764),
     (9.97, 0.021, 0.960, 0.883)],
)  # fmt: skip
def test_spheroids_are_those_of_lambs_table(slenderness, along, across, turning):
    """Lamb 1932, article 115, k1, k2 and k'."""
    assert _lamb(slenderness) == pytest.approx((along, across, turning), abs=2e-3)


def of(name: str, **known: float) -> tuple[Any, Any]:
    shipped = twin.load_vehicle(name)
    size = {"length": shipped.hull_length, "diameter": shipped.hull_diameter}
    return shipped, Dimensions(**size, mass=shipped.mass, **known).vehicle()


@pytest.mark.parametrize("name", ["remus", "tethys"])
def test_published_vehicles_are_near(name):
    published, made = of(name)
    assert made.mass == pytest.approx(published.mass)
    across = made.added_mass[1, 1] / published.added_mass[1, 1]
    assert 0.75 < across < 1.2
    ours, theirs = dict(made.law.derivatives), dict(published.law.derivatives)
    assert 0.5 < ours["Xuu"] / theirs["Xuu"] < 2.0
    for damping in ("Xuu", "Yvv", "Zww", "Nrr", "Mqq", "Nur", "Muq", "Kpp"):
        assert ours[damping] < 0.0, damping
    # fins turn the nose into the flow, and leave less than all of Munk's moment away from it
    munk = made.added_mass[1, 1] - made.added_mass[0, 0]
    assert 0.0 < ours["Nuv"] < munk
    assert -munk < ours["Muw"] < 0.0


def test_it_flies_straight_and_turns_to_port():
    _, made = of("remus", screw=0.14)

    def controller(seen: Any) -> twin.Command:
        return twin.Command(propeller=100.0, rudder=0.1 if seen.time > 30.0 else 0.0)

    scenario = twin.scenario_of(vehicle=made, duration=60.0, commanded=True)
    run = twin.simulate(scenario, controller=controller)
    assert run["true_surge"][29] > 0.5
    assert abs(run["true_yaw_rate"][29]) < 1e-6
    assert run["true_yaw_rate"][-1] < -0.01
    assert np.isfinite(run.states).all()


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ({"length": 1.3, "diameter": 0.19}, "mass missing"),
        ({"length": 1.3, "diameter": 0.19, "mas": 30.0}, "unknown dimension 'mas'"),
        ({"length": 0.3, "diameter": 0.19, "mass": 30.0}, "length over diameter is 1.6"),
        ({"length": 1.3, "diameter": 0.19, "mass": 300.0}, r"18\.9 to 56\.7 kg, not 300"),
        ({"length": 1.3, "diameter": 0.19, "mass": 30.0, "fin_place": 0.6}, "-0.65 m and 0"),
        ({"length": 1.3, "diameter": 0.19, "mass": 30.0, "density": 1.03}, "950 to 1100"),
    ],
)
def test_what_cannot_be_is_refused(numbers, says):
    with pytest.raises(InputError, match=says):
        Dimensions.of(numbers)
