"""Depth rates: what a flight model sinks with beside what a log sank with, and what fixes say.

Compared are the depth rate at every sample under water and, where a store has fixes, the
depth-averaged current of each mission with that of the mission before, which a wrong angle of
attack or compass makes jump as the vehicle turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.identify.calibration import Calibration
from twin.identify.comparison import ComparedQuantity, Comparison
from twin.identify.logged_missions import Log
from twin.identify.speed import FlightModel, horizontal, motions_of, steady_parts
from twin.identify.translation import ABREAST, Translation
from twin.identify.unknowns import UnknownParameter

Array = NDArray[np.float64]

LEAST_PAIRS = 6
"""Pairs of missions with fixes below which fixes are not used."""
LEAST_CURRENT_CHANGE = 0.01
"""[m/s] between missions that no estimate of its spread falls below."""
LONGEST_CORRELATION = 600.0
"""[s] up to which autocorrelation is summed: half of a long dive."""
FIRST_DEVIATION = 0.01
"""[m/s] of depth rate that a search starts with"""


class DepthRates(Comparison):
    """Channels "depth_rate" [m/s], of every log, and "current" [m/s], of each pair with fixes."""

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
        self.pairs = [
            k
            for k in range(1, len(logs))
            if logs[k].follows
            and logs[k].displacement is not None
            and logs[k - 1].displacement is not None
        ]
        if not fixes or len(self.pairs) < LEAST_PAIRS:
            self.pairs = []
        longest = round(LONGEST_CORRELATION / logs[0].period)
        # Differences of one series: each current enters two of them, hence twice the variance.
        channels = {
            "depth_rate": ComparedQuantity(unit="m/s", least=1e-12, longest=longest),
            "current": ComparedQuantity(unit="m/s", least=LEAST_CURRENT_CHANGE, samples=2.0),
        }
        dives = {"depth_rate": range(len(logs)), "current": self.pairs}
        super().__init__(nominal, parameters, channels, dives)
        self.weights = {
            "depth_rate": [np.full(int(m.sum()), 1.0 / FIRST_DEVIATION) for m in self.masks],
            "current": [np.full(2, 1.0 / LEAST_CURRENT_CHANGE) for _ in self.pairs],
        }
        self._kept: dict[tuple[tuple[UnknownParameter, ...], bytes], list[Translation]] = {}

    def missed(self, x: Array) -> dict[str, list[Array]]:
        """Model less log."""
        return next(self.missed_at([x]))

    def missed_at(self, places: Sequence[Array]) -> Iterator[dict[str, list[Array]]]:
        """`missed` at each place; `ABREAST` of them fly side by side."""
        for k in range(0, len(places), ABREAST):
            some = [(x, self.calibration(x)) for x in places[k : k + ABREAST]]
            keys = [self._key(x) for x, _ in some]
            new = {
                key: calibration
                for key, (_, calibration) in zip(keys, some, strict=True)
                if key not in self._kept
            }
            motions = motions_of(self.logs, list(new.values()), self.model)
            flown = self._kept | dict(zip(new, motions, strict=True))
            if k == 0:
                self._kept = {keys[0]: flown[keys[0]]}
            pairs = [
                (calibration, flown[key]) for key, (_, calibration) in zip(keys, some, strict=True)
            ]
            for rates, pair in zip(self._depth_rates(pairs), pairs, strict=True):
                yield {"depth_rate": rates, "current": self._current_changes(*pair)}

    def _key(self, x: Array) -> tuple[tuple[UnknownParameter, ...], bytes]:
        """Of the motions; the compass changes none, only where it leads."""
        moving = [not p.name.startswith("heading") for p in self.parameters]
        return self.parameters, x[np.array(moving, bool)].tobytes()

    def _depth_rates(
        self, pairs: Sequence[tuple[Calibration, list[Translation]]]
    ) -> list[list[Array]]:
        """Model less measured [m/s] at the used samples of each log, by each calibration."""
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
                moved = [
                    log.period * float(np.sum(v)) for v in horizontal(log, calibration, motion)
                ]
                current[k] = (np.array(log.displacement) - moved) / log.duration
        return [current[k] - current[k - 1] for k in self.pairs]
