"""Still water takes energy and gives none: every shipped vehicle, and laws that would give some."""

import dataclasses

import numpy as np
import pytest
from torpedo import TORPEDO

from twin.checks.passivity import LARGEST_GAIN, MODELS, check_passivity, energy_gains
from twin.vehicle.laws import BodyAxes
from twin.vehicle.laws.body_axes import lifting
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import load_vehicle

ASTERN_AND_ROLLING = np.array([[-0.5, 0.0, 0.0, 2.0, 0.0, 0.0]])


@pytest.mark.parametrize("name", vehicle_names())
def test_no_shipped_vehicle_gains_energy_from_still_water(name):
    found = check_passivity(load_vehicle(name))
    assert [decay.model for decay in found] == list(MODELS)
    assert all(decay.ok for decay in found), found


@pytest.mark.parametrize("model", MODELS)
def test_fins_at_the_ends_of_their_travel_give_none_either(model):
    for name in ("remus", "tethys"):
        vehicle = load_vehicle(name)
        turned = np.where([part.spins for part in vehicle.parts], 0.0, vehicle.rest)
        for part in ("rudder", "elevator"):
            turned[vehicle.part_names.index(part)] = vehicle.part(part).high
        starts = np.array([[s, 0.3 * c, 0.2, 0.1, c, -s] for s in (1.0, -1.0) for c in (0.5, -2)])
        assert energy_gains(vehicle, starts, model, turned).max() <= LARGEST_GAIN


@pytest.mark.parametrize("model", MODELS)
def test_roll_damping_that_drives_astern_is_found(model):
    """As printed, Kup u p drives a hull that rolls while it goes astern."""
    tethys = load_vehicle("tethys")
    assert isinstance(tethys.law, BodyAxes)
    printed = tuple(pair for pair in tethys.law.derivatives if lifting(pair[0]))
    bilinear = tethys.replace(law=dataclasses.replace(tethys.law, coupling=printed))
    assert energy_gains(bilinear, ASTERN_AND_ROLLING, model)[0] > 0.01
    assert energy_gains(tethys, ASTERN_AND_ROLLING, model)[0] == 0.0
    assert not all(decay.ok for decay in check_passivity(bilinear))


def test_ahead_the_law_is_as_printed_and_astern_its_lift_is_mirrored():
    law = load_vehicle("remus").law
    assert isinstance(law, BodyAxes)
    every = dict(law.derivatives)
    ahead = law.wrench(np.array([1.5, 0.1, 0.0, 0.0, 0.0, 0.2]), 1030.0)
    yaw = every["Nuv"] * 0.15 + every["Nur"] * 0.3 + every["Nvv"] * 0.01 + every["Nrr"] * 0.04
    assert ahead[5] == pytest.approx(yaw, rel=1e-12)
    # M_A of the file: Munk's moment (Yvdot - Xudot) u v and Yrdot u r keep their sign with u
    munk, along = 0.93 - 35.5, 1.93
    astern = law.wrench(np.array([-1.5, 0.1, 0.0, 0.0, 0.0, 0.2]), 1030.0)
    mirrored = -munk * 0.15 - along * 0.3
    mirrored += (every["Nuv"] - munk) * 0.15 + (every["Nur"] - along) * 0.3
    assert astern[5] == pytest.approx(mirrored + every["Nvv"] * 0.01 + every["Nrr"] * 0.04)


def test_cross_flow_drag_keeps_a_tumbling_hull_from_gaining():
    graver = load_vehicle("graver-2005")
    found = check_passivity(graver.replace(cross_flow_drag=0.0))
    assert all(decay.gain > 0.1 for decay in found)
    line = found[0].text(graver)
    assert "'graver-2005' gains" in line
    assert "still water" in line


def test_a_law_of_ones_own_is_checked_by_its_own_code():
    torpedo = load_vehicle(TORPEDO)
    assert all(decay.ok for decay in check_passivity(torpedo))
    law = torpedo.law
    assert isinstance(law, BodyAxes)
    driven = dict(law.derivatives) | {"Kup": 2.0}
    wrong = torpedo.replace(law=dataclasses.replace(law, derivatives=tuple(driven.items())))
    assert not any(decay.ok for decay in check_passivity(wrong))
