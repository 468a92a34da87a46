"""ROS 2 over Zenoh: Zenoh's own library is the client, rosbags' definitions read the messages."""

import json
import math
import socket
import struct
import threading
import time

import numpy as np
import pytest
from logs import refused
from patience import HANG_S

import twin
from glider_twin_protocols import ZenohServer
from glider_twin_protocols.serve_command import Serve
from twin import SteppedVehicle

zenoh = pytest.importorskip("zenoh")
typesys = pytest.importorskip("rosbags.typesys")

TYPES = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
FLOAT64 = "std_msgs::msg::dds_::Float64_"
START = (36.8, -122.4)
RATE = 20.0


def stepped(vehicle="remus", seconds=600.0):
    return SteppedVehicle(twin.scenario_of(vehicle=vehicle, duration=seconds, commanded=True))


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Client:
    """A session of Zenoh, which keeps what it hears."""

    def __init__(self, port, password=None, keys="0/**"):
        settings = {
            "mode": "client",
            "connect/endpoints": [f"tcp/127.0.0.1:{port}"],
            "scouting/multicast/enabled": False,
            "connect/timeout_ms": 2000,
        }
        if password is not None:
            settings["transport/auth/usrpwd/user"] = "twin"
            settings["transport/auth/usrpwd/password"] = password
        config = zenoh.Config()
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
        self.session = zenoh.open(config)
        self.heard: dict[str, list[tuple[bytes, bytes]]] = {}
        self._kept = self.session.declare_subscriber(keys, self._take)

    def _take(self, sample):
        entry = bytes(sample.payload), bytes(sample.attachment or b"")
        self.heard.setdefault(str(sample.key_expr), []).append(entry)

    def command(self, key, value, order="<"):
        head = b"\0\1\0\0" if order == "<" else b"\0\0\0\0"
        self.session.put(key, head + struct.pack(f"{order}d", value))

    def messages(self, name):
        """By the hash and the type that the key names."""
        (key,) = [key for key in self.heard if key.startswith(f"0/{name}/")]
        _, dds, hashed = key.removeprefix(f"0/{name}").rsplit("/", 2)
        package, folder, _, kind = dds.split("::")
        kind = f"{package}/{folder}/{kind.removesuffix('_')}"
        assert TYPES.hash_rihs01(kind) == hashed
        return [TYPES.deserialize_cdr(data, kind) for data, _ in list(self.heard[key])]


def wait(condition):
    event, end = threading.Event(), time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < end, "it did not come"
        event.wait(0.02)


@pytest.fixture
def serve():
    """Serves a vehicle on a thread; a client of it."""
    stop = threading.Event()
    tidy = []

    def begin(vehicle, *, password=None, keys="0/**", **options):
        port = free_port()
        options = {"rate": RATE, "silence": 60.0, "token": password, **options}
        server = ZenohServer(vehicle, START, port=port, **options)
        thread = threading.Thread(target=server.run, args=(stop.is_set,))
        thread.start()
        tidy.extend((thread.join, lambda: server.__exit__()))
        client = Client(port, password, keys)
        tidy.append(client.session.close)
        return server, client

    yield begin
    stop.set()
    for end in tidy:
        end()


