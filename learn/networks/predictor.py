"""Predictor: a trained network with its features and normalisation, from missions to m/s.

Also here: ensembles of predictors, and predictions of whole missions.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from learn.data.dataset import MissionSequence, Selection, pieces
from learn.data.sequences import Normalisation
from learn.files import SEAL, check_seal, read_json, write_sealed
from learn.networks.familiarity import HELD_TO, Familiarity, Tether
from learn.networks.plain import PlainAverages, load_weights
from learn.seams import NETWORKS
from twin.errors import InputError, StoreError
from twin.extras import require
from twin.navigation.features import channels_of, feature
from twin.navigation.flight_filter import FlightSpread, FlightStart
from twin.navigation.settings import ADAPTED
from twin.records.storage.store_path import StorePath
from twin.records.storage.whole import whole_file

if TYPE_CHECKING:
    from learn.networks.base import Network

Floats = NDArray[np.float32]

FORMAT = 2
"""Version of the files that `save` writes."""
UNSEALED = 1
"""Version of files without checksums, as releases up to 0.1.0 wrote."""
WEIGHTS = "weights"
"""Entry of the description: size and SHA-256 of the file of weights."""
PLACE = "class"
"""Entry of the description: `module:Class` of a network type that is not shipped."""


@dataclasses.dataclass(frozen=True)
class Predictor:
    """Network for one velocity, with its normalisation."""

    network: Any
    """A `Network`, or without torch `PlainAverages`, whose interface for arrays of numpy is one"""
    normalisation: Normalisation

    @property
    def target(self) -> str:
        """`surge` or `sway`."""
        return self.normalisation.target

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.normalisation.features

    def predict(self, missions: Sequence[MissionSequence]) -> list[Floats]:
        """[m/s] Predicted velocity of each mission, (time,), in one run from launch to end.

        Raises:
          StoreError: a mission's sample period is not the training's.
        """
        for mission in missions:
            self._check_period(mission)
        matrices = [
            self.normalisation.inputs(mission.features(self.features)) for mission in missions
        ]
        scale, mean = self.normalisation.target_scale, self.normalisation.target_mean
        return [scale * values + mean for values in self.network.run_missions(matrices)]

    def _check_period(self, mission: MissionSequence) -> None:
        trained = self.network.period
        if trained and not math.isclose(mission.period, trained, rel_tol=1e-3):
            raise StoreError(
                f"mission {mission.index} has a sample every {mission.period:g} s, and the network "
                f"was trained with one every {trained:g} s: load the missions with "
                f"period={trained:g}"
            )

    def step(self, values: Floats, state: Floats) -> tuple[float, Floats]:
        """[m/s] Velocity for one sample of features (features,), and the state after it."""
        y, state = self.network.step_sample(self.normalisation.inputs(values), state)
        return self.normalisation.target_scale * y + self.normalisation.target_mean, state

    def save(self, stem: Path) -> None:
        """Write `stem`.safetensors (weights) and `stem`.json (the rest, with the SHA-256 of both).

        The JSON file is written last: if it exists, the network is complete.

        Raises:
          WriteError: the disk refuses.
        """
        from safetensors.torch import save

        state = {k: v.detach().cpu().contiguous() for k, v in self.network.state_dict().items()}
        data = save(state)
        with whole_file(stem.with_suffix(".safetensors")) as unnamed:
            unnamed.write_bytes(data)
        description = {
            "format": FORMAT,
            "network": dataclasses.asdict(self.network.config),
            "normalisation": dataclasses.asdict(self.normalisation),
            WEIGHTS: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()},
        }
        if place := NETWORKS.place(self.network.config.kind):
            description[PLACE] = place
        write_sealed(stem.with_suffix(".json"), description)


def load_predictor(stem: Path, *, period: float | None = None, plain: bool = False) -> Predictor:
    """Load a predictor that `Predictor.save` wrote.

    Args:
      period: [s] another sample period than the training's, for networks `ema` that were trained
        with several.
      plain: load a network `ema` without torch.

    Raises:
      StoreError: a file is missing, damaged or of another format, or the two files do not match.
      InputError: the description names a feature or network unknown to this version.
    """
    weights_path, description_path = stem.with_suffix(".safetensors"), stem.with_suffix(".json")
    for path in (description_path, weights_path):
        if not path.is_file():
            raise StoreError(f"no network at {path}; train one with `learn fit`")
    remedy = "bring it back from a copy, or train it again"
    description = read_json(description_path, remedy)
    version = description.get("format")
    if version not in (UNSEALED, FORMAT):
        raise StoreError(
            f"{description_path} has format {version}, this program reads {UNSEALED} and {FORMAT}; "
            "train it again"
        )
    weights = weights_path.read_bytes()
    if version == FORMAT or SEAL in description:
        check_seal(description_path, description, remedy)
        if hashlib.sha256(weights).hexdigest() != description[WEIGHTS]["sha256"]:
            raise StoreError(
                f"{weights_path} is damaged: its SHA-256 is not the one in "
                f"{description_path.name}; {remedy}"
            )
    try:
        kind = description["network"]["kind"]
        if kind not in NETWORKS:
            raise InputError(
                f"{description_path}: {NETWORKS.unknown(str(kind), description.get(PLACE, ''))}"
            )
        shape = description["network"] | ({} if period is None else {"period": period})
        fields: dict[str, Any] = description["normalisation"]
        for name in ("features", "mean", "scale"):
            fields[name] = tuple(fields[name])
        normalisation = Normalisation(**fields)
        network = _built(shape, weights_path, plain=plain)
    except (InputError, StoreError):
        raise
    except (KeyError, TypeError, RuntimeError) as error:
        message = " ".join(str(error).split())
        raise StoreError(f"{weights_path} does not fit {description_path}: {message}") from error
    for name in ("mean", "scale"):
        values = getattr(normalisation, name)
        if len(values) != len(normalisation.features):
            raise StoreError(
                f"{description_path} is damaged: normalisation.{name} has {len(values)} numbers "
                f"for {len(normalisation.features)} features; bring it back from a copy, or train "
                "it again"
            )
        if not all(isinstance(v, float | int) and math.isfinite(v) for v in values):
            raise StoreError(f"{description_path} is damaged: normalisation.{name} is not finite")
    for name in normalisation.features:
        feature(name)  # raises if the feature is unknown
    if shape["inputs"] != len(normalisation.features):
        raise StoreError(
            f"{description_path} names {len(normalisation.features)} features for a network with "
            f"{shape['inputs']} inputs"
        )
    return Predictor(network, normalisation)


def _built(shape: Mapping[str, Any], weights: Path, *, plain: bool) -> Network | PlainAverages:
    """Network of a shape (fields of `NetworkConfig`) with the weights of a file."""
    if plain and shape["kind"] == "ema":
        return PlainAverages(shape, load_weights(weights))
    require("torch", extra="learn", purpose=f"a network of type {shape['kind']}")
    from safetensors import SafetensorError
    from safetensors.torch import load

    from learn.networks.base import NetworkConfig, build_network

    network = build_network(NetworkConfig(**shape))
    try:
        network.load_state_dict(load(weights.read_bytes()))
    except SafetensorError as error:
        raise TypeError(str(error)) from error
    return network


@dataclasses.dataclass(frozen=True, kw_only=True)
class Adapted:
    """Adaptation of networks to one vehicle, by a second flight filter.

    The second filter starts from constants fitted to earlier dives. In steady glides its surge is
    mixed with the networks', weighted by both variances; elsewhere the networks' surge is used. The
    networks read the first filter, as in their training.
    """

    start: FlightStart
    """Start of the second filter"""
    deviation: float
    """[m/s] Standard deviation of the networks' surge on missions of other vehicles"""

    def weight(self, steady: Any, filter_sd: Any) -> Any:
        """Weight of the filter's surge, from `adapted_steady` and `adapted_surge_sd` [m/s]."""
        own = self.deviation**2
        return steady * own / (own + filter_sd**2)

    def interval(self, before: float, steady: Any, filter_sd: Any) -> Any:
        """[m/s] Half-width of the surge's interval after adaptation: in steady glides, mixing with
        the filter's surge reduces the lasting error."""
        weight = self.weight(steady, filter_sd)
        lasting = weight * self.deviation**2
        return np.sqrt(np.maximum(before**2 - lasting, weight * filter_sd**2))


