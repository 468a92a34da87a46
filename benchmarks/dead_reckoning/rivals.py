"""Rivals: methods that predict surge and sway of the test missions.

Your own method is a file with

    LABELS = "none"        # data to adapt on in a test mission's first dives: `predictions.LABELS`
    TRAINED = True         # False: the method reads no training store, and none is made
    def predict(train, test, seed, seconds):
        "Paths of the training and of the test store -> predictions by dives adapted on."

that returns {0: Dataset, ...}, see `benchmarks.dead_reckoning.predictions`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import inspect
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.dead_reckoning.predictions import (
    ALL_DIVES,
    INTERVAL,
    LABELS,
    VELOCITIES,
    Predicted,
    Rival,
    table,
)
from benchmarks.dead_reckoning.tiers import DIVES
from twin.errors import InputError, StoreError, unknown_name


def baseline(name: str) -> Rival:
    """Rival that learns nothing: an estimator of `twin.seams.VELOCITY_ESTIMATORS`."""

    def predict(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
        from learn.data.dataset import Selection
        from twin.records.reader import MissionStore
        from twin.seams import VELOCITY_ESTIMATORS

        with MissionStore(test) as reader:
            vehicle = reader.vehicle
        kind, rows = VELOCITY_ESTIMATORS[name], {}
        with Selection(test, kind.needs(vehicle)) as selection:
            runner = kind(vehicle, selection.period)
            for mission in selection.each():
                said = runner.batch(mission.signals)
                rows[mission.index] = {v: getattr(said, v) for v in VELOCITIES}
        return {0: table(rows)}

    return Rival(predict)


def made_once(folder: Path, stores: Any, **settings: Any) -> Any:
    """Open a run of `learn fit` on stores; train if the run is missing."""
    from learn.api import fit
    from learn.run import open_run

    with contextlib.suppress(InputError, StoreError):  # the run is missing or not finished
        return open_run(folder)
    print(f"{folder} ...", file=sys.stderr)
    return fit(stores, folder=folder, resume=True, members=1, workers=2, **settings)


def trained(train: Path, seed: int, seconds: float, network: str, test: Path | None = None) -> Any:
    """Open the run of `learn fit` beside the training store; methods share the run.

    Args:
      test: store of logs that gives the inputs and the time between samples.
    """
    from twin.records.reader import MissionStore

    alike: dict[str, Any] = {}
    if test is not None:
        with MissionStore(test) as reader:
            alike = {"inputs": "glider", "period": reader.period} if reader.logged else {}
    folder = train.parent / "runs" / f"{network}-{seed}-{seconds:g}"
    return made_once(folder, train, seed=seed, seconds=seconds, network=network, **alike)


def flight(name: str, labels: str = "none") -> Rival:
    """Rival that is a model of `benchmarks.dead_reckoning.flight_rivals`."""

    def predict(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
        from benchmarks.dead_reckoning import flight_rivals

        found: Predicted = getattr(flight_rivals, name)(train, test, seed, seconds)
        return found

    return Rival(predict, labels)


def network(kind: str) -> Rival:
    """Rival that is networks of `learn fit`."""

    def predict(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
        run = trained(train, seed, seconds, kind, test)
        return {0: table({one.mission: vars(one) for one in run.predict(test)})}

    return Rival(predict, trained=True)


def adapted(kind: str, labels: str, whole: bool = False) -> Rival:
    """Rival that is networks of `learn fit`, adapted to each test mission by `adapt_each`."""

    def predict(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
        from twin.records.reader import MissionStore

        with MissionStore(test) as reader:
            if reader.logged:
                raise InputError(
                    "networks adapt through the flight filter, which reads rates and accelerations "
                    "that these logs lack: it is no rival of this tier"
                )
        return adapt_each(trained(train, seed, seconds, kind), test, labels, whole)

    return Rival(predict, ALL_DIVES if whole else labels, trained=True)


def adapt_each(run: Any, test: Path, labels: str, whole: bool = False) -> Predicted:
    """Predict by a run that `learn adapt` fits to each test mission's first dives.

    If a mission has too few dives, the run is not adapted.

    Args:
      labels: `dvl` also uses the Doppler log in water lock.
      whole: fit to all dives of the mission, later ones too, which no vehicle has under way.
    """
    from learn.adaptation import FIXES, LOG_CHANNELS, dive_spans
    from learn.data.dataset import Selection
    from learn.evaluation.deviation import surge_interval
    from learn.networks.familiarity import ended
    from learn.networks.predictor import Adapted
    from twin.navigation.features import channels_of
    from twin.navigation.flight_filter import FlightFilter
    from twin.navigation.flight_fit import adapt_flight, steady_glides
    from twin.navigation.settings import ESTIMATED, estimate_adapted
    from twin.records.reader import MissionStore

    with MissionStore(test) as reader:
        networks, model = run.networks(reader.vehicle), run.error_model()
    familiar = networks["surge"].familiar
    wanted = [*ESTIMATED, *channels_of(run.features), "measured_heading", *FIXES, *LOG_CHANNELS]
    said: dict[int, dict[int, Any]] = {dives: {} for dives in (DIVES[:1] if whole else DIVES)}
    with Selection(test, wanted, spread=run.spread) as selection:
        vehicle = selection.vehicle
        flight = FlightFilter(vehicle, selection.period, run.spread)
        for mission in selection.each():
            spans = dive_spans(mission, logged=False)
            log = labels == "dvl"
            outside = familiar.outside(np.array(ended(flight, mission)))[0]
            glides = steady_glides(flight, mission.signals, spans, log=log)
            for dives in said:
                first, start = glides if whole else glides[:dives], None
                with contextlib.suppress(InputError):
                    start = adapt_flight(flight, first, log=log).start if first else None
                one, adapted = [mission], None
                if start is not None:
                    second = estimate_adapted(
                        mission.signals, vehicle, mission.period, start, run.spread
                    )
                    one = [dataclasses.replace(mission, signals=mission.signals | second)]
                    adapted = Adapted(start=start, deviation=model.surge_sd)
                said[dives][mission.index] = {
                    name: dataclasses.replace(ensemble, adapted=adapted).predict(one)[0][0]
                    for name, ensemble in networks.items()
                } | {INTERVAL: surge_interval(model, one[0], adapted, outside)}
    return {dives: table(rows) for dives, rows in said.items()}


RIVALS: Mapping[str, Rival] = {
    "constant angle": baseline("pitch_plus_alpha"),
    "steady flight": baseline("steady_flight"),
    "EKF": baseline("ekf"),
    "gliderflight": flight("gliderflight"),
    "gliderflight by all dives": flight("gliderflight_of_all", ALL_DIVES),
    "identified twin": flight("identified", ALL_DIVES),
    "flight filter": baseline("flight_filter"),
    "elman": network("elman"),
    "gru": network("gru"),
    "tcn": network("tcn"),
    "ema": network("ema"),
    "ema adapted": adapted("ema", "none"),
    "ema adapted by DVL": adapted("ema", "dvl"),
    "ema by all dives": adapted("ema", "none", whole=True),
}
"""Rivals by name. `elman` is the paper's network; later work has `gru` and `tcn`; `ema` is the
default here. Rivals with ALL_DIVES cannot work under way: their fit needs the scored dives too."""


def chosen(names: str, own: Path | None) -> dict[str, Rival]:
    """Rivals of a list of names and of a file; without either, all of RIVALS.

    Raises:
      InputError: no such method, or a file without `predict`.
    """
    found = {}
    for name in names.split(",") if names else (RIVALS if own is None else ()):
        if name not in RIVALS:
            raise InputError(unknown_name("method", name, RIVALS))
        found[name] = RIVALS[name]
    if own is not None:
        found[own.stem] = _own(own)
    return found


def _own(file: Path) -> Rival:
    """Load the rival of a file."""
    if file.stem in RIVALS:
        raise InputError(f"--method {file}: {file.stem} is the name of a rival; rename the file")
    if file.suffix != ".py" or not file.is_file():
        raise InputError(f"--method {file}: there is no such Python file")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"{file} cannot be run: {type(error).__name__}: {error}") from error
    predict, labels = getattr(module, "predict", None), getattr(module, "LABELS", "none")
    try:
        inspect.signature(predict).bind(file, file, 0, 1.0)
    except (TypeError, ValueError):
        raise InputError(f"{file} has no function predict(train, test, seed, seconds)") from None
    if labels not in LABELS:
        raise InputError(f"{file}: {unknown_name('LABELS', labels, LABELS)}")
    return Rival(predict, labels, bool(getattr(module, "TRAINED", True)))
