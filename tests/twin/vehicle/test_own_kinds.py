"""A part, a hull law and a kind of segment from one file outside the package fly in both models."""

import json
import re
from pathlib import Path

import pytest
from processes import python
from torpedo import GEOMETRY_ONLY

KINDS = Path(__file__).parents[2] / "vehicles" / "own_kinds.py"
DRAG = Path(__file__).parents[2] / "vehicles" / "own_drag.py"
GLIDE = """
import json, math
import twin
from twin.checks.agreement import check_manoeuvres
from twin.errors import TwinError
from twin.faults.hull import WingLost
from twin.identify.calibration import require_glider
from twin.mission import steady_glide
from twin.navigation.estimators.flight import PitchPlusAlpha
from twin.navigation.flight_filter import FlightFilter
from twin.vehicle.additions import with_law

def refusal(call):
    try:
        return str(call() or "")
    except TwinError as error:
        return str(error)

vehicle = with_law("glider", "slow-drag")
(found,) = check_manoeuvres(vehicle, count=1, duration=120.0)
polar = vehicle.law.polar(0.05, vehicle.reference_density)
glide = steady_glide(vehicle, math.radians(-25.0), 0.1)
print(json.dumps({
    "law": vehicle.law.kind, "speed": found.speed_m_s, "position": found.position_percent,
    "drag": polar.drag, "printed": vehicle.law.drag[0] + vehicle.law.drag[1] * 0.05**2,
    "glide": glide.speed,
    "refused": [
        refusal(lambda: require_glider(vehicle)),
        refusal(lambda: FlightFilter(vehicle, 1.0)),
        refusal(lambda: PitchPlusAlpha.unsuited(vehicle)),
        refusal(lambda: WingLost.unfit(vehicle)),
    ],
}))
"""
FLY = """
import json, sys
import twin
from twin.checks.agreement import check_manoeuvres
from twin.mission import Mission

vehicle = twin.load_vehicle(sys.argv[1])
push = {"kind": "push", "thrust_n": 6.0, "duration_s": 60.0}
plan = Mission.from_dict(
    {"name": "own", "start_depth_m": 20.0, "at_end": "hold", "duration_s": 60.0, "segments": [push]}
)
run = twin.simulate(vehicle=vehicle, mission=plan)
abreast = twin.simulate(vehicle=vehicle, mission=plan, engine="lanes")
(found,) = check_manoeuvres(vehicle, count=1, duration=120.0)
print(json.dumps({
    "kinds": [vehicle.law.kind, *(part.kind for part in vehicle.parts)],
    "surge": float(run["true_surge"][-1]),
    "in_lanes": float(abreast["true_surge"][-1]),
    "jet": float(run["true_jet"][-1]),
    "segments": plan.to_dict()["segments"],
    "speed": found.speed_m_s, "attitude": found.attitude_deg, "position": found.position_percent,
}))
"""


def own_vehicle() -> str:
    """The vehicle of geometry alone with a waterjet and linear drag in place of its own."""
    masses = [10.0, 10.0, 10.0, 0.1, 4.0, 4.0]
    rows = (str(masses[i] if i == j else 0.0) for i in range(6) for j in range(6))
    text = GEOMETRY_ONLY.replace('data="ellipsoid"/>', 'data="linear-drag"/>', 1)
    parts = (
        '<text name="jet.kind" data="waterjet"/> <numeric name="linear_drag" data="4 60 8"/>'
        f'<numeric name="added_mass" data="{" ".join(rows)}"/>'
    )
    text = re.sub(
        r'<text name="propeller.kind".*?(?=<numeric name="pitch_pid")', parts, text, flags=re.S
    )
    jet = (
        '<actuator><general name="jet" site="propeller" dyntype="user" actdim="1" dynprm="0.5 60" '
        'gainprm="0" actearly="true" actlimited="true" actrange="0 10" ctrlrange="0 10"/>'
        "</actuator>"
    )
    return re.sub(r"<actuator>.*</actuator>", jet, text, flags=re.S)


