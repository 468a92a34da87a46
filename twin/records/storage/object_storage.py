"""Object storage: read and write objects below addresses such as s3://bucket/missions.zarr.

obstore does the requests. Credentials and endpoint come from the environment variables of the
storage's own tools: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION, AWS_ENDPOINT_URL etc.
boto3 reads profiles in ~/.aws, as Amazon's own tools do.

`ObjectFiles` has the interface of `Files`; `explained` translates obstore's errors.
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
"""Retries of a request if the storage is busy or does not answer: their number, and the time after
which none is made"""
FIRST = {"max_retries": 2, "retry_timeout": datetime.timedelta(seconds=8)}
"""Retries of a process's first request: fewer, so that a wrong address soon raises an error. One
try takes up to 5 s to connect and up to 30 s for an answer."""
KEY, PROFILE = "AWS_ACCESS_KEY_ID", "AWS_PROFILE"
CREDENTIALS_FILE = "AWS_SHARED_CREDENTIALS_FILE"
UNSIGNED = "AWS_SKIP_SIGNATURE"
WHO = {
    "s3": f"set {KEY} and AWS_SECRET_ACCESS_KEY, or {PROFILE}; {UNSIGNED}=true for public buckets",
    "gs": "set GOOGLE_APPLICATION_CREDENTIALS to the path of a service account's key",
    "az": "set AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY",
}
"""Advice on how to set credentials, by scheme"""
METADATA_SERVICES = ("169.254.169.254", "metadata.google.internal")
"""Hosts that give credentials to a cloud's machines; obstore asks them if it has no credentials."""
ALLOW_HTTP = {"s3": "AWS_ALLOW_HTTP", "gs": "GOOGLE_ALLOW_HTTP", "az": "AZURE_ALLOW_HTTP"}
NO_BUCKET = ("NoSuchBucket", "ContainerNotFound", "The specified bucket does not exist")
FORBIDDEN = ("401 Unauthorized", "403 Forbidden")
REFUSED = "the storage refuses what these credentials ask for"
LISTED = 1000
"""Keys in each answer of a storage's listing"""
PUT_AT_ONCE = 16
"""Number of files that are uploaded at a time, since each waits for the network"""
UNREACHED = ("error sending request", "operation timed out", "connection closed")


def explained(error: Exception, place: str) -> OSError:
    """Translate an error of obstore to an OSError with advice.

    A FileNotFoundError means that the bucket exists and the object does not.
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
"""Parts of obstore's messages that do not help a user"""


@functools.cache
def _meet(root: Url) -> None:
    """Ask a bucket once in each process, so that a wrong address fails soon; raises OSError."""
    import obstore
    from obstore.exceptions import BaseError

    try:
        next(iter(obstore.list(_open(root, FIRST), chunk_size=1)), None)
    except (BaseError, OSError) as error:
        told = explained(error, str(root))
        if not str(told.strerror).startswith(REFUSED):  # may lack listing rights, not reading
            raise told from error


def _open(url: Url, retry: Any) -> Any:
    from obstore.exceptions import BaseError
    from obstore.store import from_url

    scheme = url.parts[0].rstrip(":")
    name, path = os.environ.get(PROFILE), os.environ.get(CREDENTIALS_FILE, "~/.aws/credentials")
    options: dict[str, Any] = {}
    if (
        scheme == "s3"
        and not {KEY, UNSIGNED} & os.environ.keys()  # a key in the environment precedes profiles
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
    """Options of `from_url` from a profile in ~/.aws: its credential provider and its endpoint.

    Raises:
      InputError: boto3 is not installed, or the profile gives no credentials.
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
    """Objects below an address. A process forked after the first use cannot use the instance, as
    obstore has threads."""

    def __init__(self, url: Url):
        require("obstore", extra="cloud", purpose=f"the address {url}")
        import obstore

        self.url, self._obstore = url, obstore

    def __reduce__(self) -> tuple[Any, ...]:
        return ObjectFiles, (self.url,)

    @functools.cached_property
    def _objects(self) -> Any:
        """obstore's object for the address.

        Raises:
          InputError: the address or its configuration cannot be used, or boto3 is missing.
          OSError: the storage does not answer, or has no such bucket.
        """
        _meet(Url(*self.url.parts[:2]))
        return _open(self.url, PATIENT)

    @property
    def name(self) -> str:
        """The address."""
        return str(self.url)

    def read(self, key: str) -> bytes:
        """Read an object."""
        with self._translate_errors(key):
            return bytes(self._obstore.get(self._objects, key).bytes())

    def write(self, key: str, data: bytes, *, safe: bool = False) -> None:
        """Write an object; it is complete and safe when this returns, whatever `safe` is."""
        with self._translate_errors(key):
            self._obstore.put(self._objects, key, data)

    def take(self, files: Mapping[str, Path]) -> None:
        """Upload files of this machine, several at a time, and remove them."""

        def put(key: str) -> None:
            with self._translate_errors(key):
                self._obstore.put(self._objects, key, files[key])
            files[key].unlink()

        _ = self._objects  # opened once, and not by each thread
        with ThreadPoolExecutor(PUT_AT_ONCE) as threads:
            for _ in threads.map(put, files):
                pass

    def size(self, key: str) -> int | None:
        """Size [byte] of an object; None if there is none."""
        try:
            with self._translate_errors(key):
                return int(self._obstore.head(self._objects, key)["size"])
        except FileNotFoundError:
            return None

    def exists(self, key: str) -> bool:
        """Return whether an object has this key."""
        return self.size(key) is not None

    def sum(self, key: str) -> FileSum:
        """Size and hash of an object."""
        digest, size = hashlib.sha256(), 0
        with self._translate_errors(key):
            for piece in self._obstore.get(self._objects, key):
                digest.update(piece)
                size += len(piece)
        return FileSum(size, digest.hexdigest())

    def sizes(self) -> Iterator[tuple[str, int]]:
        """Key and size [byte] of every object."""
        with self._translate_errors(""):
            for some in self._obstore.list(self._objects, chunk_size=LISTED):
                for one in some:
                    yield str(one["path"]), int(one["size"])

    def folders(self) -> list[str]:
        """First parts of the keys that have more than one part, sorted."""
        with self._translate_errors(""):
            found = self._obstore.list_with_delimiter(self._objects)["common_prefixes"]
        return sorted(str(name).rstrip("/") for name in found)

    def zarr_store(self) -> Any:
        """Return a store object that zarr and xarray open to read."""
        from zarr.storage import ObjectStore

        return ObjectStore(self._objects, read_only=True)

    def remove(self, key: str) -> None:
        """Delete an object if there is one."""
        with contextlib.suppress(FileNotFoundError), self._translate_errors(key):
            self._obstore.delete(self._objects, key)

    def remove_all(self) -> None:
        """Delete every object as far as the storage allows."""
        for key in list(self.all_keys()):
            with contextlib.suppress(OSError):
                self.remove(key)

    @contextlib.contextmanager
    def _translate_errors(self, key: str) -> Iterator[None]:
        """Translate obstore's errors to an OSError that names the object."""
        from obstore.exceptions import BaseError

        place = f"{self.url}/{key}" if key else str(self.url)
        try:
            yield
        except (BaseError, OSError) as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise  # comes from this machine's disk, or is translated already
            raise explained(error, place) from error
