"""A vehicle file is the whole vehicle, and asks for no more than a vehicle needs."""

import pytest
from patience import little_work

from twin.errors import VehicleError
from twin.physics.mujoco_model import compile_model
from twin.vehicle.mjcf import MOST_XML, check_file
from twin.vehicle.presets import assets_folder
from twin.vehicle.vehicle import load_vehicle

GLIDER = (assets_folder() / "glider.xml").read_text()


def put(element: str, into: str = "<worldbody>") -> str:
    assert into in GLIDER
    return GLIDER.replace(into, into + element, 1)


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
    (tmp_path / "mine.xml").write_text(laughs + GLIDER.split("?>", 1)[-1])
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
