"""Parts and laws that a program puts into a vehicle file."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import twin
from twin.errors import InputError
from twin.mission.segments import Hold
from twin.physics.mujoco_model import compile_model
from twin.vehicle.additions import with_law, with_part
from twin.vehicle.presets import vehicle_names

FIN: dict[str, Any] = {
    "kind": "fin",
    "travel": (-0.3, 0.3),
    "lag": 0.3,
    "rate": 0.5,
    "place": (-0.9, 0.1, -0.2),
    "numbers": {"axis": (0.0, 0.0, 1.0), "area": 0.02, "lift_slope": 3.0},
}


@pytest.mark.parametrize("name", vehicle_names())
def test_every_shipped_vehicle_takes_a_part_and_its_file_stands_alone(name, tmp_path):
    vehicle = with_part(name, "tail", **FIN)
    path = tmp_path / "own.xml"
    path.write_text(vehicle.xml)
    again = twin.load_vehicle(path)
    assert again.part_names == (*twin.load_vehicle(name).part_names, "tail")
    part = again.part("tail")
    assert (part.low, part.high, part.lag, part.rate) == (-0.3, 0.3, 0.3, 0.5)
    assert part.position == (-0.9, 0.1, -0.2)
    model = compile_model(again)
    assert model.nu == len(again.parts)
    assert isinstance(model, mujoco.MjModel)


def test_comments_which_have_the_sources_stay():
    text = twin.load_vehicle("rogue").xml
    found = with_part("rogue", "tail", **FIN).xml
    assert found.count("<!--") == text.count("<!--")
    assert found.startswith(text[: text.index("<mujoco")])


def test_a_pose_of_the_file_has_the_part_at_rest():
    model = compile_model(with_part("glider", "tail", **FIN))
    assert model.nkey == 4
    assert (model.key_act[:, -1] == 0.0).all()
    held = with_part(
        "glider", "weight", kind="drop-weight", travel=(0.0, 1.0), lag=0.5, rate=1.0,
        numbers={"mass": 1.0},
    )  # fmt: skip
    assert (compile_model(held).key_act[:, -1] == held.part("weight").rest).all()


def test_a_mission_commands_the_part_and_guidance_steers_with_it():
    vehicle = with_part("glider", "tail", **FIN, steers=["heading"])
    assert vehicle.steered("heading") is vehicle.part("tail")
    hold = Hold(net_mass_kg=0.3, shift_m=0.02, parts={"tail": 0.2}, duration_s=60.0)
    run = twin.simulate(vehicle=vehicle, mission=twin.Mission(segments=[hold], at_end="hold"))
    assert run["true_tail"][-1] == pytest.approx(np.degrees(0.2), abs=1e-6)
    assert abs(run["true_yaw_rate"][-1]) > 1e-3


def test_a_law_replaces_the_files_own_and_its_numbers():
    vehicle = with_law("graver-2005", "body-axes", {"Xuu": -5.0, "Yvv": -50.0, "Zww": -60.0})
    assert vehicle.law.kind == "body-axes"
    again = with_law(vehicle, "body-axes", {"Xuu": -7.0})
    assert again.xml.count('name="Xuu"') == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "fim"}, "did you mean 'fin'"),
        ({"kind": "battery-slide"}, "moves a mass on a joint"),
        ({"numbers": {"axis": (0.0, 0.0, 1.0), "area": 0.02}}, "tail.lift_slope"),
        ({"numbers": {**FIN["numbers"], "aera": 1.0}}, "did you mean 'tail.area'"),
        ({"travel": (0.3, -0.3)}, "actrange"),
        ({"lag": "slow"}, "lag is 'slow': give a number"),
        ({"steers": ["depth"]}, "unknown steers 'depth'"),
    ],
)
def test_what_is_wrong_is_named(change, message):
    with pytest.raises(InputError, match=message):
        with_part("glider", "tail", **{**FIN, **change})


def test_a_second_part_of_a_name_and_values_beside_the_file_are_refused():
    vehicle = with_part("glider", "tail", **FIN)
    with pytest.raises(InputError, match="'tail' of two"):
        with_part(vehicle, "tail", **FIN)
    changed = vehicle.replace(hull_compressibility=1e-10)
    with pytest.raises(InputError, match=r"other values than its file \(hull_compressibility\)"):
        with_part(changed, "other", **FIN)
    assert Path(vehicle.path).name == "glider.xml"
