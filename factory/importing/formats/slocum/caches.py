"""Cache files: the lists of sensors that a Slocum's binary files refer to."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from factory.importing.formats.slocum.compressed import is_compressed, unpacked
from factory.importing.formats.slocum.file_names import CACHES
from twin.errors import InputError


class CacheShelf:
    """The cache files that are at hand, and the folder from which the decoder takes them."""

    def __init__(self, folder: Path, given: Path | None, named: Sequence[Path]):
        """A shelf.

        Args:
          folder: an empty one: the decoder writes into it.
          given: the user's folder of cache files; None: beside the logs.
          named: cache files that the user named.

        Raises:
          InputError: no such folder.
        """
        if given is not None and not given.is_dir():
            raise InputError(f"no folder {given} for cache files")
        self.folder = folder
        self._given = given
        self._named = named
        self._places: dict[Path, dict[str, Path]] = {}
        self._told: dict[str, str] = {}
        self._checked: dict[tuple[str, int, int], None] = {}

    def prepare(self, path: Path, header: Mapping[str, str]) -> None:
        """Put the cache file that `path` names into the folder.

        Raises:
          InputError: it is not there, or is another file's.
        """
        if header.get("sensor_list_factored") == "0":
            return  # the file lists its sensors itself
        name = header["sensor_list_crc"].lower()
        total = (int(header["total_num_sensors"]), int(header["sensors_per_cycle"]))
        if (name, *total) in self._checked:
            return
        found = self._at_hand(path)
        if name not in found:
            raise InputError(f"{path.name}: {self._missing(path, name, found)}")
        target = self.folder / f"{name}.cac"
        if is_compressed(found[name]):
            plain, _ = unpacked(found[name], self.folder)
            plain.replace(target)
        else:
            shutil.copyfile(found[name], target)
        lines = target.read_text("latin-1").split("\n")
        listed = [line.split() for line in lines if line.startswith("s:")]
        used = sum(1 for words in listed if len(words) > 1 and words[1] == "T")
        if (len(listed), used) != total:
            raise InputError(
                f"cache file {name}.cac is not the one of {path.name}: it lists {used} of "
                f"{len(listed)} sensors, the header says {total[1]} of {total[0]}"
            )
        self._checked[(name, *total)] = None

    def _missing(self, path: Path, name: str, found: Mapping[str, Path]) -> str:
        """What is missing, and the folder that has it where one of the neighbours does."""
        if name not in self._told:
            others = ", ".join(sorted(one.name for one in found.values())[:4]) or "no cache file"
            places = ", ".join(dict.fromkeys(str(p) for p in self._folders(path)))
            near = _folder_with(name, self._folders(path))
            advice = "give its folder with --cache" if near is None else f"give --cache {near}"
            self._told[name] = (
                f"cache file {name}.cac is missing; there is {others} in {places}; {advice}"
            )
        return self._told[name]

    def _folders(self, path: Path) -> list[Path]:
        if self._given is not None:
            return [self._given]
        return [path.parent, *(cache.parent for cache in self._named)]

    def _at_hand(self, path: Path) -> dict[str, Path]:
        """Cache files by their number, plain ones before compressed ones."""
        found: dict[str, Path] = {}
        for folder in self._folders(path):
            if folder not in self._places:
                every = sorted(folder.iterdir(), key=lambda one: one.suffix.lower())
                here: dict[str, Path] = {}
                for one in every:
                    if one.suffix.lower() in CACHES:
                        here.setdefault(one.stem.lower(), one)
                self._places[folder] = here
            found = {**self._places[folder], **found}
        return found


def _folder_with(name: str, folders: Sequence[Path]) -> Path | None:
    """The folder in or beside one of these that holds a cache file of this number."""
    for folder in dict.fromkeys(folders):
        for around in (folder, Path(os.path.normpath(folder / ".."))):
            try:
                near = sorted(one for one in around.iterdir() if one.is_dir())
                for one in near:
                    if any(
                        file.stem.lower() == name and file.suffix.lower() in CACHES
                        for file in one.iterdir()
                    ):
                        return one
            except OSError:
                continue  # a folder that may not be looked into offers nothing
    return None
