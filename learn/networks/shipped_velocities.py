"""Velocities of a store by the shipped networks, with missing sensors replaced."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Self

import numpy as np

from learn.data.dataset import MissionSequence, Selection
from learn.networks.predictor import Prediction, prediction
from learn.shipped import shipped_run
from learn.shipped.inputs import substituted
from twin.navigation.estimators.base import baselines
from twin.navigation.features import channels_of
from twin.navigation.settings import ESTIMATED, estimate, sources
from twin.numbers import Array
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.records.storage.whole import whole_file


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

    @property
    def judged(self) -> bool:
        """True if the store has the truth and all sensors, to judge networks and baselines."""
        return not self._reader.logged and not self.absent

    def baseline(self, method: str, split: str = "all") -> Iterator[Velocities]:
        """Velocities of each mission of a split by a baseline."""
        runner = baselines()[method](self.vehicle, self.period)
        with Selection(self._store, runner.needs(self.vehicle), split=split) as selection:
            for mission in selection.each():
                said = runner.batch(mission.signals)
                assert said.surge is not None
                assert said.sway is not None
                time = self.period * np.arange(mission.samples, dtype=np.float64)
                yield mission.index, time, np.asarray(said.surge), np.asarray(said.sway)


Velocities = tuple[int, Array, Array, Array]
"""Mission, time [s], surge and sway [m/s], (time,) each"""
LINE = "%d,%.3f,%.5f,%.5f"
"""Mission, time [s], surge and sway [m/s] in a file of velocities"""


def write_velocities(path: Path, found: Sequence[Velocities]) -> None:
    """Write velocities of missions as CSV.

    Raises:
      WriteError: the disk refuses.
    """
    rows = [np.stack([np.full(len(time), k), time, *both], 1) for k, time, *both in found]
    with whole_file(path) as place:
        np.savetxt(place, np.concatenate(rows), LINE, header="mission,time,surge,sway", comments="")
