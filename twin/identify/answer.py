"""Answer: result of a fit for a vehicle and each of its parameters.

`confused` names parameters that a log determines together but not apart. `provenance_of` is the
record of the identification in the vehicle file.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import Comparison, ResidualNoise, rms
from twin.identify.logged_missions import Record
from twin.identify.pitch import PITCHING
from twin.identify.unknowns import NAMES, UnknownParameter
from twin.records.logged import start_times
from twin.records.reader import MissionStore
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
    """Standard deviation in `unit`, given the model; NaN where not estimated"""
    spread: float
    """Standard deviation known beforehand, in `unit`"""
    determined: bool
    note: str = ""
    """Reason why the value was kept at nominal, or a remark that it lies at its bound"""

    @classmethod
    def of(
        cls,
        parameter: UnknownParameter,
        nominal: Calibration,
        calibration: Calibration,
        deviation: float,
        determined: bool,
        note: str = "",
    ) -> IdentifiedParameter:
        """Make the estimate of `parameter` by a calibration; `deviation` is in its spreads.

        The fit began at `nominal`.
        """
        began, value = float(parameter.get(nominal)), float(parameter.get(calibration))
        return cls(
            name=parameter.name,
            unit=parameter.unit,
            meaning=parameter.meaning,
            nominal=began,
            value=value,
            deviation=parameter.deviation(value, deviation),
            spread=parameter.deviation(began, 1.0),
            determined=determined,
            note=note,
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Identification:
    """Calibrated vehicle with the estimates of its parameters and the residuals of the fit."""

    calibration: Calibration
    nominal: Calibration
    model: str
    estimates: tuple[IdentifiedParameter, ...]
    correlation: Array
    """Correlation matrix of the determined parameters, in the order of `determined`"""
    depth_rate_rmse: float
    """[m/s] RMS residual of the depth rate at the fitted samples, without weights"""
    nominal_depth_rate_rmse: float
    """[m/s] RMS residual of the depth rate of the nominal vehicle"""
    robust_deviation: float
    """[m/s] Standard deviation of the depth rate's residuals, outliers weighted down"""
    correlation_time: float
    """[s] Integrated autocorrelation time of the depth rate's residuals"""
    samples: int
    hours: float
    """[h] Duration of the fitted samples"""
    missions: int
    current_change: float | None
    """[m/s] Median change of the depth-averaged current between dives; None without fixes"""
    nominal_current_change: float | None
    """[m/s] Median change of the current by the nominal vehicle; None without fixes"""
    powered: tuple[int, ...] = ()
    """Rows of the dives under a thruster, which were left out"""
    stalled: tuple[int, ...] = ()
    """Rows of the dives with a phase that is far slower than the model, as a stalled glider is"""

    @property
    def determined(self) -> tuple[str, ...]:
        """Names of the parameters that the log determines."""
        return tuple(e.name for e in self.estimates if e.determined)

    def _repr_html_(self) -> str:
        """Table of the estimates and chart of their distances from nominal, for notebooks."""
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

    def with_estimates(
        self, calibration: Calibration, estimates: Sequence[IdentifiedParameter], covariance: Array
    ) -> Identification:
        """Return the identification with the estimates of a later fit, which replace earlier ones.

        Their `covariance` is in spreads. Correlations with the other estimates are 0.
        """
        own, before = [e.name for e in estimates], self.determined
        every = {e.name: e for e in (*self.estimates, *estimates)}
        known = [e.name for e in every.values() if e.determined]
        whole = np.eye(len(known))
        for names, matrix in ((before, self.correlation), (own, correlated(covariance))):
            mine = [k for k, name in enumerate(known) if name in names]
            mine = [k for k in mine if names is own or known[k] not in own]
            places = [names.index(known[k]) for k in mine]
            whole[np.ix_(mine, mine)] = matrix[np.ix_(places, places)]
        return dataclasses.replace(
            self, calibration=calibration, estimates=tuple(every.values()), correlation=whole
        )


def correlated(covariance: Array) -> Array:
    """Correlation matrix of a covariance."""
    deviation = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(deviation, deviation))


