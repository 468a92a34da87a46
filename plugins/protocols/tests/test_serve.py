"""A vehicle stepped from outside: the same bits as flown in one go, also over the protocol."""

import json
import re
import socket
import struct
import threading
from pathlib import Path

import numpy as np
import pytest
from examples import blocks
from logs import refused

import twin
from glider_twin_protocols import ArduPilotServer, Channels
from glider_twin_protocols.ardupilot import FRAMES
from twin import SteppedVehicle
from twin.errors import InputError
from twin.mission.controller import Command
from twin.vehicle.vehicle import parse_vehicle

SECONDS = 1000.0
QUICK = 100.0
"""[s] with a command for each control period; one a second follows"""
VEHICLE = "remus"
PARTS = ("propeller", "rudder", "elevator")


def scenario(vehicle=VEHICLE, seconds=SECONDS):
    return twin.scenario_of(
        vehicle=vehicle, duration=seconds, current="uniform:0.1,-0.05", commanded=True
    )


def pulses(time):
    """A manoeuvre with every part, at some time [s]."""
    time = time if time < QUICK - 1e-6 else np.floor(time + 1e-6)
    return (
        round(1700 + 100 * np.sin(0.05 * time)), round(1500 + 200 * np.sin(0.2 * time)),
        round(1500 + 80 * np.cos(0.1 * time)),
    )  # fmt: skip


@pytest.fixture(scope="module")
def flown():
    """The manoeuvre, in one go by `twin.simulate`."""
    channels = Channels.of(scenario().vehicle, PARTS)

    def controller(seen):
        return channels.command(pulses(seen.time))

    return twin.simulate(scenario(), controller=controller)


class Client:
    """What ArduPilot is, by its protocol's description alone."""

    def __init__(self, address, rate):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(60.0)
        self._address, self.rate = address, rate
        self.frame = -1

    def send(self, values, frame=None):
        self.frame = self.frame + 1 if frame is None else frame
        padded = (*values, *(0,) * (16 - len(values)))
        packet = struct.pack("<HHI16H", 18458, self.rate, self.frame, *padded)
        self._socket.sendto(packet, self._address)

    def answer(self):
        line = self._socket.recv(4096)
        assert line.startswith(b"\n")
        assert line.endswith(b"\n")
        return json.loads(line)

    def ask(self, values, frame=None):
        self.send(values, frame)
        return self.answer()

    def close(self):
        self._socket.close()


@pytest.fixture
def serve():
    """Serves a vehicle on a thread; its client."""
    stop = threading.Event()
    tidy = []

    def begin(vehicle, rate, **options):
        channels = Channels.of(vehicle.vehicle, PARTS if vehicle.vehicle.name == VEHICLE else ())
        server = ArduPilotServer(vehicle, channels, port=0, **options)
        thread = threading.Thread(target=server.run, args=(stop.is_set,))
        thread.start()
        client = Client(server.address, rate)
        tidy.extend((thread.join, lambda: server.__exit__(), client.close))
        return server, client

    yield begin
    stop.set()
    for end in tidy:
        end()


def test_served_seconds_are_those_that_simulate_flies(flown, serve):
    vehicle = SteppedVehicle(scenario())
    rate = round(1.0 / vehicle.vehicle.control_period)
    assert 1.0 / rate == vehicle.vehicle.control_period
    server, client = serve(vehicle, rate, silence=60.0)
    time, frames = 0.0, round(QUICK * rate + SECONDS - QUICK)
    for frame in range(frames):
        if frame == round(QUICK * rate):
            client.rate = 1
        said = client.ask(pulses(time))["timestamp"]
        assert said == pytest.approx(time + 1.0 / client.rate)
        time = said
    assert time == pytest.approx(SECONDS)
    client.send(pulses(time))  # the two steps that complete the last sample
    client.answer()
    served = vehicle.trajectory()
    np.testing.assert_array_equal(served.time, flown.time)
    np.testing.assert_array_equal(served.states, flown.states)
    for name in flown.signals:
        np.testing.assert_array_equal(served[name], flown[name], err_msg=name)
    assert server.served.frames == frames + 1
    assert server.served.skipped == server.served.repeated == server.served.lost == 0
    assert flown["true_surge"].max() > 1.0  # it went somewhere


