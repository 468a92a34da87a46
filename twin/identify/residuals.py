"""Residuals of dives, model minus log: vertical velocity, pitch and turns, for any other fit.

    noise = noise_of_dives(logs[:6], calibration)
    found = dive_residuals([logs[6]], calibration, choose(["neutral_density", "drag"]), noise)
    found.information()                                   # J^T J and J^T r, to add up over dives

`DepthRates` compares the vertical velocity at every sample under water. If a store has fixes, it
also compares the depth-averaged currents of successive dives: a wrong angle of attack or compass
makes them jump when the vehicle turns.

`dive_residuals` has all residuals that `twin identify` minimises (`twin.identify.comparison`). Here
every parameter may change each residual. For example, drag changes the speed, the pitch at which
moments balance, and the glide about which turns are linearised.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from twin.identify.calibration import Array, Calibration
from twin.identify.comparison import ComparedQuantity, Comparison, ResidualNoise, Residuals
from twin.identify.linear_motion import turning_part
from twin.identify.logged_missions import Log
from twin.identify.pitch import Pitches
from twin.identify.speed import FlightModel, horizontal, motions_of, steady_parts
from twin.identify.translation import ABREAST, Translation
from twin.identify.turning_fit import Turns, biases_beside
from twin.identify.turning_windows import channel_of, groups_of, windows_of
from twin.identify.unknowns import UnknownParameter

LEAST_PAIRS = 6
"""Minimum number of pairs of consecutive dives with fixes for which fixes are used"""
LEAST_CURRENT_CHANGE = 0.01
"""[m/s] Lower bound of the standard deviation of the current's change between dives"""
LONGEST_CORRELATION = 600.0
"""[s] Longest lag over which autocorrelation is summed: half of a long dive"""
FIRST_DEVIATION = 0.01
"""[m/s] Standard deviation of the depth rate in the first fit"""


