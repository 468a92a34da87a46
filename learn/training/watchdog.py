"""Watchdog: a worker process ends with the process that started it, however that one ends."""

from __future__ import annotations

import os
import signal
import threading
import time

CHECK_S = 1.0
"""[s] between looks whether the parent lives."""


def end_with(parent: int) -> None:
    """In a process that `parent` started: end within about CHECK_S after it, even after a kill.

    An interrupt at the keyboard reaches all processes at once: it is the parent's to answer.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(CHECK_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
