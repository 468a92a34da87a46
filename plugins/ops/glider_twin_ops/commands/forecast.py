"""Command `twin forecast`: place, time and energy of a glider's next surfacings, with ellipses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from twin.cli import Console, Hours, JsonOption

if TYPE_CHECKING:
    from glider_twin_ops.forecast import Forecast as Found
    from glider_twin_ops.forecast import Known, Request
    from twin import Origin, Vehicle
    from twin.mission import Mission

USUAL_DEPTH, USUAL_RADIUS = 200.0, 500.0
"""[m] Defaults of --goto. USUAL_DEPTH: depth. USUAL_RADIUS: radius of arrival"""
USUAL_HOURS = 6.0
"""[h] Default time under water between surfacings of --goto"""


@dataclass(frozen=True, kw_only=True)
class ForecastSurfacings(JsonOption):
    """Forecast the next surfacings with ellipses of 50 and 90 %, times, energy and days left, by
    members that are sampled from what is known and flown on all cores. Examples:

        twin forecast --vehicle slocum-200 --from 36.8,-122.4,2026-11-22T12:00 --goto "36.9,-122.5"
        twin forecast --vehicle mine.xml --mission glider.mi --logs real.zarr --out next
    """

    vehicle: str | None = None
    """vehicle: file of `twin identify`, a shipped vehicle's name, or an MJCF file; default: with
    --logs the shipped one of the log's type, as in `twin flight`, else glider"""
    from_: Annotated[str | None, tyro.conf.arg(name="from", metavar="LAT,LON,TIME")] = None
    """place and time of the next dive: degrees north and east, and UTC, such as
    36.8,-122.4,2026-11-22T12:00; default: the last fix of --logs"""
    goto: Annotated[str | None, tyro.conf.arg(metavar="LAT,LON[;LAT,LON]")] = None
    """places to go to, separated by ;"""
    mission: str | None = None
    """mission file (TOML or Slocum's .mi) or shipped mission's name, in place of --goto"""
    depth: float | None = None
    """depth [m] of the dives of --goto; default: 200"""
    pitch: float | None = None
    """pitch [deg] of dives and climbs of --goto; default: the vehicle's usual glide"""
    surface_every: Hours | None = None
    """hours under water between surfacings of --goto; default: 6"""
    radius: float | None = None
    """radius of arrival [m] of --goto; default: 500"""
    current: str | None = None
    """forecast of the current: a file (CF netCDF or zarr) that covers more than --hours, or
    grid:FILE,hold=SECONDS to extend its first and last time, or any other text that `twin simulate
    --current` takes; default: models of the logs' currents"""
    current_error: float | None = None
    """standard deviation [m/s], north and east each, of the error of --current; default: 0.1"""
    density: str = "usual"
    """water column, as `twin simulate --density` takes it"""
    logs: Path | None = None
    """store of logs that `factory import` wrote: its fixes give the current, the errors of speed
    and compass, and the place"""
    way: Literal["usual", "model", "log"] = "usual"
    """source of the velocity through the water in the logs: model (the vehicle's flight model), log
    (depth rate and pitch, or the reported current) or usual (model if the vehicle is identified)"""
    members: int = 200
    """number of members, at least 10"""
    hours: Hours = 12.0
    """horizon of the surfacings, such as 12 (hours) or 2d; members fly longer, until late ones have
    surfaced"""
    energy_left_kwh: float | None = None
    """energy left in the batteries [kW h], for the days left"""
    seed: int = 0
    """seed of the samples"""
    engine: Literal["lanes", "mujoco"] = "lanes"
    """engine of the members: lanes (the Fossen model for many at once, its first member compared
    with MuJoCo) or mujoco"""
    threads: int = 0
    """number of threads; 0 takes every core"""
    out: Path | None = None
    """folder for index.html with a map, forecast.json and forecast.geojson; written with the first
    member, and again as others follow"""

    def run(self, console: Console) -> int:
        """Check the options, fly the members, print the forecast."""
        from glider_twin_ops.forecast import forecast

        self._check()
        if self.out is not None:
            from glider_twin_ops.pages import check_forecast_target

            check_forecast_target(self.out)
        request, known = self._request(console)
        seen: list[Found] = []
        with console.progress(total=request.members, label="forecast", unit="members") as progress:

            def refined(found: Found) -> None:
                if not seen:
                    _say_mean(console, found)
                seen[:] = [found]
                near: dict[str, str] = {}
                if found.surfacings:
                    ellipse = found.surfacings[0].ellipse(0.9)
                    near = {"90 %": f"{ellipse.semi_major_m / 1e3:.2f} km"}
                progress.update(found.flown + found.failed - progress.done, **near)
                if self.out is not None and not found.complete:
                    self._write(self.out, found)

            try:
                found = forecast(request, known, threads=self.threads, refined=refined)
            except KeyboardInterrupt as interrupt:
                if self.out is None or not seen:
                    raise
                self._write(self.out, seen[0], ended=True)  # the page stops reading itself again
                raise KeyboardInterrupt(
                    f"{self.out} holds the forecast of {seen[0].flown} of {request.members} "
                    "members; give the command again for all"
                ) from interrupt
        self._answer(console, found)
        return 0

    def _check(self) -> None:
        from glider_twin_ops.forecast.request import aim_of
        from twin.errors import InputError

        if self.goto is not None and self.mission is not None:
            raise InputError("give --goto or --mission, not both")
        if self.goto is None and self.mission is None:
            said = 'give --goto "LAT,LON[;LAT,LON]" or --mission FILE'
            if self.logs is not None:  # where the log's last dive was sent
                aim = aim_of(self.logs)
                sent = f'in its last dive it was sent to --goto "{aim}"'
                said += (
                    f"; {sent if aim else 'the log has none'}; `twin watch --new FOLDER --from "
                    "FILES` takes it from the log at each pass"
                )
            raise InputError(said)
        if self.from_ is None and self.logs is None:
            raise InputError("give --from LAT,LON,TIME, or --logs to begin at their last fix")
        needs = dict.fromkeys(("depth", "pitch", "surface_every", "radius"), "goto")
        for name, needed in {**needs, "current_error": "current"}.items():
            if getattr(self, name) is not None and getattr(self, needed) is None:
                option = name.replace("_", "-")
                raise InputError(f"--{option} is for --{needed}, which is not given: leave it out")
        if self.way != "usual" and self.logs is None:
            raise InputError("--way is for --logs, which is not given: leave it out")
        if self.threads < 0:
            raise InputError(f"--threads {self.threads} must be 0 or more")

    def _request(self, console: Console) -> tuple[Request, Known]:
        from glider_twin_ops.forecast import Request
        from twin.identify import identified, other_kind, with_consumption
        from twin.logs import counted_energy

        vehicle = vehicle_of(self.vehicle, self.logs)
        mission = self._mission(vehicle)
        if self.logs is not None:
            if self.vehicle is None:
                console.note(
                    f"vehicle: {vehicle.name}, of the log's kind; --vehicle takes an identified one"
                )
            console.note(f"reading {self.logs}")
            if warning := other_kind(self.logs, vehicle):
                console.warn(warning)
        model = self.way == "model" or (self.way == "usual" and bool(identified(vehicle)))
        place, known = begun_at(console, self.from_, self.logs, vehicle if model else None)
        if self.logs is not None:
            if known.silent:
                console.warn(known.silent)
            if (used := counted_energy(self.logs, vehicle, newest=True)) is not None:
                vehicle = with_consumption(vehicle, used.consumption)
                console.note(f"energy by the log's counter: {used.power:.2f} W so far")
        request = Request(
            vehicle=vehicle,
            mission=mission,
            place=place,
            hours=self.hours,
            members=self.members,
            density=self.density,
            energy_left_kwh=self.energy_left_kwh,
            seed=self.seed,
            engine=self.engine,
            **field_of(self.current, self.current_error),
        )
        for note in request.notes():
            console.warn(note)
        return request, known

    def _mission(self, vehicle: Vehicle) -> Mission:
        import math

        from glider_twin_ops.forecast import mission_to
        from twin.mission import load_mission_for

        if self.mission is not None:
            return load_mission_for(vehicle, self.mission)
        assert self.goto is not None
        every = USUAL_HOURS if self.surface_every is None else self.surface_every
        mission = mission_to(
            self.goto,
            depth=USUAL_DEPTH if self.depth is None else self.depth,
            pitch_deg=math.degrees(vehicle.usual_glide[0]) if self.pitch is None else self.pitch,
            surface_after_s=3600.0 * every,
            radius=USUAL_RADIUS if self.radius is None else self.radius,
        )
        mission.check(vehicle)
        return mission

    def _write(self, out: Path, found: Found, *, ended: bool = False) -> Path:
        """Write the folder; `ended` is True if no more members follow."""
        from glider_twin_ops.pages import write_forecast

        return write_forecast(found, out, reload_s=None if ended or found.complete else 5.0)

    def _answer(self, console: Console, found: Found) -> None:
        from glider_twin_ops.pages import forecast_row

        console.answer(**found.describe())
        if found.surfacings:
            console.table([forecast_row(found, one) for one in found.surfacings])
            console.say("semi-axes: from the middle of an ellipse to its edge")
            console.say(found.bounds_known)
        elif not found.left_out:
            console.say(f"no surfacing within {found.request.hours:g} h")
        for said in found.remarks:
            console.warn(said)
        if found.failed:
            console.warn(f"{found.failed} of {found.request.members} members went unstable")
        if (beside := found.beside_mujoco) is not None:
            say = console.warn if beside.unstable else console.say
            say(f"members flown in lanes; of the first one, {beside.text}")
        left = "" if found.days_left is None else f", {found.days_left:.1f} days left"
        console.say(f"{found.energy_per_day} per day{left}")
        for name, words in found.spread.items():
            console.say(f"{name}: {words}")
        if self.out is not None:
            console.say(f"map: {self._write(self.out, found)}")


