"""Velocities of a store by the shipped networks, with missing sensors replaced."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Self

import numpy as np

from learn.data.dataset import MissionSequence, Selection
from learn.evaluation.evaluation import evaluate
from learn.evaluation.score import FLOOR, NETWORK
from learn.networks.predictor import Prediction, prediction
from learn.shipped import shipped_run
from learn.shipped.inputs import substituted
from twin.navigation.estimators.base import baselines
from twin.navigation.features import channels_of
from twin.navigation.settings import ESTIMATED, estimate, sources
from twin.numbers import Array
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath

ERROR = "dr_velocity_percent_mean"
"""Figure that decides between methods: track error with true attitude, in % of the path"""


def predict_shipped(store: str | StorePath, *, split: str = "all") -> list[Prediction]:
    """Predict surge and sway over a store's missions by the shipped networks.

    Raises:
      InputError: no shipped networks suit the store.
      StoreError: as in `Selection`.
    """
    with ShippedNetworks(store) as shipped:
        return list(shipped.predictions(split))


class ShippedNetworks:
    """Shipped networks that suit a store, and the store's missions; a context manager."""

    def __init__(self, store: str | StorePath) -> None:
        """Open store and networks; raises as `shipped_run` and `MissionStore` do."""
        self._reader, self._store = MissionStore(store), store
        try:
            self._present = set(map(str, self._reader.dataset.data_vars))
            self.vehicle, self.period = self._reader.vehicle, self._reader.period
            self.run, self.absent = shipped_run(self.vehicle, self.period, self._present)
            self.networks = self.run.networks(self.vehicle)
        except BaseException:
            self._reader.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    def missions(self, split: str = "all") -> Iterator[MissionSequence]:
        """Missions of a split, with all inputs of the networks."""
        channels = channels_of(self.run.features)
        wanted = [c for c in sources(channels) if c not in self.absent]
        with Selection(
            self._store, [*wanted, *(["measured_heading"] if self.absent else [])], split=split
        ) as selection:
            for one in selection.each():
                signals = dict(one.signals)
                if self.absent:
                    signals = substituted(signals, one.period, self.absent)
                if set(channels) & set(ESTIMATED):
                    signals |= estimate(
                        signals, self.vehicle, one.period, mission=one.index,
                        spread=self.run.spread,
                    )  # fmt: skip
                yield dataclasses.replace(one, signals=signals)

    def predictions(self, split: str = "all") -> Iterator[Prediction]:
        """Predicted velocities of each mission of a split."""
        for one in self.missions(split):
            found = {name: every.predict([one])[0] for name, every in self.networks.items()}
            yield prediction(one, found)

    def errors(self, split: str = "all") -> dict[str, float]:
        """Track error [%] with true attitude of networks and baselines by name; empty without the
        truth, or if a sensor is missing."""
        if self._reader.logged or self.absent:
            return {}
        found = evaluate(self.networks, self._store, split=split).methods
        known = {name: method.figures[ERROR] for name, method in found.items() if name != FLOOR}
        return {name: value for name, value in known.items() if value is not None}

    def velocities(
        self, method: str, split: str = "all"
    ) -> Iterator[tuple[int, Array, Array, Array]]:
        """Mission, time [s], surge and sway [m/s] by NETWORK or a baseline, for each mission."""
        if method == NETWORK:
            for one in self.predictions(split):
                yield one.mission, one.time, one.surge.astype(float), one.sway.astype(float)
            return
        runner = baselines()[method](self.vehicle, self.period)
        with Selection(self._store, runner.needs(self.vehicle), split=split) as selection:
            for mission in selection.each():
                said = runner.batch(mission.signals)
                assert said.surge is not None
                assert said.sway is not None
                time = self.period * np.arange(mission.samples, dtype=np.float64)
                yield mission.index, time, np.asarray(said.surge), np.asarray(said.sway)
