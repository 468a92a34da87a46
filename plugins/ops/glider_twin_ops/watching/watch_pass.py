"""Watch pass: files in, and log, beliefs, events and page brought up to date, each whole or not.

Killed at any moment, the next pass does what is missing: each part says by what it was made, and
the page, which is written last, ends a pass. A part that is not as it was written is made again.

Events, `events.jsonl`, are what a pilot must know of, one JSON object a line, by the files and the
settings alone: an alarm has the times of its dives, not that of the pass which found it. What is no
longer so, such as a file that has been sent again, is no longer there.

Beliefs, `beliefs.zarr`, are channels of health over all dives, and parameters of the vehicle over
the last ones, by `log.zarr`, the vehicle and the rate of false alarms alone.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast import legs_of
from glider_twin_ops.health import CHANNELS, Beliefs, DeploymentHealth
from glider_twin_ops.pages.morning_page import PAGE, read_latest, write_morning
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from glider_twin_ops.watching.log_of_files import (
    LOG,
    LogOfFiles,
    content_of,
    damage_of,
    is_zarr,
    log_of_files,
)
from glider_twin_ops.watching.morning import Morning, morning
from glider_twin_ops.watching.news import news, surfaced
from glider_twin_ops.watching.proposed_files import flown_files
from glider_twin_ops.watching.sources.arrived_files import folder_of
from glider_twin_ops.watching.sources.base import SurfaceDialogue, newest_dialogue
from twin import __version__
from twin.records import LogStore, is_derived, is_store, whole_file, write_zarr
from twin.records.storage import lock, remove, sweep, whole_folder
from twin.show.figures import INDEX
from twin.show.style import moment_of

if TYPE_CHECKING:
    import xarray as xr

BELIEFS = "beliefs.zarr"
DIVE, CHANNEL = "dive", "channel"
FOLLOWED, PARAMETER = "followed_dive", "parameter"
LEVELS = {
    "level": "level of the channel after the dive",
    "deviation": "standard deviation of the level",
    "innovation": "dive's value less the level before it, over its standard deviation",
    "expected": "variance of that difference",
    "gain": "part of the difference by which the level moved",
}


def kept_beliefs(
    health: DeploymentHealth,
    vehicle: str,
    followed: Beliefs | None = None,
    followed_dives: Sequence[int] = (),
) -> xr.Dataset:
    """What is believed after each dive.

    Args:
      vehicle: name of the one whose flight model judged.
      followed: parameters over the last dives; None where the log does not tell them.
      followed_dives: numbers of these dives.

    Returns:
      `value`, `level`, `deviation`, `innovation`, `expected` and `gain`, (dive, channel), in the
      unit of each channel; `evidence` (dive,), log of the odds of a fault; `time` (dive,), UTC of
      the middle of each dive; attributes with the verdict. With `followed`: `parameter_value` and
      `parameter_deviation`, (followed_dive, parameter), each in the parameter's unit.
    """
    import xarray as xr

    numbers = np.array(health.dives, np.int64)
    count = len(numbers)
    fields = {"value": (health.values, "value of the channel in the dive")}
    fields |= {name: (getattr(health.levels, name), says) for name, says in LEVELS.items()}
    arrays = {
        name: ((DIVE, CHANNEL), np.asarray(values[:count], float), {"long_name": says})
        for name, (values, says) in fields.items()
    }
    evidence = np.where(np.isfinite(health.evidence), health.evidence, np.nan)
    middle = (np.round(health.time * 1e3)).astype("datetime64[ms]").astype("datetime64[ns]")
    said = {"long_name": "log of the odds of a fault after the dive", "threshold": health.threshold}
    found = xr.Dataset(
        {
            **arrays,
            "evidence": ((DIVE,), evidence, said),
            "unit": ((CHANNEL,), _words([one.unit for one in CHANNELS])),
            "says": ((CHANNEL,), _words([one.says for one in CHANNELS])),
        },
        coords={
            DIVE: numbers,
            CHANNEL: _words([one.name for one in CHANNELS]),
            "time": ((DIVE,), middle),
        },
        attrs={
            "title": "What the dives of a deployment say of its vehicle",
            "deployment": health.name,
            "vehicle": vehicle,
            "verdict": json.dumps(health.describe(), sort_keys=True),
        },
    )
    return found if followed is None else found.merge(_parameters(followed, followed_dives))


def _parameters(followed: Beliefs, dives: Sequence[int]) -> xr.Dataset:
    import xarray as xr

    names = [one.name for one in followed.parameters]
    value, deviation = (
        np.stack([tell(name) for name in names], axis=1)
        for tell in (followed.value, followed.deviation)
    )
    said = "of the vehicle after the dive"
    return xr.Dataset(
        {
            "parameter_value": ((FOLLOWED, PARAMETER), value, {"long_name": f"parameter {said}"}),
            "parameter_deviation": (
                (FOLLOWED, PARAMETER), deviation, {"long_name": "standard deviation of it"},
            ),
            "parameter_unit": (
                (PARAMETER,), _words([one.unit for one in followed.parameters]),
            ),
        },
        coords={FOLLOWED: np.array(dives, np.int64), PARAMETER: _words(names)},
    )  # fmt: skip


def _words(texts: list[str]) -> NDArray[np.object_]:
    return np.array(texts, dtype=object)  # zarr has no name for texts of a fixed width yet


def write_beliefs(dataset: xr.Dataset, folder: Path) -> Path:
    """Write `folder/beliefs.zarr`, in the place of an older one.

    Raises:
      WriteError: something else is in the way, or the disk refuses.
    """
    path = folder / BELIEFS
    with whole_folder(path, overwrite=True, ours=is_derived) as place:
        write_zarr(dataset, place)
    return path


EVENTS = "events.jsonl"


def noticed(log: LogOfFiles, health: DeploymentHealth | None) -> list[dict[str, Any]]:
    """Files that cannot be read or end too early, and an alarm with what it may be instead."""
    found: list[dict[str, Any]] = [
        {"event": "unreadable file", "says": said} for said in log.unreadable
    ]
    found += [{"event": "short file", "says": said} for said in log.short]
    if log.missing:
        found.append({"event": "nothing to import", "says": log.missing})
    if health is not None and health.alarm:
        first = health.kinds[0]
        noticed_at = health.dives.index(health.noticed_dive)
        found.append(
            {
                "event": "alarm",
                "kind": first.kind,
                "says": first.says,
                "since_dive": health.since_dive,
                "noticed_dive": health.noticed_dive,
                "noticed": f"{moment_of(float(health.time[noticed_at])):%Y-%m-%dT%H:%MZ}",
                "probability": round(health.probability, 6),
                "size": round(first.size, 6),
                "size_deviation": round(first.size_deviation, 6),
                "unit": first.unit,
                "dives": list(first.dives),
                "channels": list(first.channels),
                "also": list(first.also),
                "otherwise": first.otherwise,
                "find_out": first.find_out,
            }
        )
    return found


def write_events(events: Sequence[dict[str, Any]], folder: Path) -> Path:
    """Write `folder/events.jsonl`, empty where nothing was noticed.

    Raises:
      WriteError: the disk refuses.
    """
    path = folder / EVENTS
    text = "".join(json.dumps(event, sort_keys=True) + "\n" for event in events)
    with whole_file(path) as place:
        place.write_text(text, encoding="utf-8")
    return path


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
