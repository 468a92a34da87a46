"""Parameters: everything that the factory draws for a mission, with unit, spread and reason.

This is the one table of distributions. A row gives the parameter's name, its unit, what preset
`paper` and preset `field` draw it from, and why. `--set NAME=DISTRIBUTION` and TOML files replace
entries by name; stores keep the table that was used, and every drawn value under the name with
an underscore for the dot.

Rows of the group `mission` below SEGMENT are drawn again for every segment of a mission.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass

from factory.recipe.distribution import Distribution, parse_distribution
from twin.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """One row of the table."""

    name: str
    """group.name; the store's variable has an underscore for the dot"""
    unit: str
    """as CF writes it; "1" is dimensionless"""
    paper: str
    """distribution in presets paper and paper-test"""
    field: str
    """distribution in preset field"""
    why: str
    """one line: what it is and why these values"""
    per_segment: bool = False
    """drawn for every segment"""

    @property
    def variable(self) -> str:
        """Name in the store."""
        return self.name.replace(".", "_")


FLOWN_BY_TEST_SPIRALS = "(37, 43) (-33, -27)"
FLOWN_BY_TEST_LEVEL = "(28, 32)"
"""Exclusion zones of preset paper: its training missions never command the rotations of the two
spirals of preset paper-test (40 and -30 deg), nor the pitch of its wings-level part (30 deg)."""

_ONE_TENTH = "uniform(0.9, 1.1)"
_SPREAD = "factor on the vehicle file's value; +-10 % is our guess of how well it is known"


def _coefficient(name: str, what: str) -> Parameter:
    return Parameter(f"vehicle.{name}", "1", "1", _ONE_TENTH, f"{what}: {_SPREAD}")


