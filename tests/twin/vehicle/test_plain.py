"""A vehicle file in plain MuJoCo glides as the twin does; the twin itself sees none of that."""

import json
import math
import re
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from examples import ROOT, needs_docs
from pictures import needs_gl

from twin import load_vehicle, trim
from twin.errors import VehicleError
from twin.mission import steady_glide
from twin.physics.mujoco_model import compile_model
from twin.vehicle.plain import MARK, NOTE, without_plain
from twin.vehicle.presets import shipped_files
from twin.vehicle.vehicle import parse_vehicle

RAW = {name: path.read_text("utf-8") for name, path in shipped_files().items()}
GLIDING = [name for name, text in RAW.items() if MARK in text]
IN_USE = ["glider", "slocum-200", "slocum-1000", "seaglider", "seaexplorer", "spray"]
GLIDES = ((1.1, 1.1), (-0.85, 0.95), (0.75, 1.05))
"""Factors of net mass and pitch of the usual dive; scripts/fit_plain.py has others."""
STARTS = (
    {"qpos": [1.0, 0.0, 0.0, 0.0], "qvel": [0.0, 0.0, 0.0]},
    {"qpos": [0.8, 0.0, 0.4, 0.45], "qvel": [0.0, 0.0, 0.0]},
    {"qpos": [0.95, 0.2, -0.2, -0.1], "qvel": [0.4, 0.1, 0.2]},
)
"""From rest and level; from rest, nose down; on its way, nose up and rolled"""
ALONE = """
import json, sys
import mujoco, numpy as np
task = json.loads(sys.stdin.read())
model = mujoco.MjModel.from_xml_path(task["path"])
data, found = mujoco.MjData(model), []
for ctrl in task["controls"]:
    for start in task["starts"]:
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = ctrl
        data.qpos[3:7], data.qvel[:3] = start["qpos"], start["qvel"]
        mujoco.mj_step(model, data, nstep=round(400.0 / model.opt.timestep))
        nose = data.body("hull").xmat[6]
        found.append([np.linalg.norm(data.qvel[:3]), -data.qvel[2], np.degrees(np.arcsin(nose))])
assert not {"twin", "factory", "learn"} & set(sys.modules)
print(json.dumps(found))
"""


def wanted(vehicle):
    """Controls, and speed [m/s], sink rate [m/s] and pitch [deg] of the twin's steady glides."""
    controls, glides = [], []
    for mass, steep in GLIDES:
        pitch, net = vehicle.usual_glide
        shift = steady_glide(vehicle, -math.copysign(pitch * steep, mass), net * mass).shift
        place = {
            vehicle.steering["pitch"]: shift,
            vehicle.steering["buoyancy"]: vehicle.pump_for_net_mass(net * mass),
        }
        controls.append([place.get(part.name, part.rest) for part in vehicle.parts])
        motion = trim(vehicle, shift, 0.0, net * mass)
        glides.append([motion.speed_m_s, motion.vertical_speed_m_s, motion.pitch_deg])
    return controls, np.array(glides)


