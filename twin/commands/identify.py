"""Command `twin identify`: estimate a vehicle's parameters from its own logs."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli.console import Console, JsonOption

if TYPE_CHECKING:
    from twin import Vehicle
    from twin.cli.console import Progress
    from twin.identify import DrivenErrors, Handling, Identification, Refinement


UNUSUAL = 2.0  # usual spreads from nominal beyond which an estimate gets a warning
ESTIMATE = ("value", "deviation", "nominal", "unit", "determined", "note")
"""Keys of each parameter in the JSON answer"""
STAGES = {"fit": 60.0, "refine": 120.0, "handle": 40.0}
"""Relative duration of each stage, for the progress bar"""


@dataclass(frozen=True, kw_only=True)
class Identify(JsonOption):
    """Estimate trim, drag, lift, hull and sensor errors from depth, attitude, pump and density.

    For a propelled vehicle: estimate drag, thrust, fins, moments and trim from its runs.

    Ten hours of log take about 20 s of computing (a minute on a busy machine); --model twin takes
    longer.

    Example:

        twin identify real.zarr --vehicle slocum-200 --out mine.xml
    """

    store: Annotated[Path, tyro.conf.Positional]
    """store of logs, as `factory import` writes it, or a simulated store with sensors"""
    vehicle: str | None = None
    """vehicle to start from: shipped name, or the path of an MJCF file; default: the shipped
    vehicle of the log's type, or the vehicle of a simulated store"""
    dimensions: tuple[str, ...] = ()
    """dimensions of a propelled vehicle without a file, in place of --vehicle: length=1.33
    diameter=0.19 mass=30.5 [m, kg], and if known fin_area [m2], fin_place [m ahead of the middle],
    screw (diameter of the propeller [m]), density [kg/m3]"""
    out: Path | None = None
    """file (.xml) to write the calibrated vehicle to"""
    overwrite: bool = False
    """replace an existing --out"""
    export: Path | None = None
    """file to write the parameters of other flight models to: .m for a Seaglider's basestation
    (hd_a, hd_b, hd_c, volmax, vbdbias, abs_compress, therm_expan), .json for gliderflight (Cd0, Vg,
    mg, epsilon, ah, Cd1)"""
    start: Path | None = None
    """file like --export's (.m or .json) with the parameters to start from, not the vehicle's"""
    plot: Path | None = None
    """file (.png, .pdf or .svg) to draw the residuals to"""
    model: Literal["flight", "steady", "twin"] = "flight"
    """flight: logged attitude, with inertia; steady: forces in balance, without inflections; twin:
    flight, then full rollouts of the MuJoCo twin on the logged actuator positions"""
    parameters: tuple[str, ...] = ()
    """parameters to estimate; default: all that the log may determine, and a pitch offset if it
    improves the prediction of left-out dives"""
    known: tuple[str, ...] = ()
    """known values that are not estimated, such as mass=70 lift_ratio=48"""
    missions: str = "all"
    """missions of the store to fit, such as 0-11,14"""
    unseen: str = ""
    """runs of a propelled vehicle that are not fitted, such as 4,5; they test the identified
    vehicle and the vehicle that it started from"""
    no_fixes: bool = False
    """fit the vertical velocity only; without this option the change of current between GPS fixes
    is fitted too, where the log has fixes"""
    no_handling: bool = False
    """keep the vehicle file's pitch, turns and gains, and skip the test flights; the file is then
    written for estimates of speed, whether the vehicle flies or not"""
    correlations: bool = False
    """print the correlation of the estimates too"""
    pitch_scale: float | None = None
    """known scale of the pitch sensor, true pitch = scale * measured + offset; the scale is then
    estimated only if --parameters names it"""
    pitch_offset: float | None = None
    """known offset of the pitch sensor [deg]; estimated only if --parameters names it"""

    def _check(self) -> None:
        """Raise InputError for unusable options and targets, before anything is read."""
        from twin.cli.options import check_plot_path
        from twin.errors import InputError

        check_plot_path(self.plot)
        if self.out is not None and self.out.suffix.lower() != ".xml":
            raise InputError(f"--out {str(self.out)!r} must end in .xml")
        if self.out is not None and self.out.exists() and not self.overwrite:
            raise InputError(f"{self.out} exists already; use --overwrite or another --out")
        if self.export is not None and self.export.suffix not in (".m", ".json"):
            kinds = ".m (basestation) or .json (gliderflight)"
            raise InputError(f"--export {str(self.export)!r} must end in {kinds}")
        for option, target in (("out", self.out), ("plot", self.plot), ("export", self.export)):
            folder = None if target is None else target.absolute().parent
            if folder is not None and not (folder.is_dir() and os.access(folder, os.W_OK)):
                raise InputError(
                    f"--{option} {target}: {folder} is not a folder that can be written to"
                )
        for name, value in (("scale", self.pitch_scale), ("offset", self.pitch_offset)):
            if value is not None and not math.isfinite(value):
                raise InputError(f"--pitch-{name} must be a finite number, not {value}")
        if self.pitch_scale is not None and not 0.5 <= self.pitch_scale <= 2.0:
            raise InputError(f"--pitch-scale must be between 0.5 and 2, not {self.pitch_scale:g}")
        if self.dimensions and self.vehicle is not None:
            raise InputError("--dimensions are for a vehicle without a file: leave out --vehicle")

    def run(self, console: Console) -> int:
        """Fit the parameters, report them, and write the files."""
        from twin import identify, load_vehicle
        from twin.cli.options import parse_numbers, parse_rows
        from twin.errors import InputError
        from twin.vehicle import Dimensions

        self._check()
        offset = None if self.pitch_offset is None else math.radians(self.pitch_offset)
        if self.dimensions:
            example = "a dimension and its value, such as length=1.33"
            numbers = parse_numbers("dimensions", self.dimensions, example)
            return self._driven(console, Dimensions.of(numbers).vehicle())
        started = self.vehicle if self.vehicle is not None else identify.start_vehicle(self.store)
        vehicle = load_vehicle(started) if isinstance(started, str) else started
        if identify.driven(vehicle):
            return self._driven(console, vehicle)
        if self.unseen:
            raise InputError(
                f"--unseen {self.unseen} is of propelled vehicles, and {vehicle.name!r} is a "
                "glider: give --missions, and fly the others by `twin check --logs`"
            )
        pitch = {"pitch_scale": self.pitch_scale, "pitch_offset": offset}
        nominal = identify.load_calibration(started, **pitch)
        if odd := "" if self.vehicle is None else identify.other_kind(self.store, nominal.vehicle):
            console.warn(odd)
        if self.start is not None:
            nominal = identify.read_figures(self.start, nominal)
        known = parse_numbers("known", self.known, "a parameter and its value, such as mass=70")
        nominal = identify.with_known(nominal, known)
        fixed = [name for name, value in pitch.items() if value is not None]
        given = {*known, *fixed} - ({*self.parameters} - {*known})
        logs = identify.load_logs(self.store, parse_rows(self.missions))
        refined, handling = None, None
        with console.progress(total=1.0, label="identify", unit="") as progress:
            report = _Stages(progress, refines=self.model == "twin", handles=not self.no_handling)
            found = identify.identify(
                logs,
                nominal,
                parameters=self.parameters or None,
                known=tuple(given),
                model="steady" if self.model == "steady" else "flight",
                fixes=not self.no_fixes,
                progress=report.of("fit"),
            )
            if self.model == "twin":
                refined = identify.refine(logs, found, known=given, progress=report.of("refine"))
                found = refined.identification
            if not self.no_handling:
                proof = self.out is not None
                handling = identify.handle(logs, found, proof=proof, progress=report.of("handle"))
                found = handling.identification
        self._say(console, found, len(logs) - len(found.powered), refined)
        if found.powered:
            rows = ", ".join(map(str, found.powered))
            console.warn(
                f"left out: {len(found.powered)} of {len(logs)} missions ran their thruster, so "
                f"that their speed is no glide's ({rows})"
            )
        if found.stalled:
            console.warn(
                f"missions {', '.join(map(str, found.stalled))} sink or rise far slower than the "
                "fit, as stalled wings do: where the others do too, trim and drag are wrong"
            )
        for text in identify.confused(found):
            console.warn(text)
        if handling is not None:
            _say_handling(console, handling)
        if self.out is not None:
            from twin.checks import check_still_water

            failures = () if handling is None else handling.failures
            fitted = [log.index for log in logs if log.index not in found.powered]
            self._write(console, found, failures, "as its log", fitted, counted=True)
            for one, decay in check_still_water(load_vehicle(self.out)):
                if not decay.ok:  # the vehicle would take energy from still water
                    told = "a log of glides tells nothing of such a motion"
                    console.warn(f"{decay.text(one)}; {told}")
        if self.export is not None:
            kind = identify.write_figures(found.calibration, self.export)
            console.say(f"figures of {kind}: {self.export}")
        if self.plot is not None:
            from twin.records import whole_file
            from twin.show import residual_figure

            with whole_file(self.plot) as place:
                residual_figure(found, logs).savefig(place)
            console.say(f"plot: {self.plot}")
        if refined is not None:
            console.answer(**refined.describe())
        return 0

    def _driven(self, console: Console, vehicle: Vehicle) -> int:
        """Fit, report and write the parameters of a propelled vehicle."""
        from twin import identify
        from twin.cli.options import parse_numbers, parse_rows
        from twin.errors import InputError

        for option, given in (
            ("export", self.export),
            ("start", self.start),
            ("plot", self.plot),
            ("model", "" if self.model == "flight" else self.model),
            ("no-fixes", self.no_fixes),
            ("pitch-scale", self.pitch_scale is not None),
            ("pitch-offset", self.pitch_offset is not None),
        ):
            if given:
                raise InputError(
                    f"--{option} is of gliders, and {vehicle.name!r} is propelled: leave it "
                    "out, or give a glider with --vehicle"
                )
        known = parse_numbers("known", self.known, "a parameter and its value, such as Xuu=1.1")
        runs = identify.load_runs(self.store, vehicle, parse_rows(self.missions))
        unseen = []
        if self.unseen:
            rows = parse_rows(self.unseen)
            unseen = identify.load_runs(self.store, vehicle, rows)
            runs = [run for run in runs if run.index not in (rows or ())]
            if not runs:
                raise InputError(f"--unseen {self.unseen} leaves no run to fit")
        with console.progress(total=1.0, label="identify", unit="") as progress:
            report = _Stages(progress, refines=False, handles=False).of("fit")
            found = identify.identify_driven(
                runs,
                vehicle,
                parameters=self.parameters or None,
                known=known,
                unsure=identify.UNSURE if self.dimensions else 1.0,
                progress=report,
            )
        self._say(console, found, len(runs), None)
        for text in identify.confused(found):
            console.warn(text)
        for part in runs[0].silent:
            console.warn(f"the runs have no position of {part}: it is flown at rest")
        for part in runs[0].commanded:
            console.warn(
                f"the runs have commands of {part}, and no positions: they are what the file's lag "
                "and largest rate make of them"
            )
        if unseen:
            both = (identify.judge(unseen, one) for one in (found.calibration, found.nominal))
            _say_unseen(console, *both)
        if self.out is not None:
            failures: tuple[str, ...] = ()
            if not self.no_handling:
                cruise = identify.cruise_of(runs, vehicle)
                failures = identify.driven_failures(found.calibration, cruise)
            console.answer(failures=list(failures))
            fitted = [run.index for run in runs]
            self._write(console, found, failures, "under guidance", fitted, counted=False)
        return 0

    def _write(
        self,
        console: Console,
        found: Identification,
        failures: Sequence[str],
        how: str,
        rows: Sequence[int],
        *,
        counted: bool,
    ) -> None:
        """Write the vehicle file of these rows; if `counted`, with the log's consumption.

        Raises:
          InputError: the vehicle does not fly as it should.
        """
        from twin.errors import InputError
        from twin.identify import provenance_of, write_vehicle
        from twin.logs import counted_energy

        assert self.out is not None
        if failures:
            told = f"{self.out} is not written, the vehicle does not fly {how}"
            raise InputError(f"{told}: {'; '.join(failures)}")
        used = counted_energy(self.store, found.calibration.vehicle) if counted else None
        if used is not None:
            console.note("energy by the log's counter of charge")
        write_vehicle(
            found.calibration,
            self.out,
            provenance_of(found, self.store, rows),
            consumption=None if used is None else used.consumption,
            overwrite=self.overwrite,
        )
        console.say(f"vehicle: {self.out}")

    def _say(
        self, console: Console, found: Identification, missions: int, refined: Refinement | None
    ) -> None:
        """Print the estimates and three sentences on the fit; warn of unusual estimates."""
        rows = [
            {
                "parameter": e.name,
                "unit": "" if e.unit == "1" else e.unit,
                "nominal": e.nominal,
                "estimate": e.value,
                "deviation": e.deviation,
                "usual spread": e.spread,
                "": e.note if e.determined else f"kept: {e.note}",
            }
            for e in sorted(found.estimates, key=lambda e: not e.determined)
        ]
        console.table(rows, title=f"{found.nominal.vehicle.name}: {missions} missions", digits=6)
        console.say("\n".join(_sentences(found, missions, refined)))
        names = found.determined
        if self.correlations and len(names) > 1:
            console.table(
                [
                    {
                        "": name,
                        **{str(j + 1): f"{r:.2f}" if j <= i else "" for j, r in enumerate(row)},
                    }
                    for i, (name, row) in enumerate(zip(names, found.correlation, strict=True))
                ],
                title="correlation of the estimates",
            )
        console.answer(
            vehicle=found.nominal.vehicle.name,
            store=self.store,
            out=self.out,
            plot=self.plot,
            model=found.model,
            missions=missions,
            powered_rows_left_out=len(found.powered),
            stalled_rows=list(found.stalled),
            samples=found.samples,
            hours=found.hours,
            depth_rate_rmse_m_s=found.depth_rate_rmse,
            nominal_depth_rate_rmse_m_s=found.nominal_depth_rate_rmse,
            robust_deviation_m_s=found.robust_deviation,
            correlation_time_s=found.correlation_time,
            current_change_m_s=found.current_change,
            correlation={
                name: dict(zip(names, map(float, row), strict=True))
                for name, row in zip(names, found.correlation, strict=True)
            },
            parameters={
                e.name: {name: getattr(e, name) for name in ESTIMATE} for e in found.estimates
            },
        )
        from twin.identify import ALWAYS, NAMES

        for one in found.estimates:  # trim and drag are every vehicle's own
            away = abs(one.value - one.nominal) / one.spread
            if one.determined and one.name not in ALWAYS and away > UNUSUAL:
                unit = "" if one.unit == "1" else f" {one.unit}"
                known = f"; if you know it, give --known {one.name}=VALUE" * (one.name in NAMES)
                console.warn(
                    f"{one.name} {one.value:.4g}{unit} is {away:.1f} usual spreads away from "
                    f"{one.nominal:.4g}: the vehicle differs, or the model lacks something that "
                    f"this takes up{known}"
                )