def test_a_client_drives_and_reads_the_state(serve):
    vehicle = stepped()
    server, client = serve(vehicle)
    wait(lambda: any("/truth/odometry/" in key for key in client.heard))
    assert vehicle.time == 0.0  # it waits for the first command
    hashed = TYPES.hash_rihs01("std_msgs/msg/Float64")
    client.command(f"0/commanded/propeller/{FLOAT64}/{hashed}", 150.0)
    client.command(f"0/commanded/rudder/{FLOAT64}/TypeHashNotSupported", 0.1, order=">")
    wait(lambda: server.served.commands == 2)
    wait(lambda: vehicle.time > 3.0)
    odometry = client.messages("truth/odometry")
    last = odometry[-1]
    assert (last.header.frame_id, last.child_frame_id) == ("map", "base_link_true")
    assert last.twist.twist.linear.x > 0.3
    turned = last.twist.twist.angular.z
    assert abs(turned) > 0.005
    imu = client.messages("truth/imu")[-1]
    assert abs(imu.angular_velocity.z) > 0.005
    assert np.sign(imu.angular_velocity.z) == np.sign(turned)
    assert imu.linear_acceleration.z == pytest.approx(9.81, abs=0.3)
    fix = client.messages("truth/fix")[-1]
    assert (fix.latitude, fix.longitude) == pytest.approx(START, abs=1e-3)
    assert client.messages("truth/rudder")[-1].data == pytest.approx(0.1, abs=1e-3)
    assert client.messages("truth/propeller")[-1].data == pytest.approx(150.0, rel=0.05)
    assert {"map"} == {one.transforms[0].header.frame_id for one in client.messages("tf")}
    # stamps go on with the vehicle's own time, which is that of the clock
    stamps = np.array([one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in odometry])
    assert abs(stamps[-1] - time.time()) < 30.0
    flown = np.diff(stamps)[[one.twist.twist.linear.x > 0.05 for one in odometry[1:]]]
    np.testing.assert_allclose(flown, 1.0 / RATE, atol=1e-6)
    # nobody but the client publishes what is commanded
    commanded = [
        said for key, each in client.heard.items() if "/commanded/" in key for said in each
    ]
    assert len(commanded) <= 2


def test_what_is_attached_is_what_rmw_zenoh_reads(serve):
    """Sequence, moment and the publisher's identity, of Zenoh's serializer."""
    from zenoh.ext import Int64, UInt8, z_deserialize

    _, client = serve(stepped())
    key = "0/truth/depth/"
    wait(lambda: any(len(v) > 4 for k, v in list(client.heard.items()) if k.startswith(key)))
    (name,) = [name for name in client.heard if name.startswith(key)]
    said = [
        z_deserialize(tuple[Int64, Int64, list[UInt8]], zenoh.ZBytes(attached))
        for _, attached in list(client.heard[name])
    ]
    numbers = np.array([int(one[0]) for one in said])
    np.testing.assert_array_equal(np.diff(numbers), 1)
    assert abs(int(said[-1][1]) * 1e-9 - time.time()) < 30.0
    assert {len(one[2]) for one in said} == {16}
    assert len({bytes(map(int, one[2])) for one in said}) == 1


def test_the_graph_of_ros_has_the_node_and_its_topics(serve):
    server, client = serve(stepped(), domain=7, keys="7/**")
    wait(lambda: any("/tf/" in key for key in client.heard))
    wait(lambda: server.served.frames > 2)
    replies = client.session.liveliness().get("@ros2_lv/7/**")
    tokens = [str(reply.ok.key_expr).split("/") for reply in replies]
    assert all(len(one) == (9 if one[5] == "NN" else 13) for one in tokens)
    assert {one[8] for one in tokens} == {"glider_twin"}
    assert len({one[4] for one in tokens}) == len(tokens)
    ends = {(one[5], *one[9:]) for one in tokens}
    assert ("NN",) in ends
    kind, qos = "sensor_msgs/msg/Imu", "::,10:,:,:,,"
    assert (
        "MP",
        "%truth%imu",
        "sensor_msgs::msg::dds_::Imu_",
        TYPES.hash_rihs01(kind),
        qos,
    ) in ends
    hashed = TYPES.hash_rihs01("std_msgs/msg/Float64")
    for part in ("propeller", "rudder", "elevator"):
        assert ("MS", f"%commanded%{part}", FLOAT64, hashed, qos) in ends


def test_a_bridge_of_dds_has_the_names_alone(serve):
    vehicle = stepped()
    _, client = serve(vehicle, bridge=True, keys="truth/**")
    wait(lambda: "truth/imu" in client.heard)
    client.command("commanded/propeller", 100.0)
    wait(lambda: vehicle.time > 0.5)
    assert vehicle.state()["commanded_propeller"] == 100.0


