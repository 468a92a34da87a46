"""Vehicle files: read by name or preset, agree with MuJoCo, and say what is wrong with them."""

import dataclasses
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from patience import little_work

import twin
from twin.__main__ import PROGRAM
from twin.errors import VehicleError
from twin.frames import flip_vector
from twin.physics.mujoco_model import compile_model
from twin.records.mission_dataset import dataset_of
from twin.records.reader import MissionStore
from twin.records.store import write_store
from twin.vehicle import vehicle_template
from twin.vehicle.changes import differences
from twin.vehicle.laws import LAWS
from twin.vehicle.mjcf import MOST_XML, check_file
from twin.vehicle.parts import PARTS, Part
from twin.vehicle.plain import without_plain
from twin.vehicle.presets import (
    apply_preset,
    asset_path,
    assets_folder,
    preset_names,
    shipped_files,
    split_preset,
    vehicle_names,
)
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
        (
            '<numeric name="drag"',
            '<numeric name="dragg"',
            r"lacks <numeric> drag 2 numbers \[kg/m, kg/m/rad2\] \(is 'dragg' meant\?\)\. `twin",
        ),
        ('data="7.19 386.29"', 'data="7.19"', "drag.*must be 2 finite numbers"),
        ('data="7.19 386.29"', 'data="7.19 many"', "drag.*must be 2 numbers"),
        ('data="7.19 386.29"', 'data="7.19 nan"', "drag.*must be 2 finite numbers"),
        ('mass="54.28"', 'mass="-1"', "static_mass must be positive"),
        ('<freejoint name="hull"/>', "", "lacks <freejoint> in body 'hull'. `twin"),
        ('<site name="imu"', '<site name="ins"', "lacks <site> imu. `twin"),
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


BARE = """<mujoco><worldbody><body name="hull"><inertial pos="0 0 0" mass="50"/></body></worldbody>
<custom><numeric name="drga" data="1 2"/><text name="rudder.kind" data="fin"/></custom>
<actuator><general name="rudder" site="rudder" dyntype="user" gainprm="0" actlimited="true"
actrange="-1 1"/></actuator></mujoco>"""


def test_one_error_names_all_that_a_file_lacks():
    with pytest.raises(VehicleError) as caught:
        parse_vehicle(BARE, Path("mine.xml"))
    said = str(caught.value)
    for part in (
        "<numeric> drag 2 numbers [kg/m, kg/m/rad2] (is 'drga' meant?), lift 2 numbers",
        "added_mass 36 numbers [kg, kg m, kg m2], hull_length [m]",
        "rudder.area [m2], rudder.lift_slope [1/rad], heading_pid 3 numbers;",
        "; <option>; <inertial diaginertia> 3 numbers; <site> imu, gps, rudder; ",
        "<general dynprm> rudder 2 numbers; <freejoint> in body 'hull'.",
    ):
        assert part in said


def test_a_file_with_all_that_the_error_names_loads():
    """The error is complete: what it names, and no more, is what the file needs."""
    bare = ElementTree.fromstring(GLIDER.xml)
    custom, lost = bare.find("custom"), {}
    assert custom is not None
    for element in custom.findall("numeric"):
        custom.remove(element)
        lost[element.get("name")] = element
    with pytest.raises(VehicleError) as caught:
        parse_vehicle(ElementTree.tostring(bare, encoding="unicode"), GLIDER.path)
    named = [name for name in lost if re.search(rf"[ ]{name}\b", str(caught.value))]
    assert set(lost) - set(named) == {"identified_angle"}
    for name in named:
        custom.append(lost[name])
    parse_vehicle(ElementTree.tostring(bare, encoding="unicode"), GLIDER.path)


def test_every_misspelt_name_is_in_one_error():
    with pytest.raises(
        VehicleError, match=r"'usual_glid'.*'usual_glide'.*'rated_dept'.*rated_depth"
    ):
        broken(
            "</custom>",
            """<numeric name="usual_glid" data="1 1"/>
            <numeric name="rated_dept" data="9"/></custom>""",
        )


@pytest.mark.parametrize("name", sorted(shipped_files()))
def test_a_template_is_the_shipped_vehicle(name):
    vehicle, shipped = parse_vehicle(vehicle_template(name), Path("mine.xml")), load_vehicle(name)
    assert differences(vehicle, shipped, leave=UNLIKE) == {}
    assert differences(vehicle.law, shipped.law) == {}
    for mine, theirs in zip(vehicle.parts, shipped.parts, strict=True):
        assert differences(mine, theirs) == {}
    assert compile_model(vehicle).nu == len(shipped.parts)


UNLIKE = ("name", "path", "xml", "law", "parts", "masses", "followers", "spreads")


def test_a_template_glides_as_printed_and_marks_what_it_needs(tmp_path, capsys):
    assert PROGRAM.main(["vehicles", "--template"]) == 0
    text = capsys.readouterr().out
    path = tmp_path / "mine.xml"
    path.write_text(text)
    assert PROGRAM.main(["trim", "--vehicle", str(path), "--json"]) == 0
    assert PROGRAM.main(["trim", "--json"]) == 0
    mine, shipped = map(json.loads, capsys.readouterr().out.splitlines())
    assert mine["speed_m_s"] == shipped["speed_m_s"]
    for word, count in (("required", 17), ("optional", 3)):
        marked = re.findall(rf"[ ]*<(?:numeric|text) [^>]*/> <!-- {word}.*?-->\n", text)
        assert len(marked) == count
        for element in marked:
            less = text.replace(element, "")
            if word == "optional":
                parse_vehicle(less, path)
                continue
            with pytest.raises(VehicleError, match="lacks <numeric> "):
                parse_vehicle(less, path)
    assert PROGRAM.main(["vehicles", "--template", "glidr"]) == 2
    assert "did you mean 'glider'" in capsys.readouterr().err


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


