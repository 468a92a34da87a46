"""Currents as one line of text, for `--current`: KIND:SETTINGS, added with +."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from twin.errors import CurrentError, unknown_name
from twin.water.current.base import Current, CurrentSum, still_water
from twin.water.current.ekman import Ekman
from twin.water.current.gauss_markov import GaussMarkov
from twin.water.current.geostrophic import Geostrophic
from twin.water.current.grid import Grid
from twin.water.current.inertial import Inertial
from twin.water.current.log_layer import LogLayer
from twin.water.current.profile import Profile
from twin.water.current.tide import PERIOD_HOURS, TidalEllipse, Tide
from twin.water.current.uniform import Uniform

CURRENT_HELP = """\
none                                      still water
uniform:NORTH,EAST[,DOWN]                 m/s, e.g. uniform:-0.05,-0.002
uniform:speed=0.3,direction=90            m/s, degrees toward
profile:FILE.csv                          columns depth,north,east[,down] in m and m/s
ekman:tau=0.1,direction=90                wind stress Pa, degrees the wind blows toward
geostrophic:surface=0.2,direction=45,scale=800,barotropic=0.05
tide:m2=0.1,s2=0.03,direction=30          ellipses; also minor=, phase=, m2_phase=, k1=, o1= ...
inertial:speed=0.08,layer=40              near-inertial oscillation of the mixed layer
gauss-markov:speed=0.1,std=0.05,direction=90,direction_std=20,time=10800,seed=1
log-layer:friction=0.01,direction=0,bottom=100
grid:FILE.nc,lat=49,lon=-16,time=2000-01-05   CF netCDF or zarr
Directions are toward, clockwise from north. Add currents with +."""
"""What `--current` accepts, a line each."""

NUMBER_SETTINGS: dict[str, dict[str, str]] = {
    "ekman": {
        "tau": "stress", "stress": "stress", "direction": "direction_deg",
        "viscosity": "viscosity", "az": "viscosity", "density": "density", "lat": "latitude_deg",
    },
    "geostrophic": {
        "surface": "baroclinic", "speed": "baroclinic", "direction": "direction_deg",
        "scale": "scale_depth", "barotropic": "barotropic",
        "barotropic_direction": "barotropic_direction_deg",
    },
    "inertial": {
        "speed": "speed", "layer": "layer_depth", "decay": "decay_depth",
        "direction": "direction_deg", "lat": "latitude_deg",
    },
    "gauss-markov": {
        "speed": "speed", "direction": "direction_deg", "std": "speed_std",
        "direction_std": "direction_std_deg", "time": "correlation_time", "min": "min_speed",
        "max": "max_speed", "interval": "interval", "seed": "seed",
    },
    "log-layer": {
        "friction": "friction_velocity", "direction": "direction_deg", "bottom": "water_depth",
        "roughness": "roughness", "thickness": "thickness",
    },
}  # fmt: skip
"""Command-line name and field of every setting that is a number."""

NUMBER_KINDS: dict[str, type[Current]] = {
    "ekman": Ekman,
    "geostrophic": Geostrophic,
    "inertial": Inertial,
    "gauss-markov": GaussMarkov,
    "log-layer": LogLayer,
}

TIDE_SETTINGS = {"direction": "direction_deg", "phase": "phase_deg", "minor": "semi_minor"}
"""Command-line name and field of what every tidal constituent has beside its amplitude."""

GRID_SETTINGS = {
    "lat": "latitude_deg", "lon": "longitude_deg", "time": "time", "u": "east", "v": "north",
    "w": "up", "units": "units", "land": "land", "hold": "hold_s", "reach": "reach_m",
    "span": "span_s", "sha256": "sha256",
}  # fmt: skip
"""Command-line name and field of every setting of a grid beside its path."""
_GRID_NUMBERS = {"lat", "lon", "hold", "reach", "span"}


def parse_current(text: str) -> Current:
    """The current that a `--current` text describes; `CURRENT_HELP` lists the forms.

    Speeds in m/s, angles in degrees toward. Raises CurrentError naming what is wrong.
    """
    # A + belongs to a number (1e+3), a path or a time zone unless a kind follows it.
    pieces = re.split(r"\+(?=\s*(?:[A-Za-z][\w-]*\s*:|none\b))", text.strip())
    currents = [_parse_one(piece.strip()) for piece in pieces]
    if len(currents) == 1:
        return currents[0]
    parts = [
        part
        for current in currents
        for part in (current.parts if isinstance(current, CurrentSum) else (current,))
    ]
    return CurrentSum(parts=tuple(parts))


def _parse_one(text: str) -> Current:
    kind, colon, rest = text.partition(":")
    kind = kind.strip().lower().replace("_", "-")
    if kind == "none":
        if rest.strip():
            raise CurrentError(f"current 'none' takes no settings, not {rest!r}")
        return still_water()
    parsers: dict[str, Callable[[str], Current]] = {
        "uniform": _uniform,
        "profile": _profile,
        "tide": _tide,
        "grid": _grid,
    }
    known = [*parsers, *NUMBER_KINDS, "none"]
    if kind not in known:
        raise CurrentError(unknown_name("current", kind, known))
    if not colon or not rest.strip():
        example = next(line for line in CURRENT_HELP.splitlines() if line.startswith(kind + ":"))
        raise CurrentError(f"current {kind!r} needs settings, e.g. {example.split('  ')[0]}")
    if kind in parsers:
        return parsers[kind](rest)
    return _numeric(kind, rest)


def _numeric(kind: str, rest: str) -> Current:
    names = NUMBER_SETTINGS[kind]
    positional, given = _settings(kind, rest)
    if positional:
        raise CurrentError(f"{kind}: write NAME=VALUE, not {positional[0]!r}; {_allowed(names)}")
    settings: dict[str, float] = {}
    for name, value in given.items():
        if name not in names:
            raise CurrentError(unknown_name(f"{kind} setting", name, names))
        number = _number(kind, name, value)
        settings[names[name]] = _integer(kind, name, number) if name == "seed" else number
    needed = [
        name
        for name, field in NUMBER_KINDS[kind].__dataclass_fields__.items()
        if field.default is field.default_factory and name not in settings
    ]
    if needed:
        text = next(name for name, field in names.items() if field == needed[0])
        raise CurrentError(f"{kind}: {text}= is missing; {_allowed(names)}")
    return NUMBER_KINDS[kind](**settings)


def _uniform(rest: str) -> Current:
    positional, given = _settings("uniform", rest)
    values = [_number("uniform", f"value {i}", v) for i, v in enumerate(positional, start=1)]
    if values and not given and len(values) in (2, 3):
        return Uniform(north=values[0], east=values[1], down=values[2] if values[2:] else 0.0)
    numbers = {name: _number("uniform", name, value) for name, value in given.items()}
    if not values and set(numbers) == {"speed", "direction"}:
        return Uniform.toward(numbers["speed"], numbers["direction"])
    if not values and numbers and set(numbers) <= {"north", "east", "down"}:
        return Uniform(**numbers)
    raise CurrentError(
        f"uniform: cannot use {rest!r}; write uniform:NORTH,EAST[,DOWN] in m/s, or"
        " uniform:speed=0.3,direction=90"
    )


def _profile(rest: str) -> Current:
    positional, given = _settings("profile", rest)
    if len(positional) != 1 or given:
        raise CurrentError(f"profile: give one CSV file, as profile:FILE.csv, not {rest!r}")
    return Profile.from_csv(positional[0])


def _tide(rest: str) -> Current:
    positional, given = _settings("tide", rest)
    if positional:
        raise CurrentError(f"tide: write NAME=VALUE, e.g. m2=0.1, not {positional[0]!r}")
    fields = TIDE_SETTINGS
    constituents = [name for name in given if name.upper() in PERIOD_HOURS]
    allowed = [name.lower() for name in PERIOD_HOURS] + list(fields)
    allowed += [f"{c}_{field}" for c in constituents for field in fields]
    for name in given:
        if name not in allowed:
            raise CurrentError(unknown_name("tide setting", name, allowed))
    ellipses = []
    for name in constituents:
        settings = {
            field: _number("tide", key, given[key])
            for short, field in fields.items()
            for key in (short, f"{name}_{short}")
            if key in given
        }
        major = _number("tide", name, given[name])
        ellipses.append(TidalEllipse(constituent=name, semi_major=major, **settings))
    return Tide(ellipses=tuple(ellipses))


def _grid(rest: str) -> Current:
    positional, given = _settings("grid", rest)
    if len(positional) != 1:
        raise CurrentError(
            "grid: give one file first, as grid:FILE.nc,lat=49,lon=-16,time=2000-01-05,"
            f" not {rest!r}"
        )
    settings: dict[str, str | float] = {}
    for name, value in given.items():
        if name not in GRID_SETTINGS:
            raise CurrentError(unknown_name("grid setting", name, GRID_SETTINGS))
        field = GRID_SETTINGS[name]
        settings[field] = _number("grid", name, value) if name in _GRID_NUMBERS else value
    return Grid(path=positional[0], **settings)  # type: ignore[arg-type]


def _settings(kind: str, rest: str) -> tuple[list[str], dict[str, str]]:
    """Split comma-separated values into positional ones and NAME=VALUE."""
    positional: list[str] = []
    given: dict[str, str] = {}
    for item in rest.split(","):
        name, equals, value = item.partition("=")
        name, value = name.strip(), value.strip()
        if not equals:
            positional.append(name)
            continue
        name = name.lower()
        if name in given:
            raise CurrentError(f"{kind}: {name}= is given twice")
        given[name] = value
    return positional, given


def _number(kind: str, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CurrentError(f"{kind}: {name} must be a number, not {text!r}")
    return value


def _integer(kind: str, name: str, value: float) -> int:
    if value != int(value):
        raise CurrentError(f"{kind}: {name} must be a whole number, not {value:g}")
    return int(value)


def _allowed(names: dict[str, str]) -> str:
    return f"settings: {', '.join(names)}"