def test_the_answer_is_the_state_of_the_vehicle(flown, serve):
    vehicle = SteppedVehicle(scenario())
    rate = round(1.0 / vehicle.vehicle.control_period)
    _, client = serve(vehicle, rate, silence=60.0)
    answers = []
    for k in range(20 * rate):
        answers.append(client.ask(pulses(answers[-1]["timestamp"] if k else 0.0)))
    at = {round(one["timestamp"], 6): one for one in answers}
    rows = [k for k, t in enumerate(flown.time) if round(float(t), 6) in at]
    assert len(rows) >= 20
    for k in rows:
        said = at[round(float(flown.time[k]), 6)]
        for name, field, index in (
            ("true_north", "position", 0),
            ("true_east", "position", 1),
            ("true_depth", "position", 2),
            ("true_velocity_north", "velocity", 0),
            ("true_velocity_down", "velocity", 2),
        ):
            assert said[field][index] == pytest.approx(flown[name][k], abs=2e-3), name
        for axis, name in enumerate(("roll", "pitch", "yaw")):
            rate_then = flown[f"true_{name}_rate"][k]
            assert said["imu"]["gyro"][axis] == pytest.approx(rate_then, abs=5e-3)
        for axis, name in enumerate("xyz"):
            force = flown[f"true_specific_force_{name}"][k]
            assert said["imu"]["accel_body"][axis] == pytest.approx(force, abs=0.1)
        w, x, y, z = said["quaternion"]
        heading = np.degrees(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))
        away = (heading - flown["true_heading"][k] + 180.0) % 360.0 - 180.0
        assert abs(away) < 0.01


def test_frames_that_repeat_or_begin_again(serve):
    server, client = serve(SteppedVehicle(scenario(seconds=60.0)), 10, silence=60.0)
    first = client.ask((2000, 1500, 1500))
    client.ask((2000, 1500, 1500))
    second = client.ask((2000, 1500, 1500), frame=1)
    assert second == client.ask((1000, 1500, 1500), frame=1)  # not flown again
    client.ask((2000, 1500, 1500), frame=5)
    assert client.ask((2000, 1500, 1500), frame=0) == first
    assert server.served.repeated == 2
    assert server.served.skipped == 3
    assert server.served.restarts == 1


def test_what_is_no_packet_and_who_is_no_client_is_refused(serve):
    told = []
    vehicle = SteppedVehicle(scenario(seconds=60.0))
    server, client = serve(vehicle, 10, silence=60.0, tell=told.append)
    client.ask((2000, 1500, 1500))
    other = Client(server.address, 10)
    for _ in range(2):
        other.send((1000, 1000, 1000), frame=1)
    for rubbish in (b"", b"\x1aH", struct.pack("<HHI16H", 18458, 0, 3, *(1500,) * 16), b"x" * 40):
        client._socket.sendto(rubbish, server.address)
    then = client.ask((2000, 1500, 1500))
    assert then["timestamp"] == pytest.approx(0.2)
    assert server.served.refused == 6
    names = [f"127.0.0.1:{one._socket.getsockname()[1]}" for one in (other, client)]
    assert told == ["{} is refused: {} drives, until it is silent for 60 s".format(*names)]
    other.close()


@pytest.mark.parametrize("vehicle", ["remus", "seaglider"])
def test_a_lost_client_leaves_the_vehicle_in_its_failsafe(vehicle, serve):
    stepped = SteppedVehicle(scenario(vehicle, seconds=3600.0))
    server, client = serve(stepped, 2, silence=0.2)
    client.ask(tuple(1800 for _ in stepped.vehicle.parts))
    waited = threading.Event()
    for _ in range(300):
        if server.served.lost:
            break
        waited.wait(0.1)
    assert server.served.lost == 1
    for _ in range(300):
        if stepped.time > 1.0:
            break
        waited.wait(0.1)
    assert client.ask((0, 0, 0))["timestamp"] > 1.0  # it went on meanwhile
    wanted = stepped.failsafe()
    if vehicle == "remus":
        assert set(wanted.values()) == {0.0}
    else:
        pump = stepped.vehicle.part("pump")
        assert wanted["pump"] == pump.high > pump.rest


