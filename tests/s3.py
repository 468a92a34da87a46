"""A local S3 server: moto's, from an environment of its own (scripts/s3_server.sh)."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from patience import HANG_S

PYTHON = Path(__file__).resolve().parent.parent / ".venv-s3/bin/python"
PACKAGES = PYTHON.parent.parent / "lib/python{}.{}/site-packages".format(*sys.version_info)
"""Its own, boto3 among them"""
BUCKET = "bucket"


@contextmanager
def s3_server(*, signed: bool = False) -> Iterator[dict[str, str]]:
    """Start it with an empty bucket; what the environment must say to reach it.

    Args:
      signed: whether it refuses keys that it does not know, which are all.
    """
    pytest.importorskip("obstore", reason='needs pip install "glider-twin[cloud]"')
    if not PYTHON.exists():
        pytest.skip("needs a local S3 server: scripts/s3_server.sh")
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    server = subprocess.Popen(
        [PYTHON, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
        | ({"INITIAL_NO_AUTH_ACTION_COUNT": "1"} if signed else {}),  # the bucket
    )
    address = f"http://127.0.0.1:{port}"
    try:
        deadline = time.monotonic() + HANG_S
        while True:
            try:
                request = urllib.request.Request(f"{address}/{BUCKET}", method="PUT")
                urllib.request.urlopen(request, timeout=HANG_S).close()
                break
            except OSError:
                assert server.poll() is None, "the S3 server ended"
                assert time.monotonic() < deadline, "the S3 server does not answer"
                time.sleep(0.1)
        yield {
            "AWS_ENDPOINT_URL": address,
            "AWS_ALLOW_HTTP": "true",
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": "us-east-1",
        }
    finally:
        server.kill()
        server.wait()
