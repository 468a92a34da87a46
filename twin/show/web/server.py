"""Server of a page for browsers on this machine, with the samples of a live mission.

Every user of the machine can reach the port. So the address contains a key, which only the command
prints. A connection without the key is a stranger; strangers are limited in number and time.
"""

from __future__ import annotations

import contextlib
import errno
import hmac
import json
import secrets
import socket
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, SimulationUnstable
from twin.physics.mujoco_model import quiet_mujoco
from twin.physics.scenario import Scenario
from twin.records.trajectory import Trajectory
from twin.show.render import playback
from twin.show.render.subject import Shot, Subject, live_simulation
from twin.show.web.channels import read_channels
from twin.show.web.page import describe, pack_channels, scale_share

HOST = "127.0.0.1"  # this machine only
NAMES = (HOST, "localhost")
PORT, PORTS = 8080, 100
"""PORT: first port that is tried by default. PORTS: number of ports that are tried"""
STRANGERS = 16
"""Maximum number of waiting connections that have not shown the key; one more ends the oldest."""
SILENCE = 10.0  # [s] time without a byte in either direction after which a connection ends
FIRST = 2  # number of samples with which the page begins
LONGEST, SLICE = 0.5, 200
"""LONGEST: [s] longest computing time of one answer, however fast the page plays the mission.
SLICE: maximum number of steps between two readings of the clock"""


class PageServer(ThreadingHTTPServer):
    """Server that takes its port at once, and serves a page from `show` until the context ends."""

    daemon_threads = True
    request_queue_size = 128
    """Maximum number of pending connections; the system delays further ones by seconds."""

    def __init__(self, port: int | None = None):
        """
        Args:
          port: port number; 0 takes any free port, None the first free port from `PORT` on.

        Raises:
          InputError: the port is taken, or not allowed.
        """
        if port is not None and not 0 <= port <= 65535:
            raise InputError(f"--port {port} must be 0 to 65535; 0 takes any free one")
        for one in range(PORT, PORT + PORTS) if port is None else (port,):
            try:
                super().__init__((HOST, one), _Handler)
                break
            except OSError as error:
                if port is not None:
                    reason = f"--port {port}: {error.strerror or error}"
                    raise InputError(
                        f"{reason}; give another one, or 0 for any free one"
                    ) from error
                if error.errno != errno.EADDRINUSE:
                    raise
        else:
            last = PORT + PORTS - 1
            raise InputError(f"the ports {PORT} to {last} are taken: --port 0 takes any free one")
        self.key, self.page = secrets.token_urlsafe(16), b""
        self.live: LiveMission | None = None
        self._thread: threading.Thread | None = None
        self._strangers: dict[socket.socket, None] = {}
        self._turn = threading.Lock()

    def show(self, text: str, live: LiveMission | None = None) -> None:
        """Serve a page from now on; a second call replaces the page at the same address.

        Args:
          text: HTML of the page.
          live: mission that answers the page's requests for more samples.
        """
        self.page, self.live = text.encode(), live
        if self._thread is None:
            self._thread = threading.Thread(target=self.serve_forever, daemon=True)
            self._thread.start()

    @property
    def port(self) -> int:
        """Port of the server."""
        return int(self.server_address[1])

    @property
    def path(self) -> str:
        """Path of the page, with the key of this run."""
        return f"/{self.key}/"

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.port}{self.path}"

    def __exit__(self, *_: object) -> None:
        if self._thread is not None:
            self.shutdown()
            self._thread.join()
        self.server_close()

    def process_request(self, request: object, client_address: object) -> None:
        """Answer a connection in a thread of its own; it is a stranger until it shows the key."""
        assert isinstance(request, socket.socket)
        with self._turn:
            if len(self._strangers) >= STRANGERS:
                oldest = next(iter(self._strangers))
                del self._strangers[oldest]
                with contextlib.suppress(OSError):  # the connection may have ended already
                    oldest.shutdown(socket.SHUT_RDWR)
            self._strangers[request] = None
        super().process_request(request, client_address)

    def know(self, request: object) -> None:
        """Remove a connection from the strangers, when it has shown the key or has ended."""
        with self._turn:
            self._strangers.pop(request, None)  # type: ignore[call-overload]

    def shutdown_request(self, request: object) -> None:
        """End a connection and remove it from the strangers."""
        self.know(request)
        super().shutdown_request(request)  # type: ignore[arg-type]

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore connections that a browser closes during an answer; report other errors."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


