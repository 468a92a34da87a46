"""Surge networks: ensembles trained on simulation, on real dives, and on one after the other.

The networks are small and have one sample a minute (`benchmarks.real_logs.samples`). With ten dives
to train on, three things prevent overfitting: their size, early stopping on a dive of each member's
own, and the mean over members.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.real_logs.samples import (
    AVERAGE,
    GLIDER,
    TWIN,
    Samples,
    averaged,
    level_speed,
    sample,
)  # fmt: skip
from factory.generation.generation import generate
from factory.sampling.recipe import make_recipe
from learn.data.dataset import thinning_step
from learn.data.sequences import Normalisation, NormalisationFit, Sequences
from learn.networks.base import NetworkConfig
from learn.networks.predictor import Predictor
from learn.training.optimiser import TrainingConfig
from learn.training.trainer import Trainer
from twin.errors import InputError
from twin.identify import Calibration, Log, identify, load_calibration, load_logs
from twin.identify.logged_missions import start_vehicle
from twin.navigation.dead_reckoning import Array
from twin.records.attributes import N_SAMPLES, SAMPLE_PERIOD
from twin.records.schema import MISSION, TIME
from twin.records.store import open_store, write_store

INPUTS: dict[str, tuple[str, ...]] = {
    "": tuple(name for name in GLIDER if name != "pump"),
    "twin ": (*(name for name in GLIDER if name != "pump"), *TWIN),
}
"""Inputs of the two kinds of networks, by the beginning of their names"""
ZERO_SHOT = {"": "network, zero shot", "twin ": "network on the twin, zero shot"}
"""Names of the two kinds of networks without real training, in tables"""
NETWORK = NetworkConfig(kind="elman", hidden=16, layers=2, delays=2)
MEMBERS = 3
SIMULATED = TrainingConfig(seconds=0.0, epochs=250, window=32, washin=8, batch=16, validations=25)
REAL = TrainingConfig(seconds=0.0, epochs=120, window=32, washin=8, batch=16, validations=30)
TUNED = dataclasses.replace(REAL, epochs=100, rate=2e-3)
"""Training on real dives after simulation: fewer, smaller steps keep what the simulation taught"""
HOURS = 24.0
"""[h] Duration of all simulated missions together"""
PERIOD = 5.0
"""[s] Sample period of the simulated missions, that of an imported Seaglider"""
SPREAD = {
    "vehicle.k_d0": "loguniform(0.6, 1.7)",
    "vehicle.k_d": "loguniform(0.6, 1.7)",
    "vehicle.k_alpha": "loguniform(0.7, 1.4)",
}
"""Distributions of the simulated vehicles' coefficients, as factors on their files"""
VEHICLES = ("slocum-200", "seaglider")
RECIPE_SEED = 7
"""Seed of the simulated missions, to which the benchmark's seed is added"""
PHASES = 2
"""Number of shifted series of samples from each simulated mission"""
LEAST_SAMPLES = 8
"""Fewest samples of a simulated mission for training"""
TOGETHER = 8
"""Number of simulated missions that one process prepares at once"""
HELD_OUT = 5
"""Every fifth simulated mission is for validation"""


def simulate(folder: Path, *, seed: int = 0, workers: int | None = None) -> list[Path]:
    """Simulate missions that networks are trained on before real dives; one store for each of
    `VEHICLES`."""
    stores = []
    for vehicle in VEHICLES:
        recipe = make_recipe(
            preset="field", hours=HOURS / len(VEHICLES), seed=RECIPE_SEED + seed, vehicle=vehicle,
            sensors="field-no-dvl", changes=SPREAD, engine="lanes",
        )  # fmt: skip
        whole, thinned = (folder / f"simulated-{vehicle}{end}.zarr" for end in ("", "-thinned"))
        generate(recipe, whole, workers=workers, overwrite=True, history="learn benchmark real")
        stores.append(thin_store(whole, thinned, PERIOD))
    return stores


def thin_store(store: Path, out: Path, period: float) -> Path:
    """Write every n-th sample of a store to another one.

    Raises:
      StoreError: see `learn.data.dataset.thinning_step`.
    """
    dataset = open_store(store).load()
    time = dataset[TIME].values.astype(float)
    step = thinning_step(float(np.median(np.diff(time))), period, store)
    thin = dataset.isel({TIME: slice(None, None, step)})
    lengths = (dataset[N_SAMPLES].values + step - 1) // step
    thin = thin.assign({N_SAMPLES: (dataset[N_SAMPLES].dims, lengths, dataset[N_SAMPLES].attrs)})
    thin.attrs[SAMPLE_PERIOD] = period
    for variable in thin.variables.values():
        variable.encoding.clear()
    write_store(thin, out, overwrite=True)
    return out


def missions_together(store: Path) -> list[list[int]]:
    """All missions of a store, `TOGETHER` at a time."""
    with open_store(store) as dataset:
        count = int(dataset.sizes[MISSION])
    return [list(range(k, min(k + TOGETHER, count))) for k in range(0, count, TOGETHER)]


