"""Watch pass: files in, and log, beliefs, events and page brought up to date, each whole or not.

Killed at any moment, the next pass does what is missing: each part says by what it was made, and
the page, which is written last, ends a pass. A part that is not as it was written is made again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from glider_twin_ops.forecast import legs_of
from glider_twin_ops.pages.morning_page import PAGE, read_latest, write_morning
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from glider_twin_ops.watching.kept_beliefs import BELIEFS, kept_beliefs, write_beliefs
from glider_twin_ops.watching.log_of_files import LOG, LogOfFiles, log_of_files
from glider_twin_ops.watching.made_parts import content_of, damage_of, is_zarr
from glider_twin_ops.watching.morning import Morning, morning
from glider_twin_ops.watching.news import news, surfaced
from glider_twin_ops.watching.noticed import EVENTS, noticed, write_events
from glider_twin_ops.watching.proposed_files import flown_files
from glider_twin_ops.watching.sources.arrived_files import folder_of
from glider_twin_ops.watching.sources.base import SurfaceDialogue, newest_dialogue
from twin import __version__
from twin.records import LogStore, is_store
from twin.records.storage import lock, remove, sweep
from twin.show.figures import INDEX

PAST = "as-of"
"""Folder of what was known at moments before the newest dive"""
LOCK = ".watching"
PARTS = (LOG, BELIEFS, EVENTS)
"""What a replay makes again to the byte"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Passed:
    """What a pass did."""

    page: Path
    changed: bool
    """False: files and settings are those of the page that is there"""
    verdict: str
    log: LogOfFiles
    latest: Mapping[str, Any]
    """What `latest.json` has"""
    told: Morning | None = None
    """None where nothing changed"""
    new: tuple[str, ...] = ()
    events: tuple[dict[str, Any], ...] = ()
    same: dict[str, bool] = dataclasses.field(default_factory=dict)
    """Of a replay: whether each part has the bytes that it had"""


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[bool]:
    """Whether no other pass over the folder is under way; none can begin until the context ends."""
    descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        yield lock(descriptor)
    finally:
        os.close(descriptor)


def one_pass(
    deployment: WatchedDeployment,
    *,
    until: datetime.datetime | None = None,
    replay: bool = False,
    say: Callable[[str], object] = lambda _: None,
) -> Passed:
    """Bring a deployment up to date.

    Args:
      until: as it was known then, UTC, by the dives that had ended; into the folder `as-of`.
      replay: make everything again from the files, and compare.
      say: called with a word on what is being done.

    Raises:
      InputError: a setting that cannot be used. WriteError: the disk refuses.
    """
    folder = deployment.folder
    if until is not None:
        folder = folder / PAST / f"{until:%Y-%m-%dT%H%M%S}"
        folder.mkdir(parents=True, exist_ok=True)
    was = {name: content_of(folder / name) for name in PARTS} if replay else {}
    say("files")
    log = log_of_files(deployment, folder, until=until, again=replay)
    dialogue = newest_dialogue(
        log.kind, folder_of(deployment), recursive=deployment.recursive, until=until
    )  # fmt: skip
    made_of = _made_of(deployment, log, until, dialogue)
    damage, before = damage_of(folder / PAGE), read_latest(folder)
    page = folder / PAGE / INDEX
    same = before if before is not None and before["made_of"] == made_of else None
    if same is not None and not (replay or damage) and _parts(folder) == same["parts"]:
        sweep(folder)  # a pass that was killed at its end left what no writer comes to remove
        return Passed(page=page, changed=False, verdict=str(same["verdict"]), log=log, latest=same)
    if damage:
        say(f"{PAGE} was damaged, and is made again: {damage}")
    told = morning(deployment, log, dialogue, say=say)
    if is_zarr(folder / BELIEFS) and (told.health is None or damage_of(folder / BELIEFS)):
        remove(folder / BELIEFS)
    if told.health is not None and told.vehicle is not None:
        kept = kept_beliefs(told.health, told.vehicle.name, told.followed, told.followed_dives)
        write_beliefs(kept, folder)
    events = noticed(log, told.health)
    write_events(events, folder)
    new = [] if replay or until is not None else news(before, told)
    if same is not None:  # what was new on the page that is made again
        new = same["new"]
    say("page")
    moment = "" if until is None else f"{until:%Y-%m-%d %H:%M}"
    came = [] if until is None else _came(deployment, told)
    made = {"made_of": made_of, "parts": _parts(folder), "new": new}
    write_morning(told, folder, new=new, made=made, as_of=moment, came=came)
    return Passed(
        page=page,
        changed=True,
        verdict=told.verdict,
        log=log,
        told=told,
        latest=told.describe(),
        new=tuple(new),
        events=tuple(events),
        same={name: content_of(folder / name) == before for name, before in was.items() if before},
    )


def _parts(folder: Path) -> dict[str, str]:
    """Sums of the parts beside log and page."""
    return {name: content_of(folder / name) for name in (BELIEFS, EVENTS)}


def _came(deployment: WatchedDeployment, told: Morning) -> list[str]:
    """What a page of the past foretold beside what came, where the newest log has it."""
    store = deployment.folder / LOG
    if told.surfacings is None or not is_store(store):
        return []
    with LogStore(store) as logs:
        if told.deployment not in logs.deployments:
            return []
        legs = legs_of(logs, told.deployment)
    return surfaced(told.surfacings.describe(), legs)


def _made_of(
    deployment: WatchedDeployment,
    log: LogOfFiles,
    until: datetime.datetime | None,
    dialogue: SurfaceDialogue | None,
) -> str:
    """What a page is a function of: files, dialogue, settings, the vehicle's file, the version."""
    vehicle = deployment.place(deployment.vehicle)
    text = json.dumps(
        [
            __version__,
            log.digest,
            log.missing,
            log.unreadable,
            deployment.settings(),
            vehicle.read_text(encoding="utf-8", errors="replace")
            if deployment.vehicle and vehicle.is_file()
            else "",
            None if until is None else until.isoformat(),
            flown_files(folder_of(deployment)),
            None if dialogue is None else dataclasses.asdict(dialogue),
        ]
    )
    return hashlib.sha256(text.encode()).hexdigest()
