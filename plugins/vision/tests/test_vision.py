"""Camera: pictures of markers, poses with covariances, velocities with deviations that hold."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from glider_twin_vision.__main__ import ANGLES, SIDES, THICKNESSES, measured_cell, small_lens
from glider_twin_vision.camera_sensor import AXES, DEVIATIONS, LOGGED, MEASURED, Camera
from glider_twin_vision.detection import Detector, Sight, information
from glider_twin_vision.lens import Lens, action_camera
from glider_twin_vision.markers import MODULES, Board, plate, write_sheets
from glider_twin_vision.markers_reader import Poses, joined_clocks
from glider_twin_vision.observer import OBSERVERS, SIGNALS, looking, watch
from glider_twin_vision.scene import BACKSCATTER, Scene, Water, blurred, veiled
from glider_twin_vision.sighting import Losses, of_table, sighted
from glider_twin_vision.smoother import Frames, Settings, smooth
from twin.errors import InputError
from twin.vehicle.vehicle import load_vehicle

SEEDS = range(4)


# --- Lens and markers


def test_a_calibration_is_read_back_and_its_errors_name_what_is_missing(tmp_path):
    lens, path = action_camera(), tmp_path / "camera.yaml"
    lens.write(path)
    again = Lens.read(path)
    np.testing.assert_array_equal(again.matrix, lens.matrix)
    np.testing.assert_array_equal(again.distortion, lens.distortion)
    assert (again.width, again.height) == (lens.width, lens.height)
    with pytest.raises(InputError, match="is not there"):
        Lens.read(tmp_path / "none.yaml")
    text = path.read_text().replace("distortion_coefficients", "distortion")
    (tmp_path / "part.yaml").write_text(text)
    with pytest.raises(InputError, match="lacks distortion_coefficients"):
        Lens.read(tmp_path / "part.yaml")


def test_directions_are_the_inverse_of_the_projection():
    lens = action_camera()
    points = np.array([[0.6, -0.4, 1.0], [-0.6, 0.45, 1.0], [0.0, 0.0, 2.0]])
    found = lens.normalised(lens.project(points))
    np.testing.assert_allclose(found, points[:, :2] / points[:, 2:], atol=1e-7)


def test_plates_are_square_look_outwards_and_carry_their_number(tmp_path):
    board = Board(side=0.15)
    corners = board.corners()
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    np.testing.assert_allclose(edges, 0.15)
    assert (np.einsum("ij,ij->i", corners.mean(axis=1), board.outward) > 0.1).all()
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    for path in write_sheets(tmp_path, board):
        page = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        found, ids, _ = detector.detectMarkers(page)
        assert ids.ravel().tolist() == [int(path.name.split("_")[1])]
        assert np.ptp(found[0][0], axis=0) == pytest.approx(0.15 / 0.0254 * 300, abs=3.0)
    with pytest.raises(InputError, match="does not fit on A4"):
        write_sheets(tmp_path, Board(side=0.3))


# --- Water and motion


def test_the_veil_leaves_two_percent_of_a_contrast_at_the_visibility_and_all_at_once():
    pair = np.array([[0.9, 0.9, 0.9], [0.1, 0.1, 0.1]], np.float32)
    far = veiled(pair, np.full(2, 6.0, np.float32), 6.0)
    assert (far[0] - far[1])[1] == pytest.approx(0.02 * 0.8, rel=1e-4)
    assert (far[0] - far[1])[0] < 0.02 * 0.8  # red goes first
    np.testing.assert_allclose(veiled(pair, np.zeros(2, np.float32), 6.0), pair)
    away = veiled(pair, np.full(2, 600.0, np.float32), 6.0)
    np.testing.assert_allclose(away, np.tile(BACKSCATTER, (2, 1)), atol=1e-6)


def test_blur_keeps_the_light_and_spreads_it_along_the_motion():
    dot = np.zeros((41, 41, 3), np.float32)
    dot[20, 20] = 1.0
    wide = blurred(dot, (8.0, 0.0))[..., 0]
    assert wide.sum() == pytest.approx(1.0, abs=1e-5)
    rows, columns = np.nonzero(wide > 1e-6)
    assert set(rows) == {20}
    assert np.ptp(columns) == pytest.approx(8, abs=1)
    assert columns.mean() == pytest.approx(20.0, abs=0.51)
    np.testing.assert_array_equal(blurred(dot, (0.1, 0.1)), dot)


# --- Poses


def test_information_is_the_jacobian_of_the_projection():
    lens = dataclasses.replace(action_camera(), distortion=np.zeros(5))
    points = Board().corners()[[0, 3]].reshape(-1, 3)
    turn, place = (
        Rotation.from_euler("xyz", [0.4, -0.3, 0.2]).as_matrix(),
        np.array([0.2, 0.1, 2.0]),
    )

    def seen(six):
        moved = Rotation.from_rotvec(six[:3]).apply(points @ turn.T) + place + six[3:]
        return lens.project(moved).ravel()

    step = 1e-6
    jacobian = np.stack(
        [(seen(step * one) - seen(-step * one)) / (2 * step) for one in np.eye(6)], -1
    )
    found = information((points @ turn.T)[None], place[None], lens.matrix[0, 0])[0]
    np.testing.assert_allclose(found, jacobian.T @ jacobian, rtol=1e-4, atol=1e-2)


def test_a_pose_is_found_from_exact_corners_and_not_from_one_far_plate():
    board, lens = Board(), action_camera()
    detector = Detector(board, lens)
    turn, place = Rotation.from_euler("xyz", [1.2, 0.3, 0.2]).as_matrix(), np.array([0.1, 0.2, 2.0])
    corners = lens.project(board.corners()[[0, 3]].reshape(-1, 3) @ turn.T + place)
    pose = detector.pose(Sight(ids=np.array([0, 3]), corners=corners.reshape(2, 4, 2)))
    np.testing.assert_allclose(pose.place, place, atol=1e-4)
    np.testing.assert_allclose(pose.turn, turn, atol=1e-4)
    assert detector.pose(Sight(ids=np.zeros(0, np.int64), corners=np.zeros((0, 4, 2)))) is None
    facing = Rotation.from_euler("y", 90, degrees=True).as_matrix() @ np.eye(3)
    far = lens.project(board.corners()[3] @ facing.T + [0.0, 0.0, 12.0])
    noisy = far.reshape(1, 4, 2) + np.random.default_rng(0).normal(0, 0.3, (1, 4, 2))
    assert detector.pose(Sight(ids=np.array([3]), corners=noisy)) is None


@pytest.fixture(scope="module")
def scene():
    with Scene(load_vehicle("bluerov2"), Board(), action_camera()) as made:
        yield made


@pytest.mark.parametrize("visibility", [15.0, 5.0])
def test_drawn_pictures_give_poses_within_their_deviations(scene, visibility):
    """Corners without a bias: markers that seem too small would show in the range."""
    rng = np.random.default_rng(7)
    board, body = Board(), (np.array([0.0, 0.0, 3.0]), np.eye(3))
    detector, errors, residuals = Detector(board, scene.lens), [], []
    for _ in range(8):
        around, away = rng.uniform(-np.pi, np.pi), rng.uniform(1.3, 2.0)
        eye = body[0] + away * np.array([np.cos(around), np.sin(around), -0.4])
        turn = looking((body[0] - eye)[None])[0]
        picture = scene.picture((eye, turn), body, Water(visibility=visibility), rng, (20.0, 5.0))
        assert picture.shape == (720, 960, 3)
        pose = detector.pose(detector.sight(picture))
        if pose is None:
            continue
        rotation = Rotation.from_matrix(pose.turn @ (turn.T @ body[1]).T).as_rotvec()
        place = pose.place - turn.T @ (body[0] - eye)
        errors.append(np.r_[rotation, place] / np.sqrt(np.diag(pose.unit)))
        residuals.append((pose.squares, pose.freedom))
    assert len(errors) >= 5
    squares, freedom = np.sum(residuals, axis=0)
    corner = np.sqrt(squares / freedom)
    assert corner < 0.5  # [pixel]
    assert np.sqrt(np.mean(np.square(errors))) < 3.0 * max(corner, 0.1)
    assert abs(np.mean([one[5] for one in errors])) < 1.5 * max(corner, 0.1)  # range


def test_hidden_plates_are_not_drawn(scene):
    eye = np.array([-1.5, 0.4, 2.4])
    body = (np.array([0.0, 0.0, 3.0]), np.eye(3))
    view = eye, looking((body[0] - eye)[None])[0]
    detector, rng = Detector(Board(), scene.lens), np.random.default_rng(0)
    assert 3 in detector.sight(scene.picture(view, body, Water(), rng)).ids
    scene.hide(np.arange(5) == 3)
    assert 3 not in detector.sight(scene.picture(view, body, Water(), rng)).ids
    scene.hide(np.zeros(5, bool))


def test_the_table_of_corner_noise_is_what_drawn_pictures_show():
    """Cells drawn again with another seed: found within what 12 pictures can say."""
    with Scene(load_vehicle("bluerov2"), Board(), small_lens()) as small:
        for number, cell in enumerate([(50.0, 35.0, 0.3), (110.0, 55.0, 0.0), (20.0, 75.0, 0.9)]):
            found, spread = measured_cell(small, *cell, np.random.default_rng(100 + number), 12)
            part, deviation = (one[0] for one in of_table(*(np.array([v]) for v in cell)))
            assert abs(found - part) < 0.45
            if found > 0.5:
                assert 0.5 < spread / deviation < 2.0


def test_the_table_says_less_is_found_in_thicker_water_and_nothing_beyond_it():
    side = np.full(3, 50.0)
    part, deviation = of_table(side, np.full(3, 20.0), np.array([0.1, 0.5, 1.5]))
    assert part[0] >= part[1] >= part[2] == 0.0
    assert (deviation > 0.0).all()
    assert of_table(np.array([5.0]), np.array([0.0]), np.array([0.0]))[0] == 0.0
    assert max(SIDES) > 100.0
    assert ANGLES[0] == THICKNESSES[0] == 0.0


def test_a_fifth_of_the_markers_is_hidden_for_a_second_and_some_pictures_are_lost():
    free = Losses(dropped=0.1, hidden=0.2).arrive(np.random.default_rng(1), 20000, 5, 0.1)
    lost = ~free.any(axis=1)
    assert free.mean() == pytest.approx(0.8 * 0.9, abs=0.02)
    assert lost.mean() == pytest.approx(0.1 + 0.9 * 0.2**5, abs=0.02)
    whole = Losses(dropped=0.0, hidden=0.0).arrive(np.random.default_rng(1), 50, 5, 0.1)
    assert whole.all()


# --- Smoother


def flight(rng, count=240, period=0.5, rate=10.0, sigma=0.01, tilt=0.01):
    """Log and frames of a vehicle that swings to and fro and turns; with the true velocities."""

    def at(t):
        place = np.stack(
            [2 * np.sin(0.25 * t), 1.5 * np.cos(0.2 * t), 3 + 0.5 * np.sin(0.1 * t)], -1
        )
        speed = np.stack(
            [0.5 * np.cos(0.25 * t), -0.3 * np.sin(0.2 * t), 0.05 * np.cos(0.1 * t)], -1
        )
        pull = np.stack(
            [-0.125 * np.sin(0.25 * t), -0.06 * np.cos(0.2 * t), -0.005 * np.sin(0.1 * t)], -1
        )
        angles = np.stack([0.05 * np.sin(0.3 * t), 0.04 * np.cos(0.2 * t), 0.2 * t], -1)
        return place, speed, pull, angles

    time, frame = np.arange(count) * period, np.arange(0.0, (count - 1) * period, 1 / rate)
    _, speed, pull, angles = at(time)
    turns = Rotation.from_euler("ZYX", angles[:, ::-1])
    force = turns.inv().apply(pull - [0, 0, 9.80665]) + 0.02 * rng.standard_normal((count, 3))
    place, _, _, seen = at(frame)
    error = np.hstack(
        [tilt * rng.standard_normal((len(frame), 3)), sigma * rng.standard_normal((len(frame), 3))]
    )
    turned = Rotation.from_rotvec(error[:, :3]) * Rotation.from_euler("ZYX", seen[:, ::-1])
    frames = Frames(
        time=frame, place=place + error[:, 3:], turn=turned.as_matrix(),
        covariance=np.tile(np.diag(np.repeat([tilt**2, sigma**2], 3)), (len(frame), 1, 1)),
    )  # fmt: skip
    return time, angles, force, frames, turns.inv().apply(speed)


def test_smoothed_velocities_are_nearer_than_their_poses_allow_alone_and_deviations_hold():
    scores = []
    for seed in SEEDS:
        time, angles, force, frames, true = flight(np.random.default_rng(seed))
        found = smooth(time, angles, force, frames)
        error = found.velocity - true
        assert np.sqrt(np.mean(error**2)) < 0.02  # differences of two poses: 0.14 m/s
        assert found.used.mean() > 0.99
        scores.append(np.sqrt(np.mean((error / found.deviation) ** 2)))
    assert 0.4 < np.mean(scores) < 1.2


def test_a_turn_of_the_earth_axes_about_the_vertical_changes_no_body_velocity():
    time, angles, force, frames, _ = flight(np.random.default_rng(0))
    turn = Rotation.from_euler("z", 0.1).as_matrix()
    six = np.kron(np.eye(2), turn)
    other = Frames(
        time=frames.time, place=frames.place @ turn.T, turn=turn @ frames.turn,
        covariance=six @ frames.covariance @ six.T,
    )  # fmt: skip
    one, two = (smooth(time, angles, force, given).velocity for given in (frames, other))
    np.testing.assert_allclose(one, two, atol=4e-3)


def test_a_pose_far_astray_moves_little_and_a_gap_raises_the_deviation():
    time, angles, force, frames, true = flight(np.random.default_rng(3))
    place = frames.place.copy()
    place[300] += [1.0, -1.0, 0.5]
    found = smooth(time, angles, force, dataclasses.replace(frames, place=place))
    assert not found.used[300]
    assert np.abs(found.velocity - true)[50:70].max() < 0.06
    kept = (frames.time < 40.0) | (frames.time > 46.0)
    gap = Frames(**{f.name: getattr(frames, f.name)[kept] for f in dataclasses.fields(Frames)})
    found = smooth(time, angles, force, gap)
    inside = (time > 42.0) & (time < 44.0)
    assert found.deviation[inside].min() > 1.5 * np.median(found.deviation)


def test_an_error_of_the_observers_velocity_is_in_the_deviation():
    time, angles, force, frames, _ = flight(np.random.default_rng(0))
    alone, beside = (smooth(time, angles, force, frames, Settings(own=own)) for own in (0.0, 0.05))
    np.testing.assert_allclose(beside.deviation**2, alone.deviation**2 + 0.05**2)


# --- Observer and sensor


def mission(count=240, period=0.5):
    """Signals of a vehicle in still water that swings and turns, with a log of small errors."""
    rng = np.random.default_rng(5)
    time, angles, force, _, body = flight(rng, count, period)
    speed = Rotation.from_euler("ZYX", angles[:, ::-1]).apply(body)
    place = np.stack(
        [2 * np.sin(0.25 * time), 1.5 * np.cos(0.2 * time), 3 + 0.5 * np.sin(0.1 * time)], -1
    )
    true = [*place.T, *np.degrees(angles).T, *speed.T]
    logged = [*(np.degrees(angles).T + 0.2), *force.T]
    return dict(zip((*SIGNALS, *LOGGED), true + logged, strict=True)), body


@pytest.mark.parametrize("name", OBSERVERS)
def test_the_camera_looks_at_the_vehicle_and_knows_its_place_as_well_as_it_says(name):
    signals, _ = mission()
    view = watch(signals, 0.5, np.random.default_rng(2), name=name, rate=10.0, distance=6.0)
    place, _ = view.seen()
    lens = action_camera()
    pixels = lens.project(place)
    inside = ((pixels > 0) & (pixels < [lens.width, lens.height])).all(axis=1)
    assert inside.mean() > 0.9
    assert (view.body[:, 2] > view.eye[:, 2]).mean() > 0.9  # from above
    away = np.linalg.norm(view.known_eye - view.eye, axis=1)
    if name == "frame":
        assert away.max() == 0.0
    else:
        assert 0.0 < away[-1] < 4.0 * OBSERVERS[name].velocity * view.time[-1] + 0.5


def test_camera_velocities_are_over_ground_seeded_and_within_their_deviations():
    signals, true = mission()
    camera = Camera()
    scores, part = [], []
    for seed in SEEDS:
        drawn = camera.draw(np.random.default_rng(seed)) | {"camera_visibility": 10.0}
        made = camera.measure(signals, dt=0.5, drawn=drawn, rng=np.random.default_rng(seed))
        again = camera.measure(signals, dt=0.5, drawn=drawn, rng=np.random.default_rng(seed))
        assert list(made) == [*MEASURED, *DEVIATIONS]
        np.testing.assert_array_equal(made[MEASURED[0]], again[MEASURED[0]])
        error = np.stack([made[name] for name in MEASURED], -1) - true
        scores.append(error / np.stack([made[name] for name in DEVIATIONS], -1))
        part.append(np.isfinite(error[:, 0]).mean())
    every = np.concatenate(scores)
    every = every[np.isfinite(every)]
    assert np.mean(part) > 0.8
    assert 0.4 < np.sqrt(np.mean(every**2)) < 1.4


def test_a_camera_in_thick_water_says_nothing_and_wrong_settings_are_refused():
    signals, _ = mission(60)
    drawn = {"camera_visibility": 2.0, "camera_distance": 9.0, "camera_focal_error": 0.0,
             "camera_clock": 0.0}  # fmt: skip
    made = Camera().measure(signals, dt=0.5, drawn=drawn, rng=np.random.default_rng(0))
    assert all(np.isnan(values).all() for values in made.values())
    with pytest.raises(InputError, match="observer 'boat' is unknown: choose among frame"):
        Camera(observer="boat")
    with pytest.raises(InputError, match=r"rate is 0\.1"):
        Camera(rate=0.1)


def test_poses_without_drawing_have_the_error_that_they_state():
    signals, _ = mission()
    view = watch(signals, 0.5, np.random.default_rng(2), name="frame", rate=10.0, distance=4.0)
    frames = sighted(
        view, Board(), action_camera(), np.random.default_rng(4), visibility=15.0, losses=Losses()
    )
    at = np.searchsorted(view.time, frames.time - 1e-9)
    error = frames.place - view.body[at]
    six = np.linalg.inv(frames.covariance[:, 3:, 3:])
    squared = np.einsum("ni,nij,nj->n", error, six, error)
    assert squared.mean() == pytest.approx(3.0, rel=0.25)


# --- Clocks


def poses_of(time, place, angles):
    still = Rotation.from_matrix(looking(np.array([[1.0, 0.4, 0.3]]))[0])
    turns = still.inv() * Rotation.from_euler("ZYX", angles[:, ::-1])
    return Poses(
        time, still.inv().apply(place), turns.as_matrix(), np.tile(np.eye(6), (len(time), 1, 1))
    )


def test_vertical_motion_joins_the_clocks_and_other_motion_does_not():
    rng, unix = np.random.default_rng(0), 1.7e9
    times = unix + np.arange(0.0, 200.0, 0.2)
    depth = 3 + 0.5 * np.sin(0.11 * (times - unix)) + 0.3 * np.sin(0.047 * (times - unix))
    attitude = np.stack(
        [0.05 * np.sin(0.3 * (times - unix)), np.zeros_like(times), 0.1 * (times - unix)], -1
    )
    seen = np.arange(0.0, 90.0, 0.1)
    true = unix + 31.37
    at = seen + true
    place = np.stack([np.sin(0.2 * seen), np.cos(0.3 * seen), np.interp(at, times, depth)], -1)
    place += 0.01 * rng.standard_normal(place.shape)
    angles = np.stack([np.interp(at, times, one) for one in attitude.T], -1)
    offset, deviation, misfit = joined_clocks(poses_of(seen, place, angles), times, attitude, depth)
    assert abs(offset - true) < max(3.0 * deviation, 0.02) < 0.3
    assert misfit < 0.03
    level = place * [1.0, 1.0, 0.0]
    with pytest.raises(InputError, match="dive and climb"):
        joined_clocks(poses_of(seen, 0.1 * level, angles), times, attitude, depth)
    wrong = place + np.stack([0 * seen, 0 * seen, np.sin(0.9 * seen)], -1)
    ramp = times - unix
    falling = place * [1.0, 1.0, 0.0] + np.stack(
        [0 * seen, 0 * seen, np.interp(at, times, ramp)], -1
    )
    with pytest.raises(InputError, match="must change its vertical velocity"):
        joined_clocks(poses_of(seen, falling, angles), times, attitude, ramp)
    with pytest.raises(InputError, match="fits nowhere"):
        joined_clocks(poses_of(seen, wrong, angles), times, attitude, depth)


# --- From a video to labels


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """Folder with a mission's store, its video, calibration and log."""
    folder = tmp_path_factory.mktemp("filmed")
    page = (Path(__file__).parents[3] / "docs" / "howto" / "camera.md").read_text("utf-8")
    plan = folder / "pool.toml"
    plan.write_text(page.split("```toml\n")[1].split("```")[0])
    run = [sys.executable, "-m"]
    for words in (
        ["twin", "simulate", str(plan), "--vehicle", "bluerov2", "--sensors", "survey-field",
         "--out", "dip.zarr"],
        ["factory", "export", "dip.zarr", "--to", "mcap", "--out", "log"],
        ["twin", "observe", "dip.zarr", "--out", "dip.mp4", "--rate", "5", "--distance", "3",
         "--seconds", "28"],
    ):  # fmt: skip
        done = subprocess.run(
            [*run, *words], cwd=folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    return folder


def test_a_video_and_a_log_give_velocities_near_the_truth(filmed):
    (log,) = (filmed / "log").glob("*.mcap")
    words = ["import", "markers", "dip.mp4", "--camera", "dip.yaml", "--log", str(log)]
    command = [sys.executable, "-m", "factory", *words, "--out", "labels.zarr"]
    done = subprocess.run(command, cwd=filmed, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "clocks" in done.stdout
    from twin.records import MissionStore

    with MissionStore(filmed / "labels.zarr") as store:
        data = store.dataset.isel(mission=0)
        errors = [
            data[f"measured_camera_{axis}"].values - data[f"true_{axis}"].values for axis in AXES
        ]
        stated = [data[f"measured_camera_{axis}_deviation"].values for axis in AXES]
    there = np.isfinite(errors).all(axis=0)
    assert there.sum() > 40
    assert np.sqrt(np.mean(np.square(errors)[:, there])) < 0.04
    scores = np.array(errors)[:, there] / np.array(stated)[:, there]
    assert np.sqrt(np.mean(scores**2)) < 2.0


def test_the_modules_of_a_plate_are_eight():
    assert plate(0, 4).shape == (4 * MODULES, 4 * MODULES)
    assert plate(0)[:32].min() == 255
