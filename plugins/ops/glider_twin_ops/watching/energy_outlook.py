"""Energy outlook: days left for the plan and for changes of it, and the last day to turn home.

The plan's power is the power of the dives so far. The twin computes the power that a change adds:
it flies plan and changed plan in still water, with the consumption estimated from the deployment.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider_twin_ops.forecast import Forecast, LoggedLeg, fly_nominal
from twin import Mission
from twin.errors import MissionError, SimulationUnstable
from twin.geodesy import to_tangent_plane
from twin.logs import Endurance, EnergyUse

DEEPER, STEEPER_DEG = 1.5, 6.0
LESS = {"half the samples": ("payload", 0.5), "thruster off": ("thruster", 1.0)}
"""Consumer and fraction of its power that each change saves"""
SAFE, OWN_DAYS, STEPS = 0.05, 2.0, 500
"""SAFE: largest fraction of draws that fail to reach home after turning on the last safe day.
OWN_DAYS: [d] time between independent currents, as in forecasts. STEPS: number of turning times"""
DAY, KILO = 86400.0, 1e3


@dataclasses.dataclass(frozen=True, kw_only=True)
class WhatIf:
    """Plan or changed plan, with its power [W] and the days left [d]."""

    what: str
    power: float
    days: float
    days_90: tuple[float, float]
    between: str
    km_a_day: float | None
    """[km/d] Distance through the water; None: as in the plan"""

    def row(self) -> dict[str, object]:
        """Row of the page's table."""
        speed = self.km_a_day
        return {
            "plan": self.what,
            "power [W]": round(self.power, 2),
            "days left": round(self.days, 1),
            "90 %": self.between,
            "km a day through the water": speed,
            "km left": None if speed is None else round(speed * self.days),
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class TurnHome:
    """Latest time to turn home, for a vehicle that follows its plan until then."""

    away_km: float
    """[km] Distance from the last fix to home"""
    days: float
    """[d] Median over the draws of the latest turn, from the last fix"""
    safe_days: float
    """[d] Latest turn, from the last fix, after which 95 of 100 draws get home"""
    reached: float
    """Fraction of the draws that get home when turning at the last fix"""

    @property
    def safe(self) -> bool:
        """True where 95 of 100 draws get home from the last fix."""
        return self.reached >= 1.0 - SAFE


@dataclasses.dataclass(frozen=True, kw_only=True)
class EnergyOutlook:
    """Days left for plans, the turn home, and reasons for what is missing."""

    rows: tuple[WhatIf, ...]
    home: TurnHome | None
    lacking: tuple[str, ...]

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        return dataclasses.asdict(self)


def energy_outlook(
    found: Forecast,
    used: EnergyUse,
    lasts: Endurance,
    legs: Sequence[LoggedLeg],
    home: tuple[float, float] | None,
    *,
    guessed: bool = False,
) -> EnergyOutlook:
    """Days left for plans, and the last day to turn home.

    Args:
      found: forecast of the plan. used: energy used so far. lasts: endurance by `used`.
      legs: legs of the deployment. home: latitude, longitude [degree]; None where unknown.
      guessed: True if no target is known: then the vehicle never arrives.
    """
    missions, lacking = {"as it is": found.request.mission}, []
    for name, changed in _changes(found.request.mission).items():
        try:
            changed.check(found.request.vehicle)
            missions[name] = changed
        except MissionError as error:
            lacking.append(f"what if {name}: {error}")

    def row(what: str, added: float, km_a_day: float | None) -> WhatIf:
        power = max(lasts.power + added, lasts.power / 10.0)
        return WhatIf(
            what=what,
            power=power,
            days=lasts.days * lasts.power / power,
            days_90=lasts.interval(added),
            between=lasts.between(added),
            km_a_day=km_a_day,
        )

    flown = fly_nominal(found.request, list(missions.values()))
    plan = flown[0]
    if isinstance(plan, SimulationUnstable):
        return EnergyOutlook(rows=(), home=None, lacking=(f"what ifs: {plan}",))
    own, speed = plan.rates()
    rows = []
    for name, flight in zip(missions, flown, strict=True):
        if isinstance(flight, SimulationUnstable):
            lacking.append(f"what if {name}: {flight}")
            continue
        power, fast = flight.rates()
        rows.append(row(name, power - own, fast * DAY / KILO))
    takes = {one.name: one.energy / (used.hours * 3600.0) for one in used.terms}
    for name, (consumer, part) in LESS.items():
        if takes.get(consumer, 0.0) > 0.0:
            rows.append(row(name, -part * takes[consumer], None))
    if not takes.get("payload"):
        lacking.append("what if half the samples: the log does not tell the payload's power")
    place, targets, stays = found.request.place, found.targets(), np.inf
    if len(targets) and not guessed:  # [d] until the last target is reached at the speed made good
        longitude, latitude = (float(value) for value in targets[-1])
        there = to_tangent_plane(latitude, longitude, place.latitude_deg, place.longitude_deg)
        times, way = found.ways[0]
        stays = float(np.hypot(*there) / max(np.hypot(*way[-1]), 1.0) * times[-1] / DAY)
    turn = None if home is None else _turn_home(found, lasts, legs, home, speed, stays)
    return EnergyOutlook(rows=tuple(rows), home=turn, lacking=tuple(lacking))


def _changes(mission: Mission) -> dict[str, Mission]:
    """Changed missions, by the name of the change."""

    def changed(**factors: tuple[float, float]) -> Mission:
        segments = []
        for one in mission.segments:
            new = {
                name: getattr(one, name) * factor + added
                for name, (factor, added) in factors.items()
                if getattr(one, name, None) is not None
            }
            segments.append(dataclasses.replace(one, **new) if new else one)
        return dataclasses.replace(mission, segments=tuple(segments))

    more, steep = (DEEPER, 0.0), (1.0, STEEPER_DEG)
    return {
        f"{DEEPER:g} times as deep": changed(max_depth_m=more, surface_after_s=more),
        f"{STEEPER_DEG:.0f} degree steeper": changed(pitch_deg=steep, climb_pitch_deg=steep),
    }


def _turn_home(
    found: Forecast,
    lasts: Endurance,
    legs: Sequence[LoggedLeg],
    home: tuple[float, float],
    speed: float,
    stays: float,
) -> TurnHome:
    """Find, in every draw, the latest turn from which the energy left suffices to reach home.

    The vehicle goes straight home in the mean current of the dives so far. For the error of the
    mean, dives count as independent if they are two days apart.
    """
    place = found.request.place
    start = place.latitude_deg, place.longitude_deg
    there = np.array(to_tangent_plane(*home, *start))
    times, way = found.ways[0]
    goes = way[-1] / times[-1] * DAY  # m a day over ground
    days = np.linspace(0.0, max(lasts.days, 1e-6), STEPS)
    ahead = np.minimum(days, stays)
    to_home = there - ahead[:, None] * goes  # (time, 2)
    away = np.hypot(*to_home.T)
    currents = np.array([one.leg.current for one in legs])
    currents = currents[np.isfinite(currents).all(axis=1)]
    span = (legs[-1].leg.end - legs[0].leg.start) / DAY
    known = min(max(span / OWN_DAYS, 1.0), float(len(currents)))
    rng = np.random.default_rng(0)
    normal = rng.standard_normal((len(lasts.powers), 2))
    drawn = currents.mean(axis=0) + currents.std(axis=0) / np.sqrt(known) * normal
    towards = to_home / np.maximum(away, 1.0)[:, None]
    along = drawn @ towards.T  # (draw, time)
    across = drawn @ np.stack([-towards[:, 1], towards[:, 0]])
    made = along + np.sqrt(np.maximum(speed**2 - across**2, 0.0))
    takes = np.where(made > 0.0, away / np.maximum(made, 1e-9), np.inf) / DAY
    short = days + takes > lasts.days_drawn()[:, None]
    short[:, -1] = True
    last = days[np.maximum(np.argmax(short, axis=1) - 1, 0)]
    return TurnHome(
        away_km=float(away[0] / KILO),
        days=float(np.median(last)),
        safe_days=float(np.quantile(last, SAFE)),
        reached=float(1.0 - short[:, 0].mean()),
    )