def answer_of(
    problem: Comparison,
    x: Array,
    logs: Sequence[Record],
    wanted: Sequence[UnknownParameter],
    notes: Mapping[str, str],
    before: Mapping[str, float],
    covariance: Array,
    said: Sequence[tuple[bool, str]],
    noise: ResidualNoise,
    model: str,
) -> Identification:
    """Identification by a fit of depth rates that ended at `x`.

    Args:
      logs: fitted dives.
      notes: reasons for parameters that were left at nominal.
      before: standard deviations of these parameters in a fit with them, in spreads.
      covariance: covariance of the fitted parameters, in spreads.
      said: for each fitted parameter, True where the logs determine it, and a note.
      noise: noise of the depth rate.
    """
    calibration, nominal = problem.calibration(x), problem.nominal
    deviation = np.sqrt(np.diag(covariance))
    names = [p.name for p in problem.parameters]
    estimates = []
    for parameter in wanted:
        name, source = parameter.name, nominal
        off, sure = before.get(name, np.nan), (False, notes.get(name, ""))
        if name in names:
            k, source = names.index(name), calibration
            off, sure = deviation[k], said[k]
        estimates.append(IdentifiedParameter.of(parameter, nominal, source, float(off), *sure))
    told = [k for k, (determined, _) in enumerate(said) if determined]
    rates, changes = _unweighted(problem, x)
    rates0, changes0 = _unweighted(problem, np.zeros_like(x))
    samples, period = len(rates), logs[0].period
    return Identification(
        calibration=calibration,
        nominal=nominal,
        model=model,
        estimates=tuple(estimates),
        correlation=correlated(covariance)[np.ix_(told, told)],
        depth_rate_rmse=rms(rates),
        nominal_depth_rate_rmse=rms(rates0),
        robust_deviation=noise.deviation,
        correlation_time=noise.samples * period,
        samples=samples,
        hours=samples * period / 3600.0,
        missions=len(logs),
        current_change=changes,
        nominal_current_change=changes0,
    )


def _unweighted(problem: Comparison, x: Array) -> tuple[Array, float | None]:
    """Residuals of the depth rate and median change of the current [m/s]; None without fixes."""
    missed = problem.missed(x)
    changes = np.reshape(missed.get("current", ()), (-1, 2))
    median = float(np.median(np.hypot(*changes.T))) if len(changes) else None
    return np.concatenate(missed["depth_rate"]), median


DRIVEN = "driven"
"""Name of the model of propelled vehicles: `twin.identify.driven_flights`"""
CLOSE = 0.95
"""[1] Smallest correlation, as printed, of two estimates that are reported as not separated"""


def confused(found: Identification) -> list[str]:
    """Sentence for each group of estimates that the log does not separate, with advice."""
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
"""Significant digits of recorded numbers; a standard deviation is known to two."""


def provenance_of(
    found: Identification, store: str | Path, rows: Sequence[int] | None = None
) -> dict[str, Any]:
    """Record of a fit, its store and its estimates, JSON-able, without paths.

    The dates are those of the first and the last of `rows`, by default of the whole store.
    """

    def short(value: float) -> float | None:
        return float(f"{value:.{DIGITS}g}") if value == value else None

    errors = found.calibration.errors
    return {
        "program": f"glider-twin {__version__}",
        "started_from": found.nominal.vehicle.name,
        "store": Path(store).name,
        "store_sha256": store_hash(store),
        "dates": _dates(store, rows),
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
        "flight": errors and {name: [short(x) for x in row] for name, row in errors.items()},
    }


def _dates(store: str | Path, rows: Sequence[int] | None) -> list[str]:
    """First and last day, UTC, on which these rows begin; empty where the store has no times."""
    with MissionStore(store) as found:
        starts = start_times(found)
    starts = starts if rows is None else starts[list(rows)]
    days = starts[np.isfinite(starts)].astype("datetime64[s]").astype("datetime64[D]")
    return sorted({str(days.min()), str(days.max())}) if len(days) else []
