"""The navigator errs as it says: 70 simulated missions in currents of preset field."""

import json
import math

import numpy as np
import pytest

import factory
import learn
from benchmarks import command, navigator_consistency
from factory.sampling.conditions import build_current, origin
from factory.sampling.draw import Parameters, draw_values
from factory.sampling.parameters import declared, parameter_table
from learn.report.result_tables import verdicts
from twin.navigation.current import Leg, consistency_of
from twin.vehicle.vehicle import load_vehicle

MISSIONS, DIVES = 70, 4
DURATION, STAY, POINTS = 3600.0, 400.0, 24
SPEED = 0.35
SCALE, COMPASS, FIX = 0.01, 1.0, 4.0


def simulated_legs(seed):
    """Dives from 0 to 60 to 300 m and back, with errors of speed, compass and fixes."""
    rng = np.random.default_rng(seed)
    table = {
        name: row
        for name, row in parameter_table(load_vehicle("glider")).items()
        if name.split(".")[0] in ("current", "water", "mission")
    }
    distributions, part = declared("field", table), (np.arange(POINTS) + 0.5) / POINTS
    records = []
    for mission in range(MISSIONS):
        values = draw_values(table, distributions, seed=seed, mission=mission, attempt=0)
        values["water.bottom_below_m"] = math.nan  # out of reach
        length = DIVES * (DURATION + STAY)
        drawn = Parameters(duration_s=length, values=values, segments=())
        current, place = build_current(drawn), origin(drawn)
        assert current is not None
        scale, turn = 1.0 + SCALE * rng.normal(), math.radians(COMPASS) * rng.normal()
        legs = []
        for k in range(DIVES):
            start = k * (DURATION + STAY)
            depth = rng.uniform(60.0, 300.0) * (1.0 - np.abs(2.0 * part - 1.0))
            rest = np.zeros(POINTS)
            water = current.velocity(start + DURATION * part, rest, rest, depth, place)
            heading = rng.uniform(0.0, 2.0 * math.pi)
            said = SPEED * DURATION * np.array([math.cos(heading), math.sin(heading)])
            true = (
                SPEED
                * scale
                * DURATION
                * np.array([math.cos(heading + turn), math.sin(heading + turn)])
            )
            ground = true + DURATION * water[:, :2].mean(axis=0)
            ground += math.sqrt(2.0) * FIX * rng.normal(size=2)
            legs.append(
                Leg(
                    start=start,
                    duration=DURATION,
                    over_ground=(float(ground[0]), float(ground[1])),
                    through_water=(float(said[0]), float(said[1])),
                )
            )
        records.append(legs)
    return records


def test_70_simulated_missions_are_as_surely_known_as_the_filter_says():
    found = consistency_of(simulated_legs(3), latitude=45.0, speed_scale=SCALE, compass=COMPASS)
    assert found.fixes == MISSIONS * DIVES
    assert 1.6 <= found.nis <= 2.4
    assert 0.42 <= found.in_50 <= 0.58
    assert 0.84 <= found.in_90 <= 0.96
    assert found.first_dive_m == pytest.approx(found.first_dive_no_current_m)
    assert found.later_m <= 0.95 * found.later_persistence_m


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Missions of preset field that surface."""
    path = tmp_path_factory.mktemp("stores") / "field.zarr"
    factory.generate(
        path, preset="field", hours=3.5, seed=5, workers=1,
        changes={"mission.duration_h": "0.7", "mission.max_depth_m": "60", "mission.yos": "1"},
    )  # fmt: skip
    return path


def printed(capsys, *words):
    assert command.run(navigator_consistency.main, [*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_benchmark_prints_what_it_finds(store, capsys):
    found = printed(capsys, store)
    assert found["fixes"] == 10  # two after each of five launches: none is lost between samples
    assert found["first_dive_m"] == pytest.approx(found["first_dive_no_current_m"])
    assert 0.0 < found["nis"] < 10.0
    told = printed(capsys, store, "--learn", store)  # what they tell is another
    assert told["fixes"] == found["fixes"]
    assert told["later_persistence_m"] == pytest.approx(found["later_persistence_m"])
    assert told["nis"] != found["nis"]


def test_networks_are_judged_by_the_benchmark_and_by_their_report(
    store, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("twin.show.figures.page_layout.Page._figure", lambda *_: "")
    run = learn.fit(
        store, folder=tmp_path / "run", features=("sin_pitch", "depth_rate"), network="mlp",
        hidden=6, layers=1, epochs=2, members=1,
    )  # fmt: skip
    networks, steady = printed(capsys, store, "--run", run.folder), printed(capsys, store)
    assert networks["fixes"] == steady["fixes"]
    assert networks["first_dive_m"] != steady["first_dive_m"]  # another way through the water
    figures = learn.evaluate(run, store, split="all", baselines=()).figures
    report = figures["fixes"]
    assert report["fixes"] == networks["fixes"]
    # the navigator straightens the compass by the gyros, the report does not
    assert report["first_dive_m"] == pytest.approx(networks["first_dive_m"], rel=0.1)
    assert 0.0 < report["nis"] < 10.0
    (line,) = [one for one in verdicts(figures) if "innovation" in one]
    assert f"{report['fixes']} dives" in line
    assert f"{report['nis']:.2f}" in line
