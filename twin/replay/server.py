"""Server: a page for browsers of this machine, with the samples of a mission that is flown now."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Self
from urllib.parse import parse_qs, urlsplit

from twin.errors import InputError
from twin.replay.live import LiveMission

HOST = "127.0.0.1"
"""This machine only: whoever reaches the port reads the mission"""
NAMES = (HOST, "localhost")


class PageServer:
    """Serves a page while the context lasts; `address` is what a browser opens."""

    def __init__(self, text: str, port: int, live: LiveMission | None = None):
        """
        Args:
          text: HTML of the page.
          port: 0 takes any free one.
          live: what answers the page's questions for more samples.

        Raises:
          InputError: the port is taken, or not allowed.
        """
        if not 0 <= port <= 65535:
            raise InputError(f"--port {port} must be 0 to 65535; 0 takes any free one")
        handler = _handler(text.encode(), live)
        try:
            self._server = ThreadingHTTPServer((HOST, port), handler)
        except OSError as error:
            raise InputError(
                f"--port {port}: {error.strerror or error}; give another one, or 0 for any free one"
            ) from error
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    @property
    def port(self) -> int:
        """That it serves at."""
        return int(self._server.server_address[1])

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://{HOST}:{self.port}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


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