def test_other_machines_are_let_in_only_on_request():
    vehicle = SteppedVehicle(scenario(seconds=60.0))
    channels = Channels.of(vehicle.vehicle)
    for words, said in (
        ({"host": "0.0.0.0"}, r"0\.0\.0\.0 can be reached by other machines.*--exposed-to"),
        ({"exposed_to": ["10.0.0.7"]}, r"do not reach 127\.0\.0\.1: give --host"),
        ({"host": "0.0.0.0", "exposed_to": ["10.0.0"]}, r"'10\.0\.0' is no address or network"),
    ):
        refused(said, vehicle, channels, port=0, **words, by=ArduPilotServer)
    with (
        ArduPilotServer(vehicle, channels, port=0) as server,
        pytest.raises(InputError, match="cannot serve on 127"),
    ):
        ArduPilotServer(vehicle, channels, port=server.address[1])


def test_only_the_named_addresses_drive():
    """Packets from elsewhere are handed over as the socket would: one machine has one address."""
    vehicle = SteppedVehicle(scenario(seconds=60.0))
    told = []
    with ArduPilotServer(
        vehicle, Channels.of(vehicle.vehicle), host="0.0.0.0", port=0, tell=told.append,
        exposed_to=["192.168.1.20", "10.1.0.0/16"],
    ) as server:  # fmt: skip
        server._socket.close()
        server._socket = Unsent()
        for address, frames in (("192.168.1.21", 0), ("192.168.1.21", 0), ("10.1.7.7", 1)):
            server._take(struct.pack("<HHI16H", 18458, 10, 1, *(1500,) * 16), (address, 5000))
            assert server.served.frames == frames
        assert server.served.refused == 2
        assert told == ["192.168.1.21:5000 is refused: its address is not among those of "
                        "--exposed-to"]  # fmt: skip
        server._client = None  # silent for long
        server._take(struct.pack("<HHI16H", 18458, 10, 2, *(1500,) * 16), ("127.0.0.1", 5000))
        assert server.served.frames == 2


class Unsent:
    """A socket on which answers go nowhere."""

    def sendto(self, *_):
        pass

    def close(self):
        pass


def test_channels_are_parts():
    vehicle = scenario().vehicle
    assert Channels.of(vehicle).parts == tuple(vehicle.part_names)
    refused(r"'ruder'.*rudder", vehicle, ["ruder"], by=Channels.of)
    refused("'rudder' has two channels", vehicle, ["rudder", "rudder"], by=Channels.of)
    rudder = vehicle.part("rudder")
    command = Channels.of(vehicle, ["propeller", "rudder"]).command((0, 2500, 1200))
    assert dict(command) == {"propeller": vehicle.part("propeller").rest, "rudder": rudder.high}


ROV = twin.load_vehicle("bluerov2")
STICKS = ("roll", "pitch", "yaw", "throttle", "forward", "lateral")
SHOWN = {
    "roll": "true_roll", "pitch": "true_pitch", "yaw": "true_yaw_rate", "throttle": "true_depth",
    "forward": "true_surge", "lateral": "true_sway",
}  # fmt: skip


def six():
    """The ROV with two vertical thrusters in the middle instead of four."""
    text = ROV.xml
    for k in (7, 8):
        text = re.sub(rf'\n.*<(text|numeric|general) name="thruster_{k}[."].*', "", text)
    for y in (-0.218, 0.218):
        text = text.replace(f'pos="0.12 {y} -0.01"', f'pos="0 {y} -0.01"')
    return parse_vehicle(text, Path("six.xml"))


@pytest.mark.parametrize(("frame", "vehicle"), [("vectored-6dof", ROV), ("vectored", six())])
def test_each_stick_of_a_frame_moves_the_rov_its_way(frame, vehicle):
    channels = Channels.of_frame(vehicle, frame)
    motors = len(FRAMES[frame])
    assert channels.parts == tuple(f"thruster_{k}" for k in range(1, motors + 1))
    start = twin.Start(depth=20.0)
    for axis, stick in enumerate(STICKS):
        factors = [row[axis] for row in FRAMES[frame]]
        if not any(factors):
            continue
        for way in (1, -1):
            given = channels.command([1500 + 100 * way * factor for factor in factors])
            run = twin.simulate(
                vehicle=vehicle, duration=1.5, start=start, controller=lambda _, c=given: c
            )
            # depth is down, a throttle up; a stick moves its own axis more than it did the others
            moved = run[SHOWN[stick]][-1] - run[SHOWN[stick]][0]
            sense = -way if stick == "throttle" else way
            assert moved * sense > 0.02, (stick, way, moved)


