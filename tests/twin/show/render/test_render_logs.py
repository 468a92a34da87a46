"""Pictures of logs and of sea floors: what is drawn, what colours it, what stays unknown."""

import dataclasses

import numpy as np
import pytest
from logs import stored
from pictures import call, needs_gl
from PIL import Image

import twin
from factory.samples import Flight
from factory.samples.gliders import write_seaglider
from twin.__main__ import main
from twin.errors import FloorError, InputError, StoreError
from twin.logs import logged_trajectory
from twin.mission import Mission, SawTooth
from twin.records.logged import LoggedTrajectory
from twin.records.mission_dataset import dataset_of
from twin.records.reader import MissionStore
from twin.records.store import write_store
from twin.show.render import sea
from twin.show.render.canvas import track_colours
from twin.show.render.film import known_samples
from twin.show.render.hud import UNKNOWN, readouts
from twin.show.render.playback import moving_parts, poses, track_values
from twin.show.render.stage import build
from twin.show.render.subject import Replay, Shot, Subject, read_subject
from twin.vehicle.vehicle import load_vehicle
from twin.water.floor import Bathymetry, FlatFloor, GridFloor
from twin.water.floor.lookup import floor_depths

FLIGHT = Flight(dives=2)


@pytest.fixture(scope="module")
def log(dives):
    return logged_trajectory(dives, [0])


def values(trajectory: LoggedTrajectory, time: float) -> dict[str, str]:
    """The readouts at a time [s], by name."""
    found = poses(trajectory, np.array([time]))
    return {item.name: item.value for item in readouts(found, 0)}


def deep(log: LoggedTrajectory) -> int:
    """A sample under way and not bridged."""
    return int(np.argmax((log["true_depth"] > 20.0) & (log["measured_gap"] == 0.0)))


def test_a_log_s_pose_is_the_corrected_track_and_the_measured_attitude(log):
    k = deep(log)
    found = poses(log, log.time[[k]])
    expected = [log[f"true_{name}"][k] for name in ("north", "east", "depth")]
    np.testing.assert_allclose(found.position[0], expected)
    assert found.pitch[0] == pytest.approx(log["measured_pitch"][k])
    shown = values(log, log.time[k])
    assert shown["DEPTH"].startswith(f"{log['measured_depth'][k]:.1f}")
    assert shown["SPEED"] == f"{np.linalg.norm(log.v_rel[k]):.2f} m/s"


def test_what_nobody_knows_has_no_readout(log):
    shown = values(log, log.time[deep(log)])
    assert "NET BUOYANCY" not in shown
    assert shown["PUMPED"].endswith(" cm³")
    names = {n: v for n, v in log.items() if not n.startswith(("true_s", "true_h", "measured_h"))}
    bare = dataclasses.replace(log, signals=names)
    assert not {"SPEED", "HEADING"} & set(values(bare, log.time[deep(log)]))


def test_in_a_gap_only_the_time_is_known(log):
    gap = np.zeros(len(log.time))
    k = deep(log)
    gap[k : k + 3] = 1.0
    holed = dataclasses.replace(log, signals={**log.signals, "measured_gap": gap})
    shown = values(holed, log.time[k + 1])
    assert shown.pop("TIME") != UNKNOWN
    assert set(shown.values()) == {UNKNOWN}
    row = Replay(holed).at(float(log.time[k + 1]))
    assert {item.value for item in readouts(row, 0)[1:]} == {UNKNOWN}
    after = readouts(Replay(holed).at(float(log.time[k + 10])), 0)
    assert UNKNOWN not in {item.value for item in after}


def test_a_still_is_of_the_last_moment_outside_gaps(log):
    gap, north = np.zeros(len(log.time)), log["true_north"].copy()
    gap[-4:], north[-6:-4] = 1.0, np.nan
    holed = dataclasses.replace(
        log, signals={**log.signals, "measured_gap": gap, "true_north": north}
    )
    (time,) = Shot().still_time(holed.time, None, known_samples(holed))
    assert time == log.time[-7]
    assert Shot().still_time(holed.time, float(log.time[-2]), known_samples(holed)) == log.time[-2]


