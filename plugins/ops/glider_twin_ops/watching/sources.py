"""Sources: the places that logs come from, and the surface dialogues that come with them.

A data set of an ERDDAP server comes as one table for each UTC day. The newest days are fetched at
every pass, an older day once, or again after its file was removed. The server
sends comma-separated text whose header has names and units (`.csvp`), so that a mapping names
columns such as `time (UTC)`. The package erddapy makes addresses and constraints.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import datetime
import io
import math
import re
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from factory.importing import OF_THE_MACHINE
from twin.cli import require
from twin.errors import InputError
from twin.lazy import resolve
from twin.records import whole_file
from twin.registry import Registry

NEWEST = 3
"""Number of last days that every pass fetches, because the server may still get their rows"""
PATIENCE = 60.0
"""[s] Longest wait for a server's answer"""
MOST = 200 * 2**20
"""[byte] Limit of a day's table; a hundred columns at 1 Hz need less"""
LONGEST = 1500
"""[d] Limit of a data set's duration: no vehicle has been at sea for longer"""
NOTHING = 404
"""HTTP status of an answer without rows"""
EMPTY = ".none"
"""Ending of a hidden file that stands for a day without rows"""
DAY = datetime.timedelta(days=1)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SurfaceDialogue:
    """Values that a vehicle sent at one surfacing; times are [s] unix."""

    vehicle: str
    time: float
    """Time by the vehicle's clock or by the base station's"""
    fix: tuple[float, float] | None
    """Latitude, longitude [degree]"""
    fix_time: float | None
    sensors: Mapping[str, tuple[float, str]]
    """Value and unit by name"""
    why: str
    """Reason of the surfacing in the vehicle's words; empty without one"""
    aborts: int | None
    """Number of aborts since the vehicle's reset; None if the vehicle does not send it"""

    def facts(self) -> dict[str, str]:
        """Names and values for a page."""
        said = {"why it came up": self.why} if self.why else {}
        if self.aborts is not None:
            said["aborts since its reset"] = f"{self.aborts}"
        return said | {name: f"{v:g} {unit}" for name, (v, unit) in sorted(self.sensors.items())}


Dialogues = Callable[[Sequence[Path]], list[SurfaceDialogue]]
"""Reader of dialogues, one for each surfacing; a surfacing that cannot be read is left out."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Source:
    """Source of files; documents show all fields except names of functions."""

    name: str
    """Name, such as slocum"""
    says: str
    """Files that arrive, in a few words"""
    logs: tuple[str, ...]
    """Types of the source's logs, as named by `factory import`"""
    joins: bool = False
    """True if all logs are one deployment, although `factory import` makes a deployment of each"""
    dialogues: str = ""
    """Pattern of the names of files with dialogues; empty: there are none"""
    read_dialogues: str = ""
    """Reader of the files with dialogues, `module:function`; see `Dialogues`"""
    address: str = ""
    """Pattern of the addresses that stand for a folder; empty: the source is a folder"""
    fetch: str = ""
    """Function that brings an address's files, `module:function`: (address, folder) -> None"""

    def __post_init__(self) -> None:
        for field in ("name", "says", "logs"):
            if not getattr(self, field):
                raise InputError(f"source {self.name!r}: {field} is empty; state what it is")
        for one, other in (("dialogues", "read_dialogues"), ("address", "fetch")):
            if bool(getattr(self, one)) != bool(getattr(self, other)):
                raise InputError(f"source {self.name!r}: {one} and {other} belong together")
        for field in ("dialogues", "address"):
            try:
                re.compile(getattr(self, field))
            except re.error as error:
                raise InputError(f"source {self.name!r}: {field} is no pattern: {error}") from error


SOURCES: Registry[Source] = Registry(
    "source",
    group="glider_twin.sources",
    folder="plugins/ops/glider_twin_ops/watching",
    base="glider_twin_ops.watching.Source",
    page="howto/watch.md#a-source-of-your-own",
    shipped={
        name: f"{__name__}:{name.upper()}"
        for name in ("slocum", "seaglider", "seaexplorer", "lrauv", "netcdf", "tables", "erddap")
    },
    objects=True,
)
"""Types of source, by name."""


def source_of(address: str, kind: str) -> Source:
    """Find the source for an address, or for a folder with logs of a type.

    Args:
      kind: type of the logs; empty: no file reveals it yet.

    Raises:
      InputError: no source brings such logs from there.
    """
    online = [one for one in SOURCES.values() if one.address and re.match(one.address, address)]
    if "://" in address and not online:
        known = ", ".join(one.says for one in SOURCES.values() if one.address)
        raise InputError(f"source {address} is no address that is known: {known}, or a folder")
    there = online or [one for one in SOURCES.values() if not one.address]
    for one in there:
        if not kind or kind in one.logs:
            return one
    if online:
        raise InputError(
            f"source {address} brings logs of the kind {' or '.join(online[0].logs)}, not {kind}: "
            "set kind in deployment.toml"
        )
    return SOURCES["tables"]


