"""Simulated logs of vehicles whose parameters the tests know."""

import numpy as np

from twin.mission import Mission
from twin.mission.segments import SawTooth
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.records.mission_dataset import dataset_of
from twin.records.store import write_store
from twin.sensors import SensorSuite
from twin.water.density import DensityProfile

PERIOD = 2.0
THERMOCLINE = DensityProfile(
    depth=np.array([0.0, 20.0, 60.0, 400.0]), values=np.array([1022.0, 1022.5, 1025.5, 1027.5])
)
SUITE = SensorSuite.preset("field-no-dvl")


def changed(vehicle, *, drag=1.0, lift_ratio=1.0, neutral_density=None, compressibility=None):
    """The vehicle with other parameters; drag scales all forces."""
    changes = {
        "drag": (vehicle.flow_frame.drag[0] * drag, vehicle.flow_frame.drag[1] * drag),
        "lift": (vehicle.flow_frame.lift[0] * drag, vehicle.flow_frame.lift[1] * drag * lift_ratio),
        "side_force": (vehicle.flow_frame.side_force[0] * drag,),
    }
    if neutral_density is not None:
        changes["reference_density"] = neutral_density
    if compressibility is not None:
        changes["hull_compressibility"] = compressibility
    return vehicle.replace(**changes)


def measured(vehicle, plan, seed):
    """Truth of a mission in stratified water, and what field sensors measure."""
    trajectory = simulate(
        Scenario(vehicle=vehicle, mission=plan, density=THERMOCLINE, sample_period=PERIOD)
    )
    seeds = np.random.SeedSequence(seed)
    signals = SUITE.measure(trajectory.signals, dt=PERIOD, rng_seed=seeds, density=THERMOCLINE)
    trajectory.signals.update(signals)
    return trajectory


def flown(vehicle, seed, *, yos=2, max_depth=150.0, pitch=(22.0, 30.0)):
    """Truth and measurements of one dive with field sensors in stratified, moving water."""
    rng = np.random.default_rng(seed)
    dive, climb = pitch
    yo = SawTooth(
        max_depth_m=max_depth, pitch_deg=dive, climb_pitch_deg=climb, net_mass_kg=0.25, yos=yos
    )
    plan = Mission(name="dive", start_heading_deg=float(rng.uniform(0, 360)), segments=(yo,))
    trajectory = measured(vehicle, plan, seed)
    trajectory.signals["measured_density"] = trajectory["true_density"] + rng.normal(
        0.0, 0.01, len(trajectory.time)
    )
    # internal waves move the water and all that floats in it: seen in the depth, not in the flight
    t = trajectory.time
    wave = sum(
        rng.normal(0.0, 0.15) * np.sin(2 * np.pi * t / p + rng.uniform(0, 6.28))
        for p in (180.0, 300.0, 500.0)
    )
    trajectory.signals["measured_depth"] = trajectory.signals["measured_depth"] + wave
    return trajectory


def add_pitch_offset(trajectory, offset_deg):
    """The pitch sensor mounted askew: true pitch = measured + offset."""
    trajectory.signals["measured_pitch"] = trajectory.signals["measured_pitch"] - offset_deg
    return trajectory


def stored(path, trajectories):
    """The measured signals as a store."""
    dataset = dataset_of(trajectories)
    if "measured_density" not in dataset:
        values = np.full(dataset["measured_depth"].shape, np.nan, np.float32)
        for k, trajectory in enumerate(trajectories):
            values[k, : len(trajectory.time)] = trajectory.signals["measured_density"]
        dataset["measured_density"] = (("mission", "time"), values)
    return write_store(dataset, path)
