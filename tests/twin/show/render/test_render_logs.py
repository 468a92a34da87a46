"""Pictures of logs: what is drawn, what colours it, and that no readout shows what is unknown."""

import dataclasses

import numpy as np
import pytest
from logs import Flight, write_seaglider
from pictures import call, needs_gl
from PIL import Image

from factory.importing.import_run import import_logs
from twin.errors import InputError, StoreError
from twin.logs import logged_trajectory
from twin.records.logged import LoggedTrajectory
from twin.records.reader import MissionStore
from twin.records.store import write_store
from twin.show.render.canvas import track_colours
from twin.show.render.film import known_samples
from twin.show.render.hud import UNKNOWN, readouts
from twin.show.render.playback import moving_parts, poses, track_values
from twin.show.render.subject import Replay, Shot, read_subject

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
    data, _ = import_logs("seaglider", files)
    store = write_store(data, tmp_path / "both.zarr")
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
