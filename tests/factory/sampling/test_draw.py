"""Draws: what missions are drawn against what is declared."""

import math
from collections import defaultdict

import numpy as np
import pytest
from stores import drawn

from factory.sampling.conditions import build_current, build_density, spread_vehicle
from factory.sampling.distribution import Choice, Fixed, LogUniform, Uniform, number
from factory.sampling.draw import SURFACE, TEST, draw_parameters
from factory.sampling.fly import build_mission
from factory.sampling.parameters import declared, override, parameter_table
from factory.sampling.presets import (
    CURRENTS,
    FAMILY,
    PRESETS,
    paper_test_parameters,
    paper_test_plan,
)
from factory.sampling.recipe import make_recipe
from twin.errors import InputError
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.axes import Origin

VEHICLE = load_vehicle()
TABLE = parameter_table(VEHICLE)
MISSIONS = 300


@pytest.fixture(scope="module", params=["paper", "field"])
def many(request):
    return request.param, [drawn(request.param, mission) for mission in range(MISSIONS)]


def test_every_value_follows_its_declared_distribution(many):
    spread, missions = many
    found = defaultdict(list)
    for parameters in missions:
        for name, value in parameters.values.items():
            found[name].append(value)
        for segment in parameters.segments:
            for name, value in segment.items():
                surface = segment["mission.kind"] == SURFACE.name
                if value == value and not (surface and name == "mission.kind"):
                    found[name].append(value)
    for name, distribution in declared(spread, TABLE).items():
        values = found[name]
        if isinstance(distribution, Fixed):
            continue
        if name == "mission.duration_h":
            continue  # tests/factory/test_plan.py
        assert all(distribution.allows(value) for value in values), name
        if isinstance(distribution, Choice):
            for option, weight in zip(distribution.options, distribution.weights, strict=True):
                share = weight / sum(distribution.weights)
                seen = np.mean([value == option for value in values])
                assert abs(seen - share) < 4.5 * math.sqrt(share * (1 - share) / len(values)), name
        elif isinstance(distribution, Uniform | LogUniform) and not distribution.excluded:
            numbers = np.sort(np.array(values, float))
            low, high = distribution.low, distribution.high
            if isinstance(distribution, LogUniform):
                numbers, low, high = np.log(numbers), math.log(low), math.log(high)
            position = (numbers - low) / (high - low)
            gap = np.abs(position - np.linspace(0, 1, len(position))).max()
            # Kolmogorov-Smirnov at 1e-4 for each of some 70 parameters
            assert gap < 2.23 / math.sqrt(len(position)) + 1 / len(position), name


def test_the_table_says_unit_and_name_of_everything():
    for name, parameter in TABLE.items():
        assert parameter.name == name
        assert parameter.unit
        assert 3 < len(parameter.long_name) <= 60
        assert ";" not in parameter.long_name
        assert parameter.name.split(".")[0] in ("mission", "vehicle", "current", "water")


def test_field_spreads_at_least_what_it_promises():
    field = declared("field", TABLE)
    coefficients = [n for n in field if n.startswith(("vehicle.k_", "vehicle.added_mass_"))]
    assert len(coefficients) == 12 + 8
    promised = dict.fromkeys(coefficients, (0.9, 1.1)) | {
        "vehicle.shift_offset_mm": (-1.0, 1.0),
        "vehicle.rotation_offset_deg": (-2.0, 2.0),
        "vehicle.ballast_g": (-20.0, 20.0),
        "current.speed": (0.0, 0.3),
    }
    for name, (low, high) in promised.items():
        distribution = field[name]
        assert isinstance(distribution, Uniform), name
        assert distribution.low <= low, name
        assert distribution.high >= high, name
    for part in ("shear", "tide"):
        weight = field[f"current.{part}"]
        assert isinstance(weight, Uniform)
        assert weight.high > 0.0


