"""Logs of topics: recordings of ROS 2 by the library `rosbags`, and ArduPilot's dataflash logs."""

from pathlib import Path

import numpy as np
import pytest
from logs import circles, example, refused, values

import twin
from factory.exporting import EXPORTERS
from factory.generation.generated_store import open_exportable
from factory.importing import import_logs
from glider_twin_protocols.message_samples import write_bag, write_dataflash
from twin.records.attributes import VEHICLE_MJCF
from twin.vehicle.vehicle import load_vehicle

rosbags = pytest.importorskip("rosbags.rosbag2")
ROOT = Path(__file__).resolve().parents[3]
THRUSTER = example((ROOT / "docs" / "howto" / "import_messages.md").read_text(), "mine.toml")
"""The mapping of the page"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A propelled vehicle with field sensors, recorded."""
    path = tmp_path_factory.mktemp("flown") / "run.zarr"
    run = twin.simulate(
        vehicle="tethys", duration=200.0, sensors="field", seed=3, current="uniform:0.1,-0.05,0.02"
    )
    run.save(path)
    return path


def test_what_was_exported_comes_back(flown, tmp_path):
    store = open_exportable(flown)
    (path,) = EXPORTERS["mcap"].export(store, [0], tmp_path / "bags")
    dataset, report = import_logs("mcap", [path])
    assert report.rows == 1
    assert report.period == store.period
    assert "SIMULATED" in path.read_bytes().decode("latin1")
    assert "simulated" in dataset.attrs["comment"]
    count = int(store.samples[0])
    assert int(dataset["n_samples"][0]) == count
    made = {"north", "east", "velocity_north", "velocity_east", "velocity_down"}  # of the map
    # shifted to the row's start or zeroed at the surface, as the import does to any log; depth is
    # TEOS-10's of the pressure, and the simulated vehicle's is its own
    shifted = {
        f"measured_{name}_{axis}" for name in ("gps", "onboard") for axis in ("north", "east")
    }
    shifted |= {"measured_pressure", "measured_depth"}
    compared = 0
    for name in store.signals():
        if name.removeprefix("true_") in made:
            assert name not in dataset
            continue
        then = store.row(name, 0)[:count].astype(float)
        if not np.isfinite(then).any():
            continue
        now = values(dataset, name)
        if name in shifted:
            away = (then - now)[:-1]  # an import leaves the place where a fix may correct it out
            most = 0.1 if name == "measured_depth" else 0.01
            assert np.nanmax(away) - np.nanmin(away) < most, name
            continue
        there = np.isfinite(then)
        np.testing.assert_allclose(now[there], then[there], rtol=1e-6, atol=1e-5, err_msg=name)
        compared += 1
    assert compared > 40


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_recording_of_the_library_of_ros(storage, tmp_path):
    time, state = circles()
    bag = write_bag(tmp_path / "run_7", state, time, storage)
    mapping = tmp_path / "mine.toml"
    mapping.write_text(THRUSTER)
    dataset, report = import_logs("rosbag2", [bag], mapping=mapping)
    assert report.deployments == ("run_7",)
    assert report.count("left out") == 0
    assert report.rows == 1
    assert report.period == 0.2
    for name in ("pitch", "roll", "yaw_rate"):
        np.testing.assert_allclose(
            values(dataset, f"measured_{name}"), state[name], atol=1e-4, err_msg=name
        )
    turned = (values(dataset, "measured_heading") - state["heading"] + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(turned, 0.0, atol=1e-3)
    np.testing.assert_allclose(values(dataset, "measured_depth"), state["depth"], atol=0.02)
    np.testing.assert_allclose(values(dataset, "measured_dvl_surge"), state["surge"], atol=1e-5)
    np.testing.assert_allclose(values(dataset, "measured_dvl_sway"), state["sway"], atol=1e-5)
    assert set(values(dataset, "measured_dvl_mode")) == {1.0}
    spin = state["rpm"] * 2.0 * np.pi / 60.0
    np.testing.assert_allclose(values(dataset, "measured_propeller"), spin, rtol=1e-5)
    assert float(dataset["thruster_fraction"][0]) == 1.0
    assert "measured_specific_force_x" not in dataset  # the message says that it has none
    assert dataset.attrs[VEHICLE_MJCF] == load_vehicle("remus").xml


def test_a_hole_in_all_topics_ends_a_row(tmp_path):
    time, state = circles()
    time = np.where(np.arange(len(time)) < 700, time, time + 90.0)
    bag = write_bag(tmp_path / "run", state, time)
    _, report = import_logs("rosbag2", [bag])
    assert report.rows == 2
    assert report.hours == pytest.approx(2 * 150.0 / 3600.0, rel=0.1)


def test_what_is_wrong_with_a_recording_is_told(tmp_path):
    time, state = circles(100.0)
    bag = write_bag(tmp_path / "run", state, time)
    mapping = tmp_path / "mine.toml"
    mapping.write_text(THRUSTER.replace("/thruster/rpm", "/thruster/rpn"))
    refused(r"unknown topic '/thruster/rpn'.*/thruster/rpm", "rosbag2", [bag], mapping=mapping)
    mapping.write_text(THRUSTER.replace("rpm data", "rpm speed"))
    refused("/thruster/rpm has no number 'speed'", "rosbag2", [bag], mapping=mapping)
    mapping.write_text(THRUSTER + '[time]\ncolumn = "t"\n')
    refused("unknown key 'time'", "rosbag2", [bag], mapping=mapping)
    inside = bag / "run.db3"
    whole = inside.read_bytes()
    (bag / "metadata.yaml").rename(tmp_path / "kept.yaml")
    refused(r"run\.db3 has no metadata\.yaml.*ros2 bag reindex", "rosbag2", [bag])
    (tmp_path / "kept.yaml").rename(bag / "metadata.yaml")
    inside.write_bytes(whole[: len(whole) // 3])
    refused("run cannot be read as a ROS 2 recording", "rosbag2", [bag])


def test_what_lies_beside_recordings_is_passed_over_with_a_word(flown, tmp_path):
    (path,) = EXPORTERS["mcap"].export(open_exportable(flown), [0], tmp_path / "bags")
    beside = path.with_name("checksums.json")
    beside.write_text("{}")
    alone, _ = import_logs("mcap", [path])
    together, report = import_logs("mcap", [path, beside])
    assert together.equals(alone)
    assert "an export's list of checksums, checksums.json" in str(report.table())
    notes = path.with_name("notes.json")
    notes.write_text("calm sea")
    _, report = import_logs("mcap", [path, notes])
    assert "notes.json is no MCAP file" in str(report.table())
    refused("no files to import; name mcap logs", "mcap", [beside])


def test_a_file_that_is_damaged_inside(flown, tmp_path):
    (path,) = EXPORTERS["mcap"].export(open_exportable(flown), [0], tmp_path / "bags")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2] + bytes(5000) + content[-5000:])
    refused(r"mission_000000\.mcap.*mcap recover", "mcap", [path])


def test_a_dataflash_log(tmp_path):
    pytest.importorskip("pymavlink")
    time, state = circles()
    fix = {"latitude": np.full(len(time), 49.5), "longitude": np.full(len(time), -58.0)}
    log = write_dataflash(tmp_path / "00000012.BIN", time, {**state, **fix})
    dataset, report = import_logs("ardusub", [log], period=0.2)
    assert report.rows == 1
    np.testing.assert_allclose(
        float(dataset["start_time"].values.astype(float)[0]), time[0], atol=0.3
    )
    for name in ("pitch", "heading"):
        np.testing.assert_allclose(
            values(dataset, f"measured_{name}")[5:-5], state[name][5:-5], atol=1.2, err_msg=name
        )
    assert np.ptp(values(dataset, "measured_depth") - state["depth"]) < 0.1
    np.testing.assert_allclose(values(dataset, "measured_yaw_rate"), 0.01, atol=1e-6)  # the first
    assert any(
        entry.subject == "dataflash log" and "RCOU" in entry.detail for entry in report.entries
    )


def test_a_vehicle_that_never_met_a_satellite_needs_a_start(tmp_path):
    pytest.importorskip("pymavlink")
    time, state = circles(120.0)
    log = write_dataflash(tmp_path / "00000012.BIN", time, state, clock=False)
    refused(r"clock was not set.*start = 2026-06-25", "ardusub", [log])
    mapping = tmp_path / "mine.toml"
    mapping.write_text('vehicle = "our ROV"\nstart = 2026-06-25T08:00:00Z\n[signals]\n')
    dataset, _ = import_logs("ardusub", [log], mapping=mapping)
    assert str(dataset["start_time"].values[0]).startswith("1782374401")


def write_odometry(path, frame, body, *, down):
    """A vehicle 20 m deep that goes 0.4 m/s north and 0.3 m/s east at a heading of 30 degree, nose
    down by 5, as Odometry: z counts down and x north, or z up and x east."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    kind = types.types
    point, turn = kind["geometry_msgs/msg/Point"], kind["geometry_msgs/msg/Quaternion"]
    pitch, yaw = np.radians([-5.0, 30.0]) if down else np.radians([5.0, 60.0])
    cp, sp, cy, sy = np.cos(pitch / 2), np.sin(pitch / 2), np.cos(yaw / 2), np.sin(yaw / 2)
    attitude = turn(w=cp * cy, x=-sp * sy, y=sp * cy, z=cp * sy)
    nothing = kind["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        name = "nav_msgs/msg/Odometry"
        connection = writer.add_connection("/odom", name, typestore=types)
        for k in range(600):
            since = 0.5 * k
            depth = min(20.0, max(0.0, 0.2 * (since - 20.0)), max(0.0, 0.2 * (280.0 - since)))
            north, east = 0.4 * since, 0.3 * since
            place = point(x=north, y=east, z=depth) if down else point(x=east, y=north, z=-depth)
            stamp = kind["builtin_interfaces/msg/Time"](
                sec=1_700_000_000 + k // 2, nanosec=500_000_000 * (k % 2)
            )
            message = kind[name](
                header=kind["std_msgs/msg/Header"](stamp=stamp, frame_id=frame),
                child_frame_id=body,
                pose=kind["geometry_msgs/msg/PoseWithCovariance"](
                    pose=kind["geometry_msgs/msg/Pose"](position=place, orientation=attitude),
                    covariance=np.zeros(36),
                ),
                twist=kind["geometry_msgs/msg/TwistWithCovariance"](
                    twist=kind["geometry_msgs/msg/Twist"](linear=nothing, angular=nothing),
                    covariance=np.zeros(36),
                ),
            )
            moment = 1_700_000_000_000_000_000 + round(since * 1e9)
            writer.write(connection, moment, types.serialize_cdr(message, name))
    return path


@pytest.mark.parametrize(
    ("frame", "body", "down"),
    [
        ("world_ned", "base_link_frd", True),
        ("odom", "sam/base_link_ned", True),
        ("NED", "", True),
        ("odom", "base_link", False),
        ("planned", "base_link", False),  # no word of it
    ],
)
def test_a_pose_is_in_the_frame_that_it_names(frame, body, down, tmp_path):
    bag = write_odometry(tmp_path / "run", frame, body, down=down)
    dataset, report = import_logs("rosbag2", [bag])
    assert values(dataset, "measured_depth").max() == pytest.approx(20.0, abs=0.01)
    assert values(dataset, "measured_heading")[0] == pytest.approx(30.0, abs=1e-3)
    assert values(dataset, "measured_pitch")[0] == pytest.approx(-5.0, abs=1e-3)
    north, east = (values(dataset, f"measured_onboard_{axis}") for axis in ("north", "east"))
    assert north[-2] / east[-2] == pytest.approx(4.0 / 3.0, rel=1e-3)
    assert report.count("suspect", "/odom") == 0
    assert report.count("repaired") == 0


def test_a_pose_below_the_sea_with_z_up_is_asked_about(tmp_path):
    bag = write_odometry(tmp_path / "run", "odom", "base_link", down=True)
    dataset, report = import_logs("rosbag2", [bag])
    assert values(dataset, "measured_depth").max() == pytest.approx(20.0, abs=0.01)
    assert report.count("repaired", "measured_depth") == 600
    (why,) = [e.detail for e in report.entries if (e.action, e.subject) == ("suspect", "/odom")]
    assert "is positive under water: NED? Its frame 'odom'" in why