@dataclasses.dataclass(frozen=True)
class Ensemble:
    """Several predictors of one velocity, whose standard deviation measures the mean's error."""

    members: tuple[Predictor, ...]
    adapted: Adapted | None = None
    """Adaptation to a vehicle's first dives"""
    familiar: Familiarity | None = None
    """Statistics of the training's hulls; None if the networks do not read the flight filter"""
    interval: float = 0.0
    """[m/s] Half-width of the error interval, see `ErrorModel.surge_interval`; 0: unknown"""
    tether: Tether | None = None
    """Bias limit of surge, for a type of vehicle that was not in the training"""
    spread: FlightSpread | None = None
    """Prior standard deviations of hulls about the vehicle file, for the networks' flight filter"""

    def __post_init__(self) -> None:
        if not self.members:
            raise InputError("an ensemble needs at least one network")
        targets = {member.target for member in self.members}
        if len(targets) > 1:
            raise InputError(f"an ensemble predicts one velocity, not {' and '.join(targets)}")

    @property
    def target(self) -> str:
        """`surge` or `sway`."""
        return self.members[0].target

    def predict(self, missions: Sequence[MissionSequence]) -> list[tuple[Floats, Floats]]:
        """[m/s] Mean and standard deviation over the members, each (time,), for each mission.

        A single member gives standard deviation zero, which does not mean certainty.
        """
        runs = [member.predict(missions) for member in self.members]
        results = []
        for mission in range(len(missions)):
            stack = np.stack([run[mission] for run in runs])
            mean = self._corrected(stack.mean(0), missions[mission])
            results.append((mean, stack.std(0, ddof=1 if len(stack) > 1 else 0)))
        return results

    @property
    def start(self) -> FlightStart | None:
        """Start of the second flight filter; None without adaptation."""
        return None if self.adapted is None else self.adapted.start

    def _corrected(self, mean: Floats, mission: MissionSequence) -> Floats:
        """Apply the bias limit to the mean, and mix in the second filter's surge if an adapted
        vehicle glides steadily."""
        if self.target != "surge":
            return mean
        if self.tether is not None:
            nearest = mission.signals[HELD_TO[self.adapted is not None]]
            mean = self.tether.held(mean, nearest, mission.period).astype(np.float32)
        if self.adapted is None:
            return mean
        filtered, steady, sd = (mission.signals[name] for name in ADAPTED)
        weight = self.adapted.weight(steady, sd)
        return (mean + weight * (filtered - mean)).astype(np.float32)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prediction:
    """Velocities through the water of one mission, body axes forward and starboard."""

    mission: int
    """Row in the store."""
    time: NDArray[np.float64]
    """[s] Time since the mission's first sample, (time,)"""
    surge: Floats
    """[m/s] Mean surge over the members, (time,)"""
    sway: Floats
    """[m/s] Mean sway over the members, (time,)"""
    surge_sd: Floats
    """[m/s] Standard deviation of surge over the members, (time,); zero with a single member"""
    sway_sd: Floats
    """[m/s] Standard deviation of sway over the members, (time,); zero with a single member"""


def predict_missions(
    networks: Mapping[str, Ensemble], store: str | StorePath, *, split: str, period: float | None
) -> list[Prediction]:
    """Predict the missions of a store's split, a few at a time; errors as in `Selection`."""
    channels = [c for e in networks.values() for c in channels_of(e.members[0].features)]
    results = []
    surge = networks["surge"]
    with Selection(
        store, channels, split=split, period=period, start=surge.start, spread=surge.spread
    ) as selection:
        for places in pieces(range(len(selection)), selection.lengths):
            missions = selection.read(places)
            found = {name: ensemble.predict(missions) for name, ensemble in networks.items()}
            results += [
                prediction(m, {n: f[k] for n, f in found.items()}) for k, m in enumerate(missions)
            ]
    return results


def prediction(mission: MissionSequence, found: Mapping[str, tuple[Floats, Floats]]) -> Prediction:
    """Prediction of a mission from means and standard deviations over members, by velocity."""
    return Prediction(
        mission=mission.index,
        time=mission.period * np.arange(mission.samples, dtype=np.float64),
        surge=found["surge"][0],
        sway=found["sway"][0],
        surge_sd=found["surge"][1],
        sway_sd=found["sway"][1],
    )
