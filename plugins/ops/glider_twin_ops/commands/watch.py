"""`twin watch`: a deployment at sea, brought up to date as files of its vehicle arrive."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli import Console, JsonOption

if TYPE_CHECKING:
    import datetime
    from collections.abc import Callable, Mapping
    from typing import Any

    from glider_twin_ops.watching import Passed, WatchedDeployment

OF_NEW = ("from_", "vehicle", "kind", "goto", "energy_kwh", "cache", "mapping")
OF_PASSES = ("once", "replay", "as_of", "to_learn", "every", "serve", "port")
EVERY, LEAST_EVERY = 60.0, 1.0
"""[s] Time between two looks for files. EVERY: default. LEAST_EVERY: shortest allowed"""
HOUR, DAY_H = 3600.0, 24.0
PAST_DAYS = 30.0
"""[d] Age of the last fix from which a deployment counts as over"""


@dataclass(frozen=True, kw_only=True)
class WatchDeployment(JsonOption):
    """Look for new files of a vehicle, import them, judge its health, forecast where it surfaces
    next, and write a page: again and again, or once. Nothing is ever sent to a vehicle. Examples:

        twin watch --new calypso --from from-glider --vehicle slocum-200
        twin watch calypso --once
    """

    deployment: Annotated[Path, tyro.conf.Positional]
    """folder of the deployment: deployment.toml, log.zarr, beliefs.zarr, events.jsonl, page/"""
    new: bool = False
    """make that folder, with a deployment.toml that you then edit"""
    from_: Annotated[Path | None, tyro.conf.arg(name="from", metavar="FOLDER")] = None
    """of --new: folder in which files of the vehicle arrive; it may be empty yet"""
    vehicle: str | None = None
    """of --new: what `twin identify` wrote, or a shipped name; default: that of the kind of log"""
    kind: str | None = None
    """of --new: kind of the logs, as `factory import` takes it; default: what they look like"""
    goto: Annotated[str | None, tyro.conf.arg(metavar="LAT,LON[;LAT,LON]")] = None
    """of --new: places that it is sent to; default: it goes on as in its last dive"""
    energy_kwh: float | None = None
    """of --new: energy in the batteries [kW h] when the first dive began, for the days left"""
    cache: Path | None = None
    """of --new: folder of a Slocum's cache files; default: beside the logs"""
    mapping: str | None = None
    """of --new: what the columns of csv tables are, a file or a shipped name"""
    once: bool = False
    """one pass, for cron; it ends with 0 and a page where there is nothing to judge yet, too"""
    replay: bool = False
    """one pass that makes everything again from the files, and says whether the bytes are the same
    """
    as_of: Annotated[str | None, tyro.conf.arg(metavar="TIME")] = None
    """one pass as of a moment, UTC, such as 2023-09-20T06:00, by the dives that had ended; its
    files lie in DEPLOYMENT/as-of/TIME"""
    to_learn: bool = False
    """no pass: write the three next dives that would tell most of the vehicle, as files for it with
    the twin's flight of exactly these, into DEPLOYMENT/learn"""
    every: float | None = None
    """seconds between two looks; default: 60"""
    serve: bool = False
    """also serve the page to browsers of this machine, at an address with a key"""
    port: int | None = None
    """of --serve; 0 takes any free one; default: the first free one from 8080 on"""

    def run(self, console: Console) -> int:
        """Make a deployment's folder, or make passes over one."""
        from glider_twin_ops.watching import WatchedDeployment, propose_learning

        self._check()
        if self.new:
            self._make(console)
            return 0
        until = self._until()
        deployment = WatchedDeployment.read(self.deployment)
        if self.to_learn:
            found = propose_learning(deployment)
            console.say(f"{found.text()}\n{found.folder}")
            console.answer(folder=found.folder, **found.describe())
        elif self.once or self.replay or until is not None:
            self._pass(console, deployment, until)
        elif not self.serve:
            self._forever(console, lambda page: None)
        else:
            from twin.show.web import PageServer

            with PageServer(self.port) as server:
                console.note(f"open {server.address} in a browser once the first pass is done")
                self._forever(console, lambda page: server.show(page.read_text(encoding="utf-8")))
        return 0

    def _check(self) -> None:
        from twin.errors import InputError

        others, why = (OF_PASSES, "leave it out with --new") if self.new else (
            OF_NEW, "it is for --new; a deployment that is there has it in deployment.toml"
        )  # fmt: skip
        for name in others:
            if getattr(self, name) not in (None, False):
                raise InputError(f"--{name.strip('_').replace('_', '-')}: {why}")
        ends = sum(map(bool, (self.once, self.replay, self.as_of, self.to_learn)))
        every, endless = self.every, "is for passes without end: leave it out, or --once"
        for wrong, says in (
            (self.to_learn and ends > 1,
             "--to-learn makes no pass: leave --once, --replay and --as-of out"),
            (every is not None and ends, f"--every {endless}"),
            (self.port is not None and not self.serve,
             "--port is for --serve, which is not given: leave it out"),
            (self.serve and ends, f"--serve {endless}"),
            (every is not None and not every >= LEAST_EVERY,
             f"--every {every or 0.0:g} must be {LEAST_EVERY:g} s or more"),
            (self.json and not (self.new or ends),
             "--json needs --once, --replay, --as-of or --to-learn: watching never ends"),
        ):  # fmt: skip
            if wrong:
                raise InputError(says)

    def _until(self) -> datetime.datetime | None:
        import datetime

        from twin.errors import InputError

        if self.as_of is None:
            return None
        try:
            found = datetime.datetime.fromisoformat(self.as_of)
        except ValueError:
            said = f"--as-of {self.as_of!r} must be a time in UTC such as 2023-09-20T06:00"
            raise InputError(said) from None
        found = found if found.tzinfo is None else found.astimezone(datetime.UTC)
        return found.replace(tzinfo=datetime.UTC, microsecond=0)

    def _make(self, console: Console) -> None:
        from glider_twin_ops.watching import WatchedDeployment
        from glider_twin_ops.watching.arrived_files import kind_of
        from glider_twin_ops.watching.deployment_folder import AUTO
        from twin import load_vehicle
        from twin.errors import InputError, quoted
        from twin.identify import other_kind

        answer = self.from_ or _asked(console, "folder in which files arrive")
        if not answer:
            raise InputError("--from is missing: the folder in which files of the vehicle arrive")
        source = Path(answer)
        if not source.is_dir():
            raise InputError(f"--from {source}: there is no such folder; make it, it may be empty")
        vehicle, goto = self.vehicle, self.goto
        if vehicle is None:
            vehicle = _asked(console, "vehicle (empty: that of the kind of log)")
        flown = load_vehicle(vehicle) if vehicle else None
        if goto is None:
            goto = _asked(console, "places LAT,LON[;LAT,LON] it goes to (empty: as it flew)")
        made = WatchedDeployment(
            folder=self.deployment,
            source=str(source.resolve()),
            vehicle=_whole(vehicle),
            kind=self.kind or AUTO,
            goto=goto,
            energy_kwh=self.energy_kwh or 0.0,
            cache="" if self.cache is None else str(self.cache.resolve()),
            mapping=_whole(self.mapping or ""),
        )
        path = made.write()
        kind = kind_of(made)
        if flown is not None and kind and (odd := other_kind(source, flown, kind)):
            console.warn(odd)
        console.say(f"{path}\nedit it; then: twin watch {quoted(self.deployment)} --once")
        console.answer(settings=path, **made.settings())

    def _pass(
        self, console: Console, deployment: WatchedDeployment, until: datetime.datetime | None
    ) -> Passed | None:
        """Make one pass and print its result; None where another pass holds the folder."""
        from glider_twin_ops.pages.morning_page import summary
        from glider_twin_ops.watching import one_pass
        from glider_twin_ops.watching.watch_pass import alone

        with alone(deployment.folder) as free:
            if not free:
                console.warn(f"another pass over {deployment.folder} is under way; nothing is done")
                console.answer(busy=True)
                return None
            passed = one_pass(deployment, until=until, replay=self.replay, say=console.note)
        if passed.told is None:
            console.say(f"nothing new: {passed.verdict}")
            missing = passed.log.cut_or_left_out
        else:
            console.say(summary(passed.told, passed.new).rstrip("\n"))
            missing = list(passed.told.missing[1:])  # the summary printed the first
        if late := _late(passed.latest, until):
            console.say(late)
        for said in missing:
            console.note(f"missing: {said}")
        for name, same in passed.same.items():
            console.say(f"{name}: {'the same bytes' if same else 'other bytes than before'}")
        console.say(str(passed.page))
        console.answer(
            page=passed.page,
            changed=passed.changed,
            verdict=passed.verdict,
            late=late,
            files=passed.log.files,
            new=list(passed.new),
            events=list(passed.events),
            same=passed.same,
        )
        return passed

    def _forever(self, console: Console, show: Callable[[Path], object]) -> None:
        import time

        from glider_twin_ops.watching import WatchedDeployment
        from twin.cli import describe_error, interruption

        console.note(f"watching {self.deployment}; Ctrl-C ends it")
        while True:
            try:
                if passed := self._pass(console, WatchedDeployment.read(self.deployment), None):
                    show(passed.page)
            except Exception as error:  # settings that are being edited, a disk that is full
                if interruption(error) is not None:
                    raise
                said, _ = describe_error(error)
                console.warn(f"{said}; the next look tries again")
            time.sleep(EVERY if self.every is None else self.every)


