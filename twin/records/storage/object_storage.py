"""Object storage: obstore's view of an address, who asks, and what its errors mean.

Who may read and write, and where the storage is, say the environment variables that the storage's
own tools read: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION, AWS_ENDPOINT_URL and so on.
Profiles of ~/.aws are read by boto3, as Amazon's own tools read them.

Object files: those of an object storage, such as s3://bucket/missions.zarr, through obstore.
"""

from __future__ import annotations

import contextlib
import datetime
import errno
import functools
import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from twin.errors import InputError
from twin.extras import require
from twin.records.storage.store_path import Files, FileSum, Url

PATIENT = {"max_retries": 8, "retry_timeout": datetime.timedelta(seconds=60)}
"""Times that a request is repeated when the storage does not answer or says that it is busy, and
time after which it is not repeated"""
FIRST = {"max_retries": 2, "retry_timeout": datetime.timedelta(seconds=8)}
"""Those of a process's first request: an address that leads nowhere is told soon. One try takes
up to 5 s to connect and up to 30 s until there is an answer"""
KEY, PROFILE = "AWS_ACCESS_KEY_ID", "AWS_PROFILE"
CREDENTIALS_FILE = "AWS_SHARED_CREDENTIALS_FILE"
UNSIGNED = "AWS_SKIP_SIGNATURE"
WHO = {
    "s3": f"set {KEY} and AWS_SECRET_ACCESS_KEY, or {PROFILE}; {UNSIGNED}=true for public buckets",
    "gs": "set GOOGLE_APPLICATION_CREDENTIALS to the path of a service account's key",
    "az": "set AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY",
}
"""How a user says who asks, by scheme"""
METADATA_SERVICES = ("169.254.169.254", "metadata.google.internal")
"""Where machines of a cloud get credentials when the environment has none"""
ALLOW_HTTP = {"s3": "AWS_ALLOW_HTTP", "gs": "GOOGLE_ALLOW_HTTP", "az": "AZURE_ALLOW_HTTP"}
NO_BUCKET = ("NoSuchBucket", "ContainerNotFound", "The specified bucket does not exist")
FORBIDDEN = ("401 Unauthorized", "403 Forbidden")
REFUSED = "the storage refuses what these credentials ask for"
LISTED = 1000
"""Keys that a storage tells at a time"""
PUT_AT_ONCE = 16
"""Files that are put at a time: each waits for the network"""
UNREACHED = ("error sending request", "operation timed out", "connection closed")


def explained(error: Exception, place: str) -> OSError:
    """What obstore raised of an address as an OSError that says what to do.

    A FileNotFoundError only where the bucket is there and the object is not.
    """
    whole = str(error)
    reason = " ".join((whole.splitlines() or [type(error).__name__])[0].split())
    code = re.search(r"<Code>(\w+)</Code>", whole)
    said = _NOISE.sub("", reason.partition(": <")[0]) + (f", {code[1]}" if code else "")
    scheme, _, rest = place.partition("://")
    if any(host in reason for host in METADATA_SERVICES):
        return PermissionError(errno.EACCES, f"no credentials: {WHO[scheme]}", place)
    if any(words in whole for words in NO_BUCKET):
        bucket = rest.partition("/")[0]
        return NotADirectoryError(errno.ENOTDIR, f"the storage has no bucket {bucket!r}", place)
    if isinstance(error, FileNotFoundError):
        return FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), place)
    if isinstance(error, PermissionError) or any(words in reason for words in FORBIDDEN):
        return PermissionError(errno.EACCES, f"{REFUSED} ({said}): {WHO[scheme]}", place)
    if "http://" in reason and "builder error" in reason:
        hint = f"a storage without TLS needs {ALLOW_HTTP[scheme]}=true"
        return PermissionError(errno.EACCES, f"{hint} ({said})", place)
    if any(words in reason for words in UNREACHED):
        return OSError(errno.EIO, f"the storage cannot be reached ({said})", place)
    return OSError(errno.EIO, said, place)


_NOISE = re.compile(
    r"^Generic \w+ error: |Error performing (?:list request: Error performing )?(?=[A-Z]+ )"
    r"| in [\d.]+[nµm]?s\b|, max_retries: \d+, retry_timeout: \d+s"
)
"""What obstore says that helps nobody here"""


@functools.cache
def _meet(root: Url) -> None:
    """Ask a bucket once in each process, so that later requests may be patient; OSError."""
    import obstore
    from obstore.exceptions import BaseError

    try:
        next(iter(obstore.list(_open(root, FIRST), chunk_size=1)), None)
    except (BaseError, OSError) as error:
        told = explained(error, str(root))
        if not str(told.strerror).startswith(REFUSED):  # who may not list may perhaps read
            raise told from error


