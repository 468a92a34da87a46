"""Memory: a model owns what native code reads, and nothing written into it reaches past it.

Programs run in a process of their own, so that a crash is seen as one; it says which ran last.
"""

import json
import re
from pathlib import Path

from processes import python

ROOT = Path(__file__).parents[3]
COMMON = """
import copy, gc, pickle, sys, threading
import mujoco, numpy as np
from twin.errors import TwinError
from twin.mission import load_mission
from twin.physics.model_block import header, state, table
from twin.physics.native import block as b
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.physics.simulation import Simulation
from twin.water.current import Profile
from twin.water.density import DensityProfile

CURRENT = Profile(depth=(0.0, 400.0), north=(0.2, -0.1), east=(0.0, 0.15))
STRATIFIED = DensityProfile(depth=np.array([0.0, 500.0]), values=np.array([1022.0, 1030.0]))

def scenario(seconds=600.0, **changes):
    water = {"current": CURRENT, "density": STRATIFIED, **changes}
    return Scenario(mission=load_mission("default"), duration=seconds, **water)

def flown(model, data, steps=400):
    mujoco.mj_step(model, data, nstep=steps)
    return np.concatenate([data.qpos, data.qvel, data.act, data.ctrl, data.userdata])

def litter():
    # reuse the memory that was freed
    gc.collect()
    return [np.full(1 << k, np.nan) for k in range(4, 18) for _ in range(8)]
"""
PROGRAMS = {
    "model and data of a simulation that is gone": """
def parts():
    simulation = Simulation(scenario())
    return simulation.model, simulation.data
model, data = parts()
held = litter()
other = mujoco.MjData(model)
expected = Simulation(scenario())
np.testing.assert_array_equal(flown(model, data), flown(expected.model, expected.data))
flown(model, other, 6000)
assert other.qpos[2] < -10.0  # it dives: the mission is there
""",
    "copies and pickles": """
original = Simulation(scenario())
flown(original.model, original.data, 100)
ways = (copy.copy, copy.deepcopy, lambda owner: pickle.loads(pickle.dumps(owner)))
twins = [(copied(original.model), copied(original.data)) for copied in ways]
for twin in twins:
    np.testing.assert_array_equal(twin[0].numeric_data, original.model.numeric_data)
expected = flown(original.model, original.data)
del original
held = litter()
for twin in twins:
    np.testing.assert_array_equal(flown(*twin), expected)
""",
    "a second run on the same model": """
simulation = Simulation(scenario())
first = flown(simulation.model, simulation.data)
again = mujoco.MjData(simulation.model)
simulation.reset()
np.testing.assert_array_equal(flown(simulation.model, simulation.data), first)
for _ in range(3):
    simulation.reset()
    again.qpos[:], again.qvel[:] = simulation.data.qpos, simulation.data.qvel
    again.act[:], again.ctrl[:] = simulation.data.act, simulation.data.ctrl
    again.userdata[:], again.time = simulation.data.userdata, 0.0
    mujoco.mj_forward(simulation.model, again)
    flown(simulation.model, again)
    mujoco.mj_resetData(simulation.model, again)
""",
    "a batch whose fleet is gone": """
from twin.physics.fleet import Fleet
many = [scenario(60.0 + 30.0 * k) for k in range(5)]
singles = [Simulation(one) for one in many]
expected = [flown(one.model, one.data, 500)[:9] for one in singles]
batch = Fleet(many, threads=4).batch
held = litter()
for _ in range(5):
    batch.step(nstep=100)
np.testing.assert_array_equal(batch.bind("qpos"), expected)
""",
    "a current that is deleted or replaced while a copy steps": """
from twin.control.dm_suite import SuitePhysics as Physics
from twin.physics.start import Start
physics = Physics.from_vehicle("glider")
current = Profile(depth=(0.0, 400.0), north=(0.2, -0.1), east=(0.0, 0.15))
with physics.reset_context():
    physics.set_current(current, duration=600.0)
    physics.set_start(Start(depth=100.0, pitch=-0.4, v_rel=(0.3, 0.0, 0.0)))
expected = physics.copy()
expected.step(4000)
twin = physics.copy()
done = threading.Event()
def step():
    twin.step(4000)
    done.set()
thread = threading.Thread(target=step)
del current
thread.start()
count = 0
while not done.is_set():
    depth = np.linspace(0.0, 400.0, 2 + count % 300)
    physics.set_current(Profile(depth=depth, north=1e-3 * depth, east=2e-3 * depth), duration=10.0)
    physics.set_current(None, duration=10.0)
    count += 1
thread.join()
assert count > 3
np.testing.assert_array_equal(twin.data.qpos, expected.data.qpos)
np.testing.assert_array_equal(twin.data.userdata, expected.data.userdata)
""",
}
GARBAGE = """
FIXED = [np.nan, np.inf, -np.inf, 1e300, -1e300, -1.0, 0.5, 3e9, -3e9, 2.0**62, 1e18, 5e-324, 0.0]

def garbage(rng, size):
    kind = rng.integers(0, 4)
    if kind == 0:
        return np.full(size, rng.choice(FIXED))
    if kind == 1:
        return rng.choice(FIXED, size)
    if kind == 2:
        return rng.integers(0, 2**64, size, dtype=np.uint64).view(float)
    return rng.normal(size=size) * 10.0 ** rng.uniform(-3, 12, size)

def attempt(model, data, tally):
    try:
        with quiet_mujoco():
            mujoco.mj_forward(model, data)
            mujoco.mj_step(model, data, nstep=25)
        tally["stepped"] += 1
    except mujoco.FatalError as error:
        assert "changed after it was compiled" in str(error), error
        tally["refused"] += 1

simulation = Simulation(scenario(60.0))
whole, started = simulation.model, simulation.data
tally = {"stepped": 0, "refused": 0}
rng = np.random.default_rng(7)
"""
GARBAGE_PROGRAMS = {
    "one field of the header": """
places = np.arange(b.HEADER_WORDS)
for field in range(b.HEADER_WORDS - 2):
    for value in FIXED:
        model, data = copy.copy(whole), copy.copy(started)
        model.numeric_data[field - b.HEADER_WORDS] = value
        attempt(model, data, tally)
assert tally["refused"] > 100, tally
""",
    "several fields of the header": """
for _ in range(600):
    model, data = copy.copy(whole), copy.copy(started)
    places = rng.choice(b.HEADER_WORDS - 2, rng.integers(1, 12), replace=False) - b.HEADER_WORDS
    model.numeric_data[places] = garbage(rng, places.size)
    attempt(model, data, tally)
assert tally["refused"] > 50, tally
""",
    "all of the numeric data": """
for _ in range(200):
    model, data = copy.copy(whole), copy.copy(started)
    model.numeric_data[:] = garbage(rng, len(model.numeric_data))
    attempt(model, data, tally)
assert tally["stepped"] == 200, tally  # without its mark it is not ours
""",
    "the tables in front of the header": """
words = int(header(whole)["words"])
for _ in range(600):
    model, data = copy.copy(whole), copy.copy(started)
    body = model.numeric_data[-words : -b.HEADER_WORDS]
    if rng.integers(0, 2):
        places = rng.choice(body.size, rng.integers(1, 20), replace=False)
        body[places] = garbage(rng, places.size)
    else:
        body[:] = garbage(rng, body.size)
    attempt(model, data, tally)
assert tally["stepped"] == 600, tally
""",
    "each table alone": """
for name in ("parts", "law_values", "plan", "current", "density"):
    assert table(whole, name).size
    for _ in range(120):
        model, data = copy.copy(whole), copy.copy(started)
        values = table(model, name)
        places = rng.choice(values.size, rng.integers(1, values.size + 1), replace=False)
        values[places] = garbage(rng, places.size)
        attempt(model, data, tally)
assert tally["refused"] == 0, tally
""",
    "the state in userdata": """
outcomes = {"flown": 0, "told": 0}
for _ in range(600):
    model, data = copy.copy(whole), copy.copy(started)
    whole_state = rng.integers(0, 2)
    size = b.STATE_WORDS if whole_state else data.userdata.size
    places = rng.choice(size, rng.integers(1, size + 1), replace=False)
    data.userdata[places] = garbage(rng, places.size)
    attempt(model, data, tally)
    try:
        simulation.collect(data.userdata)
        outcomes["flown"] += 1
    except TwinError:
        outcomes["told"] += 1
assert tally == {"stepped": 600, "refused": 0}, tally
assert min(outcomes.values()) > 10, outcomes
""",
    "a run whose userdata was overwritten": """
from twin.errors import SimulationUnstable
for _ in range(100):
    simulation.reset()
    simulation.step(20)
    ours = state(simulation.data)
    name = rng.choice([n for n in b.STATE.names])
    ours[name] = garbage(rng, np.size(ours[name])).reshape(np.shape(ours[name]))
    try:
        simulation.run()
    except (TwinError, mujoco.FatalError):
        tally["refused"] += 1
    else:
        tally["stepped"] += 1
assert min(tally.values()) > 5, tally
""",
    "everything at once on many threads": """
from mujoco.batch import Batch
for _ in range(20):
    models = []
    for _ in range(8):
        model = copy.copy(whole)
        places = rng.choice(b.HEADER_WORDS - 2, 3, replace=False) - b.HEADER_WORDS
        if rng.integers(0, 2):
            model.numeric_data[places] = garbage(rng, 3)
        models.append(model)
    batch = Batch(models[0], len(models), 4)
    batch.set_models(models)
    try:
        with quiet_mujoco():
            batch.step(nstep=25)
        tally["stepped"] += 1
    except Exception as error:
        assert "changed after it was compiled" in str(error), error
        tally["refused"] += 1
assert tally["refused"] > 3, tally
""",
}


