"""Dive residuals: what one dive says of a vehicle, for a fit that goes on from dive to dive.

    noise = noise_of_dives(logs[:6], calibration)
    said = dive_residuals([logs[6]], calibration, choose(["neutral_density", "drag"]), noise)
    said.information()                                    # of the unknowns, and the step's slope

The residuals are those that `twin identify` minimises (`twin.identify.comparison`): depth rate,
pitch and turn. Here every parameter may move each of them: drag the speed, and with it the pitch
at which the moments balance and the glide that turns are linearised about.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.identify.calibration import Calibration
from twin.identify.comparison import Comparison, ResidualNoise, Residuals
from twin.identify.depth_rates import DepthRates
from twin.identify.lateral import turning_part
from twin.identify.logged_missions import Log
from twin.identify.pitch import Pitches
from twin.identify.turning_fit import Turns, biases_beside, channel_of
from twin.identify.turning_windows import groups_of, windows_of
from twin.identify.unknowns import UnknownParameter

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DiveResiduals:
    """What dives say of a vehicle near a calibration."""

    unknowns: tuple[str, ...]
    """Names of the parameters, then of the biases of `twin.identify.turning_fit`: the columns of
    each Jacobian, in spreads"""
    channels: Mapping[str, Residuals]
    """"depth_rate" [m/s], and where the log has enough of them "pitch" [rad], "yaw_rate" [rad/s]
    and "roll" [rad]"""

    def information(self) -> tuple[Array, Array]:
        """J^T J and J^T r of all residuals over their deviations, (unknowns, unknowns) and
        (unknowns,): sums over dives are those of a fit to all of them."""
        size = len(self.unknowns)
        matrix, slope = np.zeros((size, size)), np.zeros(size)
        for one in self.channels.values():
            weighted = one.jacobian / one.deviation[:, None]
            matrix += weighted.T @ weighted
            slope += weighted.T @ (one.values / one.deviation)
        return matrix, slope


def dive_residuals(
    logs: Sequence[Log],
    calibration: Calibration,
    parameters: Sequence[UnknownParameter],
    noise: Mapping[str, ResidualNoise] | None = None,
) -> DiveResiduals:
    """Residuals of dives, model less log, their deviations and their Jacobian at a calibration.

    Args:
      logs: one dive, or several of one vehicle and sample period.
      calibration: where the residuals are taken, and what each parameter's offsets count from.
      parameters: of `twin.identify.unknowns`, `pitch.PITCHING` and `turning.TURNING`.
      noise: how far each channel is off, as earlier dives had it (`noise_of_dives`); a channel
        that it lacks is judged by these dives alone.

    Raises:
      InputError: the calibration does not fly.
    """
    names = tuple(p.name for p in parameters)
    unknowns = (*names, *biases_beside(names))
    channels: dict[str, Residuals] = {}
    for comparison in _comparisons(logs, calibration, tuple(parameters)):
        x = np.zeros(comparison.size)
        comparison.reweight(x, noise)
        own = [unknowns.index(name) for name in (*names, *comparison.biases)]
        for name, one in comparison.residuals(x).items():
            if len(one.values):
                jacobian = np.zeros((len(one.values), len(unknowns)))
                jacobian[:, own] = one.jacobian
                channels[name] = dataclasses.replace(one, jacobian=jacobian)
    return DiveResiduals(unknowns=unknowns, channels=channels)


def noise_of_dives(logs: Sequence[Log], calibration: Calibration) -> dict[str, ResidualNoise]:
    """How far each channel of these dives is off, and over how many residuals."""
    found: dict[str, ResidualNoise] = {}
    for comparison in _comparisons(logs, calibration, ()):
        found |= comparison.reweight(np.zeros(comparison.size))
    return found


def _comparisons(
    logs: Sequence[Log], calibration: Calibration, parameters: tuple[UnknownParameter, ...]
) -> Iterator[Comparison]:
    """Those that these dives have something for."""
    yield DepthRates(logs, calibration, parameters)
    yield Pitches(logs, calibration, parameters)
    windows = windows_of(logs, calibration)
    part = turning_part(calibration.vehicle)
    neutral = 0.0 if part is None else part.neutral
    if windows:
        groups = groups_of(windows, channel_of(calibration), neutral)
        yield Turns(groups, calibration, parameters)
