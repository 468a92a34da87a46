"""Presets of a vehicle file: other numbers of one vehicle, each a complete MJCF text."""

import mujoco
import pytest

import twin
from twin.__main__ import PROGRAM
from twin.errors import VehicleError
from twin.records.mission_dataset import dataset_of
from twin.records.reader import MissionStore
from twin.records.store import write_store
from twin.vehicle.presets import apply_preset, asset_path, preset_names, split_preset, vehicle_names
from twin.vehicle.vehicle import load_vehicle, parse_vehicle

TEXT = asset_path("tethys.xml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("tethys", ("tethys", "")),
        ("tethys:gazebo", ("tethys", "gazebo")),
        ("own/boat.xml:fast", ("own/boat.xml", "fast")),
        ("C:/own/boat.xml", ("C:/own/boat.xml", "")),
        ("C:boat.xml", ("C:boat.xml", "")),
        ("tethys:", ("tethys:", "")),
    ],
)
def test_a_preset_is_behind_the_last_colon(text, parts):
    assert split_preset(text) == parts


def test_the_file_as_it_stands_is_its_first_preset():
    usual, named = load_vehicle("tethys"), load_vehicle("tethys:mbari")
    assert preset_names(usual.xml, usual.path) == ("mbari", "gazebo")
    assert named.xml == usual.xml == TEXT
    assert named.name == usual.name == "tethys"
    # plain MuJoCo reads it, and has nothing but the first set in it
    model = mujoco.MjModel.from_xml_path(str(asset_path("tethys.xml")))
    assert model.nu == len(usual.parts)
    assert float(model.body("battery").mass[0]) == 26.0


def test_a_preset_is_a_complete_file_without_the_others():
    derived = load_vehicle("tethys:gazebo")
    assert derived.name == "tethys:gazebo"
    assert "tethys:gazebo" in vehicle_names()
    for left_over in ("presets", "gazebo:", "Muw"):
        assert f'name="{left_over}' not in derived.xml
    model = mujoco.MjModel.from_xml_string(derived.xml)
    assert float(model.body("battery").mass[0]) == derived.battery.mass == 31.7307
    assert float(model.site("rudder").pos[0]) == -1.05
    assert dict(derived.law.derivatives)["Xuu"] == -6.2282
    again = parse_vehicle(derived.xml, derived.path)
    assert again.changes() == {}
    assert "fins at 1.05 m" in again.summary


def test_a_preset_of_an_own_file(tmp_path):
    path = tmp_path / "boat.xml"
    path.write_text(TEXT.replace('data="mbari gazebo"', 'data="slow gazebo"'))
    vehicle = load_vehicle(f"{path}:gazebo")
    assert vehicle.name == "boat:gazebo"
    assert vehicle.battery.mass == 31.7307
    assert load_vehicle(f"{path}:slow").battery.mass == 26.0


def test_a_store_of_a_preset_needs_nothing_else(tmp_path):
    run = twin.simulate(vehicle="tethys:gazebo", mission="survey", duration=5.0)
    path = tmp_path / "run.zarr"
    write_store(dataset_of([run], attributes=run.provenance), path)
    with MissionStore(path) as store:
        flown = store.vehicle
    assert flown.name == "tethys:gazebo"
    assert flown.xml == load_vehicle("tethys:gazebo").xml


def test_unknown_presets_get_the_nearest_name(capsys):
    with pytest.raises(VehicleError, match="unknown preset 'gazeboo': did you mean 'gazebo'"):
        load_vehicle("tethys:gazeboo")
    with pytest.raises(VehicleError, match=r"glider\.xml has no presets"):
        load_vehicle("glider:gazebo")
    with pytest.raises(VehicleError, match="unknown vehicle 'thetys:gazebo': did you mean 'tethys"):
        load_vehicle("thetys:gazebo")
    for words in (("simulate",), ("trim",), ("check",)):
        assert PROGRAM.main([*words, "--vehicle", "tethys:gazbo"]) == 2
        assert "did you mean 'gazebo'" in capsys.readouterr().err


def changed(old, new):
    assert old in TEXT
    return TEXT.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="gazebo:Xuu"', 'name="gazbo:Xuu"', "unknown preset 'gazbo': did you mean 'gazebo'"),
        ('name="gazebo:Xuu"', 'name="mbari:Xuu"', "unknown preset 'mbari'.*lists them, after"),
        ('name="gazebo:Xuu"', 'name="gazebo:Xu"', "unknown <numeric> 'Xu': did you mean 'Xuu'"),
        ('without" data="Xvv', 'without" data="Xvvv', "unknown element 'Xvvv'"),
        ("site/rudder@pos", "site/ruder@pos", "unknown <site> 'ruder': did you mean 'rudder'"),
        ("site/rudder@pos", "site/rudder@poss", "unknown attribute 'poss': did you mean 'pos'"),
        ("body/hull/inertial@mass", "body/hull/joint@mass", "has no <joint>"),
        ("body/hull/inertial@mass", "hull@mass", "a <text> named PRESET:TAG/NAME@ATTRIBUTE"),
    ],
)
def test_a_wrong_change_is_named(old, new, message):
    with pytest.raises(VehicleError, match=message):
        apply_preset(changed(old, new), asset_path("tethys.xml"), "gazebo")


def test_vehicles_of_all_kinds_live_in_one_process():
    """Signals of parts of the same name mean the same in every vehicle."""
    for name in ("slocum-200", "tethys", "tethys:gazebo", "remus", "glider"):
        run = twin.simulate(vehicle=name, duration=5.0)
        assert run.provenance["vehicle"] == name
        assert run.actuators == load_vehicle(name).part_names
