"""Vehicle files: read by name, agree with MuJoCo, and say what is wrong with them."""

import dataclasses
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from twin.errors import VehicleError
from twin.frames import flip_vector
from twin.physics.mujoco_model import compile_model
from twin.vehicle.laws import LAWS
from twin.vehicle.parts import PARTS, Part
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import load_vehicle, parse_vehicle

GLIDER = load_vehicle("glider")


@pytest.mark.parametrize("name", vehicle_names())
def test_parsed_and_compiled_vehicles_agree(name):
    """A moved battery too is where the formula says."""
    vehicle = load_vehicle(name)
    model = mujoco.MjModel.from_xml_string(vehicle.xml)
    data = mujoco.MjData(model)
    assert model.body("hull").mass[0] == vehicle.static_mass
    np.testing.assert_allclose(flip_vector(model.body("hull").ipos), vehicle.static_cg)
    np.testing.assert_array_equal(model.actuator_actrange[:, 1], vehicle.actuator_max)
    for shift, rotation in ((0.0, 0.0), (0.013, 0.7)):
        for mass in vehicle.masses:
            for joint, value in ((mass.slide, shift), (mass.hinge, rotation)):
                if joint is not None:
                    data.joint(joint).qpos[0] = value
        mujoco.mj_forward(model, data)
        for mass in vehicle.masses:
            found = flip_vector(data.body(mass.name).xipos - data.body("hull").xpos)
            expected = mass.position(shift * bool(mass.slide), rotation * bool(mass.hinge))
            np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("name", vehicle_names())
def test_everything_is_named_and_there_are_cameras(name):
    model = mujoco.MjModel.from_xml_string(load_vehicle(name).xml)
    counts = {"joint": "njnt", "camera": "ncam", "actuator": "nu"}
    kinds = ("body", "geom", "site", "sensor", "numeric", "light")
    for kind, count in {**counts, **{kind: f"n{kind}" for kind in kinds}}.items():
        for index in range(getattr(model, count)):
            assert getattr(model, kind)(index).name, (kind, index)
    assert {"chase", "side", "map"} <= {model.camera(i).name for i in range(model.ncam)}
    # what is only seen must neither weigh nor collide
    assert not model.geom_contype.any()


@pytest.mark.parametrize("name", vehicle_names())
def test_propellers_and_fins_are_seen_to_move(name):
    """Pictures turn the body below the hull that has a part's name."""
    vehicle = load_vehicle(name)
    model = mujoco.MjModel.from_xml_string(vehicle.xml)
    drawn = {model.body(i).name for i in range(model.nbody) if model.body_geomnum[i]}
    assert {part.name for part in vehicle.parts if part.drawn_axis is not None} <= drawn


def test_glider_has_keyframes_that_pose_it():
    model = mujoco.MjModel.from_xml_path(str(GLIDER.path))
    names = {model.keyframe(i).name for i in range(model.nkey)}
    assert {"surface", "dive", "climb"} <= names
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.keyframe("dive").id)
    mujoco.mj_forward(model, data)
    nose = data.body("hull").xmat.reshape(3, 3)[:, 0]
    assert nose[2] < -0.4  # nose down, z is up
    assert data.body("hull").xmat.reshape(3, 3)[2, 2] > 0.7  # and upright


def test_dive_keyframe_is_a_steady_glide():
    model = compile_model("glider")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.keyframe("dive").id)
    before = data.qvel[:3].copy()
    mujoco.mj_step(model, data, nstep=300)
    np.testing.assert_allclose(data.qvel[:3], before, atol=2e-4)


def broken(old: str, new: str):
    assert old in GLIDER.xml
    return parse_vehicle(GLIDER.xml.replace(old, new, 1), GLIDER.path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<numeric name="drag"', '<numeric name="dragg"', "<numeric name='drag'> is missing"),
        ('data="7.19 386.29"', 'data="7.19"', "drag.*must be 2 finite numbers"),
        ('data="7.19 386.29"', 'data="7.19 many"', "drag.*must be 2 numbers"),
        ('data="7.19 386.29"', 'data="7.19 nan"', "drag.*must be 2 finite numbers"),
        ('mass="54.28"', 'mass="-1"', "static_mass must be positive"),
        ('<site name="imu"', '<site name="ins"', "<site name='imu'> is missing"),
        (
            '<general name="pump"',
            '<general name="vbd"',
            "actuator 'vbd' must be of a kind: add <text name='vbd.kind'",
        ),
        (
            "0      0      3.61   0     7.88  0",
            "0      0      9.99   0     7.88  0",
            "added_mass must be a symmetric",
        ),
        ("</worldbody>", "</worldbod>", "not well-formed XML"),
        ('dynprm="2 0.02"', 'dynprm="0 0.02"', "lag .dynprm. must be positive"),
    ],
)
def test_a_broken_file_is_named(old, new, message):
    with pytest.raises(VehicleError, match=message):
        broken(old, new)


def test_wrong_structure_is_refused_when_compiled():
    rail = '<joint name="shift"'
    assert rail in GLIDER.xml
    loose = GLIDER.xml.replace(rail, '<joint name="loose" axis="0 1 0"/>' + rail, 1)
    with pytest.raises(VehicleError, match="joint 'loose' must be driven by an actuator"):
        compile_model(parse_vehicle(loose, GLIDER.path))
    double = GLIDER.xml.replace('density="0" viscosity="0"', 'density="1025" viscosity="0"')
    with pytest.raises(VehicleError, match="density and viscosity must be 0"):
        compile_model(parse_vehicle(double, GLIDER.path))


