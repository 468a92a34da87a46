"""ERDDAP: a data set of a server as one table a day, fetched once; the newest days again.

The server sends each UTC day's rows as comma-separated text whose header has names and units
(`.csvp`), so that a mapping names columns such as `time (UTC)`. Addresses and constraints are made
by the package erddapy. A day that is older than the newest ones stays as it was fetched: take its
file away, and the next pass asks for it again.
"""

from __future__ import annotations

import csv
import datetime
import io
import re
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from twin.cli import require
from twin.errors import InputError
from twin.records import whole_file

NEWEST = 3
"""Days at the end that are asked for at every pass: rows of them may still come"""
PATIENCE = 60.0
"""[s] without an answer, after which a server is given up"""
MOST = 200 * 2**20
"""[byte] of a day: a sample a second of a hundred columns is less"""
LONGEST = 1500
"""[d] of a data set: no vehicle has been at sea for longer"""
NOTHING = 404
"""Status of an answer without rows"""
EMPTY = ".none"
"""Ending of a hidden file that stands for a day without rows"""
DAY = datetime.timedelta(days=1)


def fetch_days(address: str, folder: Path) -> None:
    """Bring a data set's days into a folder.

    Args:
      address: https://SERVER/erddap/tabledap/DATASET.
      folder: made where it is missing; its files are named DATASET-YYYY-MM-DD.csv.

    Raises:
      InputError: erddapy is not installed; the server does not answer, or does not say its times.
    """
    require("erddapy", extra="erddap", purpose=f"the source {address}")
    from erddapy import ERDDAP

    server, _, dataset = address.rstrip("/").rpartition("/tabledap/")
    asks = ERDDAP(server=server, protocol="tabledap", response="csvp")
    asks.dataset_id = dataset
    begin, end = _range(asks.get_info_url(dataset_id=dataset, response="csv"), address)
    folder.mkdir(parents=True, exist_ok=True)
    days = (end - begin).days + 1
    if days > LONGEST:
        raise InputError(f"{address} spans {days} days: no deployment lasts longer than {LONGEST}")
    for k in range(days):
        day = begin + k * DAY
        path = folder / f"{dataset}-{day:%Y-%m-%d}.csv"
        none = path.with_name(f".{path.name}{EMPTY}")
        if k < days - NEWEST and (path.exists() or none.exists()):
            continue
        url = asks.get_download_url(
            constraints={"time>=": f"{day:%Y-%m-%d}", "time<": f"{day + DAY:%Y-%m-%d}"}
        )
        table = _answer(url, address, lacking=b"")
        with whole_file(path if table else none) as target:
            target.write_bytes(table)
        (none if table else path).unlink(missing_ok=True)


def _range(url: str, address: str) -> tuple[datetime.date, datetime.date]:
    """First and last day of a data set, by what the server says of its variable time."""
    rows = csv.reader(io.StringIO(_answer(url, address).decode("utf-8", "replace")))
    for row in rows:
        if row[:3] == ["attribute", "time", "actual_range"]:
            try:
                begin, end = (float(word) for word in re.split(r"\s*,\s*", row[-1]))
                return _day(begin), _day(end)
            except (ValueError, OverflowError, OSError):
                break
    raise InputError(f"{address} does not say from when to when its variable time reaches")


def _day(seconds: float) -> datetime.date:
    return datetime.datetime.fromtimestamp(seconds, datetime.UTC).date()


def _answer(url: str, address: str, *, lacking: bytes | None = None) -> bytes:
    """What a server sends.

    Args:
      lacking: what stands for an answer that there is nothing.

    Raises:
      InputError: it does not answer, or with an error, or with too much.
    """
    opened: Callable[..., Any] = urllib.request.urlopen
    try:
        with opened(url, timeout=PATIENCE) as answer:
            found: bytes = answer.read(MOST + 1)
    except urllib.error.HTTPError as error:
        if error.code == NOTHING and lacking is not None:
            return lacking
        raise InputError(
            f"{address} answers with the error {error.code}, {error.reason}"
        ) from error
    except OSError as error:
        raise InputError(f"{address} does not answer: {getattr(error, 'reason', error)}") from error
    if len(found) > MOST:
        raise InputError(f"{address} sends more than {MOST} bytes for a day")
    return found
