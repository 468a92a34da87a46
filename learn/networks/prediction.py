"""Prediction: what the networks of a run say of one mission."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import Mission, Selection, pieces
from learn.networks.predictor import Ensemble
from twin.navigation.features import channels_of
from twin.records.store_path import StorePath

Floats = NDArray[np.float32]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prediction:
    """Velocities through the water of one mission, body axes forward and starboard."""

    mission: int
    """Row in the store."""
    time: NDArray[np.float64]
    """[s] since its first sample, (time,)"""
    surge: Floats
    """[m/s], (time,), mean over the members"""
    sway: Floats
    """[m/s], (time,)"""
    surge_sd: Floats
    """[m/s], (time,): spread over the members, zero with a single one"""
    sway_sd: Floats
    """[m/s], (time,)"""


def predict_missions(
    networks: Mapping[str, Ensemble], store: str | StorePath, *, split: str, period: float | None
) -> list[Prediction]:
    """Free runs over the missions of a part of a store; a few at a time; errors as `Selection`."""
    channels = [c for e in networks.values() for c in channels_of(e.members[0].features)]
    results = []
    with Selection(store, channels, split=split, period=period) as selection:
        for places in pieces(range(len(selection)), selection.lengths):
            missions = selection.read(places)
            found = {name: ensemble.predict(missions) for name, ensemble in networks.items()}
            results += [
                _prediction(m, {n: f[k] for n, f in found.items()}) for k, m in enumerate(missions)
            ]
    return results


def _prediction(mission: Mission, found: Mapping[str, tuple[Floats, Floats]]) -> Prediction:
    return Prediction(
        mission=mission.index,
        time=mission.period * np.arange(mission.samples, dtype=np.float64),
        surge=found["surge"][0],
        sway=found["sway"][0],
        surge_sd=found["surge"][1],
        sway_sd=found["sway"][1],
    )
