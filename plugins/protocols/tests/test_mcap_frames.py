"""Frames of MCAP recordings, read by rosbags: what REP 103, 105 and 145 promise, and physics."""

import math
from collections import defaultdict

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from factory.exporting import EXPORTERS
from factory.generation.generated_store import GeneratedStore

pytest.importorskip("mcap")
rosbags = pytest.importorskip("rosbags.highlevel")

SPEED, GRAVITY = 0.5, 9.81
UP, DOWN = math.radians(20.0), math.radians(10.0)
"""The bow points up, and starboard lies down"""
POSED = {
    "roll": 10.0, "pitch": 20.0, "heading": 90.0, "north": 100.0, "east": 200.0, "depth": 50.0,
    "onboard_north": 110.0, "onboard_east": 190.0,
    "roll_rate": 0.1, "pitch_rate": 0.2, "yaw_rate": 0.3,
    "surge": SPEED, "sway": 0.0, "heave": 0.0,
    "dvl_surge": SPEED, "dvl_sway": 0.1, "dvl_heave": 0.2, "dvl_mode": 1.0,
    # along the bow: east and up
    "velocity_north": 0.0, "velocity_east": SPEED * math.cos(UP),
    "velocity_down": -SPEED * math.sin(UP),
    "current_north": 0.3, "current_east": 0.1, "current_down": -0.02,
    # at rest an accelerometer feels the push upwards against gravity
    "specific_force_x": GRAVITY * math.sin(UP),
    "specific_force_y": -GRAVITY * math.sin(DOWN) * math.cos(UP),
    "specific_force_z": -GRAVITY * math.cos(DOWN) * math.cos(UP),
}  # fmt: skip
"""North-east-down and forward-starboard-down, as stores have it: heading east"""


class Posed(GeneratedStore):
    """A store whose vehicle never moves from one attitude."""

    def row(self, name, mission):
        row = super().row(name, mission)
        value = POSED.get(name.partition("_")[2])
        commanded = name.startswith("commanded")
        return row if value is None or commanded else np.full_like(row, value)


