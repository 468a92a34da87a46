"""Slocum: files of Teledyne's gliders; one reader takes binary files, another tables."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.slocum.caches import BINARY, CACHES
from twin.errors import InputError

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.formats.base import Reader, ReadOptions
    from factory.importing.tally import Tally


def read_slocum(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    """Read all files into logs; binary files and tables become deployments of their own.

    If one of the two readers finds no log, its files are left out and reported.

    Raises:
      InputError: neither reader finds a log.
    """
    from factory.importing.deployment_log import UNREADABLE
    from factory.importing.formats.slocum.ascii_tables import is_text
    from factory.importing.formats.slocum.binary import read_slocum_binary
    from factory.importing.formats.slocum.sensor_tables import read_slocum_tables

    binary = [p for p in paths if p.suffix.lower() in BINARY and not is_text(p)]
    caches = [p for p in paths if p.suffix.lower() in CACHES]
    tables = [p for p in paths if p not in binary and p not in caches]
    if not binary and not tables:
        raise InputError("only cache files (.cac) are named; add the .dbd and .ebd files")
    logs: list[DeploymentLog] = []
    refused: list[tuple[int, InputError]] = []
    decode = functools.partial(read_slocum_binary, caches=caches)
    readers: list[tuple[list[Path], Reader]] = [(binary, decode), (tables, read_slocum_tables)]
    for some, read in readers:
        try:
            logs += read(some, options, tally) if some else []
        except InputError as error:
            refused.append((len(some), error))
    if not logs and len(refused) > 1:
        raise InputError("; ".join(str(error) for _, error in refused))
    for count, why in refused:
        if not logs:
            raise why
        tally.add("left out", UNREADABLE, count, str(why))
    return logs