EACH = """
import json
for name, program in json.loads(sys.argv[1]).items():
    print(name, flush=True)
    exec(program, dict(globals()))
"""


def run(program, *arguments):
    done = python("-X", "faulthandler", "-c", COMMON + program, *arguments, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr[-3000:]


def test_what_a_model_needs_lives_as_long_as_it():
    run(EACH, json.dumps(PROGRAMS))


def test_a_saved_model_flies_alike_in_another_process(tmp_path):
    save = """
simulation = Simulation(scenario())
mujoco.mj_saveModel(simulation.model, sys.argv[1] + "/model.mjb")
data = mujoco.MjData(simulation.model)
np.save(sys.argv[1] + "/flown.npy", flown(simulation.model, data))
"""
    load = """
from twin.physics.native.install import install
install()
model = mujoco.MjModel.from_binary_path(sys.argv[1] + "/model.mjb")
assert header(model)["current"]["size"] > 0.0
expected = np.load(sys.argv[1] + "/flown.npy")
assert np.isfinite(expected[:9]).all()
np.testing.assert_array_equal(flown(model, mujoco.MjData(model)), expected)
"""
    run(save, str(tmp_path))
    run(load, str(tmp_path))


def test_garbage_is_refused_or_flown_and_never_followed():
    run(EACH, json.dumps({name: GARBAGE + program for name, program in GARBAGE_PROGRAMS.items()}))


def test_no_address_of_an_array_is_taken_outside_the_native_room():
    """An address outlives its array; only the tables of struct offsets are never freed."""
    # hand arrays to machine code for the time of a call, in which they are held
    allowed = {
        "twin/checks/step_cost.py",
        "twin/control/many_lanes.py",
        "twin/fossen/lane_block.py",
        "twin/physics/lanes.py",
    }
    address = re.compile(r"\.ctypes\b|__array_interface__|ctypes\.addressof|ctypes\.data_as")
    found = set()
    for room in ("twin", "factory", "learn"):
        for path in (ROOT / room).rglob("*.py"):
            name = path.relative_to(ROOT).as_posix()
            if name.startswith("twin/physics/native/"):
                continue
            if address.search(path.read_text(encoding="utf-8")):
                found.add(name)
    assert found == allowed
