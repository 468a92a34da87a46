"""LSF packets: find and decode IMC packets (Inter-Module Communication of LSTS) in .lsf logs.

A packet has a header of 20 bytes, a payload and a CRC-16 (IMC.xml of github.com/LSTS/imc, 5.4). The
header has synchronization number, message number, payload size, time, source system and entity, and
destination. The synchronization number shows the byte order. This module finds the packets and
skips damaged bytes; `imcpy`, the binding of DUNE's own code, decodes a packet and checks its
CRC.
"""

from __future__ import annotations

import dataclasses
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from factory.importing import TRUNCATED, Tally
from twin.bounded import unpacked_file
from twin.errors import InputError

ORDERS = {b"\x54\xfe": "<", b"\xfe\x54": ">"}
"""Byte order by the first two bytes of a packet"""
HEADER, FOOTER = 20, 2
"""[byte] Sizes of a packet's header and CRC"""
GZIP = b"\x1f\x8b"
SYSTEM, ENTITY = "src", "src_ent"

Source = tuple[str, int, int]
"""Message name, source system and source entity. For a message with an `id`, the servo's or
thruster's number replaces the entity, or -1 if the message is not read"""


@dataclasses.dataclass
class Packets:
    """Content of the packets of a log."""

    rows: dict[Source, list[tuple[float, ...]]] = dataclasses.field(default_factory=dict)
    """Unix time [s] and wanted fields of each message, in the order of the log"""
    fields: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    """Wanted fields with numbers, by message"""
    labels: dict[tuple[int, int], str] = dataclasses.field(default_factory=dict)
    """Labels of entities (EntityInfo), by system and entity"""
    names: dict[Source, int] = dataclasses.field(default_factory=dict)
    """Number of messages by source"""
    title: str = ""
    """Name that the vehicle gave the log (LoggingControl)"""


def read_packets(path: Path, wanted: Mapping[str, Sequence[str]], tally: Tally) -> Packets:
    """Read the wanted fields of the wanted messages in a log.

    Args:
      wanted: fields by message, such as {"Depth": ["value"]}.

    Raises:
      InputError: the file holds no IMC packet.
    """
    import imcpy

    data = _content(path, tally)
    number_of = imcpy.Factory.id_from_abbrev
    numbers = {number_of(name): name for name in wanted if _accepts(number_of, name)}
    said = {number_of(name) for name in ("EntityInfo", "LoggingControl")}
    found = Packets()
    every: dict[int, tuple[str, bool]] = {}
    for number, system, entity, packet in _packets(path, data, tally):
        if number not in every:
            every[number] = _name(number)
        name, numbered = every[number]
        source = (name, system, -1 if numbered else entity)
        found.names[source] = found.names.get(source, 0) + 1
        if number not in numbers and number not in said:
            continue
        try:
            message = imcpy.Packet.deserialize(packet)
        except RuntimeError as error:  # a wrong CRC, or a layout of another version
            tally.add("removed", name, 1, f"messages with {' '.join(str(error).split())}")
            continue
        if number in said:
            _store_name(message, name, found)
        if number in numbers:
            _store_row(message, name, wanted[name], found)
    if not found.names:
        raise InputError(
            f"{path.name} holds no packet of IMC 5: it begins with {data[:2].hex() or 'nothing'}, "
            "and packets with 54fe or fe54. Logs of IMC before version 5 must be converted first, "
            "by Neptus"
        )
    return found


def _content(path: Path, tally: Tally) -> bytes:
    """Bytes of a log, decompressed; from a truncated gzip file, the bytes before its end."""
    with path.open("rb") as file:
        if file.read(2) != GZIP:
            file.seek(0)
            return file.read()
    whole = bytearray()
    with unpacked_file(path) as file:
        try:
            while some := file.read1(2**20):
                whole += some
        except (EOFError, OSError, zlib.error) as error:
            words = " ".join(str(error).split())
            tally.add("note", path.name, 1, f"{TRUNCATED}unpacked up to {len(whole)} byte: {words}")
    return bytes(whole)


def _packets(path: Path, data: bytes, tally: Tally) -> Iterator[tuple[int, int, int, bytes]]:
    """Message number, source system, source entity and bytes of each packet.

    A candidate is a packet if another packet or the log's end follows it, or if its CRC is right.
    Otherwise its bytes are damaged, and the search continues one byte later. Bytes between packets
    are counted in the import report.
    """
    import imcpy

    place = end = lost = 0
    while 0 <= place <= len(data) - HEADER - FOOTER:
        order = ORDERS.get(data[place : place + 2])
        if order is not None:
            number, size, _, system, entity = struct.unpack_from(f"{order}HHdHB", data, place + 2)
            stop = place + HEADER + size + FOOTER
            whole = stop == len(data) or data[stop : stop + 2] in ORDERS
            packet = data[place:stop]
            # or the CRC must be right and the message known
            if whole or (stop < len(data) and _accepts(imcpy.Packet.deserialize, packet)):
                lost += place - end
                yield number, system, entity, packet
                place = end = stop
                continue
        place = min((p for s in ORDERS if (p := data.find(s, place + 1)) >= 0), default=-1)
    tally.add("removed", path.name, lost, "byte between packets: damaged")
    if end and end < len(data):
        tally.add("note", path.name, 1, f"{TRUNCATED}{len(data) - end} byte behind the last packet")


def _accepts(function: Callable[[Any], object], argument: object) -> bool:
    """True if a function of DUNE's code accepts this argument."""
    try:
        function(argument)
    except RuntimeError:
        return False
    return True


def _name(number: int) -> tuple[str, bool]:
    """Name of the IMC message with this number, and True if its `id` numbers parts of a vehicle."""
    import imcpy

    message = imcpy.Factory.produce(number)
    if message is None:
        return f"message_{number}", False
    return str(message.msg_name), hasattr(message, "id")


def _store_name(message: Any, name: str, found: Packets) -> None:
    """Store an entity's label, or the log's name."""
    if name == "EntityInfo":
        found.labels[(getattr(message, SYSTEM), message.id)] = str(message.label)
    else:
        found.title = str(message.name) or found.title


def _store_row(message: Any, name: str, wanted: Sequence[str], found: Packets) -> None:
    fields = found.fields.get(name)
    if fields is None:
        fields = found.fields[name] = [one for one in wanted if _is_number(message, one)]
    part = message.id if hasattr(message, "id") else getattr(message, ENTITY)
    row = (message.timestamp, *(float(getattr(message, field)) for field in fields))
    found.rows.setdefault((name, getattr(message, SYSTEM), part), []).append(row)


def _is_number(message: Any, field: str) -> bool:
    try:
        float(getattr(message, field))
    except (AttributeError, TypeError, ValueError):
        return False
    return True
