"""Answer: what a fit says about a vehicle and each of its parameters."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.identify.calibration import Calibration
from twin.identify.unknowns import Parameter

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Estimate:
    """What a fit says about one parameter."""

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
        parameter: Parameter,
        *,
        nominal: float,
        value: float,
        deviation: float,
        determined: bool,
        note: str,
    ) -> Estimate:
        """What a fit says about `parameter`, whose `deviation` is in its spreads."""
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
    estimates: tuple[Estimate, ...]
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

    @property
    def determined(self) -> tuple[str, ...]:
        """Names of the parameters that the log determines."""
        return tuple(e.name for e in self.estimates if e.determined)

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)
