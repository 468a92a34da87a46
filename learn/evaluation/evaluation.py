"""Evaluation: score networks, `floor` (true velocities) and baselines on a store's missions."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from learn.data.dataset import SPEED, Selection
from learn.data.labels import LabelConfig
from learn.evaluation.judged_tracks import DvlComparison, compare, summarise
from learn.evaluation.log_score import score_logs
from learn.evaluation.score import (
    DVL,
    FLOOR,
    GPS_CHANNELS,
    NAVIGATION_CHANNELS,
    NETWORK,
    TRUTH_CHANNELS,
    MissionScore,
    ReferenceVelocity,
    network_estimate,
    score_mission,
    summarise_scores,
    visible,
)
from twin.errors import StoreError, UnknownName
from twin.navigation.estimators.base import Estimate, VelocityEstimator, check_estimate
from twin.navigation.estimators.base import baselines as all_baselines
from twin.navigation.features import channels_of
from twin.records.reader import MissionStore
from twin.records.storage.store_path import StorePath
from twin.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from learn.networks.predictor import Ensemble

GROUP = 16
"""Number of missions that are in memory and predicted together, as one group."""


@dataclasses.dataclass(frozen=True)
class Method:
    """Scores of one method that estimates velocities."""

    name: str
    scores: tuple[MissionScore, ...]

    @property
    def figures(self) -> dict[str, Any]:
        """Summary over missions, see `learn.evaluation.score.summarise_scores`."""
        return summarise_scores(self.scores)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Scores of all methods on the same missions."""

    store: str
    split: str
    methods: Mapping[str, Method]
    """Method by name: NETWORK, FLOOR and the baselines whose channels the store has."""
    missing: Mapping[str, str]
    """Reason for each missing baseline, by name."""
    provenance: Mapping[str, Any]
    """Attributes of the store."""
    propelled: bool = False
    """True if the store's vehicle has a propeller."""
    against_dvl: tuple[DvlComparison, ...] = ()
    """Comparison with the Doppler log, for each mission in which it had lock."""
    counts: Mapping[str, int] = dataclasses.field(default_factory=dict)
    """Numbers of scored rows and samples in a store of logs, see `learn.evaluation.log_score`."""

    def to_json(self) -> dict[str, Any]:
        """Numbers of the networks, with entries `floor` and `baselines`."""
        empty = summarise_scores(())
        figures = {name: method.figures for name, method in self.methods.items() if name != NETWORK}
        return {
            "store": self.store,
            "split": self.split,
            **self.methods[NETWORK].figures,
            **({"counts": dict(self.counts)} if self.counts else {}),
            **({"against_dvl": summarise(self.against_dvl)} if self.against_dvl else {}),
            FLOOR: figures.pop(FLOOR),
            "baselines": {name: figures.get(name, empty) for name in all_baselines()},
        }


Watch = Callable[[ReferenceVelocity, Mapping[str, Estimate]], None]
"""Function called with each mission and every method's estimate."""