TABLE: tuple[Parameter, ...] = (
    # --- mission -------------------------------------------------------------------------------
    Parameter("mission.duration_h", "h", "uniform(0.5, 1)", "uniform(1, 3)",
              "length; field missions hold several dives between GPS fixes"),
    Parameter("mission.start_heading_deg", "degree", "uniform(0, 360)", "uniform(0, 360)",
              "heading at launch; the glider starts at rest in the water"),
    Parameter("mission.start_depth_m", "m", "0", "0",
              "launch at the surface, so that every mission begins with surge from rest"),
    Parameter("mission.surface_every", "1", "none", "1",
              "dives between two stays at the surface (GPS fixes); none: never surfaces"),
    # SEGMENT: drawn for every segment
    Parameter("mission.kind", "1", "choice(saw-tooth, spiral)", "choice(saw-tooth: 2, spiral: 1)",
              "the paper combines wings-level and spiral motion; field work is mostly transects",
              per_segment=True),
    Parameter("mission.segment_duration_s", "s", "uniform(600, 1800)", "none",
              "time limit of a segment, one to three of them in a mission", per_segment=True),
    Parameter("mission.yos", "1", "none", "choice(1, 2)",
              "dives with their climbs in a segment; field gliders surface after one or a few",
              per_segment=True),
    Parameter("mission.max_depth_m", "m", "loguniform(40, 500)", "uniform(60, 300)",
              "lower turning depth; logarithmic, so that inflections are frequent",
              per_segment=True),
    Parameter("mission.min_depth_m", "m", "uniform(5, 25)", "uniform(5, 25)",
              "upper turning depth; below the overshoot of an inflection", per_segment=True),
    Parameter("mission.pitch_deg", "degree", f"uniform(15, 45) except {FLOWN_BY_TEST_LEVEL}",
              "uniform(18, 42)", "pitch magnitude of the dive; the range that gliders use",
              per_segment=True),
    Parameter("mission.climb_pitch_deg", "degree", f"uniform(15, 45) except {FLOWN_BY_TEST_LEVEL}",
              "uniform(18, 42)", "pitch magnitude of the climb", per_segment=True),
    Parameter("mission.net_mass_kg", "kg", "uniform(0.15, 0.45)", "uniform(0.25, 0.45)",
              "how heavy the dive is (pump volume); the Sea-Wing's pump reaches 0.5 kg",
              per_segment=True),
    Parameter("mission.climb_net_mass_kg", "kg", "uniform(0.15, 0.45)", "uniform(0.25, 0.45)",
              "how light the climb is; both are scaled down to a smaller pump", per_segment=True),
    Parameter("mission.heading_change_deg", "degree", "uniform(-180, 180)", "uniform(-120, 120)",
              "new heading of a saw-tooth, from the last one", per_segment=True),
    Parameter("mission.rotation_deg", "degree",
              f"uniform(-45, 45) except {FLOWN_BY_TEST_SPIRALS} (-5, 5)",
              "uniform(-40, 40) except (-5, 5)",
              "battery rotation of a spiral; at 45 deg the Sea-Wing rolls 14 deg in a dive and 40 "
              "in a climb, below 5 deg it is no spiral", per_segment=True),
    Parameter("mission.surface_duration_s", "s", "none", "uniform(180, 600)",
              "stay at the surface; a first fix takes 30 to 120 s", per_segment=True),
    # --- vehicle: what the guidance does not know ----------------------------------------------
    _coefficient("k_d0", "drag at zero angle of attack"),
    _coefficient("k_d", "drag due to angle of attack"),
    _coefficient("k_l0", "lift at zero angle of attack"),
    _coefficient("k_alpha", "lift slope"),
    _coefficient("k_beta", "side force"),
    _coefficient("k_mr", "roll moment"),
    _coefficient("k_p", "roll damping"),
    _coefficient("k_m0", "pitch moment at zero angle of attack"),
    _coefficient("k_m", "pitch moment"),
    _coefficient("k_q", "pitch damping"),
    _coefficient("k_my", "yaw moment"),
    _coefficient("k_r", "yaw damping"),
    _coefficient("added_mass_surge", "added mass (1,1)"),
    _coefficient("added_mass_sway", "added mass (2,2)"),
    _coefficient("added_mass_heave", "added mass (3,3)"),
    _coefficient("added_mass_roll", "added inertia (4,4)"),
    _coefficient("added_mass_pitch", "added inertia (5,5)"),
    _coefficient("added_mass_yaw", "added inertia (6,6)"),
    _coefficient("added_mass_sway_yaw", "added coupling (2,6)"),
    _coefficient("added_mass_heave_pitch", "added coupling (3,5)"),
    Parameter("vehicle.shift_offset_mm", "mm", "0", "uniform(-1, 1)",
              "battery ahead of where its encoder says; 0.3 mm is 0.4 deg of pitch"),
    Parameter("vehicle.rotation_offset_deg", "degree", "0", "uniform(-2, 2)",
              "battery turned from where its encoder says"),
    Parameter("vehicle.ballast_g", "g", "0", "uniform(-20, 20)",
              "too heavy after ballasting, at the density it was ballasted for"),
    Parameter("vehicle.cg_y_mm", "mm", "0", "uniform(-0.05, 0.05)",
              "CG of the fixed block to starboard; 0.05 mm lists the hull by half a degree"),
    Parameter("vehicle.cg_z_mm", "mm", "0", "uniform(-0.3, 0.3)",
              "CG of the fixed block lower than the file says, of 3.2 mm"),
    Parameter("vehicle.compressibility", "Pa-1", "0", "uniform(3e-10, 7e-10)",
              "hull volume lost per pressure; 5e-10 is typical, sea water has 4.4e-10"),
    Parameter("vehicle.shift_lag", "1", "1", "uniform(0.8, 1.2)",
              "factor on the lag of the battery's shift; lags are not published"),
    Parameter("vehicle.rotation_lag", "1", "1", "uniform(0.8, 1.2)",
              "factor on the lag of the battery's rotation"),
    Parameter("vehicle.pump_lag", "1", "1", "uniform(0.8, 1.2)", "factor on the pump's lag"),
    Parameter("vehicle.shift_rate", "1", "1", "uniform(0.8, 1.2)",
              "factor on the largest rate of the shift"),
    Parameter("vehicle.rotation_rate", "1", "1", "uniform(0.8, 1.2)",
              "factor on the largest rate of the rotation"),
    Parameter("vehicle.pump_rate", "1", "1", "uniform(0.8, 1.2)", "factor on the pump's rate"),
    # --- current: its speed is shared out by the weights, so that it never exceeds the speed ----
    Parameter("current.speed", "m s-1", "uniform(0, 0.3)", "uniform(0, 0.3)",
              "sum of all amplitudes; mid-latitude rms is 0.14 m/s at the surface, 0.3 is strong"),
    Parameter("current.steady", "1", "1", "uniform(0, 1)", "weight of the part without structure"),
    Parameter("current.steady_direction_deg", "degree", "uniform(0, 360)", "uniform(0, 360)",
              "toward which it flows"),
    Parameter("current.shear", "1", "0", "uniform(0, 1)",
              "weight of the geostrophic part that decays with depth"),
    Parameter("current.shear_direction_deg", "degree", "0", "uniform(0, 360)",
              "toward which it flows"),
    Parameter("current.shear_scale_m", "m", "200", "loguniform(50, 800)",
              "its decay depth; 300 to 1000 m in the open ocean, less on shelves"),
    Parameter("current.tide", "1", "0", "uniform(0, 1)", "weight of the barotropic tide"),
    Parameter("current.tide_constituent", "1", "M2", "choice(M2: 3, S2: 1, K1: 2, O1: 1)",
              "its period; weights follow usual amplitudes"),
    Parameter("current.tide_direction_deg", "degree", "0", "uniform(0, 360)",
              "major axis of its ellipse"),
    Parameter("current.tide_ratio", "1", "0", "uniform(-0.6, 0.6)",
              "minor over major axis; positive turns counterclockwise"),
    Parameter("current.tide_phase_deg", "degree", "0", "uniform(0, 360)", "its phase at launch"),
    Parameter("current.inertial", "1", "0", "uniform(0, 1)",
              "weight of the near-inertial oscillation of the mixed layer"),
    Parameter("current.inertial_direction_deg", "degree", "0", "uniform(0, 360)",
              "its direction at launch"),
    Parameter("current.inertial_layer_m", "m", "40", "uniform(20, 80)", "depth of the mixed layer"),
    Parameter("current.ekman", "1", "0", "uniform(0, 0.5)",
              "weight of the wind-driven spiral; thin, so it gets less"),
    Parameter("current.ekman_direction_deg", "degree", "0", "uniform(0, 360)",
              "toward which the wind blows"),
    Parameter("current.ekman_depth_m", "m", "25", "uniform(12, 40)", "its e-folding depth"),
    Parameter("current.bottom", "1", "0", "uniform(0, 0.5)",
              "weight of the bottom boundary layer, where there is a bottom"),
    Parameter("current.bottom_direction_deg", "degree", "0", "uniform(0, 360)",
              "toward which it flows"),
    Parameter("current.bottom_layer_m", "m", "20", "uniform(20, 100)",
              "its height, logarithmic below and constant above"),
    Parameter("current.wander", "1", "0", "uniform(0, 0.5)",
              "weight of a Gauss-Markov part: submesoscale change over the mission"),
    Parameter("current.wander_direction_deg", "degree", "0", "uniform(0, 360)",
              "its mean direction"),
    Parameter("current.wander_time_h", "h", "3", "uniform(1, 6)", "its correlation time"),
    Parameter("current.wander_seed", "1", "0", "uniform(0, 2147483647)",
              "seed of its realisation, rounded down"),
    # --- water ---------------------------------------------------------------------------------
    Parameter("water.stratified", "1", "0", "1",
              "1: density by TEOS-10 from a thermocline; 0: the constant reference density"),
    Parameter("water.surface_temperature", "degC", "16", "uniform(8, 22)", "of the mixed layer"),
    Parameter("water.deep_temperature", "degC", "4", "uniform(3, 7)", "below the thermocline"),
    Parameter("water.surface_salinity", "1", "33.4", "uniform(33, 35)",
              "practical salinity of the mixed layer"),
    Parameter("water.salinity_increase", "1", "1", "uniform(0, 0.8)",
              "deep minus surface; positive keeps the column stable"),
    Parameter("water.mixed_layer_m", "m", "30", "uniform(10, 60)", "depth of the mixed layer"),
    Parameter("water.thermocline_m", "m", "200", "uniform(60, 250)", "its decay depth below that"),
    Parameter("water.latitude", "degree_north", "36.8", "uniform(20, 65)",
              "gravity at the pressure gauge, inertial period and Ekman turning"),
    Parameter("water.bottom_below_m", "m", "none", "loguniform(20, 2000)",
              "bottom below the deepest turning depth; the DVL sees 110 m"),
)  # fmt: skip

PARAMETERS: Mapping[str, Parameter] = {parameter.name: parameter for parameter in TABLE}
SPREADS = ("paper", "field")


def declared(spread: str) -> dict[str, Distribution]:
    """The table's distributions of one column: "paper" or "field"."""
    return {p.name: parse_distribution(getattr(p, spread), p.name) for p in TABLE}


def override(
    distributions: Mapping[str, Distribution], changes: Mapping[str, str | float]
) -> dict[str, Distribution]:
    """The distributions with some replaced.

    Raises:
      InputError: a name that the table does not have (the nearest is offered), or a bad text.
    """
    result = dict(distributions)
    for name, text in changes.items():
        if name not in PARAMETERS:
            near = difflib.get_close_matches(name, PARAMETERS, n=1, cutoff=0.5)
            hint = f": did you mean {near[0]!r}?" if near else ""
            raise InputError(
                f"unknown parameter {name!r}{hint} (`factory distributions` lists them all)"
            )
        result[name] = parse_distribution(text, name)
    return result
