"""ROS 2 recordings with channels that nobody can read: the others are read."""

import numpy as np
import pytest
from logs import refused

from factory.importing import import_logs
from factory.samples import Flight
from glider_twin_protocols.mcap_recording import Ros2Recording
from glider_twin_protocols.message_samples import write_bag
from twin.errors import InputError

pytest.importorskip("rosbags.rosbag2")
FLIGHT = Flight(depth=30.0)
START = 1_700_000_000 * 10**9
SERVICE = (
    "a/Set_Request[<=1] request\n" + "=" * 80 + "\nMSG: a/srv/Set\nint64 a\n---\nint64 sum\n"
).encode()


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """A recording of dives, all of whose channels can be read."""
    time, state = FLIGHT.with_fixes()
    folder = tmp_path_factory.mktemp("plain")
    return next(write_bag(folder / "bag", state, time, "mcap").glob("*.mcap"))


@pytest.fixture(scope="module")
def right(plain):
    """What the import makes of it."""
    return import_logs("mcap", [plain])[0]


def rewritten(source, target, add, *, compression="ZSTD"):
    """The recording with more channels before its own."""
    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer

    with source.open("rb") as stream, target.open("wb") as file:
        writer = Writer(file, compression=CompressionType[compression])
        writer.start(profile="ros2", library="test")
        add(writer)
        channels = {}
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()
    return target


def add_channel(writer, topic, encoding, schema, data):
    number = 0 if schema is None else writer.register_schema(*schema)
    channel = writer.register_channel(topic, encoding, number)
    for k in range(5):
        writer.add_message(channel, START + k, data, START + k)


UNREAD = {
    "json": ("json", ("note", "jsonschema", b'{"type": "object"}'), b'{"a": 1}', "are json"),
    "json of no schema": ("json", None, b"{}", "are json"),
    "protobuf": ("protobuf", ("x.Y", "protobuf", b"\x0a\x01a"), b"\x08\x01", "are protobuf"),
    "service": ("cdr", ("a/srv/Set_Event", "ros2msg", SERVICE), b"\0" * 8, "cannot be read"),
    "broken schema": ("cdr", ("a/msg/B", "ros2msg", b"float64[ x\n{{"), b"\0" * 8, "cannot be"),
    "no type": ("cdr", ("a/msg/C", "ros2msg", b"d/Unknown x\n"), b"\0" * 8, ""),
    "of an Imu's name": ("json", ("sensor_msgs/msg/Imu", "jsonschema", b"{}"), b"{}", "are json"),
    "bytes that are no schema": ("cdr", ("a/msg/D", "ros2msg", b"\xff\xfe\0"), b"\0", "cannot be"),
    "no schema": ("cdr", None, b"\0", "cannot be read"),
}


@pytest.mark.parametrize("kind", UNREAD)
@pytest.mark.parametrize("bag", [False, True])
def test_a_channel_that_cannot_be_read_is_left_out_by_name(plain, right, tmp_path, kind, bag):
    encoding, schema, data, why = UNREAD[kind]
    target = tmp_path / "bag" / "bag_0.mcap"
    target.parent.mkdir()
    path = rewritten(plain, target, lambda w: add_channel(w, "/other", encoding, schema, data))
    if bag:
        text = (plain.parent / "metadata.yaml").read_text().replace(plain.name, path.name)
        (path.parent / "metadata.yaml").write_text(text)

    found, report = import_logs("rosbag2" if bag else "mcap", [path.parent if bag else path])
    for name in ("measured_depth", "measured_pitch", "measured_heading"):
        np.testing.assert_array_equal(found[name].values, right[name].values)
    if why:
        (told,) = (e for e in report.entries if e.subject == "/other" and e.action == "left out")
        assert why in told.detail
        assert "recover" not in told.detail


def test_a_topic_of_two_channels_keeps_the_readable_one(plain, right, tmp_path):
    path = rewritten(
        plain, tmp_path / "two.mcap",
        lambda w: add_channel(w, "/pressure", "json", ("p", "jsonschema", b"{}"), b"{}"),
    )  # fmt: skip

    found, _ = import_logs("mcap", [path])
    np.testing.assert_array_equal(found["measured_depth"].values, right["measured_depth"].values)


def test_messages_that_are_none_are_removed_and_counted(plain, right, tmp_path):
    from mcap.reader import make_reader

    channel = next(c for c in Ros2Recording(plain).channels if c.topic == "/pressure")
    with plain.open("rb") as stream:
        schemas = make_reader(stream).get_summary().schemas.values()
    schema = next(s for s in schemas if s.name == channel.kind)
    path = rewritten(
        plain, tmp_path / "broken.mcap",
        lambda w: add_channel(
            w, "/pressure", "cdr", (schema.name, schema.encoding, schema.data), b"\0\1\0\0\1"
        ),
    )  # fmt: skip

    found, report = import_logs("mcap", [path])
    np.testing.assert_array_equal(found["measured_depth"].values, right["measured_depth"].values)
    (told,) = (e for e in report.entries if e.subject == "/pressure" and e.action == "removed")
    assert told.count == 5


@pytest.mark.parametrize("json", [False, True])
def test_a_recording_of_no_known_topic_says_what_it_has(tmp_path, json):
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="test")
        text = ("std_msgs/msg/String", "ros2msg", b"string data")
        add_channel(writer, "/chatter", "json" if json else "cdr", text, b"\0\1\0\0\0\0\0\0")
        writer.finish()
    with pytest.raises(InputError, match="no topic of it is known; it has /chatter") as raised:
        import_logs("mcap", [path])
    assert "recover" not in str(raised.value)
    assert "reindex" not in str(raised.value)


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_a_recording_is_the_same_however_it_is_packed(plain, right, tmp_path, compression):
    path = rewritten(plain, tmp_path / "a.mcap", lambda _: None, compression=compression)

    found, _ = import_logs("mcap", [path])
    np.testing.assert_array_equal(found["measured_depth"].values, right["measured_depth"].values)


@pytest.mark.parametrize("compression", ["LZ4", "ZSTD"])
@pytest.mark.parametrize("honest", [True, False])
def test_a_chunk_that_unpacks_to_far_too_much_is_refused(plain, tmp_path, compression, honest):
    """Whether it says its size or not."""

    def add(writer):
        zeros = ("std_msgs/msg/String", "ros2msg", b"string data")
        for _ in range(10):
            add_channel(writer, "/zeros", "cdr", zeros, bytes(2**20))

    path = rewritten(plain, tmp_path / "a.mcap", add, compression=compression)
    assert path.stat().st_size < 2**20
    if not honest:
        data = bytearray(path.read_bytes())
        at = data.index(b"\x06", 9 + int.from_bytes(data[9:17], "little") + 8)
        assert int.from_bytes(data[at + 25 : at + 33], "little") > 2**20
        data[at + 25 : at + 33] = (1000).to_bytes(8, "little")
        path.write_bytes(data)
    refused(r"a\.mcap (unpacks to|is damaged: a chunk has another)", "mcap", [path])