def _sentences(found: Identification, missions: int, refined: Refinement | None) -> Iterator[str]:
    """Sentences on the depth rate, the current or the twin, and the deviations of a fit."""
    before, runs = found.nominal.vehicle.name, found.model == "driven"
    yield (
        f"The depth rate is within {100 * found.depth_rate_rmse:.2f} cm/s of the log's (RMS; "
        f"{before} {100 * found.nominal_depth_rate_rmse:.2f}), over {found.hours:.1f} h of "
        f"{missions} {'runs' if runs else 'dives'}."
    )
    if refined is not None:
        yield (
            f"The twin in MuJoCo is within {100 * refined.depth_rate_rmse:.2f} cm/s and "
            f"{math.degrees(refined.pitch_rmse):.2f} deg of pitch of it, in {refined.windows} "
            "windows."
        )
    elif found.current_change is not None and found.nominal_current_change is not None:
        yield (
            f"The current changes by {100 * found.current_change:.2f} cm/s from dive to dive "
            f"(median; {before} {100 * found.nominal_current_change:.2f})."
        )
    elif not runs:
        yield "No currents between fixes were compared, which would tell lift and compass."
    kept = "include the usual errors of the values that are kept"
    holds = "hold if the model does" if runs else kept
    yield f"Deviations {holds}; --correlations prints how the estimates depend on each other."


