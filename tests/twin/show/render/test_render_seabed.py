"""Seabed: pictures show the mission's own sea floor where it has one."""

import numpy as np
import pytest

import twin
from twin.__main__ import main
from twin.errors import FloorError
from twin.mission import Mission, SawTooth
from twin.records.mission_dataset import dataset_of
from twin.records.store import write_store
from twin.show.render import sea
from twin.show.render.stage import build
from twin.show.render.subject import Shot, Subject, read_subject
from twin.vehicle.vehicle import load_vehicle
from twin.water.floor import Bathymetry, FlatFloor, GridFloor
from twin.water.floor.lookup import floor_depths

AXIS = np.arange(-800.0, 801.0, 50.0)
NORTH, EAST = np.meshgrid(AXIS, AXIS, indexing="ij")
HILLS = GridFloor(north_m=AXIS, east_m=AXIS, depth_m=60.0 + 10.0 * np.sin(NORTH / 60) + 0.05 * EAST)
PLAN = Mission(segments=(SawTooth(max_depth_m=50.0, heading_deg=30, yos=2),))
VEHICLE = load_vehicle("glider")


@pytest.fixture(scope="module")
def run():
    return twin.simulate(mission=PLAN, floor=HILLS)


def dive(run, floor=None):
    return Subject(trajectory=run, vehicle=VEHICLE, floor=floor)


def vertices(stage, name):
    """Display points of a geom's mesh, shape (n, 3)."""
    model = stage.model
    geom, mesh = model.geom(name), model.mesh(name).id
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    turn = np.zeros(9)
    import mujoco

    mujoco.mju_quat2Mat(turn, geom.quat)
    return model.mesh_vert[first : first + count] @ turn.reshape(3, 3).T + geom.pos


@pytest.mark.parametrize("camera", ["orbit", "side"])
def test_the_ground_is_where_the_floor_is(run, camera):
    table = HILLS.compile(0.0)
    stage = build(dive(run, table), Shot(camera=camera))
    points = vertices(stage, "floor")
    ned = points / stage.layout.factors * np.array([1, -1, -1]) + stage.layout.centre
    found = floor_depths(table, *(np.ascontiguousarray(ned[:, i]) for i in range(2)))
    shown = np.minimum(found, stage.layout.high[2])
    np.testing.assert_allclose(ned[:, 2], shown, atol=0.05)
    assert np.ptp(ned[:, 2]) > 10.0


def test_an_abyss_does_not_flatten_the_dives(run):
    usual = build(dive(run), Shot()).layout
    shallow = build(dive(run, FlatFloor(depth_m=62.0).compile(0.0)), Shot())
    assert 62.0 < shallow.layout.high[2] < 70.0
    deep = build(dive(run, FlatFloor(depth_m=4000.0).compile(0.0)), Shot())
    assert deep.layout.high[2] == pytest.approx(sea.IN_SIGHT * usual.high[2])
    names = [deep.model.geom(i).name for i in range(deep.model.ngeom)]
    assert "deep" in names
    assert "floor" not in names  # no sand where there is none


def test_the_chase_camera_sees_the_floor_from_near_only():
    assert sea.clearness(500.0) == 0.0
    assert 0.7 < sea.clearness(15.0) < 0.9
    assert sea.clearness(-0.1) == 1.0


def test_a_store_brings_its_floor(run, tmp_path):
    run.save(tmp_path / "run.zarr")
    subject = read_subject(tmp_path / "run.zarr")
    np.testing.assert_array_equal(subject.floor, HILLS.compile(0.0))
    bare = twin.simulate(mission=PLAN)
    bare.save(tmp_path / "bare.zarr")
    assert read_subject(tmp_path / "bare.zarr").floor is None


def test_a_bathymetry_file_that_is_gone_is_told(run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "twin.show.render.subject._floor",
        lambda store: Bathymetry(path="gone.nc").compile(1.0, twin.Origin()),
    )
    write_store(dataset_of([run], attributes=dict(run.provenance)), tmp_path / "run.zarr")
    with pytest.raises(FloorError, match=r"no bathymetry file gone\.nc"):
        read_subject(tmp_path / "run.zarr")
    arguments = ["render", str(tmp_path / "run.zarr"), "--size", "320x180"]
    monkeypatch.setattr("sys.argv", ["twin", *arguments, "--out", str(tmp_path / "a.png")])
    assert main() == 0
    assert "made-up sea floor" in capsys.readouterr().err
