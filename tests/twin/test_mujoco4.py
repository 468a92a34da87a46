"""Everything but dm_control's tasks flies on MuJoCo 4 as on 3, to rounding."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
NEWER = ROOT / ".venv-mujoco4" / "bin" / "python"
FLY = """
import json, sys
from importlib import metadata
import numpy as np
import factory, twin
from twin import control
from twin.errors import InputError

run = twin.simulate(duration=600.0, current="uniform:0.1,-0.05", sensors="field", seed=3)
figures = {"states": run.states[-1].tolist(), "parts": run["true_pump"].tolist()}
figures["trim"] = twin.trim(twin.load_vehicle("glider"), shift=0.02, net_mass=0.2).speed_m_s
factory.generate(sys.argv[1], hours=0.3, seed=1, preset="field", workers=1)
store = factory.open(sys.argv[1])
figures["store"] = [store.row("true_north", m).tolist() for m in range(len(store))]
for task in control.ALL_TASKS:
    one = control.GliderEnv(task, observation="dict", randomise="field")
    many = control.GliderVectorEnv(task, 2, observation="dict", randomise="field")
    one.reset(seed=1), many.reset(seed=1)
    one.action_space.seed(0)
    for _ in range(40):
        action = one.action_space.sample()
        seen, reward, *_ = one.step(action)
        both, rewards, *_ = many.step(np.stack([action, action]))
    figures[task] = [reward, *rewards, *np.concatenate(list(seen.values())).tolist()]
    figures[f"{task}, many"] = np.concatenate([v.ravel() for v in both.values()]).tolist()
try:
    control.load("hold")
    told = "loaded"
except InputError as error:
    told = str(error)
print(json.dumps([metadata.version("mujoco"), told, figures]))
"""


def flown(python: str | Path, store: Path) -> tuple[str, str, dict]:
    """MuJoCo's version, what dm_control's face says, and figures of flights."""
    done = subprocess.run(
        [python, "-c", FLY, str(store)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return tuple(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.skipif(not NEWER.exists(), reason="needs .venv-mujoco4: scripts/mujoco4.sh")
def test_figures_are_those_of_mujoco_3(tmp_path):
    version, told, figures = flown(sys.executable, tmp_path / "older.zarr")
    assert (version.partition(".")[0], told) == ("3", "loaded")
    newer, told, others = flown(NEWER, tmp_path / "newer.zarr")
    assert newer.startswith("4.")
    assert f"need a mujoco below 4, and mujoco {newer} is installed" in told
    assert figures.keys() == others.keys()
    for name, values in figures.items():
        # MuJoCo 4 rounds the last bit of a rotation matrix otherwise; stores hold 32-bit numbers
        near = {"rtol": 1e-6, "atol": 1e-6} if name == "store" else {"rtol": 1e-11, "atol": 1e-12}
        for one, other in zip(np.atleast_1d(values), np.atleast_1d(others[name]), strict=True):
            np.testing.assert_allclose(other, one, **near, err_msg=name)
