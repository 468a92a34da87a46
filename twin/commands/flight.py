"""Commands `twin flight` and `twin energy`: speed and drift of a deployment, and its energy use."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli.console import Console, JsonOption

if TYPE_CHECKING:
    from twin.logs import EnergyUse


@dataclass(frozen=True, kw_only=True)
class EstimateFlight(JsonOption):
    """Fly a vehicle's flight model on its logs: speed through the water, angle of attack, vertical
    velocity of the water, depth-averaged currents, and the track corrected at the fixes.

    Example:

        twin flight real.zarr --vehicle mine.xml --out flight.nc --plots figures
    """

    store: Annotated[Path, tyro.conf.Positional]
    """store of logs, as `factory import` writes it, or a simulated store with sensors"""
    vehicle: str | None = None
    """vehicle that made the logs: a file of `twin identify`, or a shipped name; default: the
    shipped vehicle of the log's type, or the vehicle of a simulated store"""
    out: Path = Path("flight.nc")
    """file to write: .nc (netCDF) or .zarr"""
    overwrite: bool = False
    """replace an existing --out"""
    plots: Path | None = None
    """folder for figures: section of the vertical water velocity, its histogram by phase, map"""
    missions: str = "all"
    """missions of the store, such as 0-11,14"""
    estimator: str = "flight"
    """estimator of velocity through the water: flight (with inertia), steady (forces in balance),
    or one from a package or a file of your own, as NAME or NAME:ARGUMENT"""
    track: Literal["smoother", "linear"] = "smoother"
    """correction of the track at the fixes: smoother (with the current, from all fixes of a
    deployment), or linear (each dive's misclosure distributed in time, for comparison)"""
    energy_left_kwh: float | None = None
    """energy left in the batteries [kW h], to report the days left by the log's charge counter"""
    currents: bool = False
    """find currents against depth too, where `factory import --doppler` gave cells"""
    no_thermal_lag: bool = False
    """take the CTD's salinity and density as stored, without a correction of its thermal lag"""

    def run(self, console: Console) -> int:
        """Estimate the flight, write the file and the figures, and report a summary."""
        from twin.cli.options import parse_rows
        from twin.errors import InputError, quoted
        from twin.logs import (
            check_target,
            counted_energy,
            energy_used,
            estimate_flight,
            write_flight,
        )
        from twin.records import MissionStore

        check_target(self.out, overwrite=self.overwrite)
        if self.plots is not None and self.plots.is_file():
            raise InputError(f"--plots {self.plots} is a file; name a folder")
        rows = parse_rows(self.missions)
        left, used, days = self.energy_left_kwh, None, None
        if left is not None:  # reports a missing counter before the long computation
            used = energy_used(self.store, self.vehicle, missions=rows)
            days = used.days_left(left)
        with MissionStore(self.store) as store:
            total = len(store) if rows is None else len(rows)
        with console.progress(total=total, label="flight", unit="missions") as progress:
            found = estimate_flight(
                self.store,
                self.vehicle,
                missions=rows,
                estimator=self.estimator,
                thermal_lag=not self.no_thermal_lag,
                track=self.track,
                profiles=self.currents,
                advance=progress.update,
            )
        write_flight(found, self.out, overwrite=self.overwrite)
        summary = found.summary()
        lags = [
            f"{name}: alpha {lag.amplitude:.3f}, tau {lag.time:.0f} s"
            for name, lag in found.lags.items()
        ]
        console.pairs(
            {
                "vehicle": found.calibration.vehicle.name,
                "missions": f"{len(found.flown)} flown of {len(found.missions)}",
                "CTD's thermal lag": "; ".join(lags) or "none found",
                "vertical water velocity, mean": (
                    f"{100 * summary.w_mean_dive:.2f} cm/s in dives, "
                    f"{100 * summary.w_mean_climb:.2f} in climbs"
                ),
                "vertical water velocity, deviation": f"{100 * summary.w_deviation:.2f} cm/s",
                "largest dive less climb": (
                    f"{100 * summary.w_profile_difference:.2f} cm/s, of means in bins of depth"
                    if math.isfinite(summary.w_profile_difference)
                    else "no bin of depth has both"
                ),
                "depth rate, RMSE": f"{100 * summary.depth_rate_rmse:.2f} cm/s",
                "currents": f"of {len(found.currents)} dives between fixes",
            }
        )
        if self.currents and not found.profiles:
            console.note("no dive between fixes has cells of a Doppler log: depth averages alone")
        if used is None:
            used = counted_energy(self.store, found.calibration.vehicle, newest=True)
        if used is not None:
            lasts = "" if days is None else f", {days:.1f} days left"
            console.say(f"power by the log's counter of charge: {used.power:.2f} W{lasts}")
        if doubt := summary.doubt(found.calibration.vehicle.name):
            console.warn(
                f"{doubt}; identify one with `twin identify {quoted(self.store)} --out mine.xml` "
                "and give --vehicle mine.xml"
            )
        console.say(str(self.out))
        pictures: list[Path] = []
        if self.plots is not None:
            from twin.show import write_flight_figures

            pictures, missing = write_flight_figures(found, self.plots)
            for path in pictures:
                console.say(str(path))
            for reason in missing:
                console.note(reason)
        console.answer(
            store=self.store,
            out=self.out,
            vehicle=found.calibration.vehicle.name,
            estimator=found.estimator,
            track=found.track,
            missions=len(found.missions),
            flown=len(found.flown),
            samples=summary.samples,
            currents=len(found.currents),
            profiles=len(found.profiles),
            plots=pictures,
            power_w=None if used is None else used.power,
            days_left=days,
            **summary.describe(),
        )
        return 0


