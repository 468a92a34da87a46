"""MCAP recordings: read by the decoders of MCAP and of rosbags, compared with the store."""

import subprocess
import sys
from collections import defaultdict

import numpy as np
import pytest
from logs import refused, stored
from scipy.spatial.transform import Rotation

from factory.exporting import EXPORTERS, ExportOptions
from factory.generation.generated_store import GeneratedStore
from factory.samples import Flight
from factory.samples.gliders import write_slocum
from glider_twin_protocols.cdr import body, encode, orientation, to_body, world
from twin.errors import StoreError
from twin.records.logged import LogStore
from twin.records.timeseries import sample_coordinates

pytest.importorskip("mcap")
rosbags = pytest.importorskip("rosbags.highlevel")
ros2 = pytest.importorskip("mcap_ros2.reader")
MISSION = 1


@pytest.fixture(scope="module")
def recording(field_store, tmp_path_factory):
    folder = tmp_path_factory.mktemp("mcap") / "bags"
    run = GeneratedStore(field_store)
    (path,) = EXPORTERS["mcap"].export(run, [MISSION], folder)
    return path


@pytest.fixture(scope="module")
def messages(recording):
    """By topic: moments [ns] and messages, by MCAP's own decoder."""
    found = defaultdict(list)
    for one in ros2.read_ros2_messages(str(recording)):
        found[one.channel.topic].append((one.log_time_ns, one.ros_msg))
    return found


def column(messages, path):
    values = []
    for _, message in messages:
        value = message
        for name in path.split("."):
            value = getattr(value, name)
        values.append(value)
    return np.array(values)


def signal(run, name, mission=MISSION):
    return run.row(name, mission)[: run.samples[mission]].astype(float)


def test_messages_have_the_values_of_the_store(messages, field_store):
    run = GeneratedStore(field_store)
    imu = messages["/measured/imu"]
    for path, name, sign in (
        ("angular_velocity.x", "measured_roll_rate", 1.0),
        ("angular_velocity.y", "measured_pitch_rate", -1.0),
        ("angular_velocity.z", "measured_yaw_rate", -1.0),
        ("linear_acceleration.x", "measured_specific_force_x", 1.0),
        ("linear_acceleration.z", "measured_specific_force_z", -1.0),
    ):
        np.testing.assert_array_equal(column(imu, path), sign * signal(run, name))
    force = np.stack([column(imu, f"linear_acceleration.{axis}") for axis in "xyz"])
    assert np.median(np.linalg.norm(force, axis=0)) == pytest.approx(9.8, abs=0.1)
    assert np.median(force[2]) > 8.0  # at rest an accelerometer measures gravity upwards
    pressure = column(messages["/measured/pressure"], "fluid_pressure")
    np.testing.assert_allclose(pressure, 101325.0 + 1e4 * signal(run, "measured_pressure"))
    where = messages["/truth/odometry"]
    for path, name, sign in (("x", "east", 1.0), ("y", "north", 1.0), ("z", "depth", -1.0)):
        found = column(where, f"pose.pose.position.{path}")
        np.testing.assert_array_equal(found, sign * signal(run, f"true_{name}"))
    pump = column(messages["/commanded/pump"], "data")
    np.testing.assert_allclose(pump, signal(run, "commanded_pump") * 1e-6)
    salinity = column(messages["/measured/salinity"], "data")
    np.testing.assert_array_equal(salinity, signal(run, "measured_salinity"))
    assert {m.header.frame_id for _, m in imu} == {"imu_link"}
    assert {m.header.frame_id for _, m in messages["/truth/imu"]} == {"imu_link_true"}


def test_moments_are_those_of_the_mission(messages, field_store):
    moments = sample_coordinates(GeneratedStore(field_store), MISSION)["datetime"]
    expected = moments.astype("datetime64[ns]").astype(np.int64)
    imu = messages["/measured/imu"]
    np.testing.assert_array_equal([moment for moment, _ in imu], expected)
    stamps = column(imu, "header.stamp.sec") * 10**9 + column(imu, "header.stamp.nanosec")
    np.testing.assert_array_equal(stamps, expected)