def test_a_mission_does_not_depend_on_the_others_and_an_override_only_on_itself():
    one, again = drawn("field", 7), drawn("field", 7)
    assert one == again
    assert drawn("field", 8).values != one.values
    assert drawn("field", 7, attempt=1).values != one.values
    assert drawn("field", 7, seed=1).values != one.values
    changed = drawn("field", 7, vehicle__k_m="uniform(0.5, 0.6)")
    differing = {name for name in one.values if one.values[name] != changed.values[name]}
    assert differing == {"vehicle.k_m"}
    assert one.segments == changed.segments


def test_family_draws_hulls_far_from_their_file_and_else_what_field_draws():
    family, field = PRESETS["family"].distributions(TABLE), declared("field", TABLE)
    differing = {name for name in field if family[name].text() != field[name].text()}
    assert differing == set(FAMILY)
    hulls = [drawn("field", k, vehicle__k_d0=FAMILY["vehicle.k_d0"]) for k in range(MISSIONS)]
    drags = [parameters.values["vehicle.k_d0"] for parameters in hulls]
    assert 0.7 <= min(drags) < 0.75
    assert 1.55 < max(drags) <= 1.6
    propelled = parameter_table(load_vehicle("remus"))  # its law has no such coefficients
    assert PRESETS["family"].distributions(propelled).keys() == propelled.keys()


def test_an_rov_is_flown_by_hand_with_damping_between_its_two_sources():
    rov, wu = load_vehicle("bluerov2"), load_vehicle("bluerov2:wu")
    table = parameter_table(rov)
    assert not [name for name in table if name.endswith(("pitch_deg", "max_depth_m", "yos"))]
    recipe = make_recipe(vehicle="bluerov2", preset="rov", hours=1.0, seed=2)
    assert recipe.sensor_preset == "survey-field"
    assert max(recipe.plan.durations_s) <= 600.0
    options = {"duration_s": 300.0, "vehicle": rov, "seed": 2, "attempt": 0}
    least, most = (dict(v.law.derivatives) for v in (wu, rov))
    for mission in range(50):
        drawn_here = draw_parameters(table, recipe.distributions, mission=mission, **options)
        assert {s["mission.kind"] for s in drawn_here.segments} == {"sticks"}
        law = dict(spread_vehicle(rov, drawn_here).law.derivatives)
        for name in ("Xu", "Xuu", "Yvv", "Zw", "Zww", "Kpp", "Mqq"):
            low, high = sorted((abs(least[name]), abs(most[name])))
            assert 0.995 * low <= abs(law[name]) <= 1.005 * high, name
        plan = build_mission(drawn_here, rov)
        plan.check(rov)
        assert 5.0 <= plan.start_depth_m <= 40.0


def test_training_never_commands_the_settings_of_the_paper_test():
    """The exclusion zones of preset paper hold around what preset paper-test flies."""
    distributions = declared("paper", TABLE)
    plan = paper_test_plan()
    assert plan.splits == (TEST,) * len(CURRENTS)
    assert plan.durations_s == (10_000.0,) * 3
    spirals, level = 0, 0
    for index in range(len(CURRENTS)):
        test = paper_test_parameters(index, TABLE, distributions, (), seed=0, attempt=0)
        for segment in test.segments:
            if segment["mission.kind"] == "spiral":
                spirals += 1
                rotation = number(segment, "mission.rotation_deg")
                for near in (rotation - 2.5, rotation, rotation + 2.5):
                    assert not distributions["mission.rotation_deg"].allows(near)
            else:
                level += 1
                pitch = number(segment, "mission.pitch_deg")
                for name in ("mission.pitch_deg", "mission.climb_pitch_deg"):
                    for near in (pitch - 1.5, pitch, pitch + 1.5):
                        assert not distributions[name].allows(near)
    assert (spirals, level) == (6, 3)


def test_the_paper_test_has_the_low_current_as_printed_and_two_stronger_ones():
    recipe = make_recipe(preset="paper-test")
    speeds = []
    for index, (north, east) in enumerate(CURRENTS.values()):
        current = build_current(recipe.parameters(index, 0))
        assert current is not None
        np.testing.assert_allclose(
            current.velocity(0.0, 0.0, 0.0, 50.0), [north, east, 0], atol=1e-12
        )
        speeds.append(math.hypot(north, east))
    np.testing.assert_allclose(CURRENTS["low"], [-0.05, -0.002])
    assert speeds[0] < speeds[1] < speeds[2] <= 0.3


