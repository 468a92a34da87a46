"""Object files: those of an object storage, such as s3://bucket/missions.zarr, through obstore."""

from __future__ import annotations

import contextlib
import functools
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from twin.extras import require
from twin.records.files import Files, FileSum, LocalFiles
from twin.records.object_storage import explained, open_objects
from twin.records.store_path import StorePath, Url, store_path

LISTED = 1000
"""Keys that a storage tells at a time"""


class ObjectFiles(Files):
    """Objects whose keys begin alike. A process that was forked after the first use cannot use it:
    obstore has threads."""

    def __init__(self, url: Url):
        require("obstore", extra="cloud", purpose=f"the address {url}")
        self.url = url

    def __reduce__(self) -> tuple[Any, ...]:
        return ObjectFiles, (self.url,)

    @functools.cached_property
    def _objects(self) -> Any:
        """obstore's view of the place."""
        return open_objects(self.url)

    @property
    def name(self) -> str:
        """Its address."""
        return str(self.url)

    def below(self, key: str) -> ObjectFiles:
        """The objects whose keys go on with `key`."""
        return ObjectFiles(self.url / key)

    def read(self, key: str) -> bytes:
        """All of an object."""
        import obstore

        with self._told(key):
            return bytes(obstore.get(self._objects, key).bytes())

    def fetch(self, key: str, folder: Path) -> Path:
        """A copy, of a name that no other key has."""
        folder.mkdir(parents=True, exist_ok=True)
        place = folder / hashlib.sha256(key.encode()).hexdigest()
        with place.open("wb") as file:
            for piece in self._pieces(key):
                file.write(piece)
        return place

    def give_back(self, path: Path) -> None:
        """Remove a copy, and its folder when that is empty."""
        path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            path.parent.rmdir()

    def write(self, key: str, data: bytes) -> None:
        """Put an object, which is there whole from then on."""
        import obstore

        with self._told(key):
            obstore.put(self._objects, key, data)

    def write_safe(self, key: str, data: bytes) -> None:
        """As `write`: what a storage has taken, it keeps."""
        self.write(key, data)

    def take(self, key: str, path: Path) -> None:
        """Put the content of a file, in parts where it is large."""
        import obstore

        with self._told(key):
            obstore.put(self._objects, key, path)
        path.unlink()

    def settle(self) -> None:
        """What a storage has taken, it keeps."""

    def size(self, key: str) -> int | None:
        """Size of an object."""
        import obstore

        try:
            with self._told(key):
                return int(obstore.head(self._objects, key)["size"])
        except FileNotFoundError:
            return None

    def sum(self, key: str) -> FileSum:
        """Size and hash of an object."""
        digest, size = hashlib.sha256(), 0
        for piece in self._pieces(key):
            digest.update(piece)
            size += len(piece)
        return FileSum(size, digest.hexdigest())

    def sizes(self) -> Iterator[tuple[str, int]]:
        """All objects."""
        import obstore

        with self._told(""):
            for some in obstore.list(self._objects, chunk_size=LISTED):
                for one in some:
                    yield str(one["path"]), int(one["size"])

    def folders(self) -> list[str]:
        """First parts of longer keys."""
        import obstore

        with self._told(""):
            found = obstore.list_with_delimiter(self._objects)["common_prefixes"]
        return sorted(str(name).rstrip("/") for name in found)

    def zarr_store(self) -> Any:
        """zarr's own view of an object storage."""
        from zarr.storage import ObjectStore

        return ObjectStore(self._objects, read_only=True)

    def remove(self, key: str) -> None:
        """Delete an object."""
        import obstore

        with contextlib.suppress(FileNotFoundError), self._told(key):
            obstore.delete(self._objects, key)

    def remove_all(self) -> None:
        """Delete every object."""
        for key in list(self.all_keys()):
            with contextlib.suppress(OSError):
                self.remove(key)

    def _pieces(self, key: str) -> Iterator[bytes]:
        """The content of an object, piece by piece."""
        import obstore

        with self._told(key):
            for piece in obstore.get(self._objects, key):
                yield bytes(piece)

    @contextlib.contextmanager
    def _told(self, key: str) -> Iterator[None]:
        """Make an OSError that names the object of what obstore raises."""
        from obstore.exceptions import BaseError

        place = f"{self.url}/{key}" if key else str(self.url)
        try:
            yield
        except (BaseError, OSError) as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise  # of this machine's disk, or explained already
            raise explained(error, place) from error


def files_at(place: str | StorePath) -> Files:
    """The files of a folder of this machine, or below an address.

    Raises:
      InputError: an address that cannot be used, or obstore is not installed.
    """
    path = store_path(place)
    return ObjectFiles(path) if isinstance(path, Url) else LocalFiles(path)
