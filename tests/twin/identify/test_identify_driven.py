"""A vehicle under a propeller comes back from its runs, and flies those that no fit has seen."""

import json
from typing import Any

import numpy as np
import pytest

from twin import load_vehicle, parse_current, parse_floor, simulate
from twin.__main__ import PROGRAM
from twin.errors import InputError, StoreError
from twin.identify import identify_driven, judge, load_runs
from twin.identify.calibration import Calibration
from twin.identify.driven_fit import driven_parameters
from twin.identify.driven_flights import DOPPLER_TURN, DrivenFlights, fly_run, settled
from twin.identify.driven_runs import NEEDED, RATES, _run
from twin.mission import Mission
from twin.mission.segments import Circle, Transect
from twin.physics.scenario import Scenario
from twin.records.mission_dataset import dataset_of
from twin.records.reader import MissionStore
from twin.records.store import write_store
from twin.sensors import SensorSuite
from twin.vehicle.vehicle import Vehicle
from twin.water.density import DensityProfile

SHIPPED = load_vehicle("remus")
WATER = DensityProfile.constant(SHIPPED.reference_density)
NAMES = (
    "neutral_density", "Xuu", "Nuv", "Nrr", "propeller.thrust_coefficient", "rudder.lift_slope",
    "rudder.neutral",
)  # fmt: skip


def other() -> Vehicle:
    """More drag, less thrust, a larger rudder that sits askew, too heavy by 30 g."""
    law = SHIPPED.law.with_drag(1.25)
    assert law is not None
    return SHIPPED.replace(
        law=law,
        reference_density=1031.0,
        propeller={"thrust_coefficient": 0.9 * 0.00344775},
        rudder={"lift_slope": 1.2 * 2.815, "neutral": np.deg2rad(1.0)},
    )


def calibrated(vehicle: Vehicle) -> Calibration:
    return Calibration(vehicle=vehicle, water_density=SHIPPED.reference_density)


def plan(seed: int) -> Mission:
    rng = np.random.default_rng(seed)
    ways: list[Any] = []
    for k in range(4):
        speed, depth = float(rng.uniform(1.1, 1.8)), float(rng.uniform(8.0, 25.0))
        ways.append(Transect(depth_m=depth, speed_m_s=speed, heading_deg=90.0 * k, duration_s=30.0))
    ways.append(Circle(depth_m=12.0, speed_m_s=1.5, radius_m=20.0, duration_s=30.0))
    return Mission(name="run", start_heading_deg=0.0, start_depth_m=12.0, segments=tuple(ways))