@dataclass(frozen=True, kw_only=True)
class AccountEnergy(JsonOption):
    """Attribute the counted charge to electronics, surface, pump by depth and direction, drives,
    payload and thruster. Then test the result: predict the second half of the dives from the first.

    Example:

        twin energy real.zarr --vehicle slocum-1000 --out mine.xml --energy-left-kwh 2.5
    """

    store: Annotated[Path, tyro.conf.Positional]
    """store of logs, as `factory import` writes it, with a counter of charge and a voltage"""
    vehicle: str | None = None
    """vehicle that made the logs: a file of `twin identify`, or a shipped name; default: the
    shipped vehicle of the log's type"""
    missions: str = "all"
    """missions of the store, such as 0-11,14"""
    energy_left_kwh: float | None = None
    """energy left in the batteries [kW h], to report the days left"""
    out: Path | None = None
    """file (.xml) to write the vehicle with this consumption to, for simulations and forecasts"""
    overwrite: bool = False
    """replace an existing --out"""

    def run(self, console: Console) -> int:
        """Fit the consumption, test it on later dives, report, and write the vehicle."""
        from twin.cli.options import parse_rows
        from twin.errors import InputError
        from twin.identify import write_consumption
        from twin.logs import endurance_of, energy_used, second_half

        if self.out is not None and self.out.suffix.lower() != ".xml":
            raise InputError(f"--out {str(self.out)!r} must end in .xml")
        if self.out is not None and self.out.exists() and not self.overwrite:
            raise InputError(f"{self.out} exists already; use --overwrite or another --out")
        rows = parse_rows(self.missions)
        found = energy_used(self.store, self.vehicle, missions=rows)
        left = self.energy_left_kwh
        days = None if left is None else found.days_left(left)
        _say_energy(console, found)
        lasts = None if left is None else endurance_of(found, left)
        if days is not None:
            console.say(f"{days:.1f} days left at this power")
        if lasts is not None:
            low, high = lasts.interval()
            sure = f"(90 %: {low:.1f} to {high:.1f})"
            console.say(f"{lasts.days:.1f} days left as the last dives go on {sure}")
        tried = second_half(self.store, found.vehicle, missions=rows)
        if tried is None:
            console.note("too few dives to try the first half of them on the second")
        else:
            form = "{:.1f} %; by their charge per hour {:.1f} %, per dive {:.1f} %"
            told = tried.errors()
            errors = {
                kind: [100 * told[f"{way}_{kind}"] for way in ("model", "per_hour", "each")]
                for kind in ("per_dive", "sum")
            }
            console.pairs(
                {
                    "later dives": f"charge of {len(tried.dives)} by the {tried.taught} before",
                    "error of a dive, mean": form.format(*errors["per_dive"]),
                    "error of the sum": form.replace(":.", ":+.").format(*errors["sum"]),
                }
            )
        if self.out is not None:
            write_consumption(found.vehicle, found.consumption, self.out, overwrite=self.overwrite)
            console.say(f"vehicle: {self.out}")
        console.answer(
            store=self.store,
            vehicle=found.vehicle.name,
            out=self.out,
            days_left=days,
            days_left_90=None if lasts is None else lasts.interval(),
            later_dives=None if tried is None else {"dives": len(tried.dives), **tried.errors()},
            **found.describe(),
        )
        return 0


def _say_energy(console: Console, found: EnergyUse) -> None:
    whole = sum(one.energy for one in found.terms)
    console.table(
        [
            {
                "what": one.name,
                "factor": one.value,
                "deviation": "the vehicle's" if one.deviation != one.deviation else one.deviation,
                "unit": "" if one.unit == "1" else one.unit,
                "of the energy": f"{100 * one.energy / whole:.1f} %",
            }
            for one in found.terms
            if one.energy > 0.0
        ],
        title=f"{found.vehicle.name}: {len(found.dives)} dives",
        digits=3,
    )
    console.pairs(
        {
            "counted": f"{found.charge:.2f} A h in {found.hours:.1f} h at {found.voltage:.2f} V",
            "power": f"{found.power:.2f} W, {24 * found.charge / found.hours:.1f} A h a day",
        }
    )
    if found.resets:
        console.warn(f"the counter ran backwards in {found.resets} intervals: left out")