def _open(url: Url, retry: Any) -> Any:
    from obstore.exceptions import BaseError
    from obstore.store import from_url

    scheme = url.parts[0].rstrip(":")
    name, path = os.environ.get(PROFILE), os.environ.get(CREDENTIALS_FILE, "~/.aws/credentials")
    options: dict[str, Any] = {}
    if (
        scheme == "s3"
        and not {KEY, UNSIGNED} & os.environ.keys()  # a key of the environment goes before profiles
        and (name is not None or Path(path).expanduser().is_file())
    ):
        options = _read_profile(name, path)
    try:
        return from_url(str(url), retry_config=retry, **options)
    except (BaseError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{url} cannot be used: {reason}: {WHO[scheme]}") from error


@functools.cache
def _read_profile(name: str | None, path: str) -> dict[str, Any]:
    """Options of `from_url` by a profile in ~/.aws: what gives its credentials, and its endpoint.

    Raises:
      InputError: boto3 is not installed, or there is no such profile.
    """
    what = f"{PROFILE}={name}" if name else f"the profile in {path}"
    require("boto3", extra="aws", purpose=what)
    import boto3
    from botocore.configprovider import ConfiguredEndpointProvider
    from botocore.exceptions import BotoCoreError
    from botocore.session import get_session
    from obstore.auth.boto3 import Boto3CredentialProvider

    try:
        known = get_session()
        provider = Boto3CredentialProvider(boto3.Session(botocore_session=known))
        endpoint = ConfiguredEndpointProvider(
            known.full_config, known.get_scoped_config(), "s3"
        ).provide()
    except (BotoCoreError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{what} gives no credentials ({reason}): {WHO['s3']}") from error
    config = {"endpoint": endpoint} if endpoint else {}
    return {"credential_provider": provider, "config": config}


class ObjectFiles(Files):
    """Objects whose keys begin alike. A process that was forked after the first use cannot use it:
    obstore has threads."""

    def __init__(self, url: Url):
        require("obstore", extra="cloud", purpose=f"the address {url}")
        import obstore

        self.url, self._obstore = url, obstore

    def __reduce__(self) -> tuple[Any, ...]:
        return ObjectFiles, (self.url,)

    @functools.cached_property
    def _objects(self) -> Any:
        """obstore's view of the place.

        Raises:
          InputError: the address or its configuration cannot be used, or boto3 is missing.
          OSError: no such storage or bucket answers.
        """
        _meet(Url(*self.url.parts[:2]))
        return _open(self.url, PATIENT)

    @property
    def name(self) -> str:
        """Its address."""
        return str(self.url)

    def read(self, key: str) -> bytes:
        """All of an object."""
        with self._told(key):
            return bytes(self._obstore.get(self._objects, key).bytes())

    def write(self, key: str, data: bytes, *, safe: bool = False) -> None:
        """Put an object, which is there whole from then on, and which the storage keeps."""
        with self._told(key):
            self._obstore.put(self._objects, key, data)

    def take(self, files: Mapping[str, Path]) -> None:
        """Put the content of files, some at a time, in parts where one is large."""

        def put(key: str) -> None:
            with self._told(key):
                self._obstore.put(self._objects, key, files[key])
            files[key].unlink()

        _ = self._objects  # opened once, and not by each thread
        with ThreadPoolExecutor(PUT_AT_ONCE) as threads:
            for _ in threads.map(put, files):
                pass

    def size(self, key: str) -> int | None:
        """Size of an object."""
        try:
            with self._told(key):
                return int(self._obstore.head(self._objects, key)["size"])
        except FileNotFoundError:
            return None

    def exists(self, key: str) -> bool:
        """Whether there is such an object."""
        return self.size(key) is not None

    def sum(self, key: str) -> FileSum:
        """Size and hash of an object."""
        digest, size = hashlib.sha256(), 0
        with self._told(key):
            for piece in self._obstore.get(self._objects, key):
                digest.update(piece)
                size += len(piece)
        return FileSum(size, digest.hexdigest())

    def sizes(self) -> Iterator[tuple[str, int]]:
        """All objects."""
        with self._told(""):
            for some in self._obstore.list(self._objects, chunk_size=LISTED):
                for one in some:
                    yield str(one["path"]), int(one["size"])

    def folders(self) -> list[str]:
        """First parts of longer keys."""
        with self._told(""):
            found = self._obstore.list_with_delimiter(self._objects)["common_prefixes"]
        return sorted(str(name).rstrip("/") for name in found)

    def zarr_store(self) -> Any:
        """zarr's own view of an object storage."""
        from zarr.storage import ObjectStore

        return ObjectStore(self._objects, read_only=True)

    def remove(self, key: str) -> None:
        """Delete an object."""
        with contextlib.suppress(FileNotFoundError), self._told(key):
            self._obstore.delete(self._objects, key)

    def remove_all(self) -> None:
        """Delete every object."""
        for key in list(self.all_keys()):
            with contextlib.suppress(OSError):
                self.remove(key)

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