def _late(latest: Mapping[str, Any], until: datetime.datetime | None) -> str:
    """Sentence on the age of the last fix, now or at a moment; empty within an hour, and for a
    deployment that is over.

    Args:
      latest: values of `latest.json`. until: moment of the pass; None: now.
    """
    import time

    from twin.records import unix_seconds

    if not latest.get("last_fix"):
        return ""
    now = time.time() if until is None else until.timestamp()
    hours = (now - unix_seconds(latest["last_fix"]["time"].rstrip("Z"))) / HOUR
    if not 1.0 <= hours < PAST_DAYS * DAY_H:
        return ""
    said = f"The last fix is {_age(hours)} old"
    if surfacings := (latest.get("forecast") or {}).get("surfacings"):
        over = (now - unix_seconds(surfacings[0]["late"])) / HOUR
        if over > 0.0:
            said += (
                f"; 95 of 100 draws had come up again {_age(over)} ago: its files are late, or "
                "the vehicle is"
            )
    return said


def _age(hours: float) -> str:
    return f"{hours:.1f} h" if hours < 2.0 * DAY_H else f"{hours / DAY_H:.0f} d"


def _whole(name: str) -> str:
    """Absolute path of an existing file; any other name unchanged."""
    return str(Path(name).resolve()) if Path(name).is_file() else name


def _asked(console: Console, what: str) -> str:
    """Ask a person at the terminal; empty without one."""
    import sys

    alone = console.json or not (sys.stdin.isatty() and sys.stdout.isatty())
    return "" if alone else input(f"{what}: ").strip()
