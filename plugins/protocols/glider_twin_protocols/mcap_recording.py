"""ROS 2 recording: the channels of an MCAP file or of a rosbag2 folder, and their messages.

A channel that cannot be read, such as one of JSON or of a service's events, has the reason in
place of its type; the others are read.
"""

from __future__ import annotations

import dataclasses
import os
import re
import zlib
from collections.abc import Collection, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from twin.bounded import check_unpacked
from twin.errors import InputError

CDR = "cdr"
"""Encoding of messages in ROS 2"""
DEFINITIONS = ("ros2msg", "ros2idl")
"""Encodings of their definitions"""
_RULE = "=" * 80 + "\n"
"""Between the definitions of one text"""
_COMPRESSED = re.compile(r"^\s*compression_mode:\s*[\"']?(file|message)\b", re.IGNORECASE | re.M)
SAID = "metadata.yaml"
"""File that makes a folder a recording"""


@dataclasses.dataclass(frozen=True)
class Channel:
    """One topic's messages of one type."""

    topic: str
    kind: str
    """Type of its messages, such as sensor_msgs/msg/Imu"""
    types: Any
    """The rosbags type store that knows it; None where it cannot be read."""
    unread: str = ""
    """Why it cannot be read; empty where it can."""

    def decode(self, data: bytes) -> Any:
        """A message; raises whatever the decoder raises of damaged bytes."""
        return self.types.deserialize_cdr(data, self.kind)


class Ros2Recording:
    """A file or a folder, opened for each reading anew."""

    def __init__(self, path: Path):
        """Read what channels there are.

        Raises:
          InputError: a file unpacks to far too much.
          Exception: whatever a parser raises of damaged files.
        """
        self.path = path
        self._by_rosbags = path.is_dir() and (
            not any(path.glob("*.mcap"))
            or _COMPRESSED.search((path / SAID).read_text("utf-8", "replace")) is not None
        )
        files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if self._by_rosbags:
            _check_packed_files(path)
            with _rosbag(path) as bag:
                self._of = {path: {one.id: _of_rosbags(one) for one in bag.connections}}
        else:
            self._of = {file: _channels(file) for file in files}
        self.cut = [] if self._by_rosbags else [file.name for file in files if is_cut(file)]
        """Names of files that end before their end: what they hold until there is read"""
        every = [channel for channels in self._of.values() for channel in channels.values()]
        self.channels = sorted(every, key=lambda one: (one.topic, not one.unread))
        """In order of topics; of one topic those that can be read come last"""

    def messages(self, topics: Collection[str]) -> Iterator[tuple[Channel, int, bytes]]:
        """Channel, time of logging [ns] and bytes of each message of readable channels."""
        for file, channels in self._of.items():
            of = {k: c for k, c in channels.items() if c.topic in topics and not c.unread}
            if not of:
                continue
            if not self._by_rosbags:
                for number, moment, data in _messages(file, of):
                    yield of[number], moment, data
                continue
            with _rosbag(file) as bag:
                used = [one for one in bag.connections if one.id in of]
                for connection, moment, data in bag.messages(connections=used):
                    yield of[connection.id], moment, data


def _channel(topic: str, kind: str, encoding: str, definition: str, message: str = CDR) -> Channel:
    """A channel by what a recording says of it."""
    if kind.count("/") == 1:
        kind = kind.replace("/", "/msg/")
    if message.lower() != CDR:
        return Channel(topic, kind, None, f"its messages are {message or 'of no encoding'}")
    if definition and encoding not in DEFINITIONS:
        return Channel(topic, kind, None, f"its type is written as {encoding or 'nothing'}")
    try:
        return Channel(topic, kind, _types(kind, encoding, definition))
    except Exception as error:  # whatever another's parser raises of a definition
        why = " ".join(str(error).split())[:120] or type(error).__name__
        return Channel(topic, kind, None, f"the definition of {kind} cannot be read: {why}")


