"""Command `twin simulate`: fly one mission and report a summary."""

from __future__ import annotations

import math
import string
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import EngineOption, Seconds

if TYPE_CHECKING:
    from twin import Scenario, Trajectory


OF_A_SCENARIO = (
    *("mission", "vehicle", "current", "density", "ballast_at", "mass", "compressibility"),
    *("floor", "start", "duration", "engine", "hydrodynamics", "timestep", "integrator"),
    *("sample_period", "sensors", "seed", "navigate"),
)
"""Options that are arguments of `twin.scenario_of`, under equal names"""
LEAST_ENERGY = 1e-6  # [kJ] a part's energy below this is rounding noise, shown as 0


@dataclass(frozen=True, kw_only=True)
class Simulate(EngineOption, JsonOption):
    """Fly one mission: summary table, and on request a store and a plot.

    Examples:

        twin simulate --current uniform:0.1,-0.05 --out run.zarr --plot run.png
        twin simulate transects --vehicle tethys --floor rough:40 --sensors field
    """

    mission: Annotated[str | None, tyro.conf.Positional] = None
    """shipped mission name, or the path of a mission file, TOML or Slocum's .mi; default: the
    shipped mission that suits the vehicle. docs/reference/missions.md explains missions"""
    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file; :PRESET after it selects a preset in it"""
    current: str = "none"
    """current, such as uniform:-0.05,-0.002 (north, east [m/s]) or
    grid:FILE.nc,lat=49,lon=-16,time=2000-01-05; + adds currents;
    docs/reference/currents.md lists all types"""
    density: str = "usual"
    """water column: usual (reference density, compressed like sea water if the hull is
    compressible), constant (reference density), thermocline, grid (temperature and salinity of the
    current's file), or a CSV file. The file has columns depth [m] and density [kg/m3], or depth,
    temperature [degC] and salinity, whose density is computed for the start's place"""
    ballast_at: float | None = None
    """depth [m] in this water at which the vehicle is neutral; default: neutral in water of the
    reference density at the surface"""
    mass: float | None = None
    """mass [kg] of the whole vehicle; the hull keeps its volume, or with --ballast-at the vehicle
    is neutral there. Default: the vehicle file's"""
    compressibility: float | None = None
    """fraction of the hull's volume lost per pascal, such as 4e-10; default: the vehicle file's"""
    floor: str = "none"
    """sea floor: none; depth:METRES for a flat one; rough:METRES[,height=2,length=400,seed=0,
    slope=0,toward=0,shallowest=5,deepest=12000,reach=METRES] for a random relief about a mean
    depth; or a bathymetry file such as GEBCO.nc (latitude, longitude, elevation [m]) around
    --start. height is the relief's standard deviation [m], length its correlation length [m]. The
    slope goes down toward a direction [deg]. reach is the relief's extent [m]; default: the
    distance that the mission can cover. docs/physics/equations.md explains these floors"""
    fault: tuple[str, ...] = ()
    """fault of the vehicle, such as fouling:per_day=0.02,from=3h or
    wing_lost:side=port,from=20min; docs/howto/health.md lists all faults"""
    start: Annotated[str | None, tyro.conf.arg(metavar="LAT,LON[,TIME]")] = None
    """place and time of the start: degrees north and east, and UTC, such as
    49,-16,2003-08-01T00:00. Gridded currents, density and the store use this. Default: the place
    and time of a gridded current's file, else 36.8,-122.4,2020-01-01T00:00, off Monterey Bay; the
    store says which of place and date are defaults"""
    duration: Seconds | None = None
    """time to simulate, such as 3600 (seconds), 90min or 6h; default: the mission's duration"""
    hydrodynamics: Literal["coefficients", "ellipsoid"] = "coefficients"
    """hull law: identified coefficients, or MuJoCo's ellipsoid law on the geometry"""
    timestep: float | None = None
    """physics step [s]; default: the vehicle file's"""
    integrator: Literal["discrete", "implicitfast", "implicit"] | None = None
    """MuJoCo integrator; default: the vehicle file's. Implicit integrators need a step of 0.02 s"""
    sample_period: float = 0.5
    """seconds between stored samples"""
    sensors: str | None = None
    """sensor suite, such as ideal or field, whose measurements are added to the store and the
    plots; docs/reference/sensors.md lists all suites. Default: none"""
    seed: int = 0
    """seed of the sensors' random numbers"""
    navigate: str = "truth"
    """state that guidance sees: truth, or an on-board estimate. An estimate is named by its
    velocity estimator: ekf, flight_filter, steady_flight, pitch_plus_alpha, dvl, network:runs/NAME,
    or estimate for the vehicle's usual one. It uses --sensors, by default the suite field.
    docs/howto/navigation.md explains navigation"""
    out: Path | None = None
    """zarr store to write the trajectory to"""
    overwrite: bool = False
    """replace an existing store"""
    plot: Path | None = None
    """PNG, PDF or SVG file to draw an overview to"""

    def run(self, console: Console) -> int:
        """Simulate the mission, write the store and the plot, and report a summary."""
        import twin
        from twin.cli.options import check_plot_path
        from twin.errors import InputError, SimulationUnstable
        from twin.records import check_target

        if self.sensors is None and self.seed != 0 and self.navigate == "truth":
            raise InputError("--seed is for the sensors: give --sensors too, such as field")
        given = {name: getattr(self, name) for name in OF_A_SCENARIO}
        scenario = twin.scenario_of(**given, faults=self.fault)
        check_plot_path(self.plot)
        if self.out is not None:
            check_target(self.out, overwrite=self.overwrite)
        if told := twin.out_of_trim(scenario.vehicle, scenario.ballast, scenario.density):
            console.warn(told)
        alone = scenario.navigate is None  # a navigated scenario has its own sensors
        sensors, seed = (self.sensors, self.seed) if alone else (None, 0)
        try:
            trajectory = twin.simulate(scenario, sensors=sensors, seed=seed)
        except SimulationUnstable as error:
            if self.out is not None and error.partial is not None and len(error.partial.time):
                self._write(error.partial)
                console.note(f"the samples before it are in {self.out}")
            raise
        senses = self.sensors is not None or not alone
        if senses and "measured_temperature" not in trajectory:
            console.note(
                "the CTD measured nothing: this water column has only density; fly in "
                "--density thermocline, or a file with temperature and salinity"
            )
        if self.out is not None:
            self._write(trajectory)
        if self.plot is not None:
            from twin.records import whole_file
            from twin.show.figures import overview_figure

            figure = overview_figure(trajectory)
            with whole_file(self.plot) as place:
                figure.savefig(place)
        for text in twin.remarks(scenario, trajectory):
            console.warn(text)
        self._report(console, scenario, trajectory)
        return 0

    def _write(self, trajectory: Trajectory) -> None:
        from twin.records import dataset_of, write_store

        assert self.out is not None
        dataset = dataset_of([trajectory], attributes=trajectory.provenance)
        write_store(dataset, self.out, overwrite=self.overwrite)

    def _report(self, console: Console, scenario: Scenario, trajectory: Trajectory) -> None:
        from twin.records import summarise

        figures, place = summarise(trajectory), _place(scenario)
        engine = {} if scenario.engine == "mujoco" else {"engine": scenario.engine}
        name = getattr(scenario.mission, "name", None)
        console.answer(
            mission=name,
            vehicle=scenario.vehicle.name,
            out=self.out,
            plot=self.plot,
            start=place,
            **engine,
            **figures,
        )
        parts: dict[str, str] = {}
        for part in scenario.vehicle.parts:
            parts |= part.told(trajectory.time, trajectory[f"true_{part.name}"])
        console.pairs(
            {
                **({"start": place} if place else {}),
                **engine,
                **_texts(MOTION, figures),
                **parts,
                **_texts(BELIEF, figures),
                "energy": _energy(figures),
                "samples": figures["samples"],
            },
            title=f"{scenario.vehicle.name} flew {name or 'a schedule'!r}",
        )
        for label, path in (("store", self.out), ("plot", self.plot)):
            if path is not None:
                console.say(f"{label}: {path}")


MOTION = {
    "duration": "{duration_s:.0f} s",
    "ended": "{ended}",
    "distance through the water": "{distance_through_water_m:.0f} m",
    "horizontal distance over ground": "{horizontal_distance_m:.0f} m",
    "end position (north, east)": "{end_north_m:z.1f} m, {end_east_m:z.1f} m",
    "deepest": "{max_depth_m:z.1f} m",
    "nearest to the sea floor": "{min_altitude_m:z.1f} m",
    "grounded": "{grounded}",
    "speed through the water (mean, max)": "{mean_speed_m_s:.3f}, {max_speed_m_s:.3f} m/s",
    "pitch (min, max)": "{min_pitch_deg:z.1f}, {max_pitch_deg:z.1f} deg",
    "largest roll": "{max_roll_deg:.1f} deg",
    "largest angle of attack, 98 % of the time under water": "{angle}",
    "mean current (north, east)": "{mean_current_north_m_s:z.3f}, {mean_current_east_m_s:z.3f} m/s",
}
BELIEF = {
    "error of the on-board position (end, largest)": (
        "{onboard_error_end_m:.1f}, {onboard_error_max_m:.1f} m"
    ),
    "squared misses of fixes over what was expected (2 is right)": (
        "{nis:.2f} in {fixes_after_dives} fixes"
    ),
}
"""MOTION, BELIEF: formats by label, of the motion's figures and of the on-board position's"""


def _texts(rows: Mapping[str, str], figures: Mapping[str, Any]) -> dict[str, str]:
    """Format the rows whose values are known; a mission without sea floor lacks some."""
    angle, first = figures["angle_of_attack_p98_deg"], figures.get("first_contact_s")
    known = {**figures, "angle": "-" if math.isnan(angle) else f"{angle:.2f} deg"}
    if "grounded" in figures:
        known["grounded"] = "no" if first is None else f"first at {first:.0f} s"
    found = {}
    for label, form in rows.items():
        names = {name for _, name, _, _ in string.Formatter().parse(form) if name}
        if known.keys() >= names:
            found[label] = form.format(**known)
    return found


def _place(scenario: Scenario) -> str | None:
    """Text of place and time of the start; None if the scenario has no place."""
    place = scenario.place
    if not scenario.has_place:
        return None
    date = "" if place.time is None else f", {place.time} UTC"
    return f"latitude {place.latitude_deg:g}, longitude {place.longitude_deg:g}{date}"


def _energy(figures: dict[str, Any]) -> str:
    """Text of the energy: total, per kilometre over ground, and of each part."""
    shares = ", ".join(
        f"{name} {kilo if kilo > LEAST_ENERGY else 0.0:.3g}"
        for name, kilo in figures["energy_kJ"].items()
    )
    total, per_km = figures["total_energy_kJ"], figures["energy_per_km_kJ"]
    way = f", {per_km:.3g} kJ per km over ground" if math.isfinite(per_km) else ""
    return f"{total:.3g} kJ{way} ({shares})"
