"""The server of the page: who may read, what a question changes; a mission that is flown live."""

import contextlib
import json
import re
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from pictures import call, refused, short_scenario, unpack

from twin.errors import InputError
from twin.mission.shipped_missions import load_mission_for
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.show.render import Shot, Subject
from twin.show.web.server import STRANGERS, LiveMission, PageServer
from twin.vehicle.vehicle import load_vehicle


@pytest.fixture
def server():
    """A server that shows a short page."""
    with PageServer(0) as one:
        one.show("<p>here")
        yield one


def read(address: str | urllib.request.Request, data: bytes | None = None) -> bytes:
    with urllib.request.urlopen(address, data=data) as answer:
        return answer.read()


def test_only_a_post_flies_the_mission_on(server, subject):
    mission = LiveMission(short_scenario(), subject, Shot(), 2.0)
    server.show("<p>here", mission)
    rows = server.address + "rows?from=2"
    with pytest.raises(urllib.error.HTTPError, match="405"):
        read(rows)
    assert mission._begun is None
    assert json.loads(read(rows, data=b"")) == {"running": True}
    assert mission._begun is not None
    with pytest.raises(urllib.error.HTTPError, match="400"):
        read(server.address + "rows?from=x", data=b"")


def test_strangers_that_wait_are_few_and_keep_nobody_out(server):
    before = threading.active_count()
    with contextlib.ExitStack() as strangers:
        for _ in range(200):
            half = strangers.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            half.sendall(b"GET /")
        assert read(server.address) == b"<p>here"
        for _ in range(100):
            if threading.active_count() - before <= STRANGERS:
                break
            time.sleep(0.05)
        assert threading.active_count() - before <= STRANGERS


def test_a_silent_connection_ends(monkeypatch, server):
    monkeypatch.setattr("twin.show.web.server.SILENCE", 0.2)
    with socket.create_connection(("127.0.0.1", server.port), timeout=30.0) as half:
        half.sendall(b"GET / HTTP/1.1")
        assert half.recv(1) == b""


def test_sigterm_ends_a_served_page_with_its_own_code(store):
    words = [sys.executable, "-m", "twin", "view", str(store), "--web", "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        assert "open http://" in run.stdout.readline()
        run.terminate()
        assert run.wait(60) == 143
        assert "Traceback" not in run.stderr.read()


@pytest.mark.parametrize(
    "place", ["http://[::1", "//[x", "http://[::1]evil/", "/%00", "/\x7f\x1b[2J", "*"]
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_an_address_that_is_none_is_answered_without_a_word(server, place, method, capsys):
    with socket.create_connection(("127.0.0.1", server.port), timeout=30.0) as asked:
        host = f"Host: 127.0.0.1:{server.port}\r\n"
        asked.sendall(f"{method} {place} HTTP/1.0\r\n{host}\r\n".encode())
        answer = b"".join(iter(lambda: asked.recv(4096), b""))
    assert answer.startswith((b"HTTP/1.0 404", b"HTTP/1.0 400"))
    assert server.key.encode() not in answer
    assert read(server.address) == b"<p>here"
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", ["short", "tethys"])
def test_a_live_mission_gives_the_samples_of_the_simulation(subject, name):
    scenario = short_scenario()
    if name != "short":  # it ends before its longest time
        vehicle = load_vehicle(name)
        scenario = Scenario(vehicle=vehicle, mission=load_mission_for(vehicle, None))
        subject = Subject(trajectory=simulate(scenario), vehicle=vehicle)
    mission, expected = LiveMission(scenario, subject, Shot(), 1e6), subject.trajectory
    found = {name: [unpack(row)] for name, row in mission.mission["channels"].items()}
    running = True
    while running:
        answer = mission.rows(sum(len(row) for row in found["time"]))
        running = answer["running"]
        for name, row in answer.get("channels", {}).items():
            found[name].append(unpack(row))
    np.testing.assert_array_equal(np.concatenate(found["time"]), expected.time)
    for name in ("north", "depth", "pitch", "surge"):
        away = np.concatenate(found[name]) - expected[f"true_{name}"]
        assert np.abs(away).max() < 0.0051, name


def test_a_live_mission_waits_for_its_first_reader_and_keeps_time(subject):
    assert LiveMission(short_scenario(), subject, Shot(), 2.0).rows(2) == {"running": True}
    with pytest.raises(InputError, match="a live one begins at 0 s"):
        LiveMission(short_scenario(), subject, Shot(start=10.0), 2.0)


def test_the_server_is_for_this_machine_and_knows_its_pages(server):
    assert read(server.address) == b"<p>here"
    above = f"http://127.0.0.1:{server.port}/"
    paths = ("", "rows?from=2", f"{'a' * 22}/")
    for unknown in (f"{server.address}rows?from=2", *(above + path for path in paths)):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            read(unknown)
    with pytest.raises(urllib.error.HTTPError, match="403"):
        read(urllib.request.Request(server.address, headers={"Host": "elsewhere.example:80"}))
    with pytest.raises(InputError, match=rf"--port {server.port}: .*give another one"):
        PageServer(server.port)
    with pytest.raises(InputError, match="0 to 65535"):
        PageServer(70000)


def test_without_a_port_the_next_free_one_is_taken(monkeypatch, store, capsys):
    with PageServer(0) as first:
        for place in ("twin.show.web.server.PORT", "twin.show.web.PORT"):
            monkeypatch.setattr(place, first.port)
        with PageServer() as second:
            assert first.port < second.port < first.port + 100
        code, out, err = call(capsys, "view", store, "--web", "--seconds", "0.1")
        assert code == 0
        told = re.search(rf"port {first.port} is taken: this page is served at (\d+)\n", err)
        assert told is not None
        assert f"open http://127.0.0.1:{told[1]}/" in out
        monkeypatch.setattr("twin.show.web.server.PORTS", 1)
        with pytest.raises(InputError, match="are taken: --port 0 takes any free one"):
            PageServer()


def test_view_without_a_window_serves_a_stored_mission(store, capsys):
    code, out, err = call(capsys, "view", store, "--web", "--port", "0", "--seconds", "0.2")
    assert code == 0
    assert re.search(r"open http://127\.0\.0\.1:\d+/[\w-]{22}/ in a browser", out)
    assert "is taken" not in err
    assert "ssh -L" in err
    assert "--port is of --web" in refused(capsys, "view", "--port", "0")