def vehicle_of(name: str | None, logs: Path | None) -> Vehicle:
    """Load the named vehicle, else the shipped one of the log's type, else `glider`."""
    from twin import load_vehicle
    from twin.identify import start_vehicle

    return load_vehicle(name or "glider") if name or logs is None else start_vehicle(logs)


def begun_at(
    console: Console, start: str | None, logs: Path | None, model: Vehicle | None
) -> tuple[Origin, Known]:
    """Start of a forecast and the state there; warns of logs that are old or far away.

    Args:
      model: flight model for the velocity through the water in the logs.
    """
    from glider_twin_ops.forecast import begun, known_from_logs

    path = None if model is None else str(model.path)
    place, known, stale = begun(start, None if logs is None else known_from_logs(logs, path))
    if stale:
        console.warn(stale)
    return place, known


def field_of(current: str | None, error: float | None) -> dict[str, Any]:
    """Arguments `field` and `field_error` of `Request`."""
    from twin.water.current import parse_field

    found: dict[str, Any] = {} if error is None else {"field_error": error}
    return found if current is None else {**found, "field": parse_field(current)}


def _say_mean(console: Console, found: Found) -> None:
    """Print the surfacings of the first member, the mean of what is known."""
    if not found.surfacings:
        console.note(f"the mean of what is known does not surface in {found.request.hours:g} h")
    for one in found.surfacings:
        console.note(
            f"surfacing {one.number}: about {found.minute(one.time_s)} UTC at "
            f"{one.latitude:.4f}, {one.longitude:.4f}"
        )
