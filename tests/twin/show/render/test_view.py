"""`twin view`: what it shows, what its keys do, and what it says without a screen."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from patience import HANG_S
from pictures import refused, short_scenario
from processes import python

from twin.show.render.context import DISPLAYS
from twin.show.render.playback import poses
from twin.show.render.subject import Live, Replay

linux = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="other systems have a screen"
)


def environment(**more: str) -> dict[str, str]:
    tests = str(Path(__file__).parents[3])
    unwanted = (*DISPLAYS, "MUJOCO_GL", "PYOPENGL_PLATFORM")
    kept = {name: value for name, value in os.environ.items() if name not in unwanted}
    return {**kept, "PYTHONPATH": tests, **more}


@linux
@pytest.mark.parametrize(
    ("display", "message"), [({}, "are not set"), ({"DISPLAY": ":4711"}, ":4711 cannot be opened")]
)
def test_without_a_screen_it_says_what_to_do(display, message):
    done = python("-m", "twin", "view", env=environment(**display))
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert message in line
    assert "`twin render`" in line
    assert "xvfb-run" in line
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("--current", "uniform:0.1,0"), "--current"),
        (("--floor", "flat:40", "--web"), "--floor"),
        (("--plan", "default", "--web"), "--plan"),
    ],
)
def test_what_belongs_to_a_live_mission_is_refused_beside_a_store(capsys, store, words, option):
    told = refused(capsys, "view", store, *words)
    assert f"{option}: for a mission that is flown live" in told
    assert store.name in told


def assert_same(row, expected, tolerance):
    for name in ("position", "quaternion", "parts", "pitch", "heading", "speed", "net_mass"):
        np.testing.assert_allclose(
            getattr(row, name), getattr(expected, name), atol=tolerance, err_msg=name
        )


def test_a_replay_shows_what_was_recorded(subject):
    trajectory = subject.trajectory
    replay = Replay(trajectory)
    for time in (0.0, 17.5, 17.6, 250.25, 300.0):
        assert_same(replay.at(time), poses(trajectory, np.array([time])), 1e-9)


def test_a_live_flight_is_the_simulation_and_goes_back(subject):
    live = Live(short_scenario())
    for time in (50.0, 140.0, 100.0, 100.1):  # back: it is flown again
        row = live.at(time)
        # the log holds samples, the physics goes on between them
        expected = poses(subject.trajectory, row.time)
        assert abs(row.time[0] - time) < 0.11
        np.testing.assert_allclose(row.position, expected.position, atol=2e-3)
        np.testing.assert_allclose(row.pitch, expected.pitch, atol=0.02)
        np.testing.assert_allclose(row.speed, expected.speed, atol=1e-3)
        np.testing.assert_allclose(row.net_mass, expected.net_mass, atol=1e-3)
        np.testing.assert_allclose(row.current, expected.current, atol=1e-3)


IN_THE_WINDOW = """
import sys, threading, time
from PIL import ImageGrab
from twin.show.render.subject import Replay
from twin.show.render.subject import Shot
from twin.show.render.window import Window
from pictures import short_subject

subject = short_subject()
window = Window(subject, Shot(camera="orbit"), Replay(subject.trajectory), speed_up=50.0)
colours = []

def look(*keys):
    for key in keys:
        window._keys.put(key)
    while not window._keys.empty():  # the next frame obeys
        time.sleep(0.02)
    for _ in range(100):  # a busy machine draws late
        time.sleep(0.3)
        found = len(ImageGrab.grab().getcolors(1 << 24))
        if found > 100:
            break
    colours.append(found)

def visit():
    time.sleep(1.0)
    look()
    for key in (57, 56, 55):  # follow, map, side
        look(key)
    look(32, 263)  # pause and back
    print("time", window._time, window._paused, window._mode)
    time.sleep(0.3)
    print("still", window._time)
    look(61, 259, 32)
    print("speed", window._speed)
    print("colours", *colours)
    window.close()

visitor = threading.Thread(target=visit)
visitor.start()
window.run(seconds=100.0)
visitor.join()
"""


def under_xvfb(*command: str) -> subprocess.CompletedProcess[str]:
    if shutil.which("xvfb-run") is None:
        pytest.skip("no virtual screen: xvfb-run (Debian package xvfb) is not installed")
    screen = ["xvfb-run", "-a", "-s", "-screen 0 640x480x24"]
    return subprocess.run(
        [*screen, sys.executable, *command],
        env=environment(MUJOCO_GL="glfw"),
        capture_output=True,
        text=True,
        timeout=HANG_S,
    )


@linux
def test_the_window_and_its_keys():
    done = under_xvfb("-c", IN_THE_WINDOW)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    said = dict(line.split(maxsplit=1) for line in done.stdout.splitlines())
    time, paused, mode = said["time"].split()
    assert (paused, mode) == ("True", "side")
    assert said["still"] == time
    assert said["speed"] == "100.0"
    counts = [int(n) for n in said["colours"].split()]
    assert min(counts) > 100


@linux
def test_the_command_flies_live_and_closes():
    done = under_xvfb("-m", "twin", "view", "--camera", "chase", "--seconds", "1")
    assert done.returncode == 0, done.stderr
    assert "Mission default, live: closed" in done.stdout
    assert "Space: pause" in done.stderr
