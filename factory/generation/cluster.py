"""Cluster: a dask cluster as an executor of the standard library's kind."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor

from twin.errors import InputError
from twin.extras import require

RETRIES = 5
"""Times that a block is flown again when the worker that flew it is lost"""
TIMEOUT_S = 30.0
"""[s] to reach the scheduler"""


@contextlib.contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """The workers of the scheduler at `address`, such as tcp://127.0.0.1:8786.

    Clusters of dask-jobqueue and dask-kubernetes have such an address too.

    Raises:
      InputError: dask.distributed is not installed, or nobody answers there.
    """
    require("distributed", extra="cluster", purpose="--scheduler")
    import distributed

    try:
        client = distributed.Client(address, timeout=TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"--scheduler {address}: no dask scheduler answers there "
            f"({' '.join(str(error).split())}); `dask scheduler` prints its address"
        ) from error
    with client:
        yield client.get_executor(retries=RETRIES, pure=False)