def read(path):
    """Messages by topic, by rosbags' own reader."""
    found = defaultdict(list)
    with rosbags.AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            found[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    return found


@pytest.fixture(scope="module")
def posed(field_store, tmp_path_factory):
    folder = tmp_path_factory.mktemp("posed") / "bags"
    (path,) = EXPORTERS["mcap"].export(Posed(field_store), [0], folder)
    return read(path)


@pytest.fixture(scope="module")
def flown(field_store, tmp_path_factory):
    folder = tmp_path_factory.mktemp("flown") / "bags"
    (path,) = EXPORTERS["mcap"].export(GeneratedStore(field_store), [0], folder)
    return read(path)


def xyz(vector):
    return np.array([vector.x, vector.y, vector.z])


def rotation(quaternion):
    return Rotation.from_quat([*xyz(quaternion), quaternion.w])


def close(found, expected):
    np.testing.assert_allclose(found, expected, atol=2e-6)


@pytest.mark.parametrize("topic", ["/truth/imu", "/measured/imu", "/truth/odometry", "/tf"])
def test_heading_east_bow_up_starboard_down(posed, topic):
    """The three axes of the vehicle, worked out by hand, in east, north, up."""
    message = posed[topic][0]
    found = {
        "/tf": lambda: message.transforms[0].transform.rotation,
        "/truth/odometry": lambda: message.pose.pose.orientation,
    }.get(topic, lambda: message.orientation)()
    turn = rotation(found)
    bow, port = [math.cos(UP), 0.0, math.sin(UP)], [
        -math.sin(DOWN) * math.sin(UP), math.cos(DOWN), math.sin(DOWN) * math.cos(UP),
    ]  # fmt: skip
    close(turn.apply([1.0, 0.0, 0.0]), bow)
    close(turn.apply([0.0, 1.0, 0.0]), port)
    close(turn.apply([0.0, 0.0, 1.0]), np.cross(bow, port))
    # fixed axes, as ROS counts: yaw 0 is east, a bow that points up has a negative pitch
    close(turn.as_euler("xyz", degrees=True), [10.0, -20.0, 0.0])
    # right-handed and of length 1
    close(np.linalg.norm([*xyz(found), found.w]), 1.0)
    close(
        np.abs([found.x, found.y, found.z, found.w]),
        [
            math.cos(UP / 2) * math.sin(DOWN / 2), math.sin(UP / 2) * math.cos(DOWN / 2),
            math.sin(UP / 2) * math.sin(DOWN / 2), math.cos(UP / 2) * math.cos(DOWN / 2),
        ],
    )  # fmt: skip


def test_vectors_are_in_the_axes_of_their_frame(posed):
    odometry, imu = posed["/truth/odometry"][0], posed["/truth/imu"][0]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("map", "base_link_true")
    close(xyz(odometry.pose.pose.position), [200.0, 100.0, -50.0])
    close(xyz(odometry.twist.twist.linear), [SPEED, 0.0, 0.0])
    close(xyz(odometry.twist.twist.angular), [0.1, -0.2, -0.3])
    close(xyz(imu.angular_velocity), [0.1, -0.2, -0.3])
    # REP 145: at rest plus one g upwards
    close(rotation(imu.orientation).apply(xyz(imu.linear_acceleration)), [0.0, 0.0, GRAVITY])
    water = posed["/truth/velocity_through_water"][0]
    assert water.header.frame_id == "base_link_true"
    close(xyz(water.twist.linear), [SPEED, 0.0, 0.0])
    current = posed["/truth/current"][0]
    assert current.header.frame_id == "map"
    close(xyz(current.vector), [0.1, 0.3, 0.02])
    bottom = posed["/measured/dvl/bottom"][0]
    assert bottom.header.frame_id == "base_link"
    close(xyz(bottom.twist.twist.linear), [SPEED, -0.1, -0.2])
    places = {one.transforms[0].child_frame_id: one.transforms[0] for one in posed["/tf"]}
    close(xyz(places["base_link_true"].transform.translation), [200.0, 100.0, -50.0])
    close(xyz(places["base_link"].transform.translation), [190.0, 110.0, -50.0])


def test_a_climb_rises_in_the_recording(flown):
    """Places, velocities, turns and accelerations of a flight agree with each other."""
    found = flown["/truth/odometry"]
    time = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in found])
    time -= time[0]
    place = np.array([xyz(m.pose.pose.position) for m in found])
    turn = Rotation.from_quat(
        [[*xyz(m.pose.pose.orientation), m.pose.pose.orientation.w] for m in found]
    )
    linear = np.array([xyz(m.twist.twist.linear) for m in found])
    angular = np.array([xyz(m.twist.twist.angular) for m in found])
    over = turn.apply(linear)
    step = np.diff(time)[:, None]
    moved, mean = np.diff(place, axis=0) / step, (over[1:] + over[:-1]) / 2
    assert np.ptp(place[:, 2]) > 10.0
    assert np.abs(moved - mean).max() < 0.02 * np.abs(mean).max() + 0.003
    # the turn from one sample to the next, in the vehicle's axes
    turned = (turn[:-1].inv() * turn[1:]).as_rotvec() / step
    middle = (angular[1:] + angular[:-1]) / 2
    assert np.abs(angular).max() > 0.01
    assert np.percentile(np.abs(turned - middle), 99) < 0.05 * np.abs(angular).max()
    # through the water a glider goes where its bow points: forward and, bow up, upwards
    water = np.array([xyz(m.twist.linear) for m in flown["/truth/velocity_through_water"]])
    bow = turn.apply([1.0, 0.0, 0.0])
    gliding = (np.abs(bow[:, 2]) > math.sin(math.radians(10.0))) & (water[:, 0] ** 2 > 0.1**2)
    assert gliding.sum() > 100
    assert (water[gliding, 0] > 0.0).mean() > 0.95
    rising = turn.apply(water)[gliding, 2]
    assert (np.sign(rising) == np.sign(bow[gliding, 2])).mean() > 0.9
    force = np.array([xyz(m.linear_acceleration) for m in flown["/truth/imu"]])
    np.testing.assert_allclose(turn.apply(force).mean(axis=0), [0.0, 0.0, 9.81], atol=0.02)


def test_every_frame_of_a_message_is_in_the_tree(flown):
    tree = {"map"}
    for message in (*flown["/tf"], *flown["/tf_static"]):
        tree |= {one.child_frame_id for one in message.transforms}
    used = {
        message.header.frame_id
        for messages in flown.values()
        for message in messages
        if hasattr(message, "header")
    }
    assert used - {""} <= tree
    assert {"map", "base_link", "base_link_true", "imu_link"} <= tree
