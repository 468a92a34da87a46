"""Kept parcels: what each piece of a log said, so that a pass reads only what is new.

They lie in a hidden folder of the deployment, a file each, named by what they were made of. Any of
them may be taken away: the next pass makes it again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import json
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from factory.importing import UNREADABLE, ReadOptions
from factory.importing.dives.dive_rows import DiveRow
from factory.importing.import_run import read_logs
from factory.importing.parcels import (
    grown_rows,
    owned_rows,
    read_head,
    read_rows,
    write_rows,
)
from factory.importing.tally import EMPTY, LEFT_OUT, NOT_READ, READ, Tally, by_reason
from factory.watching.sources.arrived_files import ArrivedFiles
from factory.watching.sources.base import WHOLE
from twin.errors import InputError
from twin.plugins import imported
from twin.records.storage.whole import whole_file

KEPT, LISTS = ".parcels", "lists"
ENDING = ".npz"
COUNTED = " (parcels counted)"
"""Behind what is said of a window: its files are in several windows"""
SEVERAL = ("depth samples", "dives", "rows", "GPS fixes", "files")
"""Subjects of counts over a window that say nothing of a parcel"""
IN_SETTINGS = (
    ("--variation-deg", "variation_deg in deployment.toml"),
    (
        "give its folder with --cache",
        "put it beside the files or into the folder that cache in deployment.toml names",
    ),
    ("give --cache ", "name it as cache in deployment.toml: "),
)
"""What an import's message says of its options, and what it is here"""
STATES = (READ, LEFT_OUT, EMPTY, NOT_READ)
"""What became of a name: the first of these that it is in any parcel"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Window:
    """A parcel and those that it is read with, by the digests of their files."""

    digest: str
    members: tuple[str, ...]
    """In order of time"""
    own: tuple[float, float] = (-np.inf, np.inf)
    """[s] unix, from when on dives are its own, and from when on the next one's"""
    begin: tuple[str, float] = ("", 0.0)
    """Vehicle, and when [s] unix its files say that it begins"""
    before: str | None = None
    """The last one that it is not read with"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParcelRows:
    """The dives of all parcels, and what was said of them."""

    rows: tuple[DiveRow, ...]
    """In the order of a store"""
    files: tuple[str, ...]
    """Names of the files that were read"""
    tally: Tally
    period: float
    """[s] between samples"""
    models: frozenset[str]
    """Vehicle files that stand for the vehicles"""
    simulated: bool
    by_depth: bool
    """Whether rows are dives"""
    said: str | None
    """What people said of the deployment, where one parcel is all of it"""
    deployments: tuple[str, ...]
    """Names of those in the files"""


class KeptParcels:
    """The parcels of a deployment's files, read where they are not kept."""

    def __init__(
        self, found: ArrivedFiles, options: ReadOptions, folder: Path, place: Path, *, again: bool
    ):
        """Nothing is read yet.

        Args:
          found: the files. options: how they are read.
          folder: the deployment's. place: where files are copied to for the readers.
          again: read all, whatever is kept.
        """
        self._given = found, options, folder, place
        self.found, self.place, self.again = found, place, again
        self.folder = folder / KEPT
        self.options = self._with_lists(options)
        self._names: dict[str, tuple[str, ...]] = {}
        self._known: dict[str, dict[str, Any] | None] = {}
        self._heads: dict[str, dict[str, Any]] = {}
        self._grow = not found.source.neighbours
        """Whether parcels are read alone: their dives are then kept one by one"""

    def rows(self) -> ParcelRows:
        """The dives of all files; what is kept and no longer asked for goes away.

        Raises:
          InputError: nothing can be read. WriteError: the disk refuses.
        """
        try:
            return self._all()
        except zipfile.BadZipFile:  # a disk that lost bytes of what was kept
            shutil.rmtree(self.folder)
            return KeptParcels(*self._given, again=True)._all()

    def _all(self) -> ParcelRows:
        groups = self.found.source.parcels(self.found.sums)
        if WHOLE in groups and len(groups) > 1 and self._is_log(groups[WHOLE]):
            groups = {WHOLE: tuple(sorted(self.found.sums))}
        self._names = {self.found.digest_of(names): names for names in groups.values()}
        self._known = {d: None if self.again else read_head(self._path(d)) for d in self._names}
        self._grow = self._grow or list(groups) == [WHOLE]
        self._keep_lists()
        for window in self._windows():
            self._cut(window)
        kept = {f"{digest}{ENDING}" for digest in self._heads}
        for path in self.folder.glob(f"*{ENDING}"):
            if path.name not in kept:
                path.unlink(missing_ok=True)
        return self._together()

    def _is_log(self, names: tuple[str, ...]) -> bool:
        """Whether files that have not the names of pieces are a log of the deployment, too."""
        try:
            self.found.stage(names, self.place)
            read_logs(
                self.found.kind, [self.place / name for name in names], self.options, Tally()
            )  # fmt: skip
        except InputError:
            return False
        return True

    def _with_lists(self, options: ReadOptions) -> ReadOptions:
        """With a folder of what every parcel may need, such as lists of sensors."""
        if not self.found.source.lists:
            return options
        place = self.folder / LISTS
        if self.again and place.exists():
            shutil.rmtree(place)
        place.mkdir(parents=True, exist_ok=True)
        given = [] if options.cache is None else [p for p in options.cache.glob("*") if p.is_file()]
        beside = [n for n in self.found.sums if n.lower().endswith(self.found.source.beside)]
        for path in [*given, *(self.found.folder / name for name in beside)]:
            if path.suffix.lower() in self.found.source.beside:
                with whole_file(place / path.name) as target:
                    shutil.copyfile(path, target)
        return dataclasses.replace(options, cache=place)

    def _keep_lists(self) -> None:
        """Keep what new parcels hold for the others."""
        if not self.found.source.lists:
            return
        new = [digest for digest, head in self._known.items() if head is None]
        names = [name for digest in new for name in self._names[digest]]
        self.found.stage(names, self.place)
        imported(self.found.source.lists)(
            [self.place / name for name in names], self.folder / LISTS
        )  # fmt: skip

    def _windows(self) -> list[Window]:
        """Of each parcel, those before and after it, in order of time."""
        source = self.found.source
        if not source.neighbours:
            return [Window(digest=one, members=(one,)) for one in sorted(self._names)]
        begins: dict[str, list[tuple[float, str]]] = {}
        for digest in self._names:
            vehicle, time = self._begin(digest)
            begins.setdefault(vehicle, []).append((time, digest))
        windows = []
        for vehicle, parcels in sorted(begins.items()):
            order = sorted(parcels)
            for k, (time, digest) in enumerate(order):
                first = max(k - source.neighbours, 0)
                windows.append(
                    Window(
                        digest=digest,
                        members=tuple(d for _, d in order[first : k + source.neighbours + 1]),
                        own=(
                            time if k else -np.inf,
                            order[k + 1][0] if k + 1 < len(order) else np.inf,
                        ),
                        begin=(vehicle, time),
                        before=order[first - 1][1] if first else None,
                    )
                )
        return windows

    def _begin(self, digest: str) -> tuple[str, float]:
        """Vehicle, and when [s] a parcel begins; a file that says neither counts by its name."""
        if known := self._known[digest]:
            return str(known["begin"][0]), float(known["begin"][1])
        names = self._names[digest]
        says = imported(self.found.source.begin)
        self_said = []
        for name in names:
            try:
                self.found.stage([name], self.place)
                self_said.append(says(self.place / name))
            except (InputError, OSError):
                continue  # its own turn says why it cannot be read
        return min(self_said, key=lambda one: one[1], default=(names[0], np.inf))

    def _cut(self, window: Window) -> None:
        """Keep the dives of a parcel, where those that are kept are of other neighbours."""
        digest = window.digest
        carried = self._heads[window.before]["last"] if window.before else {}
        text = json.dumps([window.members, window.own, carried], sort_keys=True)
        made_of = hashlib.sha256(text.encode()).hexdigest()
        head = self._known[digest]
        if head is not None and head["window"] == made_of and not head["unreadable"]:
            self._heads[digest] = head
            return
        tally = Tally()
        head = {
            "window": made_of, "begin": window.begin, "files": [], "error": "", "last": carried,
        }  # fmt: skip
        rows: tuple[DiveRow, ...] = ()
        try:
            given = self.found.kind, self._staged(window.members), self.options
            if self._grow:
                owned = grown_rows(*given, tally, self._known_dive)
            else:
                owned = owned_rows(*given, window.own, carried, tally)
        except InputError as error:
            head["error"] = self._unplaced(str(error))
        else:
            rows = owned.rows
            head |= {name: value for name, value in vars(owned).items() if name != "rows"}
        lost = self._unreadable(digest) if head["error"] or tally.unreadable else []
        files = {Path(name).name for name in self._names[digest]}
        head |= {
            "unreadable": lost,
            "files": sorted(files & set(head["files"])),
            "entries": [
                [
                    one.action, one.subject, one.count, self._unplaced(one.detail),
                    one.subject in files,
                ]
                for one in tally.entries()
                if one.subject not in (*SEVERAL, UNREADABLE)
            ],
            "names": tally.names,
        }  # fmt: skip
        self._heads[digest] = head
        self.folder.mkdir(parents=True, exist_ok=True)
        with whole_file(self._path(digest)) as path:
            write_rows(rows, head, path)

    def _known_dive(self, digest: str) -> DiveRow | None:
        """A dive that was kept of files as they were before they grew."""
        path, place = self._dives.get(digest, (None, 0))
        return None if path is None else read_rows(path, [place])[0]

    @functools.cached_property
    def _dives(self) -> dict[str, tuple[Path, int]]:
        """File and place in it of every dive that is kept one by one, by what it was made of."""
        found = {}
        for path in [] if self.again else sorted(self.folder.glob(f"*{ENDING}")):
            for place, row in enumerate((read_head(path) or {"rows": ()})["rows"]):
                found[row["made_of"]] = (path, place)
        found.pop("", None)
        return found

    def _unreadable(self, digest: str) -> list[tuple[str, str]]:
        """Files of a parcel that cannot be read, and why, as they say alone."""
        tally = Tally()
        with contextlib.suppress(InputError):  # such as a log without a depth: that is readable
            read_logs(self.found.kind, self._staged((digest,)), self.options, tally)
        return [(name, self._unplaced(why)) for name, why in tally.unreadable]

    def _together(self) -> ParcelRows:
        order = sorted(self._heads, key=lambda digest: self._names[digest])
        heads = [self._heads[digest] for digest in order]
        rows = [row for digest in order for row in read_rows(self._path(digest))]
        told = [head for head in heads if not head["error"]]
        errors = [head["error"] for head in heads if head["error"]]
        if not told or (not rows and errors):
            lost = [(name, why) for head in heads for name, why in head["unreadable"]]
            others = [head["error"] for head in heads if head["error"] and not head["unreadable"]]
            said = [*by_reason(lost, len(self.found.sums)), *dict.fromkeys(others)]
            raise InputError("; ".join(said))
        names = sorted({name for head in told for name in head["deployments"]})
        if self.found.source.joins and rows:
            names = [min(rows, key=lambda one: one.segment.start).deployment]
            rows = [dataclasses.replace(one, deployment=names[0]) for one in rows]
        first: dict[str, float] = {}
        for row in rows:
            first[row.deployment] = min(row.segment.start, first.get(row.deployment, np.inf))
        rows.sort(key=lambda one: (first[one.deployment], one.deployment, one.segment.start))
        said = [head["said"] for head in told]
        return ParcelRows(
            rows=tuple(rows),
            files=tuple(sorted({name for head in heads for name in head["files"]})),
            tally=_told(heads, len(self.found.sums)),
            period=min(head["period"] for head in told),
            models=frozenset(name for head in told for name in head["models"]),
            simulated=any(head["simulated"] for head in told),
            by_depth=any(head["by_depth"] for head in told),
            said=said[0] if len(heads) == 1 else None,
            deployments=tuple(names),
        )

    def _staged(self, digests: tuple[str, ...]) -> list[Path]:
        names = [name for digest in digests for name in self._names[digest]]
        self.found.stage(names, self.place)
        return [self.place / name for name in names]

    def _unplaced(self, text: str) -> str:
        """A text without where the files were copied to, which is another place at every pass, and
        with a deployment's settings for an import's options."""
        for was, here in (
            (f"{self.place}/", ""),
            (str(self.folder / LISTS), "source and cache"),
            *IN_SETTINGS,
        ):
            text = text.replace(was, here)
        return text

    def _path(self, digest: str) -> Path:
        return self.folder / f"{digest}{ENDING}"


def _told(heads: list[dict[str, Any]], files: int) -> Tally:
    """What was said of all parcels, of so many files."""
    tally = Tally()
    for why in by_reason([(n, w) for head in heads for n, w in head["unreadable"]], files):
        tally.add("left out", UNREADABLE, 1, why)
    for head in heads:
        for action, subject, count, detail, exact in head["entries"]:
            if exact:
                tally.add(action, subject, count, detail)
            elif not subject.count("."):
                tally.add(action, subject, 1, detail + COUNTED)
        names: Mapping[str, Mapping[str, str]] = head["names"]
        for kind, states in names.items():
            known = tally.names.setdefault(kind, {})
            for name, state in states.items():
                known[name] = min(state, known.get(name, state), key=STATES.index)
    return tally
