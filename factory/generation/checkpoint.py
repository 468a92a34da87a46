"""Checkpoint: what a run has finished, kept beside the growing store until it is complete.

While a store is made it holds a folder `.generating` with the settings, one file per finished
mission and one per finished shard. Every file appears under its name only when it is whole
(written under another name, then renamed), so a killed process leaves nothing half-done. The
store's own `zarr.json` is written last: without it the store is not complete.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factory.generation.flown_mission import FlownMission
from twin.errors import StoreError
from twin.records.sharded import write_whole
from twin.records.store import UNFINISHED

Kept = tuple[FlownMission, dict[str, NDArray[np.float32]]]
"""A finished mission and its signals, each (samples,)."""
_FLOWN, _SIGNALS = "flown", "signals"


class Checkpoint:
    """The checkpoint of the store at `store`."""

    def __init__(self, store: Path):
        self.store = store
        self.folder = store / UNFINISHED

    @property
    def exists(self) -> bool:
        """Whether a run was started here."""
        return (self.folder / "settings.json").is_file()

    @property
    def blank(self) -> bool:
        """Whether the store's folder holds nothing but, at most, a run that never got going."""
        if not self.store.is_dir():
            return False
        others = [path for path in self.store.iterdir() if path != self.folder]
        return not others and not self.exists

    def start(self, settings: Mapping[str, Any]) -> None:
        """Begin a run."""
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.folder / "settings.json", json.dumps(settings, indent=1).encode())

    def settings(self) -> dict[str, Any]:
        """The settings that the run was started with.

        Raises:
          StoreError: the checkpoint is damaged.
        """
        try:
            settings: dict[str, Any] = json.loads((self.folder / "settings.json").read_bytes())
        except (OSError, ValueError) as error:
            raise StoreError(
                f"the checkpoint of {self.store} is damaged ({error}); start again with --overwrite"
            ) from error
        return settings

    @contextlib.contextmanager
    def locked(self) -> Iterator[int]:
        """Hold the store for this process; yields the file descriptor that holds it.

        Raises:
          StoreError: another process is generating into this store.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise StoreError(
                    f"another run is generating into {self.store}; wait for it or use another --out"
                ) from None
            yield descriptor
        finally:
            os.close(descriptor)

    def write_mission(
        self, flown: FlownMission, signals: Mapping[str, NDArray[np.float32]]
    ) -> None:
        """Keep one finished mission; the archive's own checksums tell damage."""
        text = json.dumps({_FLOWN: flown.to_json(), _SIGNALS: list(signals)})
        archive = io.BytesIO()
        np.savez(archive, np.frombuffer(text.encode(), np.uint8), np.stack([*signals.values()]))
        write_whole(self._mission(flown.mission), archive.getvalue())

    def read_mission(
        self, mission: int
    ) -> tuple[FlownMission, dict[str, NDArray[np.float32]]] | None:
        """A finished mission; None when there is none, or when its file is damaged."""
        try:
            with self._mission(mission).open("rb") as file:
                archive = np.load(file, allow_pickle=False)
                text, values = archive["arr_0"], archive["arr_1"]
            found = json.loads(text.tobytes())
            signals = dict(zip(found[_SIGNALS], values, strict=True))
            return FlownMission.from_json(found[_FLOWN]), signals
        except FileNotFoundError:
            return None
        except Exception:  # whatever a damaged archive raises: the mission is flown again
            return None

    def finish_shard(self, shard: int, missions: list[FlownMission]) -> None:
        """Say that a shard is in place, and forget the files of its missions."""
        text = json.dumps([flown.to_json() for flown in missions])
        write_whole(self._shard(shard), text.encode())
        self.drop(flown.mission for flown in missions)

    def read_shard(self, shard: int) -> list[FlownMission] | None:
        """The missions of a shard that is in place."""
        try:
            found = json.loads(self._shard(shard).read_bytes())
            return [FlownMission.from_json(data) for data in found]
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError):
            return None

    def drop(self, missions: Iterable[int]) -> None:
        """Forget the files of missions whose shard is in place."""
        for mission in missions:
            self._mission(mission).unlink(missing_ok=True)

    def count_missions(self) -> int:
        """Finished missions, in files of their own and in shards."""
        shards = [json.loads(path.read_bytes()) for path in self.folder.glob("shard-*.json")]
        in_shards = {flown["mission"] for missions in shards for flown in missions}
        alone = {int(path.stem.rpartition("-")[2]) for path in self.folder.glob("mission-*.npz")}
        return len(in_shards | alone)

    def remove(self) -> None:
        """The store is complete."""
        shutil.rmtree(self.folder, ignore_errors=True)

    @property
    def staging(self) -> Path:
        """Folder for shards that are not whole yet."""
        return self.folder / "staging"

    def _mission(self, mission: int) -> Path:
        return self.folder / f"mission-{mission:06d}.npz"

    def _shard(self, shard: int) -> Path:
        return self.folder / f"shard-{shard:05d}.json"
