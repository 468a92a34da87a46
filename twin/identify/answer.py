"""Answer: a fit's result for a vehicle and each of its parameters.

It names the parameters that a log determines together but not apart, and holds what a vehicle file
records about the identification that made it.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from twin.identify.calibration import Array, Calibration
from twin.identify.pitch import PITCHING
from twin.identify.unknowns import NAMES, UnknownParameter
from twin.records.storage.checksums import store_hash
from twin.version import __version__


@dataclasses.dataclass(frozen=True, kw_only=True)
class IdentifiedParameter:
    """Estimate of one parameter by a fit."""

    name: str
    unit: str
    meaning: str
    nominal: float
    value: float
    deviation: float
    """Standard deviation, given the model; NaN where not estimated."""
    spread: float
    """Standard deviation known beforehand, in `unit`."""
    determined: bool
    note: str = ""
    """Why it was kept at nominal, or that it lies at its bound."""

    @classmethod
    def of(
        cls,
        parameter: UnknownParameter,
        *,
        nominal: float,
        value: float,
        deviation: float,
        determined: bool,
        note: str = "",
    ) -> IdentifiedParameter:
        """Estimate of `parameter`, whose `deviation` is in its spreads."""
        return cls(
            name=parameter.name,
            unit=parameter.unit,
            meaning=parameter.meaning,
            nominal=nominal,
            value=value,
            deviation=parameter.deviation(value, deviation),
            spread=parameter.deviation(nominal, 1.0),
            determined=determined,
            note=note,
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Identification:
    """A calibrated vehicle, how sure its parameters are, and what is left unexplained."""

    calibration: Calibration
    nominal: Calibration
    model: str
    estimates: tuple[IdentifiedParameter, ...]
    correlation: Array
    """Of the determined parameters, in the order of `determined`."""
    depth_rate_rmse: float
    """[m/s] at the samples that were fitted, without weights."""
    nominal_depth_rate_rmse: float
    """[m/s] before."""
    robust_deviation: float
    """[m/s] of depth rate, outliers weighted down."""
    correlation_time: float
    """[s] integrated autocorrelation time of the residuals."""
    samples: int
    hours: float
    """[h] of these samples"""
    missions: int
    current_change: float | None
    """[m/s] median change of the depth-averaged current between missions; None without fixes."""
    nominal_current_change: float | None
    """[m/s] before."""
    powered: tuple[int, ...] = ()
    """Missions that a thruster drove: left out."""

    @property
    def determined(self) -> tuple[str, ...]:
        """Names of the parameters that the log determines."""
        return tuple(e.name for e in self.estimates if e.determined)

    def _repr_html_(self) -> str:
        """A table, and how far each estimate is from nominal in its spread, for notebooks."""
        from twin.notebook import card, spans

        rows: dict[str, object] = {
            e.name: f"{e.value:.4g} +- {e.deviation:.2g} {e.unit}"
            + ("" if e.determined else " (nominal stands)")
            for e in self.estimates
        }
        rows["depth rate"] = f"{1e2 * self.depth_rate_rmse:.3g} cm/s RMS, {self.missions} missions"
        moved = [
            (e.name, (e.value - e.nominal) / e.spread, e.deviation / e.spread)
            for e in self.estimates
            if e.determined and e.spread
        ]
        return card(
            f"Identification, {self.model} model", rows, spans(moved, "from nominal, in spreads")
        )

    def __getitem__(self, name: str) -> IdentifiedParameter:
        return next(e for e in self.estimates if e.name == name)


DRIVEN = "driven"
"""Model of a vehicle under a propeller: `twin.identify.driven_flights`"""
CLOSE = 0.95
"""Correlation, as printed, from which on two estimates are said not to be told apart"""


def confused(found: Identification) -> list[str]:
    """One sentence for each group of estimates that the log does not tell apart, and what would."""
    names, left = found.determined, set(range(len(found.determined)))
    close = abs(found.correlation).round(2) >= CLOSE
    texts = []
    while left:
        group: set[int] = set()
        edge = {min(left)}
        while edge:
            group |= edge
            edge = {j for i in edge for j in left if close[i, j]} - group
        left -= group
        if len(group) == 1:
            continue
        mine = [names[i] for i in sorted(group)]
        most = max(abs(found.correlation[i, j]) for i in group for j in group if i != j)
        knowable = [name for name in mine if name in NAMES]
        if found.model == DRIVEN:
            advice = "turns, dives and other speeds, and changes between them, would separate them"
        elif set(mine) & {p.name for p in PITCHING}:
            advice = (
                "dives at other pitches with the same pump, and at other pump volumes, would "
                "separate them"
            )
        elif "thermal_expansion" in mine:
            advice = "dives in water of other temperatures would separate them"
        else:
            advice = "dives at other pitches, pump volumes and depths would separate them"
        if knowable:
            advice += f"; or give one that you know, such as --known {knowable[0]}=VALUE"
        texts.append(
            f"{', '.join(mine[:-1])} and {mine[-1]} could not be separated (correlation up to "
            f"{most:.2f}): together they fit the log, each alone is less sure; {advice}"
        )
    return texts


DIGITS = 6
"""Significant digits: a deviation is not known to more than two."""


def provenance_of(found: Identification, store: str | Path) -> dict[str, Any]:
    """Record of a fit, its store and its estimates; JSON-able, no times, no paths."""

    def short(value: float) -> float | None:
        return float(f"{value:.{DIGITS}g}") if value == value else None

    return {
        "program": f"glider-twin {__version__}",
        "started_from": found.nominal.vehicle.name,
        "store": Path(store).name,
        "store_sha256": store_hash(store),
        "model": found.model,
        "missions": found.missions,
        "samples": found.samples,
        "depth_rate_rmse_m_s": short(found.depth_rate_rmse),
        "correlation_time_s": short(found.correlation_time),
        "parameters": {
            e.name: {
                "value": short(e.value),
                "deviation": short(e.deviation) if e.determined else None,
                "unit": e.unit,
                "determined": e.determined,
            }
            for e in found.estimates
        },
        "correlation": {
            "parameters": list(found.determined),
            "matrix": [[short(value) for value in row] for row in found.correlation.tolist()],
        },
    }
