"""Compressed files of a Slocum (.dcd, .ecd ..., .ccc): unpacked beside their plain names.

Such a file is a row of blocks: two bytes of length, big-endian, and as many bytes of lz4.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from twin.errors import InputError

_BLOCK = 32 * 1024
"""[bytes] of a block when unpacked, at most."""


def is_compressed(path: Path) -> bool:
    """Whether the file's ending is that of a compressed one: .dcd, .ccc."""
    ending = path.suffix.lower()
    return len(ending) == 4 and ending[2] == "c" and ending[3] in "dc" and ending != ".cac"


def unpacked(path: Path, folder: Path) -> tuple[Path, bool]:
    """The plain file in `folder`, and whether the compressed one was cut.

    What comes before a block that is cut or damaged is unpacked.

    Raises:
      ModuleNotFoundError: lz4, which comes with the extra `slocum`, is not installed.
      InputError: not even the first block can be unpacked.
    """
    lz4: Any = import_module("lz4.block")
    packed = path.read_bytes()
    plain, at, cut = bytearray(), 0, False
    while at < len(packed):
        size = int.from_bytes(packed[at : at + 2], "big")
        block = packed[at + 2 : at + 2 + size]
        try:
            plain += lz4.decompress(block, _BLOCK)
        except lz4.LZ4BlockError as error:
            if not plain:
                raise InputError(
                    f"{path.name} is no compressed Slocum file, or is cut in its first block: "
                    f"{' '.join(str(error).split())}"
                ) from error
            cut = True
            break
        at += 2 + size
    ending = f".{path.suffix[1].lower()}bd" if path.suffix[-1] in "dD" else ".cac"
    target = folder / f"{path.stem}{ending}"
    target.write_bytes(plain)
    return target, cut
