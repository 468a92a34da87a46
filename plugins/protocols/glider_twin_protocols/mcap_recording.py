"""MCAP recording: channels and messages of an MCAP file or a rosbag2 folder.

A channel that cannot be read, such as JSON or a service's events, has a reason instead of a type;
the others are read.
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
"""Encodings of message definitions in ROS 2"""
_RULE = "=" * 80 + "\n"
"""Separator of the definitions in one text"""
_COMPRESSED = re.compile(r"^\s*compression_mode:\s*[\"']?(file|message)\b", re.IGNORECASE | re.M)
SAID = "metadata.yaml"
"""File that every folder of rosbag2 has"""


@dataclasses.dataclass(frozen=True)
class Channel:
    """Channel of a recording: one topic's messages of one type."""

    topic: str
    kind: str
    """Type of the messages, such as sensor_msgs/msg/Imu"""
    types: Any
    """Typestore of rosbags with this type; None if the channel cannot be read."""
    unread: str = ""
    """Reason why the channel cannot be read; empty if it can."""

    def decode(self, data: bytes) -> Any:
        """Decode a message; damaged bytes can raise any exception of the decoder."""
        return self.types.deserialize_cdr(data, self.kind)


class Ros2Recording:
    """MCAP file or rosbag2 folder, opened anew for each reading."""

    def __init__(self, path: Path):
        """Read the list of channels.

        Raises:
          InputError: a file decompresses to far too many bytes.
          Exception: any exception of a parser, for damaged files.
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
        """Names of truncated files, which are read as far as they go"""
        every = [channel for channels in self._of.values() for channel in channels.values()]
        self.channels = sorted(every, key=lambda one: (one.topic, not one.unread))
        """Channels in order of topics; within a topic the readable ones come last"""

    def messages(self, topics: Collection[str]) -> Iterator[tuple[Channel, int, bytes]]:
        """Channel, time of logging [ns] and bytes of each message; readable channels only."""
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
    """Make a channel from a recording's entries on it."""
    if kind.count("/") == 1:
        kind = kind.replace("/", "/msg/")
    if message.lower() != CDR:
        return Channel(topic, kind, None, f"its messages are {message or 'of no encoding'}")
    if definition and encoding not in DEFINITIONS:
        return Channel(topic, kind, None, f"its type is written as {encoding or 'nothing'}")
    try:
        return Channel(topic, kind, _types(kind, encoding, definition))
    except Exception as error:  # the library's parser can raise anything on a definition
        why = " ".join(str(error).split())[:120] or type(error).__name__
        return Channel(topic, kind, None, f"the definition of {kind} cannot be read: {why}")


def _types(kind: str, encoding: str, definition: str) -> Any:
    """Typestore with a definition; without a definition, that of a ROS 2 distribution."""
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
    """Raise InputError for zstd files that decompress to far too many bytes."""
    import zstandard

    for path in folder.glob("*.zstd"):
        given = 0
        with path.open("rb") as file, zstandard.ZstdDecompressor().stream_reader(file) as packed:
            while some := packed.read(2**20):
                given += len(some)
                check_unpacked(given, path.stat().st_size, path.name)


def _channels(path: Path) -> dict[int, Channel]:
    """Channels of an MCAP file by number, from its summary or else from all its records."""
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
    """Channel number, time of logging [ns] and bytes of each message in these channels."""
    from mcap.records import Message

    for one in recorded(path):
        if isinstance(one, Message) and one.channel_id in channels:
            yield one.channel_id, one.log_time, one.data


MAGIC = b"\x89MCAP0\r\n"
"""Bytes at the start and at the end of an MCAP file"""


def is_cut(path: Path) -> bool:
    """True if an MCAP file lacks its end, as after a loss of power during recording."""
    with path.open("rb") as stream:
        stream.seek(-min(len(MAGIC), path.stat().st_size), os.SEEK_END)
        return stream.read() != MAGIC


def recorded(path: Path) -> Iterator[Any]:
    """Iterate over the records of an MCAP file, in chunks too; a truncated last record is left out.

    Raises:
      InputError: a chunk is damaged, or the file decompresses to far too many bytes.
      Exception: any exception of the parser, for a damaged file.
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
            except Exception:  # a parser can raise anything on damaged bytes
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
    """Decompress a chunk, at most one byte beyond its stated size."""
    if compression == "zstd":
        import zstandard

        return bytes(zstandard.ZstdDecompressor().stream_reader(data).read(size + 1))
    if compression == "lz4":
        lz4: Any = import_module("lz4.frame")
        return bytes(lz4.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    return data