@pytest.mark.parametrize(
    ("line", "missing"),
    [
        ('<freejoint name="hull"/>', r"the free joint 'hull' \(<freejoint name=\"hull\"/>\) is"),
        (
            'type="slide"',
            r"'battery' must be at most one slide and one hinge .*'shift' and 'rotation'",
        ),
    ],
)
def test_a_missing_joint_is_named_not_the_keyframe_that_it_breaks(line, missing):
    assert line in GLIDER.xml
    xml = GLIDER.xml.replace(line, "", 1)
    with pytest.raises(VehicleError, match=missing):
        compile_model(parse_vehicle(xml, GLIDER.path))


def test_messages_name_the_file_as_it_was_given(tmp_path):
    path = tmp_path / "fleet" / "mine.xml"
    path.parent.mkdir()
    for old, new in (
        ('data="7.19 386.29"', 'data="7.19"'),
        ('mass="54.28"', 'mass="-1"'),
        ('density="0" viscosity="0"', 'density="1"'),
    ):
        path.write_text(GLIDER.xml.replace(old, new, 1))
        with pytest.raises(VehicleError, match=re.escape(str(path))):
            compile_model(load_vehicle(path))


def test_a_file_that_is_no_vehicle_is_said_to_be_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("a file")
    with pytest.raises(VehicleError, match=r"^notes.txt is no vehicle file: .* ends in \.xml"):
        load_vehicle("notes.txt")
    with pytest.raises(VehicleError, match=r"^unknown vehicle 'other.txt'"):
        load_vehicle("other.txt")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("gliderr", "unknown vehicle 'gliderr': did you mean 'glider'"),
        ("nowhere/x.xml", "no vehicle file at"),
        ("slocum", r"slocum-1000 or slocum-200.*'graver-2005'"),  # a maker
    ],
)
def test_unknown_vehicle_offers_the_nearest(name, said):
    with pytest.raises(VehicleError, match=said):
        load_vehicle(name)


def test_a_vehicle_is_called_as_its_file(tmp_path):
    path = tmp_path / "mine.xml"
    path.write_text(GLIDER.xml)
    assert (GLIDER.name, load_vehicle(path).name) == ("glider", "mine")


@pytest.mark.parametrize(
    ("text", "rule"),
    [("1.6 0.2", "pitch must be between"), ("0.4 0", "net mass must be positive")],
)
def test_an_impossible_usual_glide_is_refused(tmp_path, text, rule):
    path = tmp_path / "mine.xml"
    numeric = f'<numeric name="usual_glide" data="{text}"/></custom>'
    path.write_text(GLIDER.xml.replace("</custom>", numeric, 1))
    with pytest.raises(VehicleError, match=rule):
        load_vehicle(path)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ('numeric name="hull_thermal_lag"', 'numeric name="hull_thermal_lga"'),
        ('text name="summary"', 'text name="sumary"'),
        ('numeric name="rudder.stall_angle"', 'numeric name="rudder.stal_angle"'),
    ],
)
def test_a_misspelt_name_is_refused_with_the_right_one(right, wrong):
    path = load_vehicle("slocum-200").path
    text = path.read_text(encoding="utf-8")
    assert right in text
    with pytest.raises(VehicleError, match=f"did you mean '{right.split(chr(34))[1]}'"):
        parse_vehicle(text.replace(right, wrong), path)


def test_names_of_ones_own_and_of_other_laws_may_be_there():
    path = load_vehicle("remus").path
    own = '<custom><numeric name="user.colour" data="3"/><numeric name="drag" data="1 2"/>'
    text = path.read_text(encoding="utf-8").replace("<custom>", own, 1)
    assert parse_vehicle(text, path).law.kind == "body-axes"


# --- docs/physics/equations.md -------------------------------------------------------------------


PAGE = (Path(__file__).parents[3] / "docs" / "physics" / "equations.md").read_text(encoding="utf-8")


def table(header):
    """Rows of the table whose header begins so: the rest of each by its first cell."""
    lines = iter(PAGE[PAGE.index(header) :].splitlines()[2:])
    rows = {}
    for line in lines:
        if not line.startswith("|"):
            return rows
        name, _, rest = line.strip("| ").partition("|")
        rows[name.strip().strip("`")] = rest
    return rows


def test_every_law_has_a_row():
    assert tuple(table("| `hull_law` |")) == LAWS.shipped()


@pytest.mark.parametrize("kind", PARTS.shipped())
def test_every_part_has_a_row_with_its_unit_and_numbers(kind):
    rows = table("| kind | position |")
    assert tuple(rows) == PARTS.shipped()
    part = PARTS[kind]
    assert part.unit == "1" or part.unit in rows[kind].split("|")[0]
    own = {field.name for field in dataclasses.fields(part)}
    own -= {field.name for field in dataclasses.fields(Part)}
    assert [name for name in own if f"`{name}`" not in rows[kind]] == []


def test_the_flow_frame_laws_numbers_are_named():
    row = table("| `hull_law` |")["flow-frame"]
    names = [field.name for field in dataclasses.fields(LAWS["flow-frame"])]
    assert [name for name in names if f"`{name}`" not in row] == []
