"""The server of the page: who may read, what a question changes, how many may wait."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

import pytest
from pictures import short_scenario, short_subject, write_short_store

from twin.show.render.subject import Shot
from twin.show.web.server import STRANGERS, LiveMission, PageServer


def test_only_a_post_flies_the_mission_on():
    mission = LiveMission(short_scenario(), short_subject(), Shot(), 2.0)
    with PageServer(0) as server:
        server.show("<p>here", mission)
        rows = server.address + "rows?from=2"
        with pytest.raises(urllib.error.HTTPError, match="405"):
            urllib.request.urlopen(rows)
        assert mission._begun is None
        with urllib.request.urlopen(rows, data=b"") as answer:
            assert json.load(answer) == {"running": True}
        assert mission._begun is not None
        with pytest.raises(urllib.error.HTTPError, match="400"):
            urllib.request.urlopen(server.address + "rows?from=x", data=b"")


def test_strangers_that_wait_are_few_and_keep_nobody_out():
    before = threading.active_count()
    with PageServer(0) as server, contextlib.ExitStack() as strangers:
        server.show("<p>here")
        for _ in range(200):
            half = strangers.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            half.sendall(b"GET /")
        with urllib.request.urlopen(server.address) as answer:
            assert answer.read() == b"<p>here"
        for _ in range(100):
            if threading.active_count() - before <= STRANGERS + 1:
                break
            time.sleep(0.05)
        assert threading.active_count() - before <= STRANGERS + 1


def test_a_silent_connection_ends(monkeypatch):
    monkeypatch.setattr("twin.show.web.server.SILENCE", 0.2)
    with PageServer(0) as server:
        server.show("<p>here")
        with socket.create_connection(("127.0.0.1", server.port), timeout=30.0) as half:
            half.sendall(b"GET / HTTP/1.1")
            assert half.recv(1) == b""


def test_sigterm_ends_a_served_page_with_its_own_code(tmp_path):
    store = write_short_store(tmp_path / "short.zarr")
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
def test_an_address_that_is_none_is_answered_without_a_word(place, method, capsys):
    with PageServer(0) as server:
        server.show("<p>here")
        with socket.create_connection(("127.0.0.1", server.port), timeout=30.0) as asked:
            host = f"Host: 127.0.0.1:{server.port}\r\n"
            asked.sendall(f"{method} {place} HTTP/1.0\r\n{host}\r\n".encode())
            answer = b"".join(iter(lambda: asked.recv(4096), b""))
        assert answer.startswith((b"HTTP/1.0 404", b"HTTP/1.0 400"))
        assert server.key.encode() not in answer
        with urllib.request.urlopen(server.address) as answer:
            assert answer.read() == b"<p>here"
    assert capsys.readouterr().err == ""
