"""The factory with a vehicle of other parts: a torpedo with a propeller, a rudder, an elevator."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import factory
from factory.__main__ import PROGRAM
from factory.commands.stored import drawn_rows
from factory.generation.generated_store import GeneratedStore
from factory.generation.generation import generate
from factory.missions_page import store_page
from factory.sampling.conditions import encoder_zeros, spread_vehicle
from factory.sampling.draw import draw_parameters
from factory.sampling.fly import build_scenario
from factory.sampling.parameters import ADDED_MASS, declared, parameter_table
from factory.sampling.recipe import make_recipe
from factory.soundness import replay_mission, verify_store
from twin.errors import InputError, VehicleError
from twin.physics.true_signals import declare_parts
from twin.vehicle.vehicle import load_vehicle, parse_vehicle

FILE = Path(__file__).parents[2] / "vehicles" / "torpedo.xml"
PARTS = ("propeller", "rudder", "elevator")
SHORT = {"mission.duration_h": "uniform(0.03, 0.06)", "mission.max_depth_m": "uniform(12, 25)"}


@pytest.fixture(scope="module")
def torpedo():
    return load_vehicle(FILE)


@pytest.fixture(scope="module", params=["paper", "field"])
def run(request, tmp_path_factory):
    out = tmp_path_factory.mktemp("torpedo") / f"{request.param}.zarr"
    recipe = make_recipe(preset=request.param, hours=0.2, changes=SHORT, vehicle=str(FILE))
    generate(recipe, out, workers=1)
    return GeneratedStore(out)


def changed(torpedo, old, new):
    assert old in torpedo.xml
    return parse_vehicle(torpedo.xml.replace(old, new), FILE)


def test_its_store_is_sound_and_replays_to_the_byte(run):
    report = verify_store(run)
    assert report.ok, [check.problems for check in report.checks]
    assert not run.failures()
    for mission in range(len(run)):
        assert replay_mission(run, mission).identical


def test_signals_carry_the_parts_own_names_and_none_of_a_gliders(run):
    data = xr.open_zarr(run.path)
    for part, unit in zip(PARTS, ("rad s-1", "degree", "degree"), strict=True):
        for kind in ("true", "measured", "commanded"):
            assert data[f"{kind}_{part}"].attrs["units"] == unit
    assert float(data["true_propeller"].max()) > 20.0
    assert {"true_shift", "measured_pump", "commanded_rotation"}.isdisjoint(data.data_vars)
    # a fin's deflection follows its command within the encoder's zero and its own travel
    assert np.nanmax(np.abs(data["commanded_rudder"].values)) <= math.degrees(0.3) * (1 + 1e-6)


def test_what_is_drawn_follows_from_its_parts(torpedo):
    table = parameter_table(torpedo)
    assert "mission.speed_m_s" in table
    glider_only = {"mission.net_mass_kg", "vehicle.ballast_g", "vehicle.k_d0", "vehicle.shift_lag"}
    assert glider_only.isdisjoint(table)
    assert {"vehicle.Xuu", "vehicle.rudder_offset_deg", "vehicle.propeller_thrust"} <= set(table)
    assert table["mission.max_depth_m"].field == "uniform(20, 90)", "its file says so"
    travel = math.degrees(torpedo.part("rudder").high)
    rotation = declared("paper", table)["mission.rotation_deg"]
    assert not rotation.allows(travel)
    assert rotation.allows(0.5 * travel)
    assert not rotation.allows(0.0)


def test_every_drawn_number_reaches_the_vehicle_and_nothing_else(torpedo):
    table = parameter_table(torpedo)
    nominal = draw_parameters(
        table, declared("paper", table), seed=1, mission=0, attempt=0, duration_s=600.0,
        vehicle=torpedo,
    )  # fmt: skip
    assert spread_vehicle(torpedo, nominal).changes() == {}

    def spread(name, value):
        values = {**nominal.values, f"vehicle.{name}": value}
        return spread_vehicle(torpedo, dataclasses.replace(nominal, values=values))

    for u in torpedo.law.uncertainties():
        changes = spread(u.name, 1.07).changes()
        assert set(changes) == {"derivatives"}
        before, after = dict(torpedo.law.derivatives), dict(spread(u.name, 1.07).law.derivatives)
        assert {n for n in before if before[n] != after[n]} == {u.name}
        assert after[u.name] == pytest.approx(1.07 * before[u.name])
    for part in torpedo.parts:
        for u in part.uncertainties():
            if u.field is not None:
                found = spread(f"{part.name}_{u.name}", 1.07).changes()
                assert set(found) == {part.name}
                assert found[part.name] == pytest.approx({u.field: 1.07 * getattr(part, u.field)})
    for name in ADDED_MASS:
        assert "added_mass" in spread(f"added_mass_{name}", 1.07).changes() or name == "roll"
    values = {**nominal.values, "vehicle.rudder_offset_deg": 2.0}
    zeros = encoder_zeros(torpedo, dataclasses.replace(nominal, values=values))
    assert zeros == pytest.approx({"rudder": math.radians(2.0), "elevator": 0.0})


def test_the_guidance_flies_the_drawn_speed(torpedo):
    recipe = make_recipe(hours=0.2, changes={**SHORT, "mission.speed_m_s": 1.0}, vehicle=str(FILE))
    plan = build_scenario(recipe.parameters(0, 0), torpedo).mission
    assert {segment.speed_m_s for segment in plan.segments} == {1.0}


def test_a_vehicle_that_nothing_turns_never_spirals(torpedo):
    still = dataclasses.replace(torpedo, steering={"pitch": "elevator", "speed": "propeller"})
    table = parameter_table(still)
    assert table["mission.kind"].paper == table["mission.kind"].field == "saw-tooth"
    assert {"mission.rotation_deg", "mission.heading_change_deg"}.isdisjoint(table)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("spread.mission.max_depth_m", "spread.mission.max_deph_m", "max_depth_m"),
        ("spread.mission.max_depth_m", "spread.mission.net_mass_kg", "unknown parameter"),
        ("loguniform(20, 90); uniform(20, 90)", "uniform(20, 90)", "preset field"),
        ("loguniform(20, 90); uniform(20, 90)", "uniform(9, 2); 5", r"spread\.mission"),
    ],
)
def test_a_spread_that_no_mission_can_draw_is_refused(torpedo, old, new, message):
    with pytest.raises(VehicleError, match=message):
        parameter_table(changed(torpedo, old, new))


def test_a_part_with_the_name_of_a_signal_is_refused(torpedo):
    elevator = dataclasses.replace(torpedo.part("elevator"), name="pitch")
    vehicle = dataclasses.replace(torpedo, parts=(elevator,), steering={})
    with pytest.raises(VehicleError, match="must not be called 'pitch'"):
        declare_parts(vehicle)
    shift = dataclasses.replace(torpedo.part("elevator"), name="shift")
    with pytest.raises(VehicleError, match="stored in degree, but is"):
        declare_parts(dataclasses.replace(torpedo, parts=(shift,), steering={}))


def test_the_papers_test_mission_is_a_gliders():
    with pytest.raises(InputError, match=r"paper-test.*has no pump.*choose preset paper"):
        make_recipe(preset="paper-test", vehicle=str(FILE))


def test_info_page_and_exports_show_its_parts(run, tmp_path):
    names = {row["parameter"] for row in drawn_rows(run)}
    assert "mission.speed_m_s" in names
    labels = {axes.get_xlabel() for axes in store_page(run).axes}
    assert {"propeller [rad s-1]", "rudder [degree]", "elevator [degree]"} <= labels
    assert (
        PROGRAM.main(
            ["export", str(run.path), "--to", "og1", "--mission", "0", "--out", str(tmp_path)]
        )
        == 0
    )
    (file,) = tmp_path.glob("*.nc")
    with xr.open_dataset(file, decode_times=False) as written:
        assert "MEASURED_RUDDER" in written
        assert "PUMPED_VOLUME" not in written


def test_distributions_of_a_vehicle_file(capsys):
    assert PROGRAM.main(["distributions", "--vehicle", str(FILE), "--preset", "field"]) == 0
    out = capsys.readouterr().out
    assert "vehicle.elevator_lift_slope" in out
    assert "ballast" not in out
    assert list(factory.parameters(FILE)) == list(parameter_table(load_vehicle(FILE)))