def simulated_samples(store: Path, missions: Sequence[int]) -> list[Samples]:
    """Samples of simulated missions, in the form of real dives.

    Inputs by the twin come from a nominal vehicle with trim and drag identified on each mission, as
    for real dives.
    """
    names = ("true_surge", "true_sway", "true_heave", "true_roll", "true_pitch")
    with open_store(store) as dataset:
        truth = {name: dataset[name].values for name in names}
    nominal = load_calibration(start_vehicle(store))
    found = []
    for log in load_logs(store, list(missions)):
        length = len(log.depth)
        surge, sway, heave, roll, pitch = (truth[name][log.index, :length] for name in names)
        level = level_speed(surge, sway, heave, np.deg2rad(roll), np.deg2rad(pitch))
        try:
            own = identify([log], nominal, parameters=("neutral_density", "drag"), fixes=False)
        except InputError:
            continue  # too short, or always turning: the vehicle cannot be identified
        clock = log.period * np.arange(length)
        for phase in range(PHASES):
            times = np.arange(AVERAGE * (0.5 + phase / PHASES), clock[-1] - 0.5 * AVERAGE, AVERAGE)
            times = times[np.interp(times, clock, log.depth) > 5.0]
            if times.size >= LEAST_SAMPLES:
                wanted = averaged(level, log.period, times)
                found.append(sample(log, own.calibration, times, wanted))
    return found


Pretrained = dict[str, list[Predictor]]
"""Members of an ensemble, by the kind of inputs"""


def pretrain(dives: Sequence[Samples], kind: str, member: int, seed: int = 0) -> Predictor:
    """Train one network on simulation; validation missions stop the training."""
    missions = sorted({dive.row for dive in dives})
    held = set(missions[member % HELD_OUT :: HELD_OUT])
    train = [dive for dive in dives if dive.row not in held]
    rest = [dive for dive in dives if dive.row in held]
    return fit_network(train, rest, INPUTS[kind], SIMULATED, seed=MEMBERS * seed + member)


def fit_network(
    train: Sequence[Samples],
    validation: Sequence[Samples],
    inputs: Sequence[str],
    config: TrainingConfig,
    *,
    seed: int,
    start: Predictor | None = None,
    network: NetworkConfig = NETWORK,
) -> Predictor:
    """Train one network, from the weights and scales of `start` if given; levels may be NaN."""
    if start is None:
        fitted = NormalisationFit(inputs, "surge")
        for dive in train:
            fitted.add(dive.matrix(inputs).astype(np.float32), dive.level.astype(np.float32))
        scales = fitted.result()
    else:
        scales = start.normalisation
    trained = Trainer(
        network,
        dataclasses.replace(config, seed=seed),
        _sequences(train, scales),
        _sequences(validation, scales),
        target_scale=scales.target_scale,
        start=None if start is None else start.network.state_dict(),
    ).run()
    return Predictor(trained.network, scales)


def _sequences(dives: Sequence[Samples], scales: Normalisation) -> Sequences:
    mean, scale = np.float32(scales.target_mean), np.float32(scales.target_scale)
    return Sequences(
        inputs=[scales.inputs(dive.matrix(scales.features).astype(np.float32)) for dive in dives],
        targets=[
            (np.nan_to_num(dive.level, nan=mean).astype(np.float32) - mean) / scale
            for dive in dives
        ],
        weights=[np.isfinite(dive.level).astype(np.float32) for dive in dives],
    )


def predict(predictor: Predictor, dives: Sequence[Samples]) -> list[Array]:
    """Predict the surge [m/s] of each dive."""
    scales = predictor.normalisation
    runs = predictor.network.run_missions(_sequences(dives, scales).inputs)
    return [scales.target_scale * run.astype(float) + scales.target_mean for run in runs]


def level_of(log: Log, calibration: Calibration, pretrained: Pretrained, kind: str) -> Array:
    """Predict the horizontal speed [m/s] along the heading, (time,), without real training.

    The prediction is the members' mean, once a minute, interpolated in between.
    """
    clock = log.period * np.arange(len(log.depth), dtype=np.float64)
    times = np.arange(0.5 * AVERAGE, max(clock[-1], AVERAGE), AVERAGE)
    dive = sample(log, calibration, times, np.zeros_like(times))
    runs = [predict(one, [dive])[0] for one in pretrained[kind]]
    return np.interp(clock, times, np.mean(runs, axis=0))


def fit_member(
    train: Sequence[Samples],
    kind: str,
    member: int,
    config: TrainingConfig,
    *,
    seed: int,
    start: Predictor | None = None,
) -> Predictor:
    """Train one member on real dives; a dive of its own stops the training early."""
    held = (seed + 1 + member * len(train) // MEMBERS) % len(train)
    rest = [dive for k, dive in enumerate(train) if k != held]
    return fit_network(
        rest, [train[held]], INPUTS[kind], config, seed=100 * seed + member, start=start
    )


def mean_of(predictors: Sequence[Predictor], dives: Sequence[Samples]) -> list[Array]:
    """Predict the surge [m/s] of each dive, as the members' mean."""
    runs = [predict(one, dives) for one in predictors]
    return [np.mean([run[k] for run in runs], axis=0) for k in range(len(dives))]


def predict_dive(
    train: Sequence[Samples], tests: Sequence[Samples], pretrained: Pretrained, seed: int
) -> dict[str, list[Array]]:
    """Predict the surge [m/s] of test dives by every kind of network, as members' means."""
    found: dict[str, list[Array]] = {}
    for kind in INPUTS:
        first = pretrained[kind]
        found[f"{kind}zero shot"] = mean_of(first, tests)
        for name, config, starts in (("real", REAL, [None] * MEMBERS), ("sim real", TUNED, first)):
            members = [
                fit_member(train, kind, k, config, seed=seed, start=start)
                for k, start in enumerate(starts)
            ]
            found[f"{kind}{name}"] = mean_of(members, tests)
    return found