def test_a_frame_needs_its_thrusters_and_full_pulses_are_400_us():
    channels = Channels.of_frame(ROV, "vectored-6dof")
    assert dict(channels.command([1100] + [1500] * 7))["thruster_1"] == 1.0
    assert dict(channels.command([2000] + [1500] * 7))["thruster_1"] == -1.0
    refused("motor 1 of 6 is no one of the vehicle's 8", ROV, "vectored", by=Channels.of_frame)
    refused("'vector'.*vectored", ROV, "vector", by=Channels.of_frame)
    remus = twin.load_vehicle("remus")
    refused("0 thrusters.*--channels", remus, "vectored", by=Channels.of_frame)


def test_a_saved_state_goes_on_to_the_same_bits():
    vehicle = SteppedVehicle(scenario(seconds=100.0))
    channels = Channels.of(vehicle.vehicle, PARTS)

    def controller(seen):
        return channels.command(pulses(seen.time))

    vehicle.fly(controller, 40.0)
    saved = vehicle.saved()
    vehicle.fly(controller, 60.0)
    once = vehicle.trajectory()
    vehicle.restore(saved)
    assert vehicle.time == pytest.approx(40.0)
    vehicle.fly(controller, 60.0)
    again = vehicle.trajectory()
    np.testing.assert_array_equal(once.states, again.states)
    np.testing.assert_array_equal(once["true_specific_force_x"], again["true_specific_force_x"])
    refused("another vehicle", saved, by=SteppedVehicle(scenario("tethys", seconds=100.0)).restore)


def test_a_stepped_vehicle_has_no_other_master():
    refused("commanded from outside", twin.scenario_of(vehicle="remus"), by=SteppedVehicle)
    vehicle = SteppedVehicle(scenario(seconds=1.0))
    refused("above 0 s", Command(), seconds=0.0, by=vehicle.step)
    vehicle.fly(lambda _: Command(), 10.0)
    refused("has flown its duration", Command(), by=vehicle.step)


def test_telemetry_is_what_a_ground_station_reads(tmp_path):
    mavutil = pytest.importorskip("pymavlink.mavutil")
    from glider_twin_protocols import MavlinkTelemetry

    station = mavutil.mavlink_connection("udpin:127.0.0.1:0")
    port = station.port.getsockname()[1]
    telemetry = MavlinkTelemetry(f"udpout:127.0.0.1:{port}", (36.8, -122.4))
    vehicle = SteppedVehicle(scenario(seconds=60.0))
    found = {}
    for _ in range(100):
        vehicle.step(Command(propeller=150.0, rudder=0.1))
        telemetry(vehicle)
        while (message := station.recv_match(blocking=False)) is not None:
            found.setdefault(message.get_type(), []).append(message)
    telemetry.close()
    station.close()
    now = vehicle.state()
    assert len(found["HEARTBEAT"]) == pytest.approx(vehicle.time, abs=1.5)
    assert len(found["ATTITUDE"]) == pytest.approx(4.0 * vehicle.time, abs=2.0)
    place = found["LOCAL_POSITION_NED"][-1]
    assert place.x == pytest.approx(now["true_north"], abs=0.5)
    assert found["GLOBAL_POSITION_INT"][-1].lat == pytest.approx(36.8e7, abs=2e4)
    assert found["ATTITUDE"][-1].pitch == pytest.approx(np.radians(now["true_pitch"]), abs=0.02)


def test_the_controllers_of_the_page(serve, capsys):
    (_, stepping), (_, client) = blocks("docs/howto/serve.md")
    exec(stepping, {})
    seconds, depth, heading = re.findall(r"[0-9.]+", capsys.readouterr().out)
    assert (float(seconds), float(depth)) == (60.0, pytest.approx(3.0, abs=0.3))
    assert float(heading) == pytest.approx(1.57, abs=0.05)
    server, _ = serve(SteppedVehicle(scenario(seconds=60.0)), 10)
    exec(client.replace("9002", str(server.address[1])), {})
    assert capsys.readouterr().out.startswith("10.0")
