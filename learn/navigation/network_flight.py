"""Network flight: a trained run as an estimator of `twin flight --estimator network:RUN`."""

from __future__ import annotations

from typing import Self

import numpy as np

from learn.networks.prediction import Prediction
from learn.runs.run import Run, open_run
from twin.errors import InputError, StoreError
from twin.flight.estimators import FlightEstimator
from twin.identify.calibration import Calibration
from twin.identify.logged import Log
from twin.identify.translation import Motion
from twin.records.reader import MissionStore
from twin.records.store_path import StorePath


class NetworkFlight(FlightEstimator):
    """Surge and sway by the networks of a run; heave is solved for from the depth rate."""

    kind = "network"
    summary = "surge and sway by the networks of a run of `learn fit`: network:RUN"

    def __init__(self, run: Run):
        self.run = run
        self._predictions: dict[StorePath, dict[int, Prediction]] = {}

    @classmethod
    def open(cls, argument: str) -> Self:
        """The estimator of the run in the folder `argument`.

        Raises:
          InputError: no folder is given.
          StoreError: there is no run in it.
        """
        if not argument:
            raise InputError("the estimator network needs a run: network:runs/NAME")
        return cls(open_run(argument))

    def motion(
        self,
        store: MissionStore,
        log: Log,
        calibration: Calibration,
        start: tuple[float, float, float],
    ) -> Motion:
        """See `FlightEstimator.motion`; between the samples of a coarser run, linear."""
        if store.path not in self._predictions:
            found = self.run.predict(store.path)
            self._predictions[store.path] = {one.mission: one for one in found}
        known = self._predictions[store.path]
        if log.index not in known:
            raise StoreError(
                f"run {self.run.name} says nothing of mission {log.index} of {store.path}; leave "
                "it out with --missions"
            )
        one = known[log.index]
        time = log.period * np.arange(len(log.depth))
        surge, sway = (np.interp(time, one.time, values) for values in (one.surge, one.sway))
        return Motion(surge=surge, sway=sway, heave=np.full(len(time), np.nan))
