"""How records reach a disk or an object store: whole or not at all, checksummed, in shards."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.records.storage.checksums import LIST as LIST
    from twin.records.storage.checksums import array_checksums as array_checksums
    from twin.records.storage.object_storage import files_at as files_at

__getattr__, __dir__ = attach(__name__, places(__name__))
