"""Watch pass: bring log, beliefs, events and page up to date, each as a whole or not at all.

After a kill at any moment the next pass completes the work: each part records what it was made of,
and the page is written last. A part that is not as it was written is made again.

`beliefs.zarr` has the channels of health over all dives, and the vehicle's parameters over the last
dives. It depends on `log.zarr`, the vehicle and the rate of false alarms alone.

`events.jsonl` has one JSON object a line and depends on files and settings alone. An alarm has the
times of its dives, not of the pass that found it. An event that no longer holds, such as a cut file
that was sent again, is dropped.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glider_twin_ops.forecast import legs_of
from glider_twin_ops.health import CHANNELS, Beliefs, DeploymentHealth
from glider_twin_ops.pages.morning_page import PAGE, read_latest, write_morning
from glider_twin_ops.watching.arrived_files import folder_of
from glider_twin_ops.watching.changes import news, surfaced
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from glider_twin_ops.watching.expected_plan import flown_files
from glider_twin_ops.watching.log_of_files import (
    LOG,
    LogOfFiles,
    content_of,
    damage_of,
    is_zarr,
    log_of_files,
)
from glider_twin_ops.watching.morning import Morning, morning
from glider_twin_ops.watching.sources import SurfaceDialogue, newest_dialogue
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
    """Data set of the state estimates after each dive.

    Args:
      vehicle: name of the vehicle whose flight model judged.
      followed: parameters over the last dives; None where the log does not determine them.
      followed_dives: numbers of these dives.

    Returns:
      `value`, `level`, `deviation`, `innovation`, `expected` and `gain`, (dive, channel), in the
      unit of each channel; `evidence` (dive,), log of the odds of a fault; `time` (dive,), UTC of
      the middle of each dive; attributes with the verdict. With `followed`: `parameter_value` and
      `parameter_deviation`, (followed_dive, parameter), each in the parameter's unit.
    """
    import xarray as xr

    numbers = np.array(health.dives, np.int64)
    fields = {"value": (health.values, "value of the channel in the dive")}
    fields |= {name: (getattr(health.levels, name), says) for name, says in LEVELS.items()}
    arrays: dict[str, Any] = {
        name: ((DIVE, CHANNEL), np.asarray(values[: len(numbers)], float), {"long_name": says})
        for name, (values, says) in fields.items()
    }
    evidence = np.where(np.isfinite(health.evidence), health.evidence, np.nan)
    middle = (np.round(health.time * 1e3)).astype("datetime64[ms]").astype("datetime64[ns]")
    said = {"long_name": "log of the odds of a fault after the dive", "threshold": health.threshold}
    arrays |= {
        "evidence": (DIVE, evidence, said),
        "unit": (CHANNEL, _words(one.unit for one in CHANNELS)),
        "says": (CHANNEL, _words(one.says for one in CHANNELS)),
    }
    coordinates: dict[str, Any] = {
        DIVE: numbers,
        CHANNEL: _words(one.name for one in CHANNELS),
        "time": (DIVE, middle),
    }
    if followed is not None:
        names = [one.name for one in followed.parameters]
        for name, tell, says in (
            ("value", followed.value, "parameter of the vehicle after the dive"),
            ("deviation", followed.deviation, "standard deviation of it"),
        ):
            values = np.stack([tell(one) for one in names], axis=1)
            arrays[f"parameter_{name}"] = ((FOLLOWED, PARAMETER), values, {"long_name": says})
        arrays["parameter_unit"] = (PARAMETER, _words(one.unit for one in followed.parameters))
        coordinates |= {FOLLOWED: np.array(followed_dives, np.int64), PARAMETER: _words(names)}
    return xr.Dataset(
        arrays,
        coords=coordinates,
        attrs={
            "title": "What the dives of a deployment say of its vehicle",
            "deployment": health.name,
            "vehicle": vehicle,
            "verdict": json.dumps(health.describe(), sort_keys=True),
        },
    )


def _words(texts: Iterable[str]) -> NDArray[np.object_]:
    return np.array(list(texts), dtype=object)  # zarr has no name for texts of a fixed width yet


def write_beliefs(dataset: xr.Dataset, folder: Path) -> None:
    """Write `folder/beliefs.zarr`, in place of an older one.

    Raises:
      WriteError: something else lies there, or the disk refuses.
    """
    with whole_folder(folder / BELIEFS, overwrite=True, ours=is_derived) as place:
        write_zarr(dataset, place)


EVENTS = "events.jsonl"


def noticed(log: LogOfFiles, health: DeploymentHealth | None) -> list[dict[str, Any]]:
    """List events: files that cannot be read or are cut, and an alarm with its alternatives."""
    said = [("unreadable file", one) for one in log.unreadable]
    said += [("short file", one) for one in log.short]
    said += [("nothing to import", log.missing)] if log.missing else []
    found: list[dict[str, Any]] = [{"event": event, "says": one} for event, one in said]
    if health is not None and health.alarm:
        first = health.kinds[0]
        at = float(health.time[health.dives.index(health.noticed_dive)])
        same = ("kind", "says", "unit", "otherwise", "find_out")
        alarm: dict[str, Any] = {name: getattr(first, name) for name in same}
        alarm |= {name: list(getattr(first, name)) for name in ("dives", "channels", "also")}
        alarm |= {name: round(getattr(first, name), 6) for name in ("size", "size_deviation")}
        found.append(
            {
                "event": "alarm",
                **alarm,
                "probability": round(health.probability, 6),
                "since_dive": health.since_dive,
                "noticed_dive": health.noticed_dive,
                "noticed": f"{moment_of(at):%Y-%m-%dT%H:%MZ}",
            }
        )
    return found


def write_events(events: Sequence[dict[str, Any]], folder: Path) -> None:
    """Write `folder/events.jsonl`, empty without events; WriteError where the disk refuses."""
    text = "".join(json.dumps(event, sort_keys=True) + "\n" for event in events)
    with whole_file(folder / EVENTS) as place:
        place.write_text(text, encoding="utf-8")


PAST = "as-of"
"""Folder of pages as of moments in the past"""
LOCK = ".watching"
PARTS = (LOG, BELIEFS, EVENTS)
"""Parts that a replay makes again, byte for byte"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Passed:
    """Result of a pass."""

    page: Path
    changed: bool
    """False where files and settings are those of the page that is there"""
    verdict: str
    log: LogOfFiles
    latest: Mapping[str, Any]
    """Values of `latest.json`"""
    told: Morning | None = None
    """Daily report; None where nothing changed"""
    new: tuple[str, ...] = ()
    events: tuple[dict[str, Any], ...] = ()
    same: dict[str, bool] = dataclasses.field(default_factory=dict)
    """After a replay: True for each part that has the bytes it had before"""


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[bool]:
    """Lock the folder against other passes; yields False where another pass holds it."""
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
      until: moment, UTC: only dives that had ended count, and results go into the folder `as-of`.
      replay: make everything again from the files, and compare.
      say: called with the name of each step as it begins.

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
        sweep(folder)  # remove what a pass left that was killed at its end
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
    if same is not None:  # the page made again keeps its news
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
    """Checksums of beliefs and events."""
    return {name: content_of(folder / name) for name in (BELIEFS, EVENTS)}


def _came(deployment: WatchedDeployment, told: Morning) -> list[str]:
    """Compare a past page's forecast with what came, where the newest log has it."""
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
    """Digest of all that a page depends on: files, dialogue, settings, vehicle, version."""
    vehicle = deployment.place(deployment.vehicle)
    own = deployment.vehicle and vehicle.is_file()
    text = vehicle.read_text(encoding="utf-8", errors="replace") if own else ""
    moment = None if until is None else until.isoformat()
    said = None if dialogue is None else dataclasses.asdict(dialogue)
    flown = flown_files(folder_of(deployment))
    parts = [__version__, log.digest, log.missing, log.unreadable, deployment.settings(), text]
    return hashlib.sha256(json.dumps([*parts, moment, flown, said]).encode()).hexdigest()
