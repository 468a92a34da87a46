"""Navigated simulations: guidance by what is known on board, and nothing of the truth."""

import dataclasses
import json

import numpy as np
import pytest
from processes import python

import twin
from twin.__main__ import PROGRAM
from twin.errors import InputError
from twin.mission.controller import Command
from twin.mission.segments import Waypoint
from twin.navigation.estimators.base import BodyVelocity, VelocityEstimator
from twin.navigation.settings import Navigation
from twin.physics.fleet import Fleet
from twin.physics.scenario import Scenario, scenario_from_dict
from twin.physics.simulation import Simulation
from twin.physics.true_signals import LiveTruth
from twin.records.mission_dataset import summarise
from twin.sensors import Compass, SensorSuite

IDEAL = Navigation(estimator="ekf", sensors="ideal")


def round_trip(side=250.0, **changes):
    """Out and back under water, by the estimated position."""
    targets = ({"north_m": side, "east_m": 0.0}, {"north_m": 0.0, "east_m": 0.0})
    settings = {
        "targets": targets, "max_depth_m": 60.0, "min_depth_m": 15.0, "pitch_deg": 26.0,
        "arrival_radius_m": 12.0, "surface_at_target": False, "renewed": "continuously",
    }  # fmt: skip
    return twin.Mission(name="there and back", segments=[Waypoint(**{**settings, **changes})])


def arrival(run, segment):
    back = np.flatnonzero(run["commanded_segment"] >= segment)
    assert back.size, "it has not arrived"
    return int(back[0])


def error(run, at):
    return float(
        np.hypot(
            *(run[f"measured_onboard_{n}"][at] - run[f"true_{n}"][at] for n in ("north", "east"))
        )
    )


def test_the_live_samples_are_those_of_the_log():
    scenario = Scenario(
        mission=twin.load_mission("default"),
        duration=150.0,
        current=twin.parse_current("uniform:0.2,-0.1"),
        floor=twin.parse_floor("depth:90"),
    )
    simulation = Simulation(scenario)
    run = simulation.run()
    rows = simulation.collected
    truth = LiveTruth(
        scenario.vehicle, rows.dtype, half_step=simulation.half_step, floor=simulation.tables.floor
    )
    for k in (0, 1, 77, 200, 299):
        sample = truth.sample(rows[k], rows[k]["acceleration"])
        assert set(sample) == set(truth.names)
        for name, value in sample.items():
            assert value == pytest.approx(run[name][k], rel=1e-9, abs=1e-9), (name, k)


@pytest.mark.parametrize(("sensors", "most"), [("ideal", 0.3), ("field", 1.5)])
def test_a_vehicle_comes_back_by_its_own_dead_reckoning(sensors, most):
    navigate = Navigation(estimator="ekf", sensors=sensors, seed=3)
    run = Simulation(Scenario(mission=round_trip(), navigate=navigate)).run()
    at = arrival(run, 2)
    north, east = run["true_north"][: at + 1], run["true_east"][: at + 1]
    way = np.hypot(np.diff(north), np.diff(east)).sum()
    assert 480.0 < way < 900.0
    assert 100.0 * error(run, at) / way < most
    assert np.hypot(north[-1], east[-1]) < 12.0 + most / 100.0 * way


def test_guidance_sees_the_compass_and_not_the_truth():
    """A compass that is 20 degrees off turns the way by as much."""
    sensors = SensorSuite.preset("ideal").replace(
        compass=dataclasses.replace(Compass.ideal(), offset_deg=1e-9)
    )

    mission = twin.Mission(
        name="north",
        segments=[
            twin.SawTooth(
                pitch_deg=26.0, max_depth_m=40.0, min_depth_m=10.0, yos=2, heading_deg=0.0
            )
        ],
        start_depth_m=12.0,
    )
    scenario = Scenario(mission=mission, navigate=dataclasses.replace(IDEAL, sensors=sensors))
    simulation = Simulation(scenario)
    draw = SensorSuite.draw

    def drawn(self, seed):
        return {**draw(self, seed), "compass_a0_deg": 20.0}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SensorSuite, "draw", drawn)
        run = simulation.run()
    assert np.median(np.mod(run["true_heading"] + 180.0, 360.0) - 180.0) == pytest.approx(
        -20, abs=2
    )


