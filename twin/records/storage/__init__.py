"""Storage: atomic writes of records to a disk or an object store, with checksums and shards."""

from typing import TYPE_CHECKING

from twin.lazy import attach, places

if TYPE_CHECKING:
    from twin.records.storage.checksums import LIST as LIST
    from twin.records.storage.checksums import array_checksums as array_checksums
    from twin.records.storage.checksums import damaged_files as damaged_files
    from twin.records.storage.disk import files_below as files_below
    from twin.records.storage.disk import lock as lock
    from twin.records.storage.disk import remove as remove
    from twin.records.storage.disk import sweep as sweep
    from twin.records.storage.disk import temporary_name as temporary_name
    from twin.records.storage.store_path import StorePath as StorePath
    from twin.records.storage.store_path import files_at as files_at
    from twin.records.storage.whole import check_folder_target as check_folder_target
    from twin.records.storage.whole import clean as clean
    from twin.records.storage.whole import whole_folder as whole_folder

__getattr__, __dir__ = attach(__name__, places(__name__))