# --- no more than a vehicle needs -----------------------------------------------------------------


SHIPPED = (assets_folder() / "glider.xml").read_text()


def put(element: str, into: str = "<worldbody>") -> str:
    assert into in SHIPPED
    return SHIPPED.replace(into, into + element, 1)


REFUSED = {
    '<include file="more.xml"/>': r"<include file='more.xml'> is not allowed.* put the elements",
    '<body><include file="more.xml"/></body>': "<include",
    '<mesh file="hull.stl"/>': r"<mesh file='hull.stl'>.*vertex=",
    '<texture type="skybox" fileup="sky.png"/>': r"<texture fileup=.*builtin=",
    '<hfield name="h" file="h.png"/>': r"<hfield file=.* elevation=",
    '<skin file="s.skn"/>': "<skin file=",
    '<model name="m" file="m.xml"/>': "<model file=",
    '<flexcomp type="grid" count="9 9 9"/>': "soft bodies",
    '<composite type="cable" count="1000000 1 1"/>': "soft bodies",
    '<plugin plugin="mujoco.sdf.torus"/>': "plugin's code",
    '<replicate count="1000000000"><geom size="1"/></replicate>': "too many elements",
    '<replicate count="1e9"><geom size="1"/></replicate>': "too many elements",
    '<replicate count="200">' * 3 + '<geom size="1"/>' + "</replicate>" * 3: "too many elements",
    '<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>': "nrow by ncol is 1e.10",
    '<texture builtin="flat" width="100000" height="100000"/>': "width by height",
    '<numeric name="user.x" size="1000000000"/>': "<numeric size='1000000000'> is too much",
    '<size memory="900T"/>': "at most 1G",
    '<size nuser_geom="1000000000"/>': "nuser_geom",
    '<user name="u" dim="1000000000"/>': "dim",
    '<general nsample="2000000000"/>': "nsample",
    '<option iterations="2000000000"/>': "iterations",
    '<mesh name="m" octree_maxdepth="30"/>': "octree_maxdepth",
    '<hfield name="h" nrow="many" ncol="2"/>': "'many'> is not a number",
    "<body>" * 100 + "</body>" * 100: "inside each other",
    "<geom/>" * 30_000: "too many elements",
}


@pytest.mark.parametrize("element", list(REFUSED), ids=lambda text: text[:40])
@little_work(2.0)
def test_what_no_vehicle_file_may_hold_is_refused_at_once(tmp_path, element):
    path = tmp_path / "mine.xml"
    path.write_text(put(element))
    with pytest.raises(VehicleError, match=REFUSED[element]) as raised:
        load_vehicle(path)
    text = str(raised.value)
    assert text.startswith(f"vehicle file {path}, line ")
    assert "\n" not in text


def test_a_file_beside_it_cannot_change_a_vehicle(tmp_path):
    """The text that a store keeps is all that there is of the vehicle."""
    (tmp_path / "more.xml").write_text('<mujoco><option timestep="0.02"/></mujoco>')
    path = tmp_path / "mine.xml"
    path.write_text(put('<include file="more.xml"/>', '<mujoco model="glider">'))
    with pytest.raises(VehicleError, match="a stored mission must hold the whole vehicle"):
        load_vehicle(path)


def test_entities_are_refused(tmp_path):
    laughs = '<!DOCTYPE m [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    (tmp_path / "mine.xml").write_text(laughs + SHIPPED.split("?>", 1)[-1])
    with pytest.raises(VehicleError, match="<!DOCTYPE> is not allowed"):
        load_vehicle(tmp_path / "mine.xml")


def test_a_giant_file_is_refused_unread(tmp_path):
    with (tmp_path / "mine.xml").open("wb") as file:
        file.truncate(10**12)  # sparse: a terabyte that takes no room
    with pytest.raises(VehicleError, match=r"larger than 16\.8 MB"):
        load_vehicle(tmp_path / "mine.xml")


def test_looks_written_into_the_file_are_welcome(tmp_path):
    corners = 'vertex="0 0 0 1 0 0 0 1 0 0 0 1"'
    asset = f'<asset><mesh name="looks" {corners}/></asset>'
    xml = put('<geom type="mesh" mesh="looks" contype="0" conaffinity="0" group="1"/>')
    path = tmp_path / "mine.xml"
    path.write_text(xml.replace("<worldbody>", f"{asset}<worldbody>", 1))
    assert compile_model(load_vehicle(path)).nmesh == compile_model("glider").nmesh + 1


@pytest.mark.parametrize("path", sorted(assets_folder().glob("*.xml")), ids=lambda p: p.stem)
def test_every_shipped_vehicle_is_within_the_limits(path):
    text = path.read_text()
    check_file(text, path)
    assert len(text.encode()) <= MOST_XML


# --- presets --------------------------------------------------------------------------------------


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
    assert named.xml == usual.xml == without_plain(TEXT, usual.path)
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