@pytest.mark.parametrize("name", ["remus", "seaglider"])
def test_a_lost_client_leaves_the_vehicle_in_its_failsafe(name, serve):
    vehicle = stepped(name)
    part = vehicle.vehicle.part("pump" if name == "seaglider" else "propeller")
    server, client = serve(vehicle, silence=0.5)
    metres = 1e-6 if name == "seaglider" else 1.0  # cm3 are m3 in ROS
    key = f"0/commanded/{part.name}/{FLOAT64}/any"
    client.command(key, 0.5 * part.low * metres if name == "seaglider" else 100.0)
    wait(lambda: vehicle.time > 0.0)
    wanted = 0.5 * part.low if name == "seaglider" else 100.0
    assert vehicle.state()[f"commanded_{part.name}"] == pytest.approx(wanted)
    wait(lambda: server.served.lost >= 1)
    wait(lambda: vehicle.state()[f"commanded_{part.name}"] == part.failsafe)
    client.command(key, 1e9)  # beyond the travel is its end
    wait(lambda: vehicle.state()[f"commanded_{part.name}"] == part.high)
    assert server.served.lost >= 1


def test_what_is_no_number_is_refused(serve):
    vehicle = stepped()
    server, client = serve(vehicle)
    key = f"0/commanded/rudder/{FLOAT64}/any"
    for data in (b"", b"\0\1\0\0", b"\0\1\0\0" + bytes(4), b"\0\7\0\0" + bytes(8)):
        client.session.put(key, data)
    client.command(key, math.nan)
    wait(lambda: server.served.refused == 5)
    assert server.served.commands == 0
    assert vehicle.time == 0.0


def test_who_lacks_the_token_does_not_connect(serve):
    server, client = serve(stepped(), password="a-token")
    wait(lambda: bool(client.heard))
    for wrong in (None, "another"):
        with pytest.raises(zenoh.ZError, match="Unable to connect"):
            Client(server.port, wrong)


def test_a_router_in_between(serve):
    port = free_port()
    config = zenoh.Config()
    for name, value in (
        ("mode", "router"),
        ("listen/endpoints", [f"tcp/127.0.0.1:{port}"]),
        ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(name, json.dumps(value))
    router = zenoh.open(config)
    vehicle = stepped()
    stop = threading.Event()
    with ZenohServer(vehicle, START, router=f"tcp/127.0.0.1:{port}", rate=RATE) as server:
        thread = threading.Thread(target=server.run, args=(stop.is_set,))
        thread.start()
        client = Client(port)
        wait(lambda: bool(client.heard))
        client.command(f"0/commanded/propeller/{FLOAT64}/any", 100.0)
        wait(lambda: vehicle.time > 0.0)
        stop.set()
        thread.join()
    client.session.close()
    router.close()
    refused(
        r"cannot connect to the router tcp/127\.0\.0\.1",
        stepped(),
        START,
        router=f"tcp/127.0.0.1:{port}",
        by=ZenohServer,
    )


def test_other_machines_need_a_token_and_options_their_protocol(tmp_path):
    refused(
        r"0\.0\.0\.0 can be reached.*--token-file", stepped(), START, host="0.0.0.0", by=ZenohServer
    )
    for words, said in (({"rate": 0.0}, "rate must be above 0"), ({"domain": -1}, "0 to 232")):
        refused(said, stepped(), START, **words, by=ZenohServer)
    for words, said in (
        ({"rate": 5.0}, "--rate is of --protocol ros2, not of ardupilot"),
        ({"protocol": "ros2", "exposed_to": "10.0.0.1"}, "--exposed-to is of --protocol ardup"),
        ({"protocol": "ros2", "token_file": tmp_path / "none"}, "--token-file .*none"),
    ):
        refused(said, None, by=Serve(**words).run)
    (tmp_path / "two").write_text("two words")
    refused("a token is one word", None, by=Serve(protocol="ros2", token_file=tmp_path / "two").run)