def evaluate(
    networks: Mapping[str, Ensemble],
    store: str | StorePath,
    *,
    split: str = "test",
    baselines: Sequence[str] | None = None,
    limit: int | None = None,
    watch: Watch | None = None,
    period: float | None = None,
    labels: LabelConfig | None = None,
    also: Mapping[str, Mapping[str, Ensemble]] = MappingProxyType({}),
) -> Evaluation:
    """Evaluate networks, true velocities (`floor`) and baselines on missions of a store.

    Args:
      networks: ensembles `surge` and `sway`.
      store: path of the store.
      split: train, validation, test or all.
      baselines: names of the baselines to run; None runs all.
      limit: most missions, from the first on; no effect on logs.
      watch: called with every mission and its estimates, for tracks, figures and progress.
      period: [s] sample period of the networks; samples of a shorter period are thinned.
      labels: settings that take velocities from a Doppler log. These are compared with networks and
        are the reference of real logs. None: only tracks are compared with the Doppler log, and
        the truth is the reference of real logs.
      also: further networks by method, unseen by `watch`, that read the same simulated channels.

    Real logs are scored by `learn.evaluation.log_score`, and the watch receives a `LogReference`.

    Raises:
      InputError: a baseline is unknown, or returns something other than an `Estimate`.
      StoreError: the store is missing, empty or without splits; a channel is missing or not finite
        (named).
    """
    known = all_baselines()
    names = tuple(known if baselines is None else baselines)
    for name in names:
        if name not in known:
            raise UnknownName("baseline", name, known)
    with MissionStore(store) as reader:
        present, attributes = set(map(str, reader.dataset.data_vars)), dict(reader.attributes)
        vehicle, logged = reader.vehicle, reader.logged
    missing = {name: why for name in names if (why := _unusable(known[name], vehicle, present))}
    kinds = {name: known[name] for name in names if name not in missing}
    wanted = [
        *NAVIGATION_CHANNELS,
        *TRUTH_CHANNELS,
        *(c for ensemble in networks.values() for c in channels_of(ensemble.members[0].features)),
        *(c for kind in kinds.values() for c in kind.needs(vehicle)),
        *(c for c in GPS_CHANNELS if c in present),
    ]
    if labels is not None and (logged or DVL in kinds):
        wanted += labels.channels()
    if logged:
        # logs may lack navigation channels, such as depth if their rows are not dives
        wanted = [c for c in wanted if c in present or c not in NAVIGATION_CHANNELS]
        wanted += [c for c in (SPEED,) if c in present]
        if split != "all":
            with Selection(store, (), split=split):  # raises if there is no split
                pass
    scores: dict[str, list[MissionScore]] = {n: [] for n in (NETWORK, FLOOR, *kinds, *also)}
    beside_log: list[DvlComparison] = []
    surge = networks["surge"]
    some: dict[str, Any] = {} if logged else {"split": split, "limit": limit}
    with Selection(
        store, wanted, period=period, start=surge.start, spread=surge.spread, **some
    ) as selection:
        runners = {name: kind(vehicle, selection.period) for name, kind in kinds.items()}
        if logged:
            judged = score_logs(
                selection.groups(GROUP),
                lambda mission: split in ("all", mission.split),
                networks=networks,
                baselines=runners,
                vehicle=vehicle,
                labels=labels or LabelConfig(),
                watch=watch,  # type: ignore[arg-type]  # of a log it sees a LogReference
            )
            return Evaluation(
                store=str(store),
                split=split,
                methods={name: Method(name, rows) for name, rows in judged.scores.items()},
                missing=missing,
                provenance=attributes,
                counts=judged.counts,
            )
        for group in selection.groups(GROUP):
            predictions, *others = (
                {name: ensemble.predict(group) for name, ensemble in every.items()}
                for every in (networks, *also.values())
            )
            for k, mission in enumerate(group):
                try:
                    reference = ReferenceVelocity.of(mission)
                    estimates = {
                        NETWORK: network_estimate({n: p[k] for n, p in predictions.items()}),
                        FLOOR: Estimate(surge=reference.surge, sway=reference.sway),
                    }
                    seen = visible(mission)
                    for name, runner in runners.items():
                        guess = runner.batch(seen)
                        estimates[name] = check_estimate(name, guess, mission.samples)
                except StoreError as error:
                    raise StoreError(f"store {store}, mission {mission.index}: {error}") from error
                for name, estimate in estimates.items():
                    scores[name].append(score_mission(reference, estimate))
                for name, found in zip(also, others, strict=True):
                    own = network_estimate({n: p[k] for n, p in found.items()})
                    scores[name].append(score_mission(reference, own))
                if DVL in estimates:
                    beside = compare(reference, estimates[NETWORK], estimates[DVL], labels)
                    beside_log += [] if beside is None else [beside]
                if watch is not None:
                    watch(reference, estimates)
    return Evaluation(
        store=str(store),
        split=split,
        methods={name: Method(name, tuple(rows)) for name, rows in scores.items()},
        missing=missing,
        provenance=attributes,
        propelled=vehicle.steered("speed") is not None,
        against_dvl=tuple(beside_log),
    )


def pooled(each: Sequence[Evaluation]) -> Evaluation:
    """Pool evaluations of the same networks on simulated stores, over all their missions.

    A baseline that one store lacks is left out: its numbers would belong to other missions.
    """
    if len(each) == 1:
        return each[0]
    shared = [name for name in each[0].methods if all(name in one.methods for one in each)]
    return dataclasses.replace(
        each[0],
        store=", ".join(one.store for one in each),
        methods={
            name: Method(name, tuple(score for one in each for score in one.methods[name].scores))
            for name in shared
        },
        missing={name: f"store {one.store}: {why}" for one in each for name, why in
                 one.missing.items()},
        propelled=all(one.propelled for one in each),
        against_dvl=tuple(found for one in each for found in one.against_dvl),
    )  # fmt: skip


def _unusable(kind: type[VelocityEstimator], vehicle: Vehicle, present: set[str]) -> str:
    """Reason why a baseline cannot run with this vehicle and these channels; empty if it can."""
    why = kind.unsuited(vehicle)
    gone = [channel for channel in kind.needs(vehicle) if channel not in present]
    if not why and gone:
        why = f"the store has no channel {gone[0]}"
    return why
