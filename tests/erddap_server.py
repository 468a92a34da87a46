"""An ERDDAP server of one data set, as far as its tabledap goes, on this machine."""

from __future__ import annotations

import csv
import datetime
import http.server
import io
import threading
import urllib.parse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Erddap(http.server.ThreadingHTTPServer):
    """Answers as a server's tabledap does, with the samples until a time."""

    until = np.inf
    """[s] unix: what has come later it does not have yet"""
    broken = False

    def __init__(self, name: str, columns: Sequence[str], rows: NDArray[Any]) -> None:
        """A table.

        Args:
          name: its datasetID.
          columns: header of a .csvp: names with units, (columns,). One has unit UTC and is called
            time; all of that unit are times.
          rows: (samples, columns): numbers, times as unix seconds, and text. NaN is missing.
        """
        super().__init__(("127.0.0.1", 0), Answer)
        self.name, self.columns, self.rows = name, list(columns), rows
        self.asked: list[str] = []
        """Days that tables were asked for"""

    @property
    def times(self) -> NDArray[Any]:
        return self.rows[:, self.columns.index("time (UTC)")].astype(float)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/erddap/tabledap/{self.name}"

    @contextmanager
    def serving(self) -> Iterator[Erddap]:
        with self:
            thread = threading.Thread(target=self.serve_forever, daemon=True)
            thread.start()
            yield self
            self.shutdown()
            thread.join()


class Answer(http.server.BaseHTTPRequestHandler):
    server: Erddap

    def log_message(self, *_: object) -> None:
        """Nothing on the terminal."""

    def do_GET(self) -> None:
        path, _, query = urllib.parse.unquote(self.path).partition("?")
        server = self.server
        known = server.times < server.until
        if server.broken:
            self.send_error(503, "down for repair")
        elif path == f"/erddap/info/{server.name}/index.csv":
            low, high = (float(edge) for edge in server.times[known][[0, -1]])
            self._send(
                "Row Type,Variable Name,Attribute Name,Data Type,Value\nvariable,time,,double,\n"
                f'attribute,time,actual_range,double,"{low!r}, {high!r}"\n'
            )
        elif path == f"/erddap/tabledap/{server.name}.csvp":
            begin, end = self._limits(query)
            server.asked.append(written_time(begin)[:10])
            rows = server.rows[known & (server.times >= begin) & (server.times < end)]
            if not len(rows):
                self.send_error(404, "Your query produced no matching results.")
                return
            written = io.StringIO()
            table = csv.writer(written, lineterminator="\n")
            table.writerow(server.columns)
            for row in rows:
                table.writerow(map(_cell, row, server.columns))
            self._send(written.getvalue())
        else:
            self.send_error(404, f"Currently unknown datasetID {path}")

    @staticmethod
    def _limits(query: str) -> tuple[float, float]:
        words = query.split("&")
        (low,) = (float(one[6:]) for one in words if one.startswith("time>="))
        (high,) = (float(one[5:]) for one in words if one.startswith("time<"))
        return low, high

    def _send(self, text: str) -> None:
        self.send_response(200)
        self.end_headers()
        self.wfile.write(text.encode())


def _cell(value: Any, column: str) -> str:
    if isinstance(value, str):
        return value
    if column.endswith(" (UTC)"):
        return "" if np.isnan(value) else written_time(float(value))
    return "NaN" if np.isnan(value) else str(value)


def written_time(time: float) -> str:
    """Unix seconds as a server writes them, with milliseconds."""
    moment = datetime.datetime.fromtimestamp(round(time, 3), datetime.UTC)
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"
