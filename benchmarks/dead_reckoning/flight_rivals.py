"""Flight rivals: flight models fitted to the depth rate, as glider groups fit them.

`gliderflight`: the steady balance of forces with volume and drag fitted to the depth rate
(Merckelbach et al. 2010 and 2019). On simulated missions the fit uses the first dives, and other
coefficients of the vehicle's file. On logs (`gliderflight by all dives`) it uses all dives of a
deployment, and published coefficients. `identified twin`: the vehicle that `twin identify` fits to
depth rate and fixes of a deployment's log. No model is fitted to a velocity.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.dead_reckoning.predictions import Predicted, table
from benchmarks.dead_reckoning.tiers import DIVES
from benchmarks.real_logs.folds import Fitted, FoldJob, fit_fold, thinned
from benchmarks.real_logs.public import AREA, SteadyModel, fit_balance
from learn.adaptation import dive_spans
from learn.data.dataset import Selection
from twin.errors import InputError
from twin.identify import Log, density_of, load_logs, motion_of
from twin.navigation.dead_reckoning import Array, depth_rate
from twin.records.reader import MissionStore
from twin.vehicle.vehicle import Vehicle

SMOOTHED_S = 10.0
"""[s] Averaging time of the depth rate"""
CHANNELS = (
    "measured_depth", "measured_pitch", "measured_pump", "measured_density",
    "measured_gps_north", "measured_gps_east",
)  # fmt: skip


class SimulatedDives(NamedTuple):
    """Dives of a simulated mission, as `benchmarks.real_logs.public` fits them."""

    period: float
    depth: Array
    depth_rate: Array
    pump: Array
    use: bool = True


def gliderflight(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
    """Predict surge by the balance of forces; sway is 0."""
    with MissionStore(test) as reader:
        if reader.logged:
            raise InputError("on logs it is the rival `gliderflight by all dives`")
        vehicle = reader.vehicle
    said: dict[int, dict[int, dict[str, Array]]] = {dives: {} for dives in DIVES}
    nominal = balance_of(vehicle)
    with Selection(test, CHANNELS) as selection:
        for mission in selection.each():
            signals, period = mission.signals, mission.period
            pitch, density = np.deg2rad(signals["measured_pitch"]), signals["measured_density"]
            rate = depth_rate(signals["measured_depth"], period)
            wide = max(round(SMOOTHED_S / period), 1)
            rate = np.convolve(rate, np.ones(wide) / wide, "same")
            whole = SimulatedDives(
                period, signals["measured_depth"], rate, signals["measured_pump"]
            )
            spans = dive_spans(mission, logged=False)
            for dives in DIVES:
                model, first = nominal, spans[:dives]
                if first:
                    parts = [
                        SimulatedDives(period, whole.depth[s], whole.depth_rate[s], whole.pump[s])
                        for s in first
                    ]
                    model = fit_balance(
                        parts, [pitch[s] for s in first], [density[s] for s in first], nominal
                    )
                level = model.bridged(whole, pitch, density).level
                level = np.where(whole.depth < 1.0, 0.0, level)
                surge = level * np.cos(pitch) - rate * np.sin(pitch)
                said[dives][mission.index] = {"surge": surge, "sway": np.zeros_like(surge)}
    return {dives: table(rows) for dives, rows in said.items()}


def gliderflight_of_all(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
    """Predict surge in logs by a balance with published coefficients, fitted to all dives."""
    return _logged(test, lambda fitted, log: _balance_surge(fitted.steady, fitted, log))


def balance_of(vehicle: Vehicle) -> SteadyModel:
    """Balance of forces with the coefficients of a vehicle's file, not fitted."""
    law, per = vehicle.flow_frame, 0.5 * vehicle.reference_density * AREA
    return SteadyModel(
        mass=vehicle.mass, volume=vehicle.neutral_volume, drag=law.drag[0] / per,
        lift=law.lift[1] / per, induced=law.drag[1] / per,
    )  # fmt: skip


def identified(train: Path, test: Path, seed: int, seconds: float) -> Predicted:
    """Predict surge and sway by the twin identified from the test dives' depth rate and fixes."""

    def motion(fitted: Fitted, log: Log) -> tuple[Array, Array]:
        found = motion_of(log, fitted.calibration)
        return found.surge, found.sway

    return _logged(test, motion)


def _balance_surge(model: SteadyModel, fitted: Fitted, log: Log) -> tuple[Array, Array]:
    through = model.bridged(log, log.pitch, density_of(log, fitted.calibration))
    surge = through.level * np.cos(log.pitch) - log.depth_rate * np.sin(log.pitch)
    return surge, np.zeros_like(surge)


def _logged(test: Path, velocities: Callable[[Fitted, Log], tuple[Array, Array]]) -> Predicted:
    """Predict every dive by models that are fitted to all dives."""
    with MissionStore(test) as reader:
        if not reader.logged:
            raise InputError("what is fitted to all dives needs logs: a rival of tier public alone")
    logs = load_logs(test)
    rows = [log.index for log in logs]
    fitted = fit_fold(FoldJob(store=test, block=tuple(rows), train=tuple(thinned(rows))))
    said = {
        log.index: dict(zip(("surge", "sway"), velocities(fitted, log), strict=True))
        for log in logs
    }
    return {0: table(said)}
