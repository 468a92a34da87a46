"""Known parameters come back from simulated logs within their stated uncertainty."""

import identify_logs as simulated
import numpy as np
import pytest

from twin.identify import identify, load_calibration, load_logs
from twin.identify.pitch import righting_arm, with_righting_arm
from twin.identify.rollout import refine
from twin.vehicle.vehicle import load_vehicle

VEHICLE = load_vehicle("glider")
RATIO = VEHICLE.flow_frame.lift[1] / VEHICLE.flow_frame.drag[0]
MOST_DEVIATIONS = 3.5
"""of one estimate: beyond it in one of 2000 cases"""


def draw(seed):
    """A vehicle within the known spread, its parameters, and its pitch sensor's offset [deg]."""
    rng = np.random.default_rng(seed)
    drag, lift_ratio = (float(np.exp(rng.normal(0.0, 0.15))) for _ in range(2))
    neutral = 1025.0 + float(rng.normal(0.0, 0.5))
    kappa, offset = float(rng.uniform(2.0, 8.0)), float(rng.normal(0.0, 0.7))
    vehicle = simulated.changed(
        VEHICLE,
        drag=drag,
        lift_ratio=lift_ratio,
        neutral_density=neutral,
        compressibility=1e-10 * kappa,
    )
    truth = {
        "neutral_density": neutral,
        "drag": VEHICLE.flow_frame.drag[0] * drag,
        "lift_ratio": RATIO * lift_ratio,
        "compressibility": kappa,
        "pitch_offset": offset,
    }
    return vehicle, truth


def deviations(found, truth):
    """Error of each determined estimate in its own stated deviation."""
    return {
        e.name: (e.value - truth[e.name]) / e.deviation for e in found.estimates if e.determined
    }


@pytest.fixture(scope="module")
def recovered(tmp_path_factory):
    """(identification, truth) of four vehicles, three dives each."""
    out = []
    for seed in range(4):
        vehicle, truth = draw(seed)
        runs = [
            simulated.add_pitch_offset(
                simulated.flown(vehicle, 100 * seed + k, pitch=pitch), truth["pitch_offset"]
            )
            for k, pitch in enumerate(((22.0, 30.0), (30.0, 22.0), (26.0, 35.0)))
        ]
        store = simulated.stored(tmp_path_factory.mktemp("logs") / f"{seed}.zarr", runs)
        found = identify(load_logs(store), load_calibration("glider"), parameters=list(truth))
        out.append((found, truth))
    return out


def test_flight_model_recovers_trim_drag_lift_hull_and_pitch_sensor(recovered):
    for found, truth in recovered:
        errors = deviations(found, truth)
        assert set(found.determined) >= {"neutral_density", "drag", "compressibility"}
        assert max(map(abs, errors.values())) < MOST_DEVIATIONS, errors


def test_stated_deviations_are_neither_boastful_nor_timid(recovered):
    errors = np.array([v for found, truth in recovered for v in deviations(found, truth).values()])
    assert 0.4 < np.sqrt(np.mean(errors**2)) < 1.6


def test_what_is_estimated_is_known_better_than_before_and_than_nominal(recovered):
    for found, truth in recovered:
        for e in found.estimates:
            factor = e.value / e.nominal if e.unit in ("kg m-1", "rad-1") else 1.0
            # what stays at nominal may leave lift, which was asked for, less sure than before
            assert e.deviation < e.spread * factor or e.name == "lift_ratio"
        nominal = abs(found["drag"].nominal - truth["drag"])
        assert abs(found["drag"].value - truth["drag"]) < max(nominal, 2 * found["drag"].deviation)
        assert found.depth_rate_rmse < 0.9 * found.nominal_depth_rate_rmse


def test_steady_model_recovers_trim_and_drag_in_water_of_one_density(tmp_path, monkeypatch):
    """In stratified water the buoyancy changes on the way and nothing is steady."""
    from twin.water.density import DensityProfile

    monkeypatch.setattr(simulated, "THERMOCLINE", DensityProfile.constant(1025.0))
    vehicle = simulated.changed(VEHICLE, drag=1.2, neutral_density=1025.3)
    runs = [
        simulated.flown(vehicle, k, pitch=p) for k, p in enumerate(((22.0, 30.0), (30.0, 22.0)))
    ]
    store = simulated.stored(tmp_path / "one.zarr", runs)
    names = ["neutral_density", "drag"]
    found = identify(load_logs(store), load_calibration("glider"), parameters=names, model="steady")
    truth = {"neutral_density": 1025.3, "drag": 1.2 * VEHICLE.flow_frame.drag[0]}
    assert set(found.determined) == set(names)
    assert max(map(abs, deviations(found, truth).values())) < MOST_DEVIATIONS


@pytest.mark.parametrize("seed", [0, 3])
def test_full_twin_recovers_what_the_moments_tell(tmp_path, seed):
    """Trim and drag, the place of the battery, of the centre of gravity and of the pump."""
    rng = np.random.default_rng(seed)
    drag, neutral = float(np.exp(rng.normal(0, 0.15))), 1025.0 + float(rng.normal(0, 0.5))
    place = VEHICLE.battery.neutral_x + float(rng.normal(0.0, 3e-3))
    nominal = load_calibration("glider")
    arm = righting_arm(nominal) * float(np.exp(rng.normal(0.0, 0.15)))
    pump_position = float(rng.normal(0.0, 0.5))
    vehicle = simulated.changed(VEHICLE, drag=drag, neutral_density=neutral)
    vehicle = vehicle.replace(
        battery={"neutral_x": place}, pump={"position": (pump_position, 0.0, 0.0)}
    )
    vehicle = with_righting_arm(nominal.replace(vehicle=vehicle), arm).vehicle
    runs = [
        simulated.flown(vehicle, 100 * seed + k, pitch=pitch, yos=1)
        for k, pitch in enumerate(((22.0, 30.0), (30.0, 22.0)))
    ]
    logs = load_logs(simulated.stored(tmp_path / "twin.zarr", runs))
    flight = identify(logs, nominal, parameters=["neutral_density", "drag"])
    refined = refine(logs, flight)
    found = refined.identification
    truth = {
        "neutral_density": neutral,
        "drag": drag * VEHICLE.flow_frame.drag[0],
        "shift_offset": 1e3 * place,
        "righting_arm": 1e3 * arm,
        "pump_position": pump_position,
    }
    assert set(found.determined) >= set(truth)
    errors = deviations(found, {**truth, "pitch_moment": 0.0})
    assert max(abs(errors[name]) for name in truth) < MOST_DEVIATIONS
    assert abs(found["shift_offset"].value - 1e3 * place) < 0.6  # [mm], a fifth of what was drawn
    assert abs(found["pump_position"].value - pump_position) < 0.1  # [m], the same
    assert refined.depth_rate_rmse < 0.01
    assert refined.pitch_rmse < np.deg2rad(1.0)