def newest_dialogue(
    kind: str, folder: Path, *, recursive: bool, until: datetime.datetime | None = None
) -> SurfaceDialogue | None:
    """Read the newest surface dialogue in the files of a folder; None without any.

    Args:
      kind: type of the logs; empty: unknown, so that the dialogues of every source are read.
      until: latest time of a surfacing, UTC.
    """
    if not folder.is_dir():
        return None
    every = sorted(folder.rglob("*") if recursive else folder.iterdir())
    names = [one for one in every if not one.name.startswith(".")]
    last = math.inf if until is None else until.timestamp()
    known: list[SurfaceDialogue] = []
    for source in SOURCES.values():
        if source.dialogues and (not kind or kind in source.logs):
            fits = re.compile(source.dialogues, re.IGNORECASE).fullmatch
            read: Dialogues = resolve(source.read_dialogues)
            for path in (one for one in names if fits(one.name)):
                try:
                    known += read([path])
                except OF_THE_MACHINE:
                    raise
                except Exception:
                    continue  # an unreadable dialogue must not prevent the page
    return max((d for d in known if d.time <= last), key=lambda one: one.time, default=None)


SLOCUM = Source(
    name="slocum",
    says="folder of a dockserver: .sbd and .tbd (.dbd, .ebd, .mbd, .nbd; compressed, too) with "
    "their .cac, and the surface dialogues *.log",
    logs=("slocum",),
    dialogues=r".+\.log",
    read_dialogues="glider_twin_ops.watching.dialogues:read_dialogues",
)

SEAGLIDER = Source(
    name="seaglider",
    says="folder of a base station: p*.nc, a dive each, and comm.log with every call",
    logs=("seaglider",),
    dialogues=r"comm(?:_\w+)?\.log",
    read_dialogues="glider_twin_ops.watching.dialogues:read_calls",
)

SEAEXPLORER = Source(
    name="seaexplorer",
    says="folder of .gli and .pld1 files, a cycle each, plain or gzip",
    logs=("seaexplorer",),
)

LRAUV = Source(
    name="lrauv",
    says="folder of .mat and .nc4 logs, one for each time the vehicle began a log",
    logs=("lrauv",),
    joins=True,
)
"""MBARI's long-range AUVs; logs of one vehicle may share a name, each in a folder of its own."""

NETCDF = Source(
    name="netcdf",
    says="folder with a netCDF file that grows, or with a profile a file: OG1.0, NGDAC, Spray",
    logs=("og1", "ngdac", "spray"),
)

TABLES = Source(
    name="tables",
    says="folder of tables, or of logs of a kind of your own",
    logs=("csv",),
)
"""Tables of any vehicle, by a mapping; and importers from outside the package."""

ERDDAP = Source(
    name="erddap",
    says="a tabledap data set of an ERDDAP server, https://SERVER/erddap/tabledap/DATASET, read as "
    "a table by the mapping of deployment.toml",
    logs=("csv",),
    address=r"https?://[^?#]+/tabledap/[^/?#]+/?$",
    fetch="glider_twin_ops.watching.sources:fetch_days",
)


def fetch_days(address: str, folder: Path) -> None:
    """Fetch a data set's days into a folder.

    Args:
      address: https://SERVER/erddap/tabledap/DATASET.
      folder: made if it is missing; its files are named DATASET-YYYY-MM-DD.csv.

    Raises:
      InputError: erddapy is not installed; the server does not answer, or gives no range of times.
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
    """First and last day of a data set, by the attributes of its variable `time` on the server."""
    rows = csv.reader(io.StringIO(_answer(url, address).decode("utf-8", "replace")))
    spans = (row[-1] for row in rows if row[:3] == ["attribute", "time", "actual_range"])
    with contextlib.suppress(ValueError, OverflowError, OSError):
        begin, end = (
            datetime.datetime.fromtimestamp(float(word), datetime.UTC).date()
            for word in re.split(r"\s*,\s*", next(spans, ""))
        )
        return begin, end
    raise InputError(f"{address} does not say from when to when its variable time reaches")


def _answer(url: str, address: str, *, lacking: bytes | None = None) -> bytes:
    """Fetch a server's answer.

    Args:
      lacking: value that is returned if the server says that there are no rows.

    Raises:
      InputError: no answer, an error, or too many bytes.
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