def test_a_fix_at_the_surface_corrects_position_and_current():
    mission = twin.Mission(
        name="two dives",
        segments=[
            twin.SawTooth(pitch_deg=26.0, max_depth_m=70.0, yos=1, heading_deg=0.0),
            twin.Surface(duration_s=200.0),
            twin.SawTooth(pitch_deg=26.0, max_depth_m=70.0, yos=1, heading_deg=0.0),
        ],
    )
    current = twin.parse_current("uniform:0.05,0.15")
    run = Simulation(Scenario(mission=mission, current=current, navigate=IDEAL)).run()
    fixes = np.isfinite(run["measured_gps_north"])
    under = np.flatnonzero(run["commanded_segment"] == 0)
    assert error(run, under[-1]) > 40.0  # the first dive knows no current
    assert error(run, int(np.flatnonzero(fixes)[-1])) < 3.0
    second = np.flatnonzero(run["commanded_segment"] == 2)
    assert error(run, second[-1]) < 0.35 * error(run, under[-1])
    figures = summarise(run)
    assert figures["fixes_after_dives"] == len(run.provenance["fix_innovations"]) == 1
    assert 0.0 < figures["nis"] < 9.2  # of two degrees of freedom 99 % are below


def test_truth_and_the_estimate_of_perfect_sensors_fly_alike():
    plan = twin.load_mission("default")
    by_truth = Simulation(Scenario(mission=plan, duration=400.0)).run()
    by_estimate = Simulation(Scenario(mission=plan, duration=400.0, navigate=IDEAL)).run()
    assert np.abs(by_truth["true_depth"] - by_estimate["true_depth"]).max() < 3.0
    assert np.array_equal(by_truth["commanded_segment"], by_estimate["commanded_segment"])


def test_the_same_seed_flies_the_same_and_another_does_not():
    def end(seed):
        navigate = Navigation(estimator="ekf", seed=seed)
        run = twin.simulate(Scenario(mission=round_trip(), duration=240.0, navigate=navigate))
        return run["true_north"][-1], run["measured_heading"][-1]

    assert end(1) == end(1)
    assert end(1) != end(2)


def test_simulate_navigates_and_keeps_what_was_measured_under_way():
    run = twin.simulate(
        mission="default", duration=120.0, navigate="estimate", sensors="field", seed=4,
        density="thermocline",
    )  # fmt: skip
    said = json.loads(run.provenance["scenario"])["navigate"]
    assert (said["estimator"], said["seed"]) == ("estimate", 4)
    again = scenario_from_dict(json.loads(run.provenance["scenario"]))
    live = Simulation(again).run()
    for name in ("measured_pitch", "measured_depth", "measured_heading", "measured_onboard_north"):
        assert np.array_equal(run[name], live[name]), name
    assert "measured_temperature" not in live  # nobody on board reads it: measured afterwards
    assert np.isfinite(run["measured_temperature"]).all()


class Still(VelocityEstimator):
    """A vehicle that believes to lie still."""

    channels = ("measured_depth",)

    def __init__(self, period=0.5):
        self.period = period

    def reset(self):
        self.steps = 0

    def step(self, sample):
        self.steps += 1
        return BodyVelocity(surge=0.0, sway=0.0, heave=0.0)


def test_an_estimator_that_reads_a_ctd_flies_where_the_water_has_a_temperature(tmp_path):
    water = tmp_path / "water.csv"
    water.write_text("depth,temperature,salinity\n0,18,35\n50,15,35.2\n300,8,35.4\n")
    given = {"mission": "default", "duration": 1800.0, "start": "36,-122", "density": water}
    learned = Navigation(estimator="flight_filter", sensors="ideal")
    run = twin.simulate(navigate=learned, **given)
    np.testing.assert_allclose(run["measured_density"], run["true_density"], rtol=1e-6)
    assert error(run, -1) < 5.0
    del given["density"]
    with pytest.raises(InputError, match=r"reads measured_density, .* profile with temperature"):
        twin.simulate(navigate=learned, **given)