def test_gaps_have_no_message_and_fixes_are_degrees(messages, field_store):
    run = GeneratedStore(field_store)
    fixed = np.isfinite(signal(run, "measured_gps_north"))
    fixes = messages["/measured/fix"]
    assert 0 < fixed.sum() == len(fixes) < len(fixed)
    truth = sample_coordinates(run, MISSION)
    np.testing.assert_allclose(
        column(fixes, "latitude"), truth["latitude"][fixed], atol=1e-4, rtol=0
    )
    sigma = run.sensor_constants(MISSION)["gps_sigma"]
    assert fixes[0][1].position_covariance[0] == pytest.approx(sigma**2)
    assert fixes[0][1].position_covariance_type == 1
    mode = signal(run, "measured_dvl_mode")
    for name, code in (("bottom", 1), ("water", 2)):
        assert len(messages.get(f"/measured/dvl/{name}", [])) == (mode == code).sum()
    surge = column(messages["/measured/dvl/water"], "twist.twist.linear.x")
    np.testing.assert_array_equal(surge, signal(run, "measured_dvl_surge")[mode == 2])


def test_rosbags_reads_the_same_and_converts_it(recording, messages, tmp_path):
    counts = defaultdict(int)
    quaternions = []
    with rosbags.AnyReader([recording]) as reader:
        for connection, _, raw in reader.messages():
            counts[connection.topic] += 1
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/measured/imu":
                quaternions.append(message.orientation.w)
    assert counts == {topic: len(found) for topic, found in messages.items()}
    np.testing.assert_array_equal(quaternions, column(messages["/measured/imu"], "orientation.w"))
    for target in ("dive.bag", "dive_db3"):
        done = subprocess.run(
            [sys.executable, "-m", "rosbags.convert", "--src", recording, "--dst",
             tmp_path / target, *(["--dst-typestore", "ros1_noetic"] if "bag" in target else
             ["--dst-storage", "sqlite3"])], capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        with rosbags.AnyReader([tmp_path / target]) as reader:
            assert reader.message_count == sum(counts.values())


def test_frames_are_a_tree_and_the_file_says_what_it_is(recording, messages):
    from mcap.reader import make_reader

    parents = {}
    for topic in ("/tf", "/tf_static"):
        for _, message in messages[topic]:
            for one in message.transforms:
                parents.setdefault(one.child_frame_id, set()).add(one.header.frame_id)
    assert parents == {
        "base_link": {"map"}, "base_link_true": {"map"}, "imu_link": {"base_link"},
        "imu_link_true": {"base_link_true"},
    }  # fmt: skip
    with recording.open("rb") as stream:
        reader = make_reader(stream)
        (said,) = [one.metadata for one in reader.iter_metadata()]
        assert reader.get_header().profile == "ros2"
        channels = {c.topic: c.metadata for c in reader.get_summary().channels.values()}
    assert "SIMULATED" in said["data"]
    assert float(said["map_latitude"]) == pytest.approx(
        messages["/truth/fix"][0][1].latitude, abs=1e-6
    )
    assert channels["/measured/pump"]["units"] == "m3"
    assert channels["/measured/imu"]["signals"].split()[0] == "measured_roll"
    moments = [moment for found in messages.values() for moment, _ in found]
    assert min(moments) > 1e18


def test_long_missions_are_written_piece_by_piece(recording, field_store, tmp_path, monkeypatch):
    from mcap.reader import make_reader

    monkeypatch.setattr("glider_twin_protocols.mcap_file.AT_A_TIME", 100)
    run = GeneratedStore(field_store)
    (pieces,) = EXPORTERS["mcap"].export(run, [MISSION], tmp_path / "bags")
    found = []
    for path in (recording, pieces):
        with path.open("rb") as stream:
            found.append(
                [
                    (channel.topic, message.log_time, message.sequence, message.data)
                    for _, channel, message in make_reader(stream).iter_messages()
                ]
            )
    assert found[0] == found[1]
    assert len(found[0]) > 1000


def test_dives_of_a_deployment_are_one_recording(tmp_path):
    run = LogStore(stored(tmp_path / "real.zarr", "slocum", write_slocum(tmp_path, Flight())))
    (path,) = EXPORTERS["mcap"].export(run, range(len(run)), tmp_path / "bags")
    found = defaultdict(list)
    last = 0
    for one in ros2.read_ros2_messages(str(path)):
        assert one.log_time_ns >= last
        last = one.log_time_ns
        found[one.channel.topic].append((one.log_time_ns, one.ros_msg))
    assert not any(topic.startswith("/truth") for topic in found)
    depth = np.concatenate([signal(run, "measured_depth", k) for k in range(len(run))])
    np.testing.assert_array_equal(
        column(found["/measured/depth"], "data"), depth[np.isfinite(depth)]
    )
    imu = found["/measured/imu"][0][1]
    assert imu.angular_velocity_covariance[0] == imu.linear_acceleration_covariance[0] == -1.0
    assert len(found["/measured/track"]) > 0


def test_axes_are_those_of_ros():
    """Against rotation matrices: the nose of the vehicle must point where the compass says."""
    rng = np.random.default_rng(1)
    roll, pitch, heading = rng.uniform(-80, 80, (3, 20))
    ned = Rotation.from_euler("ZYX", np.stack([heading, pitch, roll], axis=1), degrees=True)
    quaternion = orientation(roll, pitch, heading)
    enu = Rotation.from_quat(quaternion)
    vector = rng.normal(size=(20, 3))
    np.testing.assert_allclose(enu.apply(body(*vector.T)), world(*ned.apply(vector).T), atol=1e-12)
    np.testing.assert_allclose(to_body(quaternion, enu.apply(vector)), vector, atol=1e-12)
    east = Rotation.from_quat(orientation(*np.zeros((2, 1)), np.array([90.0])))
    np.testing.assert_allclose(east.apply([1.0, 0.0, 0.0]), [[1.0, 0.0, 0.0]], atol=1e-12)


def test_bytes_are_those_of_rosbags():
    """Texts, lists and numbers of all sizes, with the padding between them."""
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    kind = types.types
    header = kind["std_msgs/msg/Header"](
        stamp=kind["builtin_interfaces/msg/Time"](sec=5, nanosec=7), frame_id="abc"
    )
    state = kind["sensor_msgs/msg/NavSatFix"](
        header=header, status=kind["sensor_msgs/msg/NavSatStatus"](status=-1, service=3),
        latitude=1.5, longitude=-2.5, altitude=3.0, position_covariance=np.arange(9.0),
        position_covariance_type=2,
    )  # fmt: skip
    values = {
        "header": {"stamp": {"sec": np.array([5, 6]), "nanosec": 7}, "frame_id": "abc"},
        "status": {"status": -1, "service": 3}, "latitude": np.array([1.5, 1.6]),
        "longitude": -2.5, "altitude": 3.0, "position_covariance": tuple(range(9)),
        "position_covariance_type": 2,
    }  # fmt: skip
    table = encode(types, "sensor_msgs/msg/NavSatFix", values, 2)
    assert table[0].tobytes() == bytes(types.serialize_cdr(state, "sensor_msgs/msg/NavSatFix"))
    assert table.shape[0] == 2
    with pytest.raises(KeyError, match="no field 'speed'"):
        encode(types, "sensor_msgs/msg/NavSatFix", {"speed": 1}, 2)


def test_what_has_no_date_or_takes_no_option_is_told(field_store, tmp_path, monkeypatch):
    run = GeneratedStore(field_store)
    refused(
        "mcap export takes no --vehicle",
        run,
        [0],
        tmp_path / "a",
        options=ExportOptions(vehicle="glider"),
        by=EXPORTERS["mcap"].export,
    )
    nowhere = sample_coordinates(run, 0)
    nowhere["datetime"] = np.full(len(nowhere["datetime"]), np.datetime64("NaT"))
    monkeypatch.setattr("glider_twin_protocols.mcap_file.sample_coordinates", lambda *_: nowhere)
    with pytest.raises(StoreError, match="lacks the start time of mission 0"):
        EXPORTERS["mcap"].export(run, [0], tmp_path / "b")
    assert list(tmp_path.iterdir()) == []