def _say_unseen(console: Console, mine: DrivenErrors, before: DrivenErrors) -> None:
    """Report errors on runs that were not fitted: `mine` identified, `before` the start vehicle."""
    console.table(
        [
            {
                "vehicle": name,
                "speed": f"{100.0 * errors.speed:.2f} %",
                "yaw rate, a second ahead": f"{100.0 * errors.turn_rate:.1f} %",
                "depth rate": f"{100.0 * errors.depth_rate:.1f} %",
            }
            for name, errors in (("identified", mine), ("started from", before))
        ],
        title=f"errors on runs that were not fitted, {mine.pieces} pieces of 20 s; speed by the "
        + ("truth of the simulation" if mine.against == "truth" else "Doppler log less a current"),
    )
    console.answer(unseen={"identified": mine.describe(), "started_from": before.describe()})


class _Stages:
    """Stages of a command on one progress bar, which is full when all stages have ended."""

    def __init__(self, progress: Progress, *, refines: bool, handles: bool):
        self._progress, self._done = progress, 0.0
        asked = {"fit": True, "refine": refines, "handle": handles}
        self._names = [name for name in STAGES if asked[name]]
        self._whole = sum(STAGES[name] for name in self._names)

    def of(self, stage: str) -> Callable[[float], None]:
        """Make the function that reports the finished fraction of a stage, 0 to 1."""
        before = sum(STAGES[name] for name in self._names[: self._names.index(stage)])

        def report(part: float) -> None:
            done = (before + part * STAGES[stage]) / self._whole
            self._progress.update(done - self._done)
            self._done = done

        return report