def _types(kind: str, encoding: str, definition: str) -> Any:
    """A type store that knows a definition; that of a ROS 2 distribution where there is none."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if not definition:
        standard = get_typestore(Stores.ROS2_HUMBLE)
        if kind not in standard.fielddefs:
            raise InputError("the recording has none, and ROS 2 no such message")
        return standard
    types: dict[str, Any] = {}
    if encoding == "ros2msg":
        types.update(get_types_from_msg(definition, kind))
    else:
        texts = definition.split(_RULE) if definition.startswith(f"{_RULE}IDL: ") else [definition]
        for text in filter(None, texts):
            types.update(get_types_from_idl(re.sub(r"\AIDL: .*\n", "", text)))
    found = get_typestore(Stores.EMPTY)
    found.register(types)
    return found


def _rosbag(path: Path) -> Any:
    from rosbags.rosbag2 import Reader

    return Reader(path)


def _of_rosbags(connection: Any) -> Channel:
    definition = connection.msgdef
    encoding = {"MSG": "ros2msg", "IDL": "ros2idl"}.get(definition.format.name, "")
    return _channel(connection.topic, connection.msgtype, encoding, definition.data)


def _check_packed_files(folder: Path) -> None:
    """Refuse files of zstd that unpack to far too much; raises InputError."""
    import zstandard

    for path in folder.glob("*.zstd"):
        given = 0
        with path.open("rb") as file, zstandard.ZstdDecompressor().stream_reader(file) as packed:
            while some := packed.read(2**20):
                given += len(some)
                check_unpacked(given, path.stat().st_size, path.name)


def _channels(path: Path) -> dict[int, Channel]:
    """The channels of an MCAP file by their numbers: of its summary, or of all of it."""
    from mcap.reader import make_reader
    from mcap.records import Channel as Record
    from mcap.records import Schema

    summary = None
    if not is_cut(path):
        with path.open("rb") as stream:
            summary = make_reader(stream).get_summary()
    if summary is not None and summary.channels:
        records, schemas = dict(summary.channels), dict(summary.schemas)
    else:
        records, schemas = {}, {}
        for one in recorded(path):
            if isinstance(one, Record):
                records[one.id] = one
            elif isinstance(one, Schema):
                schemas[one.id] = one
    found = {}
    for number, one in sorted(records.items()):
        schema = schemas.get(one.schema_id)
        name, encoding, text = (
            ("", "", "") if schema is None
            else (schema.name, schema.encoding, schema.data.decode("utf-8", "replace"))
        )  # fmt: skip
        found[number] = _channel(one.topic, name, encoding, text, one.message_encoding)
    return found


def _messages(path: Path, channels: Mapping[int, Channel]) -> Iterator[tuple[int, int, bytes]]:
    """Channel, time of logging [ns] and bytes of each message of some channels."""
    from mcap.records import Message

    for one in recorded(path):
        if isinstance(one, Message) and one.channel_id in channels:
            yield one.channel_id, one.log_time, one.data


MAGIC = b"\x89MCAP0\r\n"
"""Begins and ends a file"""


def is_cut(path: Path) -> bool:
    """Tell whether an MCAP file lacks its end, as after a loss of power while it was written."""
    with path.open("rb") as stream:
        stream.seek(-min(len(MAGIC), path.stat().st_size), os.SEEK_END)
        return stream.read() != MAGIC


def recorded(path: Path) -> Iterator[Any]:
    """The records of an MCAP file, those within its chunks too; of one that is cut, the whole ones.

    Raises:
      InputError: it unpacks to far too much.
      Exception: whatever a parser raises of a damaged file.
    """
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    stored, given = path.stat().st_size, 0
    cut = is_cut(path)
    with path.open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True, record_size_limit=stored).records
        while True:
            try:
                one = next(records)
            except StopIteration:
                return
            except Exception:  # whatever a parser raises
                if cut:
                    return
                raise
            if not isinstance(one, Chunk):
                yield one
                continue
            given += one.uncompressed_size
            check_unpacked(given, stored, path.name)
            data = _unpacked(one.compression, one.data, one.uncompressed_size)
            if len(data) != one.uncompressed_size:
                raise InputError(f"{path.name} is damaged: a chunk has another size than it says")
            if one.uncompressed_crc and zlib.crc32(data) != one.uncompressed_crc:
                raise InputError(f"{path.name} is damaged: a chunk has another sum than it says")
            yield from breakup_chunk(dataclasses.replace(one, compression="", data=data))


def _unpacked(compression: str, data: bytes, size: int) -> bytes:
    """Unpack a chunk, up to one byte more than its size."""
    if compression == "zstd":
        import zstandard

        return bytes(zstandard.ZstdDecompressor().stream_reader(data).read(size + 1))
    if compression == "lz4":
        lz4: Any = import_module("lz4.frame")
        return bytes(lz4.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    return data
