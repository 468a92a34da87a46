"""Checkpoint: the state of a network's training, in a file that is replaced as a whole."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from twin.bounded import check_archive
from twin.cli.console import one_line
from twin.errors import StoreError
from twin.records.storage.whole import whole_file

NEEDED = {"identity", "history", "best", "best_state", "bad"}
"""Entries of every checkpoint."""


def write_checkpoint(path: Path, state: dict[str, Any]) -> None:
    """Write a checkpoint of tensors and plain values, with the entries NEEDED."""
    saved = io.BytesIO()  # write the file below: torch.save would hide an OSError
    torch.save(state, saved)
    # if the process is killed while writing, the previous checkpoint stays
    with whole_file(path) as place:
        place.write_bytes(saved.getbuffer())


def _check_records(checkpoint: Path) -> None:
    """Check the CRC-32 of a checkpoint's records, because torch does not check it.

    Raises:
      StoreError: a record is damaged.
    """
    try:
        with zipfile.ZipFile(checkpoint) as archive:
            damaged = archive.testzip()
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, ValueError) as error:
        damaged = str(error)
    if damaged is not None:
        raise StoreError(
            f"checkpoint {checkpoint} is damaged ({damaged}); remove it to train this network from "
            "its start"
        )


def read_checkpoint(
    path: Path, device: torch.device | str, identity: Mapping[str, Any]
) -> dict[str, Any]:
    """Read a checkpoint, which may hold tensors and plain values only.

    Args:
      identity: settings of the present training, which must equal those in the checkpoint.

    Raises:
      StoreError: the file is damaged, is no checkpoint, or has other settings.
    """
    remedy = "remove it to start over"
    try:
        check_archive(path, f"checkpoint {path}", StoreError)
    except StoreError as error:
        raise StoreError(f"{error}; {remedy}") from error
    _check_records(path)
    try:
        saved = torch.load(path, map_location=device, weights_only=True)
        missing = NEEDED - set(saved)
    except Exception as error:  # the reader of torch raises many types
        line = one_line(str(error)).split(". ")[0]
        raise StoreError(
            f"checkpoint {path} cannot be read ({type(error).__name__}: {line}); {remedy}"
        ) from error
    if missing:
        raise StoreError(f"checkpoint {path} lacks {', '.join(sorted(missing))}; {remedy}")
    if saved["identity"] != identity:
        raise StoreError(
            f"checkpoint {path} was made with other settings "
            f"({_difference(saved['identity'], identity)}); give the same ones, or remove it to "
            "start over"
        )
    return dict(saved)


def _difference(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> str:
    """First setting that differs, in words."""
    for part, values in ours.items():
        if not isinstance(values, dict):
            if theirs.get(part) != values:
                return f"{part} {theirs.get(part)} instead of {values}"
            continue
        for name, value in values.items():
            if theirs.get(part, {}).get(name) != value:
                return f"{part} {name} {theirs.get(part, {}).get(name)} instead of {value}"
    return "an unknown one"
