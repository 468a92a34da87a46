"""Journal: what a run has finished, kept beside the growing store until it is complete.

While a store is made it holds a folder `.generating` with the settings, one part file per finished
mission and one note per finished shard. Every file appears under its name only when it is whole
(written under another name, then renamed), so a killed process leaves nothing half-done. The
store's own `zarr.json` is written last: without it the store is not complete.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shutil
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from factory.generation.chunk import checksum
from factory.generation.mission_record import Record
from twin.errors import StoreError
from twin.records.store import UNFINISHED

_MAGIC = b"glider mission part 1\n"
_LENGTH = struct.Struct("<I")


class Journal:
    """The journal of the store at `store`."""

    def __init__(self, store: Path):
        self.store = store
        self.folder = store / UNFINISHED

    @property
    def exists(self) -> bool:
        """Whether a run was started here."""
        return (self.folder / "settings.json").is_file()

    @property
    def blank(self) -> bool:
        """Whether the store's folder holds nothing but, at most, a run that never got going."""
        if not self.store.is_dir():
            return False
        others = [path for path in self.store.iterdir() if path != self.folder]
        return not others and not self.exists

    def start(self, settings: Mapping[str, Any]) -> None:
        """Begin a run."""
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.folder / "settings.json", json.dumps(settings, indent=1).encode())

    def settings(self) -> dict[str, Any]:
        """The settings that the run was started with.

        Raises:
          StoreError: the journal is damaged.
        """
        try:
            settings: dict[str, Any] = json.loads((self.folder / "settings.json").read_bytes())
        except (OSError, ValueError) as error:
            raise StoreError(
                f"the journal of {self.store} is damaged ({error}); start again with --overwrite"
            ) from error
        return settings

    @contextlib.contextmanager
    def locked(self) -> Iterator[int]:
        """Hold the store for this process; yields the file descriptor that holds it.

        Raises:
          StoreError: another process is generating into this store.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise StoreError(
                    f"another run is generating into {self.store}; wait for it or use another --out"
                ) from None
            yield descriptor
        finally:
            os.close(descriptor)

    def write_part(self, record: Record, chunks: Mapping[str, bytes]) -> None:
        """Keep one finished mission."""
        header = json.dumps(
            {"record": record.to_json(), "chunks": {k: len(v) for k, v in chunks.items()}}
        ).encode()
        body = b"".join([_MAGIC, _LENGTH.pack(len(header)), header, *chunks.values()])
        write_whole(self._part(record.mission), body + checksum(body))

    def read_part(self, mission: int) -> tuple[Record, dict[str, bytes]] | None:
        """A finished mission; None when there is none, or when its file is damaged."""
        try:
            data = self._part(mission).read_bytes()
        except FileNotFoundError:
            return None
        start = len(_MAGIC) + _LENGTH.size
        if len(data) < start + 4 or checksum(data[:-4]) != data[-4:] or not data.startswith(_MAGIC):
            return None
        (length,) = _LENGTH.unpack_from(data, len(_MAGIC))
        header = json.loads(data[start : start + length])
        chunks, offset = {}, start + length
        for name, size in header["chunks"].items():
            chunks[name] = data[offset : offset + size]
            offset += size
        return Record.from_json(header["record"]), chunks

    def drop_parts(self, missions: range) -> None:
        """Forget parts whose shard is written."""
        for mission in missions:
            self._part(mission).unlink(missing_ok=True)

    def write_shard_note(self, shard: int, records: list[Record]) -> None:
        """Say that a shard is in place."""
        text = json.dumps([record.to_json() for record in records])
        write_whole(self._note(shard), text.encode())

    def read_shard_note(self, shard: int) -> list[Record] | None:
        """The records of a shard that is in place."""
        try:
            return [Record.from_json(data) for data in json.loads(self._note(shard).read_bytes())]
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError):
            return None

    def count_missions(self) -> int:
        """Finished missions, in parts and in shards."""
        notes = [json.loads(path.read_bytes()) for path in self.folder.glob("shard-*.json")]
        in_shards = {record["mission"] for note in notes for record in note}
        in_parts = {
            int(path.stem.rpartition("-")[2]) for path in self.folder.glob("mission-*.part")
        }
        return len(in_shards | in_parts)

    def remove(self) -> None:
        """The store is complete."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _part(self, mission: int) -> Path:
        return self.folder / f"mission-{mission:06d}.part"

    def _note(self, shard: int) -> Path:
        return self.folder / f"shard-{shard:05d}.json"


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is there completely or not at all."""
    # the name of the process: two of them may write the same file, with the same bytes
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