def flown(vehicle: Vehicle, seed: int) -> Any:
    return simulate(
        Scenario(
            vehicle=vehicle,
            believed=SHIPPED,
            mission=plan(seed),
            density=WATER,
            current=parse_current("uniform:0.1,-0.05"),
            floor=parse_floor("rough:60"),
            sample_period=0.2,
        )
    )


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Three runs of a vehicle that the shipped file is not, with sensor errors."""
    runs = [flown(other(), seed) for seed in range(3)]
    for seed, run in enumerate(runs):
        measured = SensorSuite.preset("survey-field").measure(
            run.signals, dt=0.2, rng_seed=np.random.SeedSequence(seed), density=WATER
        )
        run.signals.update(measured)
    path = tmp_path_factory.mktemp("driven") / "runs.zarr"
    write_store(dataset_of(runs), path)
    return path


def test_the_true_vehicle_flies_its_runs(store):
    run = load_runs(store, SHIPPED)[0]
    velocity = fly_run(run, calibrated(other()), np.array([0.1, -0.05])).velocity
    assert run.true_velocity is not None
    for flown, true in zip((velocity.surge, velocity.sway), run.true_velocity[:2], strict=True):
        assert np.abs((flown - true)[settled(run)]).max() < 5e-3


def test_a_models_depth_rate_goes_through_the_filter_of_the_logs(store):
    """The slope of a parabola through a window is not the parabola's middle: where a vehicle
    pitches over they are 2 cm/s apart, which made moments of pitch a fifth too small."""
    run = load_runs(store, SHIPPED)[0]
    rates = np.zeros(len(run.depth))  # whose trapezia add up to the depth
    for k, step in enumerate(np.diff(run.depth)):
        rates[k + 1] = 2.0 * step / run.period - rates[k]
    np.testing.assert_allclose(run.filtered(rates), run.depth_rate, atol=1e-9)


def test_what_drives_and_turns_it_comes_back_and_flies_unseen_missions(store):
    runs = load_runs(store, SHIPPED)
    found = identify_driven(runs[:2], SHIPPED, parameters=NAMES)
    known = {p.name: p.get(calibrated(other())) for p in driven_parameters(SHIPPED)}
    # the speed tells the ratio of thrust and drag; each alone is told by accelerations only
    ratio = found["Xuu"].value / found["propeller.thrust_coefficient"].value
    assert abs(ratio * 0.9 / 1.25 - 1.0) < 0.03
    assert abs(found["rudder.lift_slope"].value - known["rudder.lift_slope"]) < 0.1
    assert abs(found["rudder.neutral"].value - known["rudder.neutral"]) < 0.15
    assert abs(found["neutral_density"].value - 1031.0) < 0.3
    mine, before = judge(runs[2:], found.calibration), judge(runs[2:], found.nominal)
    assert mine.against == "truth"
    assert mine.speed < 0.01
    assert mine.speed < 0.3 * before.speed
    assert mine.turn_rate < 0.5 * before.turn_rate
    real, same, shipped = (flown(v, 7) for v in (other(), found.calibration.vehicle, SHIPPED))
    count = min(len(run.time) for run in (real, same, shipped))
    surge = real["true_surge"][50:count]
    off, rival = (np.abs(r["true_surge"][50:count] - surge).mean() for r in (same, shipped))
    assert off < 0.01 * surge.mean()
    assert off < 0.2 * rival


def test_a_vehicle_without_a_file_is_found_from_its_dimensions(store, tmp_path, capsys):
    """The command has the outside of the vehicle alone; judged by a run that it has not seen."""
    out = tmp_path / "mine.xml"
    words = ["identify", str(store), "--missions", "0-2", "--unseen", "2", "--json"]
    words += ["--out", str(out), "--no-handling", "--parameters", "neutral_density", "Xuu"]
    words += ["propeller.thrust_coefficient", "Yvv", "Nuv", "Nrr", "rudder.neutral"]
    words += ["--dimensions", "length=1.333", "diameter=0.191", "mass=30.479", "screw=0.1397"]
    words += ["fin_area=0.00665", "fin_place=-0.638", "density=1030"]
    assert PROGRAM.main(words) == 0
    said = json.loads(capsys.readouterr().out)
    mine, before = (said["unseen"][name] for name in ("identified", "started_from"))
    assert mine["against"] == "truth"
    assert mine["speed"] < 0.02
    assert mine["speed"] < 0.3 * before["speed"]
    assert mine["turn_rate"] < 0.8 * before["turn_rate"]
    written = load_vehicle(out)
    assert written.part_names == SHIPPED.part_names
    assert "length=1.333" in written.xml


def test_a_run_is_kept_where_nothing_has_changed_for_it(store):
    runs = load_runs(store, SHIPPED)
    problem = DrivenFlights(runs, calibrated(SHIPPED), ())
    first = problem.flown(np.zeros(problem.size))
    moved = np.zeros(problem.size)
    moved[1] = 1.0  # pitch offset of the second run
    again = problem.flown(moved)
    assert again[0] is first[0]
    assert again[2] is first[2]
    assert not np.array_equal(again[1].depth_rate, first[1].depth_rate)


def test_the_command_fits_judges_and_writes(store, tmp_path, capsys):
    out = tmp_path / "mine.xml"
    words = ["identify", str(store), "--vehicle", "remus", "--missions", "0-2", "--unseen", "2"]
    words += ["--out", str(out), "--known", "Nuv=1", "--json", "--parameters", "neutral_density"]
    words += ["Xuu", "Nuv", "propeller.thrust_coefficient"]
    assert PROGRAM.main(words) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["model"] == "driven"
    assert said["missions"] == 2
    assert not said["parameters"]["Nuv"]["determined"]
    assert said["unseen"]["identified"]["speed"] < 0.3 * said["unseen"]["started_from"]["speed"]
    written = load_vehicle(out)
    drag = dict(written.law.derivatives)["Xuu"]  # type: ignore[attr-defined]
    assert drag == pytest.approx(-1.62 * said["parameters"]["Xuu"]["value"], rel=1e-8)
    assert "identification" in written.xml


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "does not say which: give --vehicle, such as remus or tethys"),
        (["--vehicle", "remus", "--start", "a.json"], "--start is of gliders"),
        (["--vehicle", "remus", "--pitch-offset", "1"], "--pitch-offset is of gliders"),
        (["--vehicle", "remus", "--parameters", "Xvu"], "unknown parameter 'Xvu'"),
        (["--vehicle", "remus", "--unseen", "0-2"], "leaves no run to fit"),
        (["--vehicle", "slocum-200", "--unseen", "2"], "is a glider"),
        (["--vehicle", "remus", "--dimensions", "length=1"], "leave out --vehicle"),
        (["--dimensions", "length=1.3", "width=1"], "unknown dimension 'width'"),
    ],
)
def test_what_cannot_be_is_refused_by_name(store, words, says, capsys):
    assert PROGRAM.main(["identify", str(store), *words]) != 0
    assert says in capsys.readouterr().err


def test_runs_without_controls_are_refused_by_what_they_lack(store, tmp_path):
    runs = [flown(SHIPPED, 0)]
    for name in ("roll", "pitch", "heading", "depth", "roll_rate", "pitch_rate", "yaw_rate"):
        runs[0].signals[f"measured_{name}"] = runs[0][f"true_{name}"]
    for part in SHIPPED.part_names:
        del runs[0].signals[f"commanded_{part}"]
    path = tmp_path / "bare.zarr"
    write_store(dataset_of(runs), path)
    with pytest.raises(StoreError, match="no measured_propeller or commanded_propeller; no"):
        load_runs(path, SHIPPED)


def test_what_a_gyroscope_has_from_switching_on_is_taken_off(store):
    with MissionStore(store) as found:
        names = [f"true_{axis}_rate" for axis in ("roll", "pitch", "yaw")]
        true = np.stack([found.rows(name, [0, 1, 2]) for name in names]).astype(float)
        measured = np.stack([found.rows(name, [0, 1, 2]) for name in RATES]).astype(float)
    left, raw = [], []
    for run in load_runs(store, SHIPPED):
        part = np.s_[:, run.index, : len(run.depth)]
        left.append(np.rad2deg(np.mean(run.rates - true[part], axis=1)))
        raw.append(np.rad2deg(np.mean(measured[part] - true[part], axis=1)))
    assert np.abs(raw).max() > 0.03
    assert np.abs(left).max() < 0.03
    assert np.square(left).mean() < 0.25 * np.square(raw).mean()


def test_a_doppler_log_sits_turned_in_its_mount(store):
    runs = load_runs(store, SHIPPED)
    problem = DrivenFlights(runs, calibrated(SHIPPED), ())
    x = np.zeros(problem.size)
    straight, motions = problem.missed(x), problem.flown(x)
    turn = DOPPLER_TURN * np.array([0.5, -1.0, 1.5])
    for axis, part in zip("xyz", (0.5, -1.0, 1.5), strict=True):
        x[problem.biases.index(f"dvl_turn_{axis} of run {runs[0].index}")] = part
    askew = problem.missed(x)
    for piece, (number, rows) in enumerate(problem.pieces):
        velocity = motions[number].velocity
        body = np.stack([velocity.surge, velocity.sway, velocity.heave])
        seen = -np.cross(turn, body, axisb=0).T if number == 0 else np.zeros_like(body)
        for place, name in enumerate(("surge", "sway")):
            change = askew[name][piece] - straight[name][piece]
            np.testing.assert_allclose(change, seen[place, rows[name]], atol=1e-12)


def test_a_glider_has_no_runs():
    with pytest.raises(InputError, match="has no propeller"):
        driven_parameters(load_vehicle("slocum-200"))


def test_a_run_that_lacks_one_of_its_rates_is_none():
    names = (*NEEDED, *(f"measured_{part.name}" for part in SHIPPED.parts))
    signals = {name: np.linspace(5.0, 6.0, 200) for name in names}
    assert _run(0, signals, 0.5, SHIPPED) is not None
    for rate in RATES:
        assert _run(0, {**signals, rate: np.full(200, np.nan)}, 0.5, SHIPPED) is None