def test_they_fly_in_both_models(tmp_path):
    path = tmp_path / "own.xml"
    path.write_text(own_vehicle(), encoding="utf-8")
    done = python("-c", FLY, str(path), GLIDER_TWIN_PLUGINS=str(KINDS))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["kinds"] == ["linear-drag", "waterjet"]
    assert found["segments"][0]["kind"] == "push"
    assert found["jet"] == pytest.approx(6.0, abs=1e-6)
    # (m + X_A) du/dt = F - d u, with the waterjet's lag of 0.5 s
    assert found["surge"] == pytest.approx(
        6.0 / 4.0 * (1.0 - 2.718281828 ** (-59.5 / 10.0)), rel=0.01
    )
    assert found["in_lanes"] == pytest.approx(found["surge"], rel=1e-3)
    assert found["speed"] < 1e-4
    assert found["attitude"] < 0.1
    assert found["position"] < 0.3


def test_a_drag_law_of_ones_own_flies_and_whoever_needs_the_printed_one_refuses_it(tmp_path):
    done = python("-c", GLIDE, cwd=tmp_path, GLIDER_TWIN_PLUGINS=str(DRAG))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["law"] == "slow-drag"
    assert found["speed"] < 5e-4
    assert found["position"] < 0.1
    assert found["drag"] == pytest.approx(found["printed"], rel=1e-3), "at the speed of both"
    assert 0.1 < found["glide"] < 0.5
    for refusal in found["refused"]:
        assert refusal, "it takes the coefficients of another law for its own"


@pytest.mark.parametrize(
    ("law", "named"),
    [
        ("linear-drag", "unknown hull_law 'linear-drag' (allowed: body-axes, "),
        ("ellipsoid", "unknown vehicle part 'waterjet' (allowed: battery-hinge"),
    ],
)
def test_without_the_file_the_kind_is_named(tmp_path, law, named):
    path = tmp_path / "own.xml"
    path.write_text(own_vehicle().replace("linear-drag", law), encoding="utf-8")
    done = python("-m", "twin", "trim", "--vehicle", str(path), GLIDER_TWIN_PLUGINS="")
    assert done.returncode == 2
    assert named in done.stderr
    assert len(done.stderr.splitlines()) == 1


COMPILE = """
import sys, warnings
import twin
from twin.physics.lanes import Lane

scenario = twin.Scenario(vehicle=twin.load_vehicle(sys.argv[1]), duration=1.0, engine="lanes")
structure = Lane(scenario).structure
for _ in range(2):  # the second time it is known
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        structure.rate(8)
    print([str(one.message) for one in found])
"""
FORGET = """
from twin.compiled.folder import NOTE, cache_root
from twin.fossen.structure import _kept_loop

_, stamp = _kept_loop(structure, structure.text, 8)
note = cache_root() / f"twin.fossen.structure-{stamp}" / NOTE
print(int(note.is_file()))
note.unlink()
"""
LOST = {
    "an array": "force = np.zeros(3)\n    force[0] = position",
    "a loop": "n = 0.0\n    while n * n < position:\n        n += 1.0\n    force = (n, 0.0, 0.0)",
}


@pytest.mark.parametrize("how", [*LOST, "nothing"])
def test_a_kind_that_spoils_vector_code_is_named(tmp_path, how):
    kinds, vehicle = tmp_path / "kinds.py", tmp_path / "own.xml"
    vehicle.write_text(own_vehicle(), encoding="utf-8")
    text, right = KINDS.read_text(encoding="utf-8"), "force = (position, 0.0, 0.0)"
    assert text.count(right) == 1
    kinds.write_text(text.replace(right, LOST.get(how, right)), encoding="utf-8")
    # compiled, then loaded by another process; code that was kept without its note is seen again
    for again in ("", "", FORGET, FORGET) if how == "an array" else ("", ""):
        done = python("-c", COMPILE + again, str(vehicle), GLIDER_TWIN_PLUGINS=str(kinds))
        assert done.returncode == 0, done.stderr
        first, second, *noted = done.stdout.splitlines()
        assert second == "[]"
        assert ("fossen_wrench of part kind 'waterjet'" in first) == (how != "nothing"), first
        assert "hull law" not in first
        assert noted == ["1"] * bool(again)