def test_no_field_current_is_faster_than_its_declared_speed():
    rng = np.random.default_rng(0)
    kinds = set()
    for mission in range(25):
        parameters = drawn("field", mission)
        current = build_current(parameters)
        assert current is not None
        kinds |= {part["kind"] for part in current.describe().get("parts", [])}
        time, depth = rng.uniform(0, 10_800, 80), rng.uniform(0, 300, 80)
        position = rng.uniform(-3000, 3000, (2, 80))
        origin = Origin(latitude_deg=parameters.number("water.latitude"))
        velocity = current.velocity(time, position[0], position[1], depth, origin)
        speed = np.linalg.norm(velocity, axis=-1).max()
        assert speed <= parameters.number("current.speed") * (1 + 1e-9)
    assert kinds == {
        "uniform", "geostrophic", "tide", "inertial", "ekman", "log-layer", "gauss-markov"
    }  # fmt: skip


def test_still_water_and_constant_density_where_nothing_is_declared():
    assert build_current(drawn("paper", 0, current__speed="0")) is None
    assert build_density(drawn("paper", 0)) is None
    density = build_density(drawn("field", 0))
    assert density is not None
    assert np.all(np.diff(density.values) > 0)  # a stable column


def test_an_unknown_parameter_is_named_with_the_nearest():
    with pytest.raises(InputError, match=r"mission.pich_deg.*did you mean 'mission.pitch_deg'"):
        override(declared("paper", TABLE), {"mission.pich_deg": 3})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mission__kind": "hold"}, "allowed: saw-tooth, spiral"),
        ({"mission__surface_every": "often"}, "give a number or none"),
        ({"mission__max_depth_m": "deep"}, r"deep is no number: give .* or uniform\(0, 0.1\)"),
        ({"mission__segment_duration_s": "0.5"}, "more than 100 segments"),
    ],
)
def test_values_that_make_no_mission_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        _ = drawn("paper", 0, **changes).deepest_m


@pytest.mark.parametrize("preset", ["paper", "field"])
@pytest.mark.parametrize("vehicle", ["glider", "graver-2005", "rogue"])
def test_a_shipped_preset_draws_what_the_pump_of_a_shipped_vehicle_reaches(preset, vehicle):
    recipe = make_recipe(preset=preset, vehicle=vehicle)
    for name, end in (("net_mass_kg", "low"), ("climb_net_mass_kg", "high")):
        reach = abs(recipe.vehicle.net_mass_for_pump(getattr(recipe.vehicle.part("pump"), end)))
        weight = recipe.distributions[f"mission.{name}"]
        assert isinstance(weight, Uniform)
        assert 0.8 * reach < weight.high <= reach
    sea_wings = declared(preset, TABLE)
    changed = {n for n, d in recipe.distributions.items() if d.text() != sea_wings[n].text()}
    weights = {"mission.net_mass_kg", "mission.climb_net_mass_kg"}
    assert changed == (weights if vehicle == "graver-2005" else set())


def test_a_net_mass_that_the_user_gives_is_taken_as_it_is():
    recipe = make_recipe(
        preset="field", vehicle="graver-2005", changes={"mission.net_mass_kg": "uniform(0.1, 0.4)"}
    )
    assert recipe.distributions["mission.net_mass_kg"] == Uniform(0.1, 0.4)


@pytest.mark.parametrize("name", ["slocum-200", "slocum-1000", "seaglider", "seaexplorer", "spray"])
def test_missions_of_a_glider_in_use_hold_its_usual_glide(name):
    vehicle = load_vehicle(name)
    pitch, net_mass = vehicle.usual_glide
    usual = {"pitch_deg": math.degrees(pitch), "net_mass_kg": net_mass}
    for preset in ("paper", "field"):
        rows = declared(preset, parameter_table(vehicle))
        for what, value in usual.items():
            for climb in ("", "climb_"):
                row = rows[f"mission.{climb}{what}"]
                assert row.low <= value <= row.high, (preset, climb, what)