class DepthRates(Comparison):
    """Residuals "depth_rate" [m/s] of every log and "current" [m/s] of each pair with fixes."""

    def __init__(
        self,
        logs: Sequence[Log],
        nominal: Calibration,
        parameters: tuple[UnknownParameter, ...],
        model: FlightModel = "flight",
        *,
        fixes: bool = False,
    ):
        self.logs, self.model = logs, model
        self.masks = [log.use & steady_parts(log) for log in logs]
        fixed = [log.displacement is not None for log in logs]
        pairs = [k for k in range(1, len(logs)) if logs[k].follows and fixed[k] and fixed[k - 1]]
        self.pairs = pairs if fixes and len(pairs) >= LEAST_PAIRS else []
        longest = round(LONGEST_CORRELATION / logs[0].period)
        # the scatter of the differences has both dives' currents in it
        channels = {
            "depth_rate": ComparedQuantity(unit="m/s", least=1e-12, longest=longest),
            "current": ComparedQuantity(unit="m/s", least=LEAST_CURRENT_CHANGE, samples=1.0),
        }
        dives = {"depth_rate": range(len(logs)), "current": self.pairs}
        super().__init__(nominal, parameters, channels, dives)
        self.weights = {
            "depth_rate": [np.full(int(m.sum()), 1.0 / FIRST_DEVIATION) for m in self.masks],
            "current": [np.full(2, 1.0 / LEAST_CURRENT_CHANGE) for _ in self.pairs],
        }
        self._kept: dict[tuple[tuple[UnknownParameter, ...], bytes], list[Translation]] = {}

    def missed(self, x: Array) -> dict[str, list[Array]]:
        """Residuals, model minus log (see `Comparison`)."""
        return next(self.missed_at([x]))

    def missed_at(self, places: Sequence[Array]) -> Iterator[dict[str, list[Array]]]:
        """Yield `missed` at each place; `ABREAST` places are computed at once."""
        for k in range(0, len(places), ABREAST):
            some = [(x, self.calibration(x)) for x in places[k : k + ABREAST]]
            keys = [self._key(x) for x, _ in some]
            made = {key: calibration for key, (_, calibration) in zip(keys, some, strict=True)}
            new = [key for key in made if key not in self._kept]
            motions = motions_of(self.logs, [made[key] for key in new], self.model)
            flown = self._kept | dict(zip(new, motions, strict=True))
            if k == 0:
                self._kept = {keys[0]: flown[keys[0]]}
            pairs = [(own, flown[key]) for key, (_, own) in zip(keys, some, strict=True)]
            for rates, pair in zip(self._depth_rates(pairs), pairs, strict=True):
                yield {"depth_rate": rates, "current": self._current_changes(*pair)}

    def _key(self, x: Array) -> tuple[tuple[UnknownParameter, ...], bytes]:
        """Cache key of the motions at these offsets, without the compass, which changes none."""
        moving = [not p.name.startswith("heading") for p in self.parameters]
        return self.parameters, x[np.array(moving, bool)].tobytes()

    def _depth_rates(
        self, pairs: Sequence[tuple[Calibration, list[Translation]]]
    ) -> list[list[Array]]:
        """Model minus measured [m/s] at the used samples of each log, for each calibration."""
        out: list[list[Array]] = [[] for _ in pairs]
        for k, (log, mask) in enumerate(zip(self.logs, self.masks, strict=True)):
            sinks = [
                motions[k].sink_rate(log.roll, calibration.true_pitch(log.pitch))
                for calibration, motions in pairs
            ]
            for found, rates in zip(out, log.filtered(np.stack(sinks)), strict=True):
                found.append((rates - log.depth_rate)[mask])
        return out

    def _current_changes(self, calibration: Calibration, motions: list[Translation]) -> list[Array]:
        """North and east change of the depth-averaged current [m/s] of each pair."""
        if not self.pairs:
            return []
        current = np.full((len(self.logs), 2), np.nan)
        for k, (log, motion) in enumerate(zip(self.logs, motions, strict=True)):
            if log.displacement is not None:
                swum = horizontal(log, calibration, motion)
                moved = [log.period * float(np.sum(v)) for v in swum]
                current[k] = (np.array(log.displacement) - moved) / log.duration
        return [current[k] - current[k - 1] for k in self.pairs]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class DiveResiduals:
    """Residuals of dives near a calibration, with their Jacobian."""

    unknowns: tuple[str, ...]
    """Columns of each Jacobian, in spreads: names of the parameters, then of the biases of
    `twin.identify.turning_fit`"""
    channels: Mapping[str, Residuals]
    """"depth_rate" [m/s], and if the log has enough of them "pitch" [rad], "yaw_rate" [rad/s] and
    "roll" [rad]"""

    def information(self) -> tuple[Array, Array]:
        """J^T J, (unknowns, unknowns), and J^T r, (unknowns,), of all residuals divided by their
        standard deviations. For a fit to several dives, add those of the dives."""
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
    """Residuals of dives, model minus log, with standard deviations and Jacobian at a calibration.

    Args:
      logs: one dive, or several of one vehicle and sample period.
      calibration: point at which residuals and slopes are computed.
      parameters: any of `twin.identify.unknowns`, `pitch.PITCHING` and `turning_fit.TURNING`.
      noise: noise of each channel in earlier dives (`noise_of_dives`); channels that it lacks have
        the noise of these dives.

    Raises:
      InputError: the vehicle cannot fly with the calibration.
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
                channels[name] = one._replace(jacobian=jacobian)
    return DiveResiduals(unknowns=unknowns, channels=channels)


def noise_of_dives(logs: Sequence[Log], calibration: Calibration) -> dict[str, ResidualNoise]:
    """Noise of each channel in these dives, by the channel's name."""
    found: dict[str, ResidualNoise] = {}
    for comparison in _comparisons(logs, calibration, ()):
        found |= comparison.reweight(np.zeros(comparison.size))
    return found


def _comparisons(
    logs: Sequence[Log], calibration: Calibration, parameters: tuple[UnknownParameter, ...]
) -> Iterator[Comparison]:
    """Yield the comparisons for which these dives have data."""
    yield DepthRates(logs, calibration, parameters)
    yield Pitches(logs, calibration, parameters)
    windows = windows_of(logs, calibration)
    part = turning_part(calibration.vehicle)
    neutral = 0.0 if part is None else part.neutral
    if windows:
        groups = groups_of(windows, channel_of(calibration), neutral)
        yield Turns(groups, calibration, parameters)