@pytest.mark.parametrize("name", IN_USE)
def test_a_glider_glides_without_this_package(name):
    controls, glides = wanted(load_vehicle(name))
    task = {"path": str(shipped_files()[name]), "controls": controls, "starts": STARTS}
    done = subprocess.run(
        [sys.executable, "-I", "-c", ALONE],
        input=json.dumps(task), capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "WARNING" not in done.stdout + done.stderr
    found = np.array(json.loads(done.stdout)).reshape(len(GLIDES), len(STARTS), 3)
    for start in range(len(STARTS)):
        np.testing.assert_allclose(found[:, start, :2], glides[:, :2], rtol=0.25)
        np.testing.assert_allclose(found[:, start, 2], glides[:, 2], atol=4.0)


@pytest.mark.parametrize("name", sorted(RAW))
def test_each_file_glides_or_says_why_not(name):
    assert set(IN_USE) <= set(GLIDING)
    model = mujoco.MjModel.from_xml_string(RAW[name])
    assert (model.opt.density > 0.0) == (name in GLIDING)
    if name not in GLIDING:
        assert f"{NOTE}the file poses there in vacuum and does not glide: " in RAW[name]


def ready(name):
    model = mujoco.MjModel.from_xml_path(str(shipped_files()[name]))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("name", GLIDING)
def test_it_is_neutral_in_plain_mujoco_and_the_pump_lifts_it(name):
    model, data = ready(name)
    vehicle = load_vehicle(name)
    mujoco.mj_forward(model, data)
    weight = vehicle.mass * vehicle.gravity
    buoyancy = data.qfrc_passive[2] - 1e-3 * vehicle.gravity  # less the weight of its own body
    assert buoyancy == pytest.approx(weight, rel=1e-9)
    assert data.qfrc_passive[2] == pytest.approx(data.qfrc_bias[2], rel=1e-9)
    pump = model.actuator("pump").id
    data.act[pump] = data.ctrl[pump] = 100.0
    mujoco.mj_forward(model, data)
    lift = data.qfrc_actuator[2]
    assert lift == pytest.approx(100e-6 * vehicle.reference_density * vehicle.gravity, rel=1e-6)
    data.qpos[3:7] = [0.8, 0.0, 0.6, 0.0]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[:3], [0.0, 0.0, lift], atol=1e-9)


def test_controls_move_pump_and_battery_with_their_lags():
    model, data = ready("glider")
    data.ctrl[:] = 0.02, 0.5, -200.0
    mujoco.mj_step(model, data, nstep=30)  # 3 s
    lags = np.array([2.0, 2.0, 4.0])  # <actuator> of the file
    np.testing.assert_allclose(data.act, data.ctrl * -np.expm1(-3.0 / lags), rtol=1e-6)
    assert data.joint("shift").qpos[0] == pytest.approx(data.act[0], abs=1e-4)
    assert data.joint("rotation").qpos[0] == pytest.approx(data.act[1], abs=1e-3)


@pytest.mark.parametrize("law", ["coefficients", "ellipsoid"])
@pytest.mark.parametrize("name", GLIDING)
def test_nothing_of_it_survives_in_the_twin(name, law):
    vehicle = load_vehicle(name)
    assert "plain" not in re.sub(r"<!--.*?-->", "", vehicle.xml, flags=re.DOTALL)
    assert NOTE not in vehicle.xml
    model = compile_model(vehicle, hydrodynamics=law)
    names = model.names.decode().split("\0")
    assert not [one for one in names if "plain" in one]
    assert model.opt.density == 0.0
    assert not np.any(model.body_gravcomp)
    assert np.all(model.actuator_dyntype == mujoco.mjtDyn.mjDYN_USER)
    at_site = model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE
    assert np.any(at_site)
    assert not np.any(model.actuator_gainprm[at_site])
    assert np.all(model.actuator_trnid[at_site, 1] == -1)
    drawn = len(re.findall('<geom name="fluid_', RAW[name]))
    assert len(vehicle.with_law("ellipsoid").law.geoms) == drawn > 0


def test_a_set_in_another_form_is_refused():
    text = RAW["glider"].replace('<site name="plain_world" pos', "<site\n  name='plain_world' pos")
    with pytest.raises(VehicleError, match=r"'plain_world' belongs .* run the script again"):
        parse_vehicle(text, shipped_files()["glider"])
    assert without_plain(load_vehicle("glider").xml, ROOT) == load_vehicle("glider").xml


@needs_docs
@needs_gl
def test_the_page_runs(tmp_path, monkeypatch, capsys):
    """docs/howto/plain_mujoco.md."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "assets").symlink_to(ROOT / "assets")
    page = (ROOT / "docs/howto/plain_mujoco.md").read_text("utf-8")
    (text,) = re.findall(r"```python gl\n(.*?)```", page, re.DOTALL)
    exec(text, {})
    speed, sink = map(float, capsys.readouterr().out.split())
    assert speed == pytest.approx(0.47, abs=0.02)
    assert sink == pytest.approx(0.27, abs=0.02)
    assert (tmp_path / "plain.png").stat().st_size > 10_000
