"""Object storage: obstore's view of an address, who asks, and what its errors mean.

Who may read and write, and where the storage is, say the environment variables that the storage's
own tools read: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION, AWS_ENDPOINT_URL and so on.
Profiles of ~/.aws are read by boto3, as Amazon's own tools read them.
"""

from __future__ import annotations

import datetime
import errno
import functools
import os
import re
from pathlib import Path
from typing import Any

from twin.errors import InputError
from twin.extras import require
from twin.records.store_path import Url

RETRIES, RETRY_S = 8, 60
"""Times that a request is repeated when the storage does not answer or says that it is busy, and
[s] after which it is not repeated"""
FIRST_RETRIES, FIRST_S = 2, 8
"""The same of a process's first request: an address that leads nowhere is told soon. One try takes
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
UNREACHED = ("error sending request", "operation timed out", "connection closed")


def open_objects(url: Url) -> Any:
    """obstore's view of the objects whose keys begin with an address.

    Raises:
      InputError: the address or its configuration cannot be used, or boto3 is missing.
      OSError: no such storage or bucket answers.
    """
    _meet(_root(url))
    return _open(url, {"max_retries": RETRIES, "retry_timeout": _seconds(RETRY_S)})


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

    retry = {"max_retries": FIRST_RETRIES, "retry_timeout": _seconds(FIRST_S)}
    first = _open(root, retry)
    try:
        next(iter(obstore.list(first, chunk_size=1)), None)
    except (BaseError, OSError) as error:
        told = explained(error, str(root))
        if not str(told.strerror).startswith(REFUSED):  # who may not list may perhaps read
            raise told from error


def _open(url: Url, retry: Any) -> Any:
    from obstore.exceptions import BaseError
    from obstore.store import from_url

    options: dict[str, Any] = {}
    credentials = _profile() if _scheme(url) == "s3" else None
    if credentials is not None:
        options = {"credential_provider": credentials[0], "config": credentials[1]}
    try:
        return from_url(str(url), retry_config=retry, **options)
    except (BaseError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{url} cannot be used: {reason}: {WHO[_scheme(url)]}") from error


def _profile() -> tuple[Any, dict[str, str]] | None:
    """What gives the credentials of a profile in ~/.aws, and what else the profile says; None when
    the environment has a key itself, or there are no profiles.

    Raises:
      InputError: boto3 is not installed, or there is no such profile.
    """
    environment = os.environ
    if KEY in environment or UNSIGNED in environment:
        return None
    name, path = environment.get(PROFILE), environment.get(CREDENTIALS_FILE, "~/.aws/credentials")
    if name is None and not Path(path).expanduser().is_file():
        return None
    return _read_profile(name, path)


@functools.cache
def _read_profile(name: str | None, path: str) -> tuple[Any, dict[str, str]]:
    what = f"{PROFILE}={name}" if name else f"the profile in {path}"
    require("boto3", extra="aws", purpose=what)
    import boto3
    from botocore.configprovider import ConfiguredEndpointProvider
    from botocore.exceptions import BotoCoreError
    from obstore.auth.boto3 import Boto3CredentialProvider

    try:
        session = boto3.Session()
        provider = Boto3CredentialProvider(session)
        known = session._session
        endpoint = ConfiguredEndpointProvider(
            known.full_config, known.get_scoped_config(), "s3"
        ).provide()
    except (BotoCoreError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{what} gives no credentials ({reason}): {WHO['s3']}") from error
    return provider, {"endpoint": endpoint} if endpoint else {}


def _root(url: Url) -> Url:
    """The bucket of an address."""
    return Url(*url.parts[:2])


def _scheme(url: Url) -> str:
    return url.parts[0].rstrip(":")


def _seconds(number: float) -> datetime.timedelta:
    return datetime.timedelta(seconds=number)
