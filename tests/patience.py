"""How long tests wait: a busy machine is slow, and only what hangs or works without end fails."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

HANG_S = 900.0
"""[s] of waiting for another process; a test that waits as long hangs"""


@contextmanager
def little_work(seconds: float) -> Iterator[None]:
    """What runs within, or a decorated test, takes less processor time [s] of this process.

    However busy the machine is: time of others does not count.

    Raises:
      AssertionError: it took more.
    """
    begun = time.process_time()
    yield
    took = time.process_time() - begun
    assert took < seconds, f"{took:.1f} s of the processor, at most {seconds} s are allowed"
