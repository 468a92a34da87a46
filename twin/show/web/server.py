"""Server: a page for browsers of this machine, with the samples of a mission that is flown now."""

from __future__ import annotations

import errno
import json
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Self
from urllib.parse import parse_qs, urlsplit

from twin.errors import InputError
from twin.show.web.live_source import LiveMission

HOST = "127.0.0.1"
"""This machine only: whoever reaches the port reads the mission"""
NAMES = (HOST, "localhost")
PORT = 8080
"""That is taken when none is asked for, or the next free one"""
PORTS = 100
"""So many are tried then"""


class PageServer:
    """Has its port from the beginning, and serves a page from `show` until the context ends."""

    def __init__(self, port: int | None = None):
        """
        Args:
          port: 0 takes any free one; None the first free one from `PORT` on.

        Raises:
          InputError: the port is taken, or not allowed.
        """
        if port is not None and not 0 <= port <= 65535:
            raise InputError(f"--port {port} must be 0 to 65535; 0 takes any free one")
        self._server = _first_free() if port is None else _bound(port)
        self._thread: threading.Thread | None = None

    def show(self, text: str, live: LiveMission | None = None) -> None:
        """Serve a page from now on.

        Args:
          text: HTML of the page.
          live: what answers the page's questions for more samples.
        """
        self._server.RequestHandlerClass = _handler(text.encode(), live)
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """That it serves at."""
        return int(self._server.server_address[1])

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://{HOST}:{self.port}/"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._thread is not None:
            self._server.shutdown()
            self._thread.join()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    """A browser that goes away in the middle of an answer is no error."""

    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


def _bound(port: int) -> _Server:
    try:
        return _Server((HOST, port), BaseHTTPRequestHandler)
    except OSError as error:
        raise InputError(
            f"--port {port}: {error.strerror or error}; give another one, or 0 for any free one"
        ) from error


def _first_free() -> _Server:
    for port in range(PORT, PORT + PORTS):
        try:
            return _Server((HOST, port), BaseHTTPRequestHandler)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
    raise InputError(
        f"the ports {PORT} to {PORT + PORTS - 1} are taken: --port 0 takes any free one"
    )


def _handler(page: bytes, live: LiveMission | None) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            # A name that another site's address was bent to is not ours.
            host = (self.headers.get("Host") or "").rpartition(":")[0]
            address = urlsplit(self.path)
            if host not in NAMES:
                self.send_error(403)
            elif address.path == "/":
                self._answer(page, "text/html; charset=utf-8")
            elif address.path == "/favicon.ico":
                self.send_response(204)
                self.end_headers()
            elif address.path == "/rows" and live is not None:
                first = parse_qs(address.query).get("from", [""])[0]
                if not first.isdecimal():
                    self.send_error(400, "from must be the number of a sample")
                    return
                self._answer(json.dumps(live.rows(int(first))).encode(), "application/json")
            else:
                self.send_error(404)

        def _answer(self, body: bytes, kind: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing: the command's own lines are what people read."""

    return Handler