def test_a_log_without_attitude_is_drawn_along_its_track(log):
    angles = ("pitch", "roll", "heading")
    names = {n: v for n, v in log.items() if not n.endswith(angles)}
    plain = dataclasses.replace(log, signals=names)
    k = deep(log)
    found = poses(plain, log.time[[k]])
    assert found.unknown >= set(angles)
    assert found.heading[0] % 360.0 == pytest.approx(log["true_heading"][k], abs=25.0)
    assert found.pitch[0] < 0.0
    assert not {"PITCH", "HEADING"} & set(values(plain, log.time[k]))


def test_the_track_is_coloured_by_what_is_known(log):
    everywhere = np.ones(len(log.time), bool)
    _, scale = track_values(log, None, everywhere, ())
    assert scale.label == "speed through water, flight model [m/s]"
    found, scale = track_values(log, "current", everywhere, ())
    assert scale.label == "depth-averaged current [m/s]"
    assert np.nanmedian(found) == pytest.approx(np.hypot(FLIGHT.north, FLIGHT.east), abs=0.06)
    slow = dataclasses.replace(
        log, signals={n: v for n, v in log.items() if n not in ("true_surge", "true_current_north")}
    )
    assert track_values(slow, None, everywhere, ())[1].label == "depth, measured [m]"
    with pytest.raises(InputError, match=r"records no true_current_north.*it can by depth"):
        track_values(slow, "current", everywhere, ())
    assert Shot(colour="depth").colour == "depth"
    grey = track_colours(np.array([np.nan, 0.2]), 0.0, 1.0)
    np.testing.assert_allclose(grey[0], 0.6)


def test_parts_without_a_command_move_too():
    names = {"measured_shift": 0, "true_shift": 0, "commanded_shift": 0, "measured_rotation": 0}
    assert moving_parts(names) == ("shift", "rotation")


def test_the_subject_of_a_log_says_which_dive_it_is(dives):
    subject = read_subject(dives, 1)
    assert "SG1" in subject.title
    assert "mission 1" in subject.title
    assert subject.vehicle.name == "seaglider"
    both = read_subject(dives, missions=[0, 1])
    assert "missions 0 to 1" in both.title
    assert both.trajectory.time[-1] > 1.9 * subject.trajectory.time[-1]
    drawn = read_subject(dives, 0, vehicle="tethys")  # drawn only: it has no glide to fly
    assert drawn.vehicle.name == "tethys"


def test_dives_of_several_deployments_are_named_with_what_to_type(tmp_path):
    files = []
    for name in ("SG171", "SG265"):
        (tmp_path / name).mkdir()
        files += write_seaglider(tmp_path / name, FLIGHT, name)
    store = stored(tmp_path / "both.zarr", "seaglider", files)
    with pytest.raises(InputError, match="of 2 deployments") as raised:
        read_subject(store, missions=[0, 1, 2, 3])
    assert str(raised.value).endswith(": SG171: --missions 0-1; SG265: --missions 2-3")


def test_a_log_without_any_track_says_why(dives, tmp_path):
    data = MissionStore(dives).dataset.load().drop_vars(["measured_pump", "position_method"])
    for name in ("displacement_north", "displacement_east"):
        data[name] = data[name] * np.nan
    plain = write_store(data, tmp_path / "plain.zarr")
    with pytest.raises(StoreError, match=r"no flight model .* and no two fixes"):
        read_subject(plain)


@needs_gl
def test_a_picture_of_a_log(dives, tmp_path, capsys):
    words = ("render", dives, "--missions", "all", "--size", "320x180", "--out", tmp_path / "a.png")
    code, _, err = call(capsys, *words)
    assert (code, err) == (0, "")
    picture = np.asarray(Image.open(tmp_path / "a.png"))
    assert picture.shape == (180, 320, 3)
    assert picture.std() > 10.0


# --- the sea floor of a mission -------------------------------------------------------------------


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