class _Handler(BaseHTTPRequestHandler):
    server: PageServer

    def setup(self) -> None:
        super().setup()
        self.connection.settimeout(SILENCE)

    def do_GET(self) -> None:
        """Answer with the page; a GET request changes nothing."""
        what = self._asked()
        if what == "":
            self._answer(self.server.page, "text/html; charset=utf-8")
        elif what == "rows" and self.server.live is not None:
            self.send_error(405, "the mission goes on by POST")
        elif what is not None:
            self.send_error(404)

    def do_POST(self) -> None:
        """Fly the mission on to the present time and answer with the samples from `from` on."""
        what, live = self._asked(), self.server.live
        if what == "rows" and live is not None:
            first = parse_qs(urlsplit(self.path).query).get("from", [""])[0]
            if first.isdecimal() and len(first) < 16:
                self._answer(json.dumps(live.rows(int(first))).encode(), "application/json")
            else:
                self.send_error(400, "from must be the number of a sample")
        elif what is not None:
            self.send_error(404)

    def _asked(self) -> str | None:
        """Path after the key; None when the request has been answered already."""
        # Reject other host names, which another site may have pointed to this machine.
        host = (self.headers.get("Host") or "").rpartition(":")[0]
        try:
            path = urlsplit(self.path).path
        except ValueError:  # such as http://[::1
            path = ""
        shown, _, what = path.removeprefix("/").partition("/")
        if host not in NAMES:
            self.send_error(403)
        elif shown == "favicon.ico":  # browsers request this icon for every page
            self.send_response(204)
            self.end_headers()
        elif not hmac.compare_digest(shown.encode(), self.server.key.encode()):
            self.send_error(404, "take the whole address that the command printed")
        else:
            self.server.know(self.connection)
            return what
        return None

    def _answer(self, body: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Suppress the log of requests, which would disturb the command's own output."""


class LiveMission:
    """Closed-loop simulation that advances while a page requests its samples.

    The simulation begins with the first request, so that the page shows the mission from the start.
    """

    def __init__(self, scenario: Scenario, subject: Subject, shot: Shot, speed_up: float):
        """
        Args:
          subject: trajectory of an earlier flight of this mission, which sets the sea's size.
          speed_up: mission seconds per second.

        Raises:
          InputError: the scenario is navigated, or the shot shows only an interval.
        """
        self._simulation = live_simulation(scenario)
        if shot.start is not None or shot.end is not None:
            raise InputError("--start and --end are for a stored mission; a live one begins at 0 s")
        self._subject, self._shot, self._speed = subject, shot, speed_up
        trajectory = subject.trajectory
        time = trajectory.time
        whole = np.ones(len(time), bool)
        _, self._scale = playback.track_values(trajectory, shot.colour, whole, ())
        self.mission = describe(subject, shot, len(time))
        """Description of the mission for the page: the scene, the first samples and the end"""
        self._still = self.mission["profile"] is None
        self.mission["channels"] = self._channels(trajectory, 0, FIRST)
        deepest = float(trajectory["true_depth"].max())
        self.mission["live"] = {"end": float(time[-1]), "depth": deepest}
        self.mission["opening"] |= {"time": float(time[0]), "speed": speed_up}
        self.mission["notes"] = ["The mission is flown while this page shows it."]
        # end with the flight of `subject`, which may have aborted; 2 steps complete its last sample
        flown = float(time[-1]) / self._simulation.model.opt.timestep
        self._steps = min(self._simulation.steps, round(flown) + 2)
        self._begun: float | None = None
        self._turn = threading.Lock()
        self._problem = ""

    def rows(self, first: int) -> dict[str, Any]:
        """Samples flown so far, from number `first` on, and a flag that tells if more will come."""
        with self._turn:
            running = self._fly()
            # a running simulation completes its last sample one step after the sample's time
            count = len(self._simulation.rows) - running
            flown = self._simulation.trajectory() if count > max(first, 1) else None
        if self._problem:
            return {"running": False, "problem": self._problem}
        if flown is None:
            return {"running": running}
        return {"running": running, "channels": self._channels(flown, first, count)}

    def _fly(self) -> bool:
        """Step the simulation up to the clock's time; return True if the mission continues."""
        now = time.monotonic()
        if self._begun is None:
            self._begun = now
        simulation = self._simulation
        timestep = simulation.model.opt.timestep
        due = (now - self._begun) * self._speed
        try:
            with quiet_mujoco():
                while simulation.data.time < due and not self._over:
                    ahead = int((due - simulation.data.time) / timestep) + 1
                    left = self._steps - round(simulation.data.time / timestep)
                    simulation.step(max(1, min(ahead, SLICE, left)))
                    if time.monotonic() - now > LONGEST:
                        # computing is too slow: shift the clock, and fly as fast as possible
                        self._begun = time.monotonic() - simulation.data.time / self._speed
                        break
            if simulation.failed:
                simulation.trajectory()
        except SimulationUnstable as error:
            self._problem = str(error)
        return not self._over

    @property
    def _over(self) -> bool:
        simulation = self._simulation
        done = round(simulation.data.time / simulation.model.opt.timestep) >= self._steps
        return done or simulation.failed or bool(self._problem)

    def _channels(self, trajectory: Trajectory, first: int, count: int) -> dict[str, Any]:
        """Samples `first` to `count` of a trajectory, packed."""
        shown: NDArray[np.bool_] = np.zeros(len(trajectory.time), bool)
        shown[first:count] = True
        values, _ = playback.track_values(trajectory, self._shot.colour, shown, ())
        share = scale_share(values, self._scale)
        channels = read_channels(trajectory, shown, share, self._subject.floor, count)
        return pack_channels(channels, still=self._still)