def _say_handling(console: Console, handling: Handling) -> None:
    """Report pitch, turns, asymmetry and control gains, as text and as JSON."""
    vehicle = handling.identification.calibration.vehicle
    rows: dict[str, str] = {}
    degrees = {
        name: None if value is None else math.degrees(value)
        for name, value in (
            ("pitch_rmse_deg", handling.pitch_deviation),
            ("turn_deviation_deg_s", handling.turn_deviation),
            ("yaw_bias_deg", handling.yaw_bias),
            ("roll_offset_deg", handling.roll_offset),
            ("neutral_deg", handling.neutral),
        )
    }
    steady, turn, bias, roll, neutral = degrees.values()
    if steady is not None:
        rows["steady pitch, RMSE"] = f"{steady:.2f} deg"
    if turn is not None:
        rows["yaw rate of a minute, deviation"] = f"{turn:.3f} deg/s"
    if bias is not None and roll is not None:
        rows["asymmetry"] = f"turns as at {bias:.1f} deg of sideslip, roll sensor {roll:.1f} deg"
    if neutral is not None:
        rows[f"{vehicle.steering['heading']} that goes straight"] = f"{neutral:.1f} deg"
    pitch, net_mass = vehicle.usual_glide
    rows["usual glide"] = f"{math.degrees(pitch):.1f} deg, net mass {net_mass:.2f} kg"
    for name in ("pitch_pid", "heading_pid"):
        rows[name] = " ".join(f"{gain:.4g}" for gain in getattr(vehicle, name))
    console.pairs(rows)
    for note in handling.notes:
        console.warn(note)
    console.answer(
        **degrees,
        usual_glide_pitch_deg=math.degrees(pitch),
        usual_glide_net_mass_kg=net_mass,
        pitch_pid=list(vehicle.pitch_pid),
        heading_pid=list(vehicle.heading_pid),
        failures=list(handling.failures),
    )
