"""`twin compile`: afterwards no flight compiles."""

import json
import subprocess
import sys

from patience import HANG_S

FLY = """
from numba.core import event
import twin

with event.install_recorder("numba:compile") as made:
    for engine in ("mujoco", "lanes"):
        twin.simulate(vehicle="glider", engine=engine, duration=60.0)
print(len(made.buffer))
"""


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, timeout=HANG_S, check=False
    )


def test_afterwards_a_flight_finds_everything():
    done = run("-m", "twin", "compile", "--vehicle", "glider", "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["vehicles"] == ["glider"]
    assert answer["seconds"] > 0.0
    flown = run("-c", FLY)
    assert flown.returncode == 0, flown.stderr
    assert flown.stdout.strip() == "0"


def test_what_is_no_vehicle_is_told_before_anything_is_compiled():
    done = run("-m", "twin", "compile", "--vehicle", "glider", "nothing")
    assert done.returncode == 2
    assert "nothing" in done.stderr
    assert len(done.stderr.splitlines()) == 1