def test_an_estimator_may_be_an_object_of_ones_own():
    still = Still()
    run = twin.simulate(mission="default", duration=100.0, navigate=still, sensors="ideal")
    assert still.steps == len(run.time)
    believed = np.hypot(run["measured_onboard_north"], run["measured_onboard_east"])
    assert believed[-1] < 1.0 < np.hypot(run["true_north"], run["true_east"])[-1]
    with pytest.raises(InputError, match=r"navigated by an object of .*Still, which a file"):
        scenario_from_dict(json.loads(run.provenance["scenario"]))
    slow = Still(period=2.0)
    twin.simulate(mission="default", duration=100.0, navigate=slow, sensors="ideal")
    assert slow.steps == 51


def test_a_controller_of_ones_own_sees_the_estimate():
    seen = []

    def controller(observation):
        seen.append((observation.north, observation.current_north, observation.shift))
        return Command(shift=0.02, pump=-150.0)

    simulation = Simulation(Scenario(duration=60.0, navigate=IDEAL))
    simulation.run(controller)
    assert len(seen) == 121
    assert np.isfinite(seen).all()
    assert seen[-1][2] == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"navigate": "efk"}, "unknown velocity estimator 'efk': did you mean 'ekf'"),
        ({"navigate": 3}, "navigate is 3: give 'truth', 'estimate'"),
        ({"compass_offset": 0.1}, "leave compass_offset out"),
        (
            {"mission": twin.Schedule(times=np.zeros(1), commands=np.zeros((1, 3)))},
            "a schedule sees",
        ),
        ({"mission": None}, "the scenario's mission or by a controller"),
        ({"navigate": Still(period=0.7)}, r"every 0.7 s, and there is one every 0.5 s"),
    ],
)
def test_what_cannot_be_navigated_is_refused(changes, message):
    settings = {"mission": round_trip(), "duration": 60.0, "navigate": IDEAL, **changes}
    with pytest.raises(InputError, match=message):
        Simulation(Scenario(**settings)).run()


def test_native_loops_refuse_navigated_scenarios():
    scenario = Scenario(mission=round_trip(), duration=60.0, navigate=IDEAL)
    with pytest.raises(InputError, match="fly navigated scenarios with simulate_many"):
        Fleet([scenario])
    with pytest.raises(InputError, match="leave sensors, seed and bottom_depth out"):
        twin.simulate(scenario, sensors="field")
    assert Scenario(navigate="truth", duration=1.0).navigate is None


def test_the_command_says_how_far_the_belief_was_off(tmp_path, capsys):
    out = tmp_path / "run.zarr"
    arguments = ["simulate", "--duration", "60", "--navigate", "ekf", "--seed", "2", "--json"]
    assert PROGRAM.main([*arguments, "--out", str(out)]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert 0.0 < figures["onboard_error_end_m"] <= figures["onboard_error_max_m"] < 20.0
    store = twin.open_store(out)
    assert "measured_onboard_north" in store
    assert PROGRAM.main(["simulate", "--duration", "60", "--navigate", "efk"]) == 2
    assert "did you mean 'ekf'" in capsys.readouterr().err
    assert PROGRAM.main(["simulate", "--duration", "60", "--seed", "2"]) == 2
    assert "--seed is for the sensors" in capsys.readouterr().err


def test_a_propelled_vehicle_goes_by_its_doppler_log():
    """In bottom lock the log sees the current, too, and no filter adds it again."""
    navigate = Navigation(sensors="survey-field", seed=2)
    run = Simulation(
        Scenario(
            vehicle=twin.load_vehicle("tethys"),
            mission=twin.load_mission("transects"),
            floor=twin.parse_floor("depth:60"),
            current=twin.parse_current("uniform:0.1,-0.1"),
            duration=300.0,
            navigate=navigate,
        )
    ).run()
    way = np.hypot(np.diff(run["true_north"]), np.diff(run["true_east"])).sum()
    assert way > 150.0
    assert error(run, -1) < 0.03 * way + 2.0


def test_a_fresh_process_knows_the_parts_of_a_propelled_vehicle():
    """Elsewhere in the suite a run before may have declared them."""
    words = ["simulate", "--vehicle", "tethys", "--navigate", "estimate", "--duration", "5"]
    done = python("-m", "twin", *words)
    assert done.returncode == 0, done.stderr
    assert "error of the on-board position" in done.stdout
