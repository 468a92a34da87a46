"""Command `twin check`: compare MuJoCo with the Fossen model, published motions, or real logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from twin.cli.console import Console, JsonOption

VEHICLE, MANOEUVRES, SEED = "glider", 20, 0  # defaults of the manoeuvres


@dataclass(frozen=True, kw_only=True)
class CheckModels(JsonOption):
    """Fly random manoeuvres in both models, recompute the published motions, and check that still
    water gives no energy. With --many compare the two engines; with --logs compare a vehicle's twin
    with its own logs.

    Examples:

        twin check
        twin check --many 1000
        twin check --logs real.zarr --vehicle mine.xml --page twin_and_logs
    """

    vehicle: str | None = None
    """shipped vehicle name or MJCF file (:PRESET after it selects a preset). Manoeuvres, published
    motions and still water are then of this vehicle; with --logs it is the logs' vehicle.
    [default: glider for the manoeuvres, all vehicles for published motions and still water]"""
    manoeuvres: int | None = None
    """number of random 600 s manoeuvres [default: 20]"""
    seed: int | None = None
    """seed of the first manoeuvre [default: 0]"""
    many: int | None = None
    """number of manoeuvres that both engines fly instead, MuJoCo and lanes (the Fossen model), with
    all shipped vehicles in turn or only --vehicle. Reports quantiles of the differences, vehicle
    and seed of the worst, and the error of the time steps"""
    timestep: float | None = None
    """MuJoCo's physics step in the manoeuvres [s]; default: the vehicle file's"""
    logs: Path | None = None
    """store of logs, as `factory import` writes it. The twin flies these dives in closed loop with
    the log's pitch, pump, turning depths and headings; descents and climbs are compared"""
    missions: str | None = None
    """with --logs: dives of the store, such as 0-11,14 [default: all]"""
    engine: Literal["mujoco", "lanes"] | None = None
    """with --logs: physics engine of the twin: mujoco; or lanes, the Fossen model for all dives at
    once, whose first dive is also flown in MuJoCo and compared [default: mujoco]"""
    page: Path | None = None
    """with --logs: folder for a page with plots (index.html and its figures as PNG)"""

    def run(self, console: Console) -> int:
        """Run the chosen comparison; the exit code is 1 when a limit is exceeded."""
        from twin.errors import InputError

        idle = ("manoeuvres", "seed", "timestep")
        told = "is of the manoeuvres, which --logs does not fly: leave it out"
        if self.logs is None:
            idle = ("missions", "engine", "page")
            told = "is of the comparison with logs: give --logs STORE as well"
        for name in idle:
            if getattr(self, name) is not None:
                raise InputError(f"--{name} {told}")
        if self.many is not None:
            for name in ("logs", "manoeuvres", "timestep"):
                if getattr(self, name) is not None:
                    raise InputError(f"--{name} does not go with --many: leave one of them out")
        for name, value, least in (("many", self.many, 1), ("seed", self.seed, 0)):
            if value is not None and value < least:
                bound = f"at least {least}" if least else f"{least} or more"
                raise InputError(f"--{name} must be {bound}, not {value}")
        seed = SEED if self.seed is None else self.seed
        if self.many is not None:
            return self._engines(self.many, seed, console)
        if self.logs is not None:
            return self._logs(self.logs, console)
        return self._models(seed, console)

    def _engines(self, count: int, seed: int, console: Console) -> int:
        """Compare MuJoCo with the Fossen model in lanes, over many manoeuvres."""
        import os

        from twin import load_vehicle, vehicle_names
        from twin.checks import FINER, WITHIN, check_engines

        names = vehicle_names() if self.vehicle is None else [self.vehicle]
        vehicles = [load_vehicle(name) for name in names]
        with console.progress(total=count, label="check", unit="manoeuvres") as progress:
            found = check_engines(
                vehicles, count=count, seed=seed, threads=os.cpu_count() or 1, watch=progress.update
            )
        told, share = found.describe(), f"{100.0 * WITHIN:g}"
        console.table(
            [
                {
                    "vehicle": one["vehicle"], "flown": one["flown"],
                    "unstable": len(one["unstable"]), **_figures(
                        {name: values.get(share) for name, values in one["quantiles"].items()}
                    ),
                }
                for one in told["vehicles"]
            ],
            title=f"MuJoCo against lanes: {share} % of a vehicle's manoeuvres are within",
            digits=3,
        )  # fmt: skip
        console.say()
        console.table(
            [
                {
                    "vehicle": one["vehicle"], "step s": one["steps"]["timestep_s"],
                    **_figures(one["steps"]["lanes_error"]),
                    **{f"{name} falls by": fall for name, fall in one["steps"]["falls"].items()},
                }
                for one in told["vehicles"]
                if one["steps"]
            ],
            title=f"Error of lanes against a step {FINER} times shorter; what an engine's "
            "speed changes by when its step is halved falls so at the next halving",
            digits=3,
        )  # fmt: skip
        console.say()
        console.table(
            [
                {"difference": name, "limit": told["limits"][name],
                 **{f"{share} %": value for share, value in values.items()}}
                for name, values in told["quantiles"].items()
            ],
            title=f"All {told['manoeuvres']} manoeuvres of {told['duration_s']:.0f} s",
            digits=3,
        )  # fmt: skip
        if worst := told["worst"]:
            figures = ", ".join(f"{name} {value:.3g}" for name, value in _figures(worst).items())
            console.say(f"worst: {worst['vehicle']}, seed {worst['seed']}: {figures}")
        console.answer(**told)
        return _verdict(console, found.beyond())

    def _logs(self, store: Path, console: Console) -> int:
        """Compare the twin with the logs."""
        from twin.cli.options import parse_rows
        from twin.errors import InputError
        from twin.identify import check_logs
        from twin.show import log_check_rows, write_log_check
        from twin.show.figures import check_page_target

        if self.vehicle is None:
            raise InputError(
                "--logs needs --vehicle: the file of the vehicle that made them, such as `twin "
                "identify` writes, or a shipped name"
            )
        if self.page is not None:
            check_page_target(self.page)
        rows, engine = parse_rows(self.missions or "all"), self.engine or "mujoco"
        found = check_logs(store, self.vehicle, missions=rows, engine=engine)
        title = f"{found.vehicle.name} beside {len(found.dives)} dives"
        console.table(log_check_rows(found), title=title)
        for text in found.notes:
            console.note(text)
        if (beside := found.beside_mujoco) is not None:
            say = console.warn if beside.unstable else console.say
            say(f"dives flown in lanes; of the first one, {beside.text}")
        console.answer(**found.describe())
        if self.page is not None:
            given = {"missions": self.missions, "engine": self.engine}
            more = [f" --{name} {value}" for name, value in given.items() if value is not None]
            command = f"twin check --logs {store} --vehicle {self.vehicle}{''.join(more)}"
            path = write_log_check(self.page, found, command)
            console.say(f"page: {path}")
            console.answer(page=path)
        return _verdict(console, found.beyond)

    def _models(self, seed: int, console: Console) -> int:
        """Check the two models, the published motions and still water."""
        from twin import check_manoeuvres, check_published, checks, load_vehicle
        from twin.errors import InputError

        count = MANOEUVRES if self.manoeuvres is None else self.manoeuvres
        if count < 1:
            raise InputError(f"--manoeuvres must be at least 1, not {count}")
        vehicle = load_vehicle(VEHICLE if self.vehicle is None else self.vehicle)
        rows, broken = [], []
        sources: dict[str, int] = {}
        published = check_published(None if self.vehicle is None else vehicle)
        for motion, model, trim in published:
            violations = motion.violations(trim)
            broken += [f"{motion.vehicle}, {motion.source}, {model}: {v}" for v in violations]
            found = motion.differences(trim)
            angle = max((found[n] for n in checks.ANGLES if n in found), key=abs, default=None)
            rows.append(
                {
                    "vehicle": motion.vehicle,
                    "source": sources.setdefault(motion.source, len(sources) + 1),
                    "model": model,
                    "speed m/s": trim.speed_m_s,
                    "off mm/s": _thousandths(found.get("speed")),
                    "pitch deg": round(trim.pitch_deg, 3),
                    "off deg": None if angle is None else round(angle, 3),
                    "off mrad/s": _thousandths(found.get("turn_rate")),
                    "down m/s": round(trim.vertical_speed_m_s, 6),
                    "off mm/s ": _thousandths(found.get("vertical_speed")),
                    "ok": "no" if violations else "yes",
                }
            )
        if rows:
            title = "Published motions (largest angle difference of each)"
            console.table(rows, title=title, digits=3)
        else:
            console.say(f"no published motion of {vehicle.name!r} is on record")
        for source, number in sources.items():
            console.item(f"source {number}: {source}")
        decays = checks.check_still_water(None if self.vehicle is None else vehicle)
        broken += [decay.text(one) for one, decay in decays if not decay.ok]
        console.say()
        console.table(
            [
                {
                    "vehicle": one.name, "model": decay.model, "gains %": 100.0 * decay.gain,
                    "limit %": 100.0 * checks.LARGEST_GAIN, "ok": "yes" if decay.ok else "no",
                }
                for one, decay in decays
            ],
            title="Energy from still water, the most of ahead, astern, sideways and tumbling",
        )  # fmt: skip
        differences = check_manoeuvres(vehicle, count=count, seed=seed, timestep=self.timestep)
        broken += [f"manoeuvre {d.seed} exceeds a limit" for d in differences if not d.ok]
        limits = {
            "speed_m_s": checks.SPEED_LIMIT,
            "attitude_deg": checks.ATTITUDE_LIMIT,
            "position_percent": checks.POSITION_LIMIT,
        }
        largest = {name: max(getattr(d, name) for d in differences) for name in limits}
        console.say()
        console.table(
            [
                {"largest difference": name, "measured": largest[name], "limit": limits[name]}
                for name in largest
            ],
            title=f"MuJoCo against Fossen, {len(differences)} manoeuvres of "
            f"{checks.DURATION:.0f} s in sheared current",
        )
        console.answer(
            **largest,
            limits=limits,
            manoeuvres=[asdict(d) for d in differences],
            published=[
                {"vehicle": g.vehicle, "source": g.source, "model": m, **g.differences(t)}
                for g, m, t in published
            ],
            passivity=[{"vehicle": one.name, **asdict(decay)} for one, decay in decays],
            ok=not broken,
        )
        return _verdict(console, broken)


def _figures(difference: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a difference in the tables' units."""
    speed = difference["speed_m_s"]
    return {
        "speed mm/s": None if speed is None else 1e3 * speed,
        "attitude deg": difference["attitude_deg"],
        "position %": difference["position_percent"],
    }


def _thousandths(value: float | None) -> float | None:
    """Thousandfold of a value (such as m to mm), rounded to 1e-6 to hide the solver's noise."""
    return None if value is None else round(1e3 * value, 6)


def _verdict(console: Console, broken: Sequence[str]) -> int:
    """Report the values that are beyond their limits and return the exit code."""
    for text in broken:
        console.warn(text)
    console.say("all within the limits" if not broken else f"{len(broken)} beyond the limits")
    return 1 if broken else 0
