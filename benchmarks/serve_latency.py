"""How long `twin serve` takes to answer: a client on this machine, at a steady rate.

    python -m benchmarks.serve_latency [--vehicle remus] [--rate 100] [--seconds 600] [--json]

The client sends a packet every 1/rate s, as ArduPilot does in real time, and notes how long the
answer takes. The server is a process of its own. Printed are the answers' 50, 99 and 99.9 %
and the longest, and the same of the client's own lateness, which is the machine's.
"""

from __future__ import annotations

import argparse
import json
import socket
import struct
import subprocess
import sys
import time

import numpy as np

from benchmarks.figures import measured
from twin.cli.text_table import format_table

SHARES = (50.0, 99.0, 99.9)
LIMIT_MS = 5.0
"""99.9 % of the answers on a free core"""


def ask(port: int, rate: int, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """[ms] of each answer, and by how much each packet left late."""
    client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    client.settimeout(30.0)
    pulses = (1700, *(1500,) * 15)
    answers, late = np.zeros(frames), np.zeros(frames)
    begun = 0.0
    for k in range(-rate, frames):  # a second to get warm
        if k <= 0:
            begun = time.perf_counter()
        due = begun + max(k, 0) / rate
        time.sleep(max(0.0, due - time.perf_counter()))
        sent = time.perf_counter()
        client.sendto(struct.pack("<HHI16H", 18458, rate, k + rate, *pulses), ("127.0.0.1", port))
        client.recv(4096)
        if k >= 0:
            answers[k], late[k] = 1e3 * (time.perf_counter() - sent), 1e3 * (sent - due)
    client.close()
    return answers, late


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def main() -> int:
    """Print the table; 1 where the answers are too late."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicle", default="remus")
    parser.add_argument("--rate", type=int, default=100, help="[Hz]")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    port = free_port()
    words = [sys.executable, "-m", "twin", "serve", "--vehicle", options.vehicle]
    words += ["--port", str(port), "--silence", "60"]
    server = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    try:
        assert server.stderr is not None
        while "waits on" not in (line := server.stderr.readline()):
            if not line:
                raise SystemExit("the server did not begin")
        answers, late = ask(port, options.rate, round(options.seconds * options.rate))
    finally:
        server.terminate()
        server.wait()
    rows = [
        {"of": name, **{f"{share:g} %": np.percentile(values, share) for share in SHARES},
         "longest": values.max()}
        for name, values in (("answer [ms]", answers), ("client late by [ms]", late))
    ]  # fmt: skip
    figures = {f"{share:g}": float(np.percentile(answers, share)) for share in SHARES}
    if options.json:
        print(json.dumps({"vehicle": options.vehicle, "frames": len(answers), "ms": figures}))
    else:
        print(f"{options.vehicle}, {len(answers)} frames at {options.rate} Hz")
        print(format_table(rows, digits=3))
    named = {f"p{share:g}".replace(".", "_"): figures[f"{share:g}"] for share in SHARES}
    measured("serve_latency", **named)
    kept = figures["99.9"] <= LIMIT_MS
    print(f"limit {LIMIT_MS:g} ms for 99.9 %: {'kept' if kept else 'missed'}", file=sys.stderr)
    return int(not kept)


if __name__ == "__main__":
    sys.exit(main())
